"""A search in any valid scene, however extreme, ends with an answer or a one-line error and computes few states."""
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import DragonError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.tracks.spec import Spiral

MOST_STATES = 20_000


def decades(low, high):
    return st.floats(low, high).map(lambda power: 10.0**power)


@pytest.mark.parametrize('pitch_m', [10.0, 100.0])
def test_a_spiral_far_wider_than_the_dragon_is_long_takes_few_states(pitch_m):
    found = first_contact(Scene(track=Spiral(pitch_m)))
    assert not found
    assert found.certificate.complete
    assert found.states < 400


@examples(30)
@given(decades(-2, 2), decades(-6, 2), st.floats(1, 30), decades(-1, 1), st.integers(1, 40))
def test_an_extreme_scene_gets_an_answer_or_one_line_after_few_states(pitch_m, speed_m_s, turns, times, benches):
    states = []
    with suppress(DragonError):
        dragon = Dragon(benches, 3.41 * times, 2.2 * times, 0.3 * times, 0.275 * times)
        scene = Scene(dragon=dragon, track=Spiral(pitch_m, turns), head=Head(speed_m_s), run=Run())
        first_contact(scene, states.append)
    assert sum(states) <= MOST_STATES
