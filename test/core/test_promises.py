"""Promises hold for random chains of the whole world, through state, states and tick, with and without a table.

The long form of these tests is ``./dragon cost promises --chains 100000``, which compares chains with 40 digits, too.
"""
import numpy as np
import pytest
from properties import thinned

from benchmarks import promises
from benchmarks.promises import measure, random_scene, shares, table


@pytest.mark.parametrize('first', thinned(range(0, 1000, 20), lambda first: first == 0))
def test_random_chains_of_the_world_keep_their_promise_through_state_states_and_tick(first):
    found = [promises._measured(number) for number in range(first, first + 20)]
    worst = max((float(np.max(one.shares)), int(one.scenes[0])) for one in found if one.shares.size)
    assert sum(len(one.shares) for one in found) > 60
    assert worst <= (1, first + 20)


@pytest.mark.parametrize('number', [191, 312])
def test_speeds_near_the_lock_of_a_tightly_wound_spiral_keep_their_promise(number):
    """Once a link is almost a diameter, its rear handle slows down and turns back within less than a pitch."""
    scene, times_s = random_scene(number)
    assert scene.track.pitch_m < 0.04 * float(np.mean(scene.dragon.link_lengths_m))
    assert np.max(shares(scene, times_s)) < 0.5


def test_an_interrupted_long_run_tells_of_the_chains_that_are_done(monkeypatch):
    parts = [promises._measured(number) for number in (191, 312)]
    measured = iter(parts)

    def interrupted(number):
        try:
            return next(measured)
        except StopIteration:
            raise KeyboardInterrupt from None
    monkeypatch.setattr(promises, '_measured', interrupted)
    found = measure(1e9)
    assert len(found.shares) == 10
    assert '10 random chains' in table(found)
