
import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import ChainLockError, CrowdError
from dragon_ros.core.geometry.broad_phase import box_pairs, candidates
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps, witness
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral

A, B = np.array([0]), np.array([1])


def rectangles(*rows):
    """Return benches from rows of x, y, yaw, length and width."""
    x, y, yaw, length, width = np.array(rows, dtype=float).T
    return Benches(np.stack((x, y), 1), np.stack((np.cos(yaw), np.sin(yaw)), 1), length / 2, width / 2)


@pytest.mark.parametrize(('other', 'expected'), [
    ((3, 0, 0, 2, 1), 1.0),                         # side by side
    ((2, 0, 0, 2, 1), 0.0),                         # touching
    ((1.5, 0, 0, 2, 1), -0.5),                      # overlapping ends
    ((0, 0, np.pi / 2, 2, 1), -1.5),                # the rectangles cross, and no corner is inside the other one
    ((0, 0, 0, 0.2, 0.1), -0.55),                   # nested
    ((5, 4, 0, 2, 1), np.hypot(3, 3)),              # corner to corner
    ((0, 1.5, np.pi / 4, 1, 1), 1.0 - np.sqrt(0.5)),    # corner to edge
])
def test_gap_of_known_rectangles(other, expected):
    both = rectangles((0, 0, 0, 2, 1), other)
    assert gaps(both, A, B)[0] == pytest.approx(expected, abs=1e-15)
    assert gaps(both, B, A)[0] == pytest.approx(expected, abs=1e-15)


sizes = st.floats(0.05, 4)
bench = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-4, 4), sizes, sizes)


@given(bench, bench)
@example((0, 0, 0, 2, 1), (0, 1.0000001, 1e-9, 2, 1))
@example((0, 0, 0.3, 4, 0.05), (0.1, 0, 0.3, 4, 0.05))
def test_gap_agrees_with_shapely(one, two):
    both = rectangles(one, two)
    gap = gaps(both, A, B)[0]
    first, second = (shapely.Polygon(corners) for corners in both.corners)
    if gap > 1e-12:
        assert first.distance(second) == pytest.approx(gap, rel=1e-12, abs=1e-13)
    elif gap < -1e-12:
        assert first.intersects(second)
        assert first.distance(second) == 0


@given(bench, bench)
def test_a_translation_by_the_depth_parts_overlapping_rectangles(one, two):
    both = rectangles(one, two)
    gap = gaps(both, A, B)[0]
    if gap > -1e-9:
        return
    directions = [(u, sign) for u in (both.axis[0], both.axis[1], both.axis[0][::-1] * [-1, 1],
                                      both.axis[1][::-1] * [-1, 1]) for sign in (1, -1)]
    moved = []
    for u, sign in directions:
        shift = np.array([[0, 0], sign * -gap * (1 + 1e-9) * u])
        moved.append(gaps(Benches(both.centre + shift, both.axis, both.half_length, both.half_width), A, B)[0])
    assert max(moved) >= -1e-12


def test_witness_is_the_touching_corner():
    both = rectangles((0, 0, 0, 2, 1), (0.3, 0.5 + np.sqrt(0.5), np.pi / 4, 1, 1))
    assert witness(both, 0, 1).point_m == pytest.approx((0.3, 0.5), abs=1e-15)


def all_pairs(scene, t_s):
    chain = state(scene, t_s)
    benches = benches_of(chain, scene.dragon, axes_of(chain))
    return chain, benches, np.triu_indices(scene.dragon.benches, 2)


@pytest.mark.parametrize('t_s', [0.0, 100.0, 300.0, 409.831989, 412.48, 425.0])
def test_candidates_miss_no_pair_of_the_classic_dragon(t_s):
    chain, benches, every = all_pairs(Scene(), t_s)
    gap = gaps(benches, *every)
    found = set(zip(*candidates(chain.p, benches), strict=True))
    near = {(i, j) for i, j, g in zip(*every, gap, strict=True) if g < 0.05}
    assert near <= found
    assert len(found) < 8 * 223


