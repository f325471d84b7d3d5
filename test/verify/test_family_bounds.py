"""The checker's bounds for a family hold for every bench of its dragons and are tight."""
import json
import random
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from itertools import product
from math import asinh, cos, hypot, pi, sin, sqrt
from types import SimpleNamespace

import pytest
import shapely
from flint import arb
from hypothesis import given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes.load import scene_values
from dragon_ros.verify import family
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.family import AHEAD, OTHER, THETA, _family_of, _Pair, _Proof
from dragon_ros.verify.reading import claims_of

BENCHES = 24
SCENE = Scene(dragon=Dragon(BENCHES, 1.5, 1.2, 0.2, 0.1), track=Spiral(0.5, 4.0), run=Run(start_s=3.0))
WITHIN = {'dragon.width_m': 0.01, 'dragon.head_length_m': 0.02, 'dragon.body_length_m': 0.03,
          'dragon.hole_inset_m': 0.005, 'track.pitch_m': 0.004}
UNTIL_S = 11.0
NEVER_MIND = 1e-12      # rad: rounding of the floats in these tests


def family_of(within=WITHIN, until_s=UNTIL_S, scene=SCENE):
    values = {'family': 1, 'scene': scene_values(scene), 'within': within, 'proved_s': until_s}
    return _family_of(claims_of(json.dumps(values).encode()))


def proof_of(**given):
    return _Proof(family_of(**given), 60_000, lambda *told: None)


PROOF = proof_of()


