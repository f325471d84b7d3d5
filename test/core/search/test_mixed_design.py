"""Design questions about mixed benches reject invalid input, and their answers hold for every sample of the run."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.bounding_box import bounding_box
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.max_speed import max_speed
from dragon_ros.core.search.min_pitch import coming_in, min_pitch
from dragon_ros.core.tracks.spec import STurn
from dragon_ros.scenes.load import load_scene


def test_the_smallest_pitch_of_an_even_list_is_that_of_equal_benches():
    even = min_pitch(Mixed((Group(3.41), Group(2.2, 39))), largest_m=0.5, within_m=1e-6)
    assert even == min_pitch(Dragon(40), largest_m=0.5, within_m=1e-6)


def test_the_smallest_pitch_of_a_mixed_dragon_is_halved_between_a_contact_and_none():
    dragon = Mixed((Group(3.41), Group(2.2, 28), Group(2.2001)))
    seen = []
    found = min_pitch(dragon, 4.0, 5.0, 0.9, 0.01, seen.append, 0.45)
    assert not found.proved
    assert found.states == sum(seen) > 0
    assert 0 < found.high_m - found.low_m <= 0.01
    touch = first_contact(coming_in(dragon, found.low_m, 5.0, 4.0))
    assert touch.benches == found.benches
    assert not hasattr(first_contact(coming_in(dragon, found.high_m, 5.0, 4.0)), 'benches')
    equal = min_pitch(Dragon(30), 4.0, 5.0, 0.9, 1e-4)
    assert found.low_m <= equal.high_m <= found.high_m + 1e-3


@pytest.mark.parametrize(('smallest_m', 'says'), [
    (None, r'smallest_m: None .* mixed benches is bisected .* give a pitch at which benches touch'),
    (0.89, r'smallest_m: 0.89 .* no benches touch'), (1.5, r'largest_m: 0.9 ')])
def test_a_bracket_of_mixed_benches_that_holds_no_pitch_is_refused(smallest_m, says):
    with pytest.raises(FieldError, match=says):
        min_pitch(Mixed((Group(3.41), Group(2.2, 28), Group(2.2001))), 4.0, 5.0, 0.9, 0.01, smallest_m=smallest_m)


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