@given(st.floats(0.3, 2), st.floats(3, 20), st.floats(0.05, 0.4), st.floats(1, 4), st.floats(0.7, 3))
def test_the_adjacent_layer_finds_the_closest_pair_that_all_pairs_find(pitch, turns, width, head, body):
    scene = Scene(dragon=Dragon(60, head, body, min(width, 0.6 * pitch)), track=Spiral(pitch, turns), solver='march')
    try:
        chain, benches, every = all_pairs(scene, 0.0)
    except ChainLockError:   # the chain is locked at this time, which another property covers
        return
    gap = gaps(benches, *every)
    if np.min(gap) < 0.1 * pitch:
        found = gaps(benches, *candidates(chain.p, benches))
        assert np.min(found) <= max(np.min(gap), 0.0) + 1e-12


def test_first_contact_of_the_classic_dragon():
    found = first_contact(Scene())
    assert isinstance(found, Contact)
    assert found.t_s == pytest.approx(412.473837682115, abs=1e-9)
    assert found.benches == (0, 8)
    assert found.point_m == pytest.approx((1.474394671648, 2.110664876932), abs=1e-9)


def test_the_near_misses_before_it_are_not_taken_for_contact():
    for t_s, bench, gap in ((409.831989, 11, 0.865235e-3), (406.845, 9, 2.96e-3)):
        _, benches, _ = all_pairs(Scene(), t_s)
        assert gaps(benches, A, np.array([bench]))[0] == pytest.approx(gap, abs=5e-6)
    before = first_contact(Scene(run=Run(409.0, 412.4738)))
    assert isinstance(before, NoContact)
    assert before.end.reason == 'stop'


def test_speed_scales_the_time_of_contact_alone():
    found = first_contact(Scene(head=Head(4.0)))
    assert found.t_s == pytest.approx(412.473837682115 / 4, rel=1e-12)
    assert found.benches == (0, 8)


def test_a_run_that_starts_in_contact_reports_its_start():
    found = first_contact(Scene(run=Run(413.0)))
    assert (found.t_s, found.benches) == (413.0, (0, 8))


def test_a_pitch_too_small_for_the_benches_is_a_contact_at_the_start():
    found = first_contact(Scene(track=Spiral(0.2)))
    assert isinstance(found, Contact)
    assert found.t_s == 0.0


def test_one_bench_cannot_touch_and_ends_in_the_lock():
    found = first_contact(Scene(dragon=Dragon(1)))
    assert isinstance(found, NoContact)
    assert found.end.reason == 'lock'


def test_a_dragon_on_a_wide_track_ends_without_contact():
    found = first_contact(Scene(track=Spiral(1.7), run=Run(0, 300)))
    assert isinstance(found, NoContact)
    assert found.end.reason == 'stop'


def test_a_body_pair_that_touches_first_is_found():
    scene = Scene(dragon=Dragon(60, 0.9, 2.2), run=Run(0, 432))
    found = first_contact(scene)
    assert isinstance(found, Contact)
    before = all_pairs(scene, found.t_s - 1e-6)
    assert np.min(gaps(before[1], *before[2])) > 0
    after = all_pairs(scene, found.t_s + 1e-9)
    assert np.min(gaps(after[1], *after[2])) <= 0


def test_winding_out_is_searched_too():
    found = first_contact(Scene(track=Spiral(0.55, 5.0), head=Head(-1.0), run=Run(0, 60)))
    assert isinstance(found, NoContact)


def test_a_crowd_is_refused_before_it_fills_the_memory():
    crowd = rectangles(*[(0, 0, 0, 1, 1)] * 3000)
    with pytest.raises(CrowdError, match='3000 benches'):
        box_pairs(crowd)


@pytest.mark.parametrize('unit', [0.1, 10.0])
def test_a_dragon_of_any_size_is_searched_as_the_classic_one(unit):
    one, other = (first_contact(Scene(Dragon(20, 3.41 * size, 2.2 * size, 0.3 * size, 0.275 * size),
                                      Spiral(0.55 * size, 8.0), Head(size), Run(0, 200))) for size in (1.0, unit))
    assert one.t_s == pytest.approx(other.t_s, rel=1e-6)
    assert one.benches == other.benches
    assert other.states < 3 * one.states