def root(f, low, high):
    """Return the root of an increasing function."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if f(middle) > 0 else (middle, high)
    return 0.5 * (low + high)


def arc(theta):
    return 0.5 * (theta * sqrt(1 + theta * theta) + asinh(theta))


def head_at(t_s, scale):
    """Return the polar angle after ``t_s`` of a head that moves at 1 m/s."""
    return root(lambda theta: arc(theta) - arc(8 * pi) + t_s * scale, 0.0, 8 * pi)


def behind(theta, chord):
    """Return the polar angle of the next handle on r = theta; up to half a turn, the chord grows with the span."""
    def excess(delta):
        outer = theta + delta
        return hypot(outer * cos(delta) - theta, outer * sin(delta)) - chord
    return theta + root(excess, 0.0, pi)


def handles(t_s, scale, links):
    out = [head_at(t_s, scale)]
    for link in links:
        out.append(behind(out[-1], scale * link))
    return out


def one_of(draw, ends):
    """Return either end of an interval or, in one case of three, a value inside it."""
    low, high = ends
    return draw.choice([low, high, draw.uniform(low, high)])


def dragon(draw):
    """Draw 1 / b and the links of a dragon of the family, often all at the ends of their tolerances."""
    scale, alike = one_of(draw, PROOF._scale), draw.choice([0, 1, None])
    ends = [PROOF._head] + [PROOF._body] * (PROOF._family.benches - 1)
    return scale, [one_of(draw, pair) if alike is None else pair[alike] for pair in ends]


def test_links_and_benches_of_a_family_are_as_long_and_as_wide_as_its_tolerances_make_them():
    def exactly(value):
        return Fraction(value)
    got = family_of()
    inset = exactly(0.1) - exactly(0.005), exactly(0.1) + exactly(0.005)
    assert got.head_link_m == (exactly(1.5) - exactly(0.02) - 2 * inset[1], exactly(1.5) + exactly(0.02) - 2 * inset[0])
    assert got.body_link_m == (exactly(1.2) - exactly(0.03) - 2 * inset[1], exactly(1.2) + exactly(0.03) - 2 * inset[0])
    assert got.pitch_m == (exactly(0.5) - exactly(0.004), exactly(0.5) + exactly(0.004))
    assert got.width_m == exactly(0.2) + exactly(0.01)
    assert got.overhang_m == inset[1]
    ends = [(PROOF._scale, [2 * pi / pitch for pitch in (0.504, 0.496)]), (PROOF._head, (1.27, 1.33)),
            (PROOF._body, (0.96, 1.04)), ((PROOF._half, PROOF._over), (0.105, 0.105))]
    for found, wanted in ends:
        assert found == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize(('low', 'high'), [(Fraction(1, 3), Fraction(2, 3)), (Fraction(-1, 7), Fraction(-1, 9))])
def test_floats_around_an_interval_are_outside_of_it_and_next_to_it(low, high):
    for ends in ((low, high), (family.exact(low), family.exact(high))):
        found = family._floats(*ends)
        assert Fraction(found[0]) < low
        assert high < Fraction(found[1])
        assert found == pytest.approx((float(low), float(high)), rel=1e-15)


@examples(40)
@given(st.floats(2, 60), st.floats(0.5, 6), st.booleans())
def test_a_span_is_held_between_floats_next_to_it(theta, chord, outer):
    theta = max(theta, chord)
    true = behind(theta, chord) - theta
    low, high = (family._span(theta, chord, sense) for sense in (-1, 1))
    assert low - NEVER_MIND < true < high + NEVER_MIND
    assert high - low < 1e-10 * true
    assert family._excess(arb(theta), arb(low), arb(chord)) < 0
    assert family._excess(arb(theta), arb(high), arb(chord)) > 0


@pytest.mark.parametrize('off', [1e-3, -1e-3, 3e-11, -3e-11])
def test_a_span_is_proved_however_far_off_it_is_looked_for(monkeypatch, off):
    true = behind(20.0, 3.0) - 20.0
    monkeypatch.setattr(family, 'about_span', lambda theta, chord: true * (1 + off))
    family._span.cache_clear()
    try:
        for sense in (-1, 1):
            with suppress(Refused):
                assert (family._span(20.0, 3.0, sense) - true) * sense > -NEVER_MIND
    finally:
        family._span.cache_clear()


def test_a_span_of_more_than_half_a_turn_is_none():
    with pytest.raises(Refused):
        family._span(0.1, 3.5, 1)


def test_what_links_span_in_a_box_is_what_they_do_at_its_ends():
    found = family._spans((20.0, 21.0), (11.0, 11.5), (0.9, 1.0))
    ends = behind(21.0, 11.0 * 0.9) - 21.0, behind(20.0, 11.5) - 20.0
    assert (float(found.lower()), float(found.upper())) == pytest.approx(ends, abs=1e-7)    # radii have 30 bits
    assert found.lower() < ends[0] + NEVER_MIND
    assert found.upper() > ends[1] - NEVER_MIND
    assert family._added((1.0, 2.0), (10.0, 30.0)) == pytest.approx((11.0, 32.0), abs=1e-14)


# Boxes that can occur


def held(lead, box, ahead):
    """Return 'held' if the remaining box contains the other bench, and otherwise how the box misses it."""
    left = PROOF._occurring(lead, box)
    if left is None:
        return 'nothing'
    low, high = left[AHEAD]
    return 'held' if low - NEVER_MIND <= ahead <= high + NEVER_MIND else 'beyond' if ahead > high else 'before'


def rectangle(theta, rear, angle, scale, half, over):
    """Return a bench of the family's largest size, given the angles of its front and rear handles."""
    front = theta * complex(cos(angle), sin(angle))
    back = rear * complex(cos(angle + rear - theta), sin(angle + rear - theta))
    u = (front - back) / abs(front - back)
    corners = [front + u * scale * complex(over, half), front + u * scale * complex(over, -half),
               back + u * scale * complex(-over, -half), back + u * scale * complex(-over, half)]
    return shapely.Polygon([(z.real, z.imag) for z in corners])


def around(value, wide):
    return value - wide, value + wide


