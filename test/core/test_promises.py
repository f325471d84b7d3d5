"""Promises hold for random short chains, through state, states and tick, with and without a table.

Each scene is compared with forward placement, which test_accuracy compares with 50 digits. The long
form of this test is ``./dragon cost promises --chains 100000``.
"""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples

from benchmarks import promises
from benchmarks.promises import measure, shares, table
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn


@pytest.mark.parametrize('number', [205, 8507])
def test_a_head_with_a_short_link_leaves_all_speeds_as_exact_as_the_others_do(number):
    scene, times_s = promises.random_scene(number)
    assert scene.dragon.link_lengths_m[0] < 0.2 * scene.dragon.link_lengths_m[1]
    assert np.max(shares(scene, times_s)) < 0.3     # 0.75 if series were truncated for the link of the head


lengths = st.floats(0.05, 6)
even = st.builds(lambda benches, head, body: Dragon(benches, head, body, 0.05, 0.0), st.integers(2, 60), lengths,
                 lengths)
groups = st.lists(st.builds(Group, lengths, st.integers(1, 20)), min_size=1, max_size=3)
mixed = st.builds(lambda groups: Mixed(tuple(groups), 0.05, 0.0), groups)
shapes = st.lists(st.builds(Line, st.floats(0.1, 9)) | st.builds(
    lambda radius, angle, left: Arc(radius, angle if left else -angle), st.floats(3.1, 9), st.floats(5, 200),
    st.booleans()) | st.builds(SpiralArc, st.floats(2.5, 4), st.floats(3, 4), st.floats(1.5, 2.9),
                               st.sampled_from(['left', 'right'])), min_size=1, max_size=5)
tracks = st.one_of(
    st.builds(Spiral, st.floats(0.1, 10), st.floats(1, 40)),
    st.builds(STurn, st.floats(1, 3), st.floats(20, 30), st.floats(0.5, 2), st.floats(-30, 30)),
    shapes.map(lambda pieces: Composite(tuple(pieces))))


@examples(50)
@given(even | mixed, tracks, st.sampled_from(['head', 'tail']),
       st.one_of(st.just(0.0), st.floats(0, 1), st.floats(0, 8).map(lambda digits: 1 - 10**-digits)),
       st.sampled_from(['table', 'march']))
def test_random_chains_keep_their_promise_through_state_states_and_tick(dragon, track, lead, part, solver):
    try:
        scene = Scene(dragon, track, Head(1.0, lead), Run(0, 1e3), solver=solver)
        t_s = round(part * min(100.0, compile_scene(scene).end.t_s), 9)     # ticks are at whole nanoseconds
    except DragonError:
        assume(False)
    if t_s > compile_scene(scene).end.t_s:
        t_s = 0.0
    assert np.max(shares(scene, [0.0, t_s])) <= 1


def test_an_interrupted_long_run_tells_of_the_chains_that_are_done(monkeypatch):
    measured = iter([promises._measured(0), promises._measured(1)])

    def interrupted(number):
        try:
            return next(measured)
        except StopIteration:
            raise KeyboardInterrupt from None
    monkeypatch.setattr(promises, '_measured', interrupted)
    found = measure(1e9)
    assert len(found.shares) == 10
    assert '10 random chains' in table(found)
