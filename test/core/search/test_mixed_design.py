"""Design questions about mixed benches reject invalid input, and their answers hold for every sample of the run."""
from dataclasses import replace

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.bounding_box import bounding_box
from dragon_ros.core.search.certificate import NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.max_speed import max_speed
from dragon_ros.core.search.min_pitch import coming_in, min_pitch
from dragon_ros.core.tracks.spec import STurn
from dragon_ros.scenes.load import load_scene


def test_the_smallest_pitch_of_an_even_list_is_that_of_equal_benches():
    even = min_pitch(Mixed((Group(3.41), Group(2.2, 19))), largest_m=0.5, within_m=1e-3)
    assert even == min_pitch(Dragon(20), largest_m=0.5, within_m=1e-3)


ALMOST_EQUAL = Mixed((Group(3.41), Group(2.2, 28), Group(2.2001)))
UNEVEN = Mixed((Group(3.41), *map(Group, np.random.default_rng(1).uniform(2.1, 2.3, 40).tolist())))
CLOSE = Mixed((Group(2.2), Group(2.2, 28), Group(2.2001)))
LONG_AND_SHORT = Mixed((Group(3.41), *map(Group, np.random.default_rng(1).uniform(1.2, 2.6, 40).tolist())))


@pytest.mark.parametrize(('dragon', 'diameter_m', 'turns'), thinned(
    [(ALMOST_EQUAL, 4.0, 5.0), (UNEVEN, 8.0, 10.0), (CLOSE, 4.0, 5.0), (LONG_AND_SHORT, 6.0, 8.0)],
    lambda case: case[0] is UNEVEN))
def test_the_smallest_pitch_of_a_mixed_dragon_is_between_a_contact_and_pitches_without_one(dragon, diameter_m, turns):
    seen = []
    found = min_pitch(dragon, diameter_m, turns, 0.9, 1e-4, seen.append, 0.42)
    assert found.states == sum(seen) > 0
    assert 0 < found.high_m - found.low_m <= 1e-4
    touch = first_contact(coming_in(dragon, found.low_m, turns, diameter_m))
    assert touch.benches == found.benches
    for above_m in (found.high_m, *found.clear_m[::20]):
        assert isinstance(first_contact(coming_in(dragon, above_m, turns, diameter_m)), NoContact)


@pytest.mark.long       # by default, the test above compares an even list with equal benches
def test_the_smallest_pitch_of_an_almost_equal_dragon_is_almost_that_of_equal_benches():
    found, equal = min_pitch(ALMOST_EQUAL, 4.0, 5.0, 0.9, 1e-4, smallest_m=0.45), min_pitch(Dragon(30), 4.0, 5.0, 0.9)
    assert found.low_m - 1e-6 <= equal.high_m <= found.high_m + 1e-6


@pytest.mark.parametrize(('dragon', 'diameter_m', 'largest_m'), [
    (Mixed((Group(1.2), Group(2.2, 18), Group(2.2001))), 4.0, 0.9),     # the head touches only at smaller pitches
    pytest.param(Mixed((Group(3.41), Group(2.2, 40), Group(8.2))), 9.0, 4.0,    # a link almost as long as the circle
                 marks=pytest.mark.long)])
def test_the_pitch_of_a_mixed_dragon_is_bisected_if_the_contacts_of_its_head_do_not_decide(dragon, diameter_m,
                                                                                           largest_m):
    found = min_pitch(dragon, diameter_m, 8.0, largest_m, 0.05, smallest_m=0.35 if diameter_m < 9 else 1.2)
    assert found.benches[0] > 0
    assert 0 < found.high_m - found.low_m <= 0.05
    assert first_contact(coming_in(dragon, found.low_m, 8.0, diameter_m)).benches == found.benches
    assert isinstance(first_contact(coming_in(dragon, found.high_m, 8.0, diameter_m)), NoContact)


def test_of_a_bracket_whose_upper_end_has_a_contact_the_end_is_refused():
    for largest_m, within_m in ((0.46, 0.001), (0.56, 0.2)):
        with pytest.raises(FieldError, match=f'largest_m: {largest_m} .* benches touch'):
            min_pitch(ALMOST_EQUAL, 4.0, 5.0, largest_m, within_m, smallest_m=0.45)


@pytest.mark.parametrize(('smallest_m', 'says'), [
    (0.89, r'smallest_m: 0.89 .* no benches touch'), (1.5, r'largest_m: 0.9 ')])
def test_a_bracket_of_mixed_benches_that_holds_no_pitch_is_refused(smallest_m, says):
    with pytest.raises(FieldError, match=says):
        min_pitch(ALMOST_EQUAL, 4.0, 5.0, 0.9, 0.01, smallest_m=smallest_m)


def test_the_room_of_a_mixed_dragon_holds_every_corner_of_its_run():
    scene = replace(load_scene('mixed'), run=Run(390, 393))
    times = np.linspace(390, 393, 200).tolist()
    chain = states(scene, times)
    reached = 2 * np.max(np.abs(benches_of(chain, scene.dragon, axes_of(chain)).corners))
    low, high = bounding_box(scene).centred_m
    assert reached <= high < low + 1e-9
    assert low < reached + 1e-3


@pytest.mark.parametrize('lead', ['head', 'tail'])
def test_no_handle_of_a_mixed_dragon_is_faster_than_the_fastest(lead):
    dragon = Mixed((Group(0.9, 5), Group(2.2, 3), Group(1.3, 4), Group(3.0), Group(2.2, 3)))
    scene = Scene(dragon=dragon, track=STurn(before_m=5.0 if lead == 'head' else -15.0), head=Head(1.0, lead),
                  run=Run(0, 30))
    v = states(scene, np.linspace(0, 30, 3000).tolist()).velocities(np.ones(3000))
    seen = np.max(np.hypot(v[..., 0], v[..., 1]))
    assert seen <= max_speed(scene).bound < seen + 1e-4