@pytest.mark.parametrize('wide', [1e-9, 0.02])
def test_all_pairs_of_all_dragons_up_to_the_claimed_time_are_in_the_boxes_and_none_is_left_out(wide):
    """This includes the start and the claimed time. Pairs that are treated as out of reach do not touch."""
    draw, first, seen = random.Random(9), PROOF._first(), {'held': 0, 'beyond': 0}
    for _ in range(12):
        scale, links = dragon(draw)
        t_s = draw.choice([3.0, UNTIL_S, draw.uniform(3.0, UNTIL_S)])
        thetas = handles(t_s, scale, links)
        pairs = [(i, j) for i in range(BENCHES - 2) for j in range(i + 2, BENCHES)]
        for i, j in [(0, 2), (0, BENCHES - 1), (1, BENCHES - 1), *draw.sample(pairs, 12)]:
            lead, ahead = min(i, 1), thetas[j] - thetas[i]
            assert any(row == lead and box[THETA][0] - NEVER_MIND <= thetas[i] <= box[THETA][1] + NEVER_MIND
                       for row, box in first)
            box = (around(thetas[i], wide), (0.0, 9e9), around(scale, wide), around(links[i], 0.1 * wide),
                   around(links[j], 0.1 * wide))
            what = held(lead, box, ahead)
            seen[what] += 1
            if what == 'beyond':
                one, other = (rectangle(thetas[n], thetas[n + 1], thetas[n] - thetas[i], scale, 0.105, 0.105)
                              for n in (i, j))
                assert not one.intersects(other)
    assert min(seen.values()) > 10


@pytest.mark.parametrize('lead', [0, 1])
@pytest.mark.parametrize(('t_s', 'sense'), [(UNTIL_S, -1), (3.0, 1)])
def test_what_is_a_hair_before_the_start_or_after_the_claimed_time_does_not_occur(lead, t_s, sense):
    """All tolerances are tested for the head at the start, and for the head and the next bench at the claimed time."""
    for scale in (PROOF._scale if sense < 0 else PROOF._scale[:1]):
        links = [PROOF._head[0]] + [PROOF._body[0]] * 3
        theta = handles(t_s, scale, links)[lead]
        box = [around(theta, 1e-9), (0.0, 9e9), (scale, scale), (links[lead], links[lead]), (links[2], links[2])]
        assert PROOF._occurring(lead, tuple(box)) is not None
        box[THETA] = around(theta + sense * (1e-6 if lead else 3e-9), 1e-9)     # six passes bound the head's position
        if lead == 0 or sense < 0:
            assert PROOF._occurring(lead, tuple(box)) is None
        links, inside = ((PROOF._head, PROOF._body)[lead], PROOF._body), around(theta - sense * 2e-9, 1e-9)
        assert PROOF._occurring(lead, (inside, (0.0, 9e9), PROOF._scale, *links)) is not None


def test_the_head_is_nowhere_near_its_place_at_0_s_when_its_run_starts_later():
    box = (around(8 * pi, 1e-3), (0.0, 9e9), PROOF._scale, PROOF._head, PROOF._body)
    assert PROOF._occurring(0, box) is None


def test_each_box_that_is_examined_counts():
    proof, seen = proof_of(until_s=3.5), []
    proof._occurring = lambda lead, box: seen.append(box) or _Proof._occurring(proof, lead, box)
    lead, box = next(row for row in proof._first() if row[0])
    assert proof._clear(lead, box, 0) == len(seen) > 1
    assert proof._clear(lead, (box[0], (0.0, 1e-9), *box[2:]), 5) == 1


def test_the_head_has_passed_no_place_further_in_by_the_claimed_time():
    assert 0 <= head_at(UNTIL_S, PROOF._scale[1]) - PROOF._innermost() < 1e-9


def test_where_some_link_might_lock_no_head_is_said_to_go():
    """The limit applies to 1.09 / r times the longer link, which may be that of the head or of the body."""
    for dragon in (Dragon(8, 2.9, 0.8, 0.2, 0.1), Dragon(8, 0.8, 2.9, 0.2, 0.1)):
        scale, least = 2 * pi / 0.5, 0.5 * 1.09 * (2 * pi / 0.5) * 2.7
        gone_s = (arc(8 * pi) - arc(least)) / scale
        scene = replace(SCENE, dragon=dragon)
        assert proof_of(within={}, until_s=gone_s - 1e-6, scene=scene)._innermost() == pytest.approx(least, abs=1e-5)
        with pytest.raises(Refused, match='links might lock'):
            proof_of(within={}, until_s=gone_s + 1e-6, scene=scene)._innermost()


