"""Stored near pairs affect only the time that an evaluation takes: results equal those of a search of all pairs."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.flags import Effect
from dragon_ros.core.geometry import near_pairs
from dragon_ros.core.geometry.near_pairs import TOUCH_M, NearPairs, closeness
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.spec import Spiral, STurn
from hard_cases.cases import MIXED


def of_all_pairs(benches):
    """Compute the clearance, the closest pair, and the touching pairs with their gaps independently, from all pairs."""
    i, j = np.triu_indices(benches.half_length.size, 2)
    if not i.size:
        return np.inf, None, [], []
    gap = gaps(benches, i, j)
    rows = sorted(np.flatnonzero(gap <= TOUCH_M).tolist(), key=lambda row: (gap[row], i[row], j[row]))
    least = int(np.argmin(gap))
    return gap[least], (i[least], j[least]), [(i[row], j[row]) for row in rows], gap[rows].tolist()


def told(found):
    """Return a closeness in the form returned by ``of_all_pairs``."""
    return found.clearance_m, found.closest, list(zip(found.i, found.j, strict=True)), found.gap_m.tolist()


def agree(looks):
    near, expecting, looks = NearPairs(), NearPairs(), list(looks)
    for n, (p, benches) in enumerate(looks):
        if n % 4 == 1:
            expecting.expect([benches for _, benches in looks[n:n + 4]])
        assert told(near.look(p, benches)) == told(expecting.look(p, benches)) == of_all_pairs(benches)
    return near


def placed(scene, times_s):
    for t_s in times_s:
        chain = state(scene, t_s)
        yield chain.p, benches_of(chain, scene.dragon, axes_of(chain))


def poses(centre, yaw_rad, half_length, half_width):
    benches = Benches(centre, np.stack((np.cos(yaw_rad), np.sin(yaw_rad)), 1), half_length, half_width)
    return np.concatenate((centre, centre[:1])), benches


@st.composite
def layouts(draw):
    """Draw sequences of layouts in which benches are shaken, moved together, moved singly, moved away, or replaced."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    spread = draw(st.sampled_from([0.3, 3.0, 10.0, 40.0]))      # from deep overlaps to a few close pairs

    def fresh():
        count = int(rng.integers(1, 25))
        return (rng.uniform(-spread, spread, (count, 2)), rng.uniform(-4, 4, count), rng.uniform(0.2, 2, count),
                rng.uniform(0.05, 0.5, count))
    centre, yaw, half, side = fresh()
    looks = [poses(centre, yaw, half, side)]
    for move in draw(st.lists(st.sampled_from(['shake', 'rest', 'as one', 'one', 'drift', 'jump', 'other', 'larger']),
                              min_size=3, max_size=14)):
        if move == 'shake':
            centre, yaw = centre + rng.normal(0, 0.03, centre.shape), yaw + rng.normal(0, 0.03, yaw.shape)
        elif move == 'as one':
            turn = rng.uniform(-3, 3)
            c, s = np.cos(turn), np.sin(turn)
            centre, yaw = centre @ np.array([[c, s], [-s, c]]) + rng.normal(0, 100, 2), yaw + turn
        elif move == 'one':
            centre = centre.copy()
            centre[rng.integers(len(centre))] = rng.uniform(-spread, spread, 2)
        elif move == 'drift':
            centre = centre + 0.1 * centre[::-1]
        elif move in ('jump', 'other'):
            count = len(centre)
            centre, yaw, *sizes = fresh()
            if move == 'jump':
                centre, yaw = np.resize(centre, (count, 2)), np.resize(yaw, count)
            else:
                half, side = sizes
        elif move == 'larger':
            half = half * 1.5
        looks.append(poses(centre, yaw, half, side))
    return looks


@given(layouts())
@examples(20, long=40)
@pytest.mark.parametrize('first_part', thinned([4, near_pairs._FIRST_PART], lambda size: size == 4))
def test_looks_at_any_layouts_equal_a_search_of_all_pairs(first_part, looks):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(near_pairs, '_FIRST_PART', first_part)
        agree(looks)
    for p, benches in looks:
        assert told(closeness(p, benches)) == of_all_pairs(benches)


