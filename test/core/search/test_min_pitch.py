"""The smallest pitch is correct and bracketed, and agrees with ``first_contact`` on both sides."""
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.broad_phase import candidates
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.min_pitch import min_pitch
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import SpiralCurve

REFERENCE = json.loads((Path(__file__).parents[2] / 'data' / 'min_pitch.json').read_text())


def scene_to(radius_m, pitch_m, dragon):
    track = Spiral(pitch_m)
    return Scene(dragon=dragon, track=track, run=Run(stop_s=SpiralCurve.of(track).distance_to(radius_m / track.b_m)))


def test_the_smallest_pitch_of_the_contest_is_bracketed_to_its_last_digits():
    found = min_pitch()
    assert found.low_m <= float(REFERENCE['pitch_m']) <= found.high_m
    assert found.high_m - found.low_m <= 3e-11
    assert list(found.benches) == REFERENCE['benches']
    assert found.radius_m == pytest.approx(float(REFERENCE['radius_m']), abs=1e-5)


@pytest.mark.parametrize(('dragon', 'radius_m'), thinned([
    (Dragon(), 4.5), (Dragon(benches=60), 3.0), (Dragon(benches=24, width_m=0.4, head_length_m=3.0), 5.0)],
    lambda case: case[1] > 4.5))
def test_just_below_there_is_a_contact_on_the_way_and_just_above_there_is_none(dragon, radius_m):
    found = min_pitch(dragon, 2 * radius_m, largest_m=0.7, within_m=1e-9)
    below = first_contact(scene_to(radius_m, found.low_m - 1e-9, dragon))
    assert isinstance(below, Contact)
    assert below.benches == found.benches
    for above in (1e-9, 1e-4, 0.003, 0.02, 0.1):
        assert isinstance(first_contact(scene_to(radius_m, found.high_m + above, dragon)), NoContact)


def test_looking_only_at_the_circle_would_miss_contacts_on_the_way():
    at_circle = scene_to(4.5, 0.4203, Dragon())
    there = state(at_circle, compile_scene(at_circle).end.t_s)
    benches = benches_of(there, at_circle.dragon, axes_of(there))
    assert np.min(gaps(benches, *candidates(there.p, benches))) > 0
    assert isinstance(first_contact(at_circle), Contact)


def test_progress_counts_every_state():
    seen = []
    assert min_pitch(Dragon(benches=40), largest_m=0.5, within_m=1e-6, progress=seen.append).states == sum(seen)


@pytest.mark.parametrize(('options', 'says'), [
    ({'start_turns': 8.0}, '0.5625'), ({'largest_m': 0.2}, 'largest_m'), ({'diameter_m': 3.0}, 'diameter_m'),
    ({'dragon': Dragon(benches=2)}, 'at least 3'), ({'within_m': 1e-15}, 'within_m'),
    ({'diameter_m': -1}, 'diameter_m'),
])
def test_what_has_no_answer_is_refused(options, says):
    with pytest.raises(FieldError, match=says):
        min_pitch(**options)


def test_where_benches_touch_at_the_largest_pitch_no_smallest_one_is_claimed():
    with pytest.raises(FieldError, match=r'largest_m: 0.44 .* benches touch .* give a larger pitch'):
        min_pitch(Dragon(benches=40), largest_m=0.44)


def test_a_body_that_touches_first_counts_too():
    found = min_pitch(Dragon(20, head_length_m=1.0), largest_m=0.6, within_m=1e-3)
    assert found.benches[0] > 0
    assert 0 < found.high_m - found.low_m <= 1e-3


@pytest.mark.parametrize(('body_length_m', 'width_m'), thinned([(1.7, 0.2), (1.8, 0.2)], lambda case: case[0] == 1.8))
def test_the_bracket_of_slim_benches_is_a_few_errors_of_a_gap_wide(body_length_m, width_m):
    found = min_pitch(Dragon(40, body_length_m=body_length_m, width_m=width_m), largest_m=0.8)
    assert 0 < found.high_m - found.low_m < 4e-10       # the gap grows by a tenth of the pitch, or less


def test_the_runs_above_are_stated_and_each_has_no_contact():
    found = min_pitch(Dragon(40), largest_m=0.5, within_m=1e-3)
    assert found.clear_m[-1] == 0.5
    assert all(1 < two / one <= 1.0100001 for one, two in pairwise((found.low_m, *found.clear_m)))
    for pitch_m in (found.high_m, *found.clear_m[::4]):
        assert isinstance(first_contact(scene_to(4.5, pitch_m, Dragon(40))), NoContact)