@pytest.mark.parametrize('benches', [3, 4, 5, 24, 60])
def test_boxes_reach_out_to_the_last_bench_with_two_behind_it_and_no_further(benches):
    """The reach is needed when the head starts with the longest links on the narrowest spiral."""
    scene = replace(SCENE, dragon=Dragon(benches, 1.5, 1.2, 0.2, 0.1), run=Run())
    proof = proof_of(scene=scene)
    last = handles(0.0, PROOF._scale[1], [PROOF._head[1], *[PROOF._body[1]] * benches])[benches - 3]
    row = [box[THETA] for lead, box in proof._first() if lead]
    if benches == 3:        # only the head has two benches behind it
        assert not row
    else:
        assert last - NEVER_MIND * benches <= row[-1][1] < last + 1e-9 * benches
        assert row[0][0] < row[-1][1]


@pytest.mark.parametrize('theta', [(20.0, 20.0), (20.0, 20.05)])
def test_strips_reach_from_the_shortest_links_to_the_longest_and_no_further(theta):
    scale, link = PROOF._scale, PROOF._body
    near, far = [theta[1]], [theta[0]]
    for _ in range(BENCHES - 1):
        near.append(behind(near[-1], scale[0] * link[0]))
        far.append(behind(far[-1], scale[1] * link[1]))
    least, most = [one - theta[1] for one in near], [one - theta[0] for one in far]

    def strips(lead, *ahead):
        return PROOF._strips(lead, (theta, ahead, scale, link, link))
    for lead, last in ((0, BENCHES - 1), (1, BENCHES - 2)):
        low, high = strips(lead, 0.0, 9e9)
        assert (low, high) == pytest.approx((least[2], most[last]), abs=1e-9)
        assert low <= least[2] + NEVER_MIND
        assert high >= most[last] - NEVER_MIND
        assert strips(lead, most[last] + 1e-6, 9e9) == (float('inf'), float('-inf'))
    for j in (2, 3, 4):
        low, high = strips(1, most[j - 1] + 1e-6, least[j + 1] - 1e-6)
        assert (low, high) == pytest.approx((least[j], most[j]), abs=1e-9)


def reach(theta, scale, link, other, half, over):
    """Return how far ahead another bench may be and still be considered, on a track without ends."""
    wide = SimpleNamespace(_half=half, _over=over, _head=link, _body=link, _start=arb(1e6),
                           _gone_m=(arb(0), arb(1e9)), _gone_by=lambda theta, scale: arb(0.5),
                           _strips=lambda lead, box: box[AHEAD])
    return _Proof._occurring(wide, 0, (theta, (0.0, 9e9), scale, link, other))[AHEAD][1]


@pytest.mark.parametrize(('theta', 'link', 'half', 'over'), [
    (30.0, 0.3, 2.0, 0.01), (30.0, 0.3, 1.0, 0.3), *((8.0, 0.8, 0.1 + 0.03 * n, 0.001) for n in range(12))])
def test_wide_and_long_benches_that_are_out_of_reach_do_not_touch_all_round(theta, link, half, over):
    """On a narrow spiral, successive benches pass on all sides of the inner one."""
    scale = 10.0
    far = reach(*((value, value) for value in (theta, scale, link, link)), half, over)
    inner = rectangle(theta, behind(theta, scale * link), 0.0, scale, half, over)

    def touches(ahead):
        return inner.intersects(rectangle(theta + ahead, behind(theta + ahead, scale * link), ahead, scale, half, over))
    assert not any(touches(far + 2 * pi * k / 60) for k in range(60))
    assert theta < 10 or any(touches(0.85 * far + 2 * pi * k / 60) for k in range(60))


@pytest.mark.parametrize('half', [0.1, 0.3])
def test_the_reach_of_a_box_is_that_of_its_places_and_hardly_more(half):
    theta, scale, link, other = box = (8.0, 8.1), (10.0, 10.1), (0.7, 0.71), (0.8, 0.81)
    points = [reach(*((ends[n], ends[n]) for ends, n in zip(box, corner, strict=True)), half, 0.05)
              for corner in product((0, 1), repeat=4)]
    assert max(points) < reach(theta, scale, link, other, half, 0.05) < max(points) + 0.11
    front, far = (8.0, 8.0), 2 * 10.0 * hypot(half, 0.05)
    chord = behind(8.0, 7.0)
    assert reach(front, (10.0, 10.0), (0.7, 0.7), (0.8, 0.8), half, 0.05) == pytest.approx(
        hypot(chord + far, 8.0) - 8.0, rel=1e-9)