@st.composite
def converging(draw):
    """Draw layouts of benches that move and turn steadily, each differently: mostly towards others, or on the spot."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = int(rng.integers(3, 25))
    pace, spin, spread = draw(st.sampled_from([(0.05, 0.0, 15), (0.01, 0.02, 10), (0.002, 0.0, 5), (0.0, 0.1, 4)]))
    half, side = rng.uniform(0.05, 1.5, count), rng.uniform(0.05, 0.3, count)
    centre, yaw = rng.uniform(-spread, spread, (count, 2)), rng.uniform(-4, 4, count)
    way, turn = -pace * (centre + rng.normal(0, 1, centre.shape)), rng.normal(0, spin, count)
    return [poses(centre + n * way, yaw + n * turn, half, side) for n in range(30)]


@given(converging(), st.sampled_from([-0.2, 0.0, 0.5]))
@examples(40, long=80)
def test_a_part_names_every_pair_within_a_limit_whatever_comes_near(looks, limit_m):
    far = np.hypot(looks[0][1].half_length, looks[0][1].half_width)
    i, j = np.triu_indices(far.size, 2)
    listed = near_pairs._listed(near_pairs._bodies(looks[0][1], far), *looks[0], (0, far.size, far.size),
                                max(limit_m, 0.0) + 0.5, limit_m)
    assert listed
    part, _ = listed
    for p, benches in looks:
        seen = near_pairs._seen_part(part, near_pairs._bodies(benches, far), p, benches, limit_m, 0.5)
        assert seen
        part, rows = seen
        named = set(zip(*(one[rows].tolist() for one in part.list.pairs), strict=True))
        gap = gaps(benches, i, j)
        assert set(zip(i[gap <= limit_m].tolist(), j[gap <= limit_m].tolist(), strict=True)) <= named


@given(converging())
@examples(20, long=40)
def test_looks_at_benches_that_converge_equal_a_search_of_all_pairs(looks):
    agree(looks)


@pytest.mark.parametrize('pace', thinned([0.97, 0.9, 0.6], lambda pace: pace == 0.6))
def test_parts_that_come_nearer_to_the_origin_one_by_one_are_seen(monkeypatch, pace):
    monkeypatch.setattr(near_pairs, '_FIRST_PART', 4)
    rng = np.random.default_rng(5)
    radius = np.repeat(np.arange(1.0, 13), 4) + np.tile([0.0, 0.01, 0.02, 0.03], 12)
    angle, half, side = np.arange(48) * 1.7, np.full(48, 0.1), np.full(48, 0.05)
    outer, looks = np.arange(48) >= 24, []
    for _ in range(40):
        looks.append(poses(radius[:, None] * np.stack((np.cos(angle), np.sin(angle)), 1), angle, half, side))
        radius = np.where(outer, radius * pace, radius)
        angle = angle + rng.normal(0, 0.01, 48)
    near = agree(looks[:1])
    assert len(near._kept.parts) > 2
    agree(looks)


def lying(centre, half=1.0, side=0.1):
    """Return benches along x at centres given as complex numbers."""
    count = len(centre)
    return poses(np.stack((centre.real, centre.imag), 1), np.zeros(count), np.full(count, half), np.full(count, side))


def both_sides(step):
    """Return a layout in which benches 0 and 2 have each moved a step towards the other.

    Until these two meet, benches 4 and 6 are the closest pair; bench 5 does not move.
    """
    return lying(np.array([-1.3 + step, 20j, 1.3 - step, -20j, 10j, -10.65j, 10.25j]))


def test_two_benches_that_approach_from_both_sides_are_seen_to_overlap():
    near = agree([both_sides(0.0), both_sides(0.36)])
    assert near._kept.closest == (0, 2)


@pytest.mark.parametrize('step', [0.01, 0.1, 0.36])
def test_gaps_are_taken_to_change_by_both_steps_and_no_more(step):
    near = agree([both_sides(0.0)])
    (part,), (_, benches) = near._kept.parts, both_sides(step)
    assert part.change_m(near_pairs._bodies(benches, near._kept.far)) == pytest.approx(2 * step, rel=1e-12)


def in_a_row(step, end=None):
    """Return a row of benches, with the first four moved a step forwards and those from ``end`` onwards a step back."""
    n = np.arange(24)
    return lying(0.5 + 0.11 * n + step * np.where(n < 4, 1, np.where(n >= (end or 24), -1, 0)) + 0j, 0.1, 0.001)


def test_two_benches_of_different_parts_that_approach_from_both_sides_are_seen_to_overlap(monkeypatch):
    monkeypatch.setattr(near_pairs, '_FIRST_PART', 4)
    near = agree([in_a_row(0.0)])
    end = near._kept.parts[0].end
    assert near._kept.parts[0].stop == 4 < end < 24
    agree([in_a_row(0.0), in_a_row(0.075, end)])


@pytest.mark.parametrize('step', [0.01, 0.075])
def test_pairs_of_different_parts_are_taken_to_come_nearer_by_both_steps_and_no_more(monkeypatch, step):
    monkeypatch.setattr(near_pairs, '_FIRST_PART', 4)
    kept = agree([in_a_row(0.0)])._kept
    _, benches = in_a_row(step, kept.parts[0].end)
    across_m = kept.across_m(near_pairs._bodies(benches, kept.far))
    assert across_m == pytest.approx(kept.apart_m - 2 * step, abs=1e-12)
    assert across_m <= gaps(benches, np.array([3]), np.array([kept.parts[0].end]))[0]


def times(start_s, stop_s, rate_hz):
    return np.arange(start_s, stop_s, 1 / rate_hz)


SCENES = {
    'classic': (Scene(run=Run(0, 425)), times(300, 302, 50)),
    'jumps': (Scene(run=Run(0, 425)), [0.0, 300.0, 300.02, 0.02, 425.0, 424.98, 1.0, 412.4, 412.6]),
    'backwards': (Scene(run=Run(0, 425)), times(411, 413.5, 20)[::-1]),
    'overlaps': (Scene(run=Run(0, 430)), times(412, 426, 2)),
    'turning': (Scene(track=STurn(before_m=100.0), run=Run(0, 200)), times(90, 120, 1)),
    'unwinding': (Scene(dragon=Dragon(100), track=Spiral(0.55, 6.0), head=Head(1.0, 'tail'), run=Run(0, 300)),
                  times(20, 26, 5)),
    'mixed': (Scene(dragon=MIXED, run=Run(0, 400)), times(350, 360, 10)),
    'dense': (Scene(dragon=Dragon(60), track=Spiral(0.2, 16.0), run=Run(0, 400)), times(0, 4, 10)),
    'toy': (Scene(dragon=Dragon(100, 0.1, 0.08, 0.01, 0.005), track=Spiral(0.02), head=Head(0.036),
                  run=Run(0, 400)), times(300, 303, 20))}


@pytest.mark.parametrize(('name', 'first_part'), thinned(
    [(name, size) for name in SCENES for size in (4, near_pairs._FIRST_PART)],
    lambda case: case[1] == 4 and case[0] not in ('classic', 'turning', 'backwards')))
def test_looks_at_a_run_equal_a_search_of_all_pairs(monkeypatch, name, first_part):
    monkeypatch.setattr(near_pairs, '_FIRST_PART', first_part)
    scene, times_s = SCENES[name]
    agree(placed(scene, times_s))


def test_a_large_dragon_is_cut_in_parts_that_agree():
    scene = Scene(dragon=Dragon(3000), run=Run(0, 400))
    near = NearPairs()
    for p, benches in placed(scene, times(300, 301, 25)):
        assert told(near.look(p, benches)) == told(closeness(p, benches))
    assert [(part.first, part.stop) for part in near._kept.parts] == [(0, 512), (512, 1024), (1024, 3000)]


def test_a_large_dragon_that_winds_outwards_is_cut_from_its_tail():
    scene = Scene(dragon=Dragon(3000), track=Spiral(0.55, 3.0), head=Head(1.0, 'tail'), run=Run(0, 4000))
    near = NearPairs()
    for p, benches in placed(scene, times(3000, 3001, 10)):
        assert told(near.look(p, benches)) == told(closeness(p, benches))
    assert len(near._kept.parts) > 1


@pytest.fixture
def searches(monkeypatch):
    """Return a list that records the sizes of the dragons whose pairs are searched for."""
    out, search = [], near_pairs.candidates

    def counted(p, benches, reach_m=None):
        out.append(len(benches.centre))
        return search(p, benches, reach_m)
    monkeypatch.setattr(near_pairs, 'candidates', counted)
    return out


def test_pairs_are_searched_for_a_few_times_a_second(searches):
    agree(placed(Scene(run=Run(0, 425)), times(300, 303, 50)))
    assert len(searches) < 2 * 150 / 20     # with and without expected samples


def test_expected_samples_are_bounded_together_whatever_is_looked_at(monkeypatch):
    calls, change_m = [], near_pairs._NearList.change_m
    monkeypatch.setattr(near_pairs._NearList, 'change_m', lambda part, bodies: (
        calls.append(bodies.centre.ndim), change_m(part, bodies))[1])
    looks = list(placed(Scene(run=Run(0, 425)), times(300, 300.16, 50)))
    near = NearPairs()
    near.expect([benches for _, benches in looks])      # nothing is known yet
    assert told(near.look(*looks[0])) == of_all_pairs(looks[0][1])
    near.expect([benches for _, benches in looks[1:]])
    for n in (3, 4):
        assert told(near.look(*looks[n])) == of_all_pairs(looks[n][1])
    assert calls == [2]
    for n in (1, 5, 0):         # an earlier sample, the next one, and one that was not expected
        assert told(near.look(*looks[n])) == of_all_pairs(looks[n][1])
    assert calls == [2, 2, 1]


def test_a_dragon_that_moves_as_one_is_searched_once(searches):
    (p, benches), = placed(Scene(), [300.0])
    near = NearPairs()
    near.look(p, benches)
    searches.clear()
    for turn in np.linspace(0, 2, 20):
        c, s = np.cos(turn), np.sin(turn)
        move = np.array([[c, s], [-s, c]])
        moved = Benches(benches.centre @ move + 50 * turn, benches.axis @ move, benches.half_length, benches.half_width)
        assert told(near.look(p @ move, moved)) == of_all_pairs(moved)
    assert not searches


def test_a_crowd_is_searched_from_nothing_each_time():
    rng = np.random.default_rng(3)
    looks = [poses(rng.uniform(0, 1, (150, 2)), rng.uniform(0, 3, 150), np.full(150, 0.5), np.full(150, 0.5))] * 2
    assert agree(looks)._kept is None


def test_a_frame_does_not_depend_on_the_frames_before_it():
    effects = Effect.BENCHES | Effect.CLEARANCE | Effect.CONTACT
    scene, again = (Scene(run=Run(412, 414), effects=effects) for _ in range(2))
    ordered = [tick(scene, k) for k in range(40)]
    for k in np.random.default_rng(2).permutation(40).tolist():
        frame = tick(again, k)
        assert told(frame.closeness) == told(ordered[k].closeness) == of_all_pairs(frame.benches)
        np.testing.assert_array_equal(frame.contacts.benches, ordered[k].contacts.benches)
        np.testing.assert_array_equal(frame.contacts.point_m, ordered[k].contacts.point_m)


def test_parts_of_a_long_dragon_are_the_same_from_either_end():
    benches = benches_of(chain := state(Scene(dragon=Dragon(3000), track=Spiral(0.55, 100.0)), 0.0), Dragon(3000),
                         axes_of(chain))
    sizes = []
    for each in (benches, Benches(*(values[::-1] for values in (benches.centre, benches.axis, benches.half_length,
                                                                benches.half_width)))):
        bodies = near_pairs._bodies(each, np.hypot(each.half_length, each.half_width))
        sizes.append([stop - first for first, stop, _ in near_pairs._cuts(bodies, 1.0)])
    assert len(sizes[0]) > 2
    assert sizes[0] == sizes[1][::-1]