# Whether two benches are apart


MIDDLE = [40.0, 6.35, 11.42, 2.86, 1.65]


def at(point):
    return _Pair([arb(value) for value in point], [(value, value) for value in point])


def gap(point, half, over):
    return max(min(float(one) for one in at(point).distances(edge, half, over)[0]) for edge in range(8))


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('wide', [1e-6, 1e-2])
def test_distances_and_slopes_of_a_box_hold_those_of_its_points(seed, wide):
    draw = random.Random(seed)
    middle = [value * draw.uniform(0.95, 1.05) for value in MIDDLE]
    box = [around(value, wide * draw.random()) for value in middle]
    everywhere = _Pair([family._ball(one) for one in box], box)
    points = [[draw.choice([*ends, draw.uniform(*ends)]) for ends in box] for _ in range(4)]
    for edge in range(8):
        bounds = everywhere.distances(edge, 0.15, 0.275, with_slopes=True)
        for point in points:
            for bound, one in zip(bounds[0], at(point).distances(edge, 0.15, 0.275)[0], strict=True):
                assert bound.contains(one.mid())
            slopes = at(point).distances(edge, 0.15, 0.275, with_slopes=True)[1]
            for bound, corner in zip(bounds[1], slopes, strict=True):
                assert all(wider.contains(one.mid()) for wider, one in zip(bound, corner, strict=True))
        assert max(float(one.rad()) for corner in bounds[1] for one in corner) < 3e3 * wide


@pytest.mark.parametrize(('rows', 'seed'), thinned(
    [(rows, seed) for rows in (*((row,) for row in range(5)), (0, 1), (2, 3, 4), (0, 1, 2, 3, 4)) for seed in range(3)],
    lambda case: case[1] == 0 and (len(case[0]) > 3 or case[0] == (4,))), ids=str)
def test_a_box_is_cleared_while_its_benches_are_apart_and_no_longer(rows, seed):
    """The box is widened around benches with a small gap; the mean value theorem loses only a second-order term."""
    draw, over = random.Random(seed), 0.2
    point = [value * draw.uniform(0.97, 1.03) for value in MIDDLE]
    half = root(lambda half: -gap(point, half, over) + 0.02, 0.0, 3.0)
    shape = SimpleNamespace(_half=half, _over=over)

    def cleared(wide):
        return _Proof._unclear(shape, tuple(around(value, wide * (n in rows)) for n, value in enumerate(point))) is None
    assert cleared(0.0)
    low, high = 0.0, 0.4
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cleared(middle) else (low, middle)
    ends = [[value + sign * low * (n in rows) for n, (value, sign) in enumerate(zip(point, signs, strict=True))]
            for signs in product((-1, 1), repeat=5)]
    gaps = [gap(end, half, over) for end in ends]
    assert min(gaps) > 0
    assert min(gaps) < 0.014 or high == 0.4


def test_a_box_of_two_halves_is_all_of_it_and_is_cut_where_it_costs_most():
    box = ((40.0, 40.2), (6.3, 6.4), (11.4, 11.5), (2.8, 2.9), (1.6, 1.7))
    for row in range(5):
        first, second = _Proof._halves(box, row)
        assert first[row] == (box[row][0], second[row][0])
        assert second[row][1] == box[row][1]
        assert all(first[n] == second[n] == box[n] for n in range(5) if n != row)
    shape = SimpleNamespace(_half=0.15, _over=0.275)
    for row in (THETA, AHEAD, OTHER):
        one = tuple(ends if n == row else around(0.5 * sum(ends), 1e-9) for n, ends in enumerate(box))
        assert _Proof._unclear(shape, one) in (row, None)
