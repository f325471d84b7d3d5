"""On composite tracks every step of the search has a valid bound, and the checker rejects every forgery."""
import copy
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from apart import smallest
from certificates import proved, refusal
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.enclosures.on_track import kinematics, link_states, second_derivatives, views
from dragon_ros.core.errors import DragonError
from dragon_ros.core.geometry.rectangles import axes_of
from dragon_ros.core.geometry.signed_distance import parted_between, placement
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search import conservative_advancement
from dragon_ros.core.search.certificate import Certificate, Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.near_misses import near_misses
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Arc, Composite, Line, SpiralArc, STurn
from dragon_ros.scenes import certificate

LOOP = Composite((Line(5.0), Arc(3.0, 720.0)))
BENT = Composite((Line(50.0), Arc(3.0, -200.0), Line(1.0), SpiralArc(1.2, 2, 4.0)), start_m=70.0)
BACK_AND_FORTH = Profile(((0.0, 0.0), (5.0, 1.0), (10.0, -1.0), (20.0, -1.0), (30.0, 1.0)))
TIGHT = Scene(dragon=Dragon(40), track=STurn(0.8, before_m=100.0), run=Run(80, 200))
SCENES = {
    'turn': Scene(dragon=Dragon(60), track=STurn(before_m=100.0), run=Run(95, 140)),
    'a tight turn': TIGHT,
    'loop': Scene(dragon=Dragon(20), track=LOOP, run=Run(0, 30)),
    'back and forth': Scene(dragon=Dragon(20), track=LOOP, head=BACK_AND_FORTH, run=Run(3, 100)),
    'tail': Scene(dragon=Dragon(10), track=BENT, head=Head(1.0, 'tail'), run=Run(0, 30)),
    'two benches': Scene(dragon=Dragon(2, 3.41, 0.6), track=LOOP, run=Run(0, 20)),
    'rest': Scene(dragon=Dragon(20), track=LOOP, head=Head(0.0), run=Run(0, 10)),
    'the end of the track': Scene(dragon=Dragon(20), track=Composite((Line(5.0), Arc(6.0, 120.0)))),
    'out from a spiral': Scene(dragon=Dragon(3),
                               track=Composite((SpiralArc(3.0, 0.6, 3.0, 'left'), Line(9.0)), start_m=9.0),
                               run=Run(0, 30))}
MEETING = {'a tight turn': (113.28625812330225, (0, 15)), 'loop': (22.16017797019889, (0, 10)),
           'back and forth': (59.66017797019889, (0, 10))}


@pytest.mark.parametrize('name', thinned(SCENES, lambda name: name not in ('turn', 'a tight turn')))
def test_every_joined_track_has_a_certificate_that_holds(name):
    found = first_contact(SCENES[name])
    assert found.certificate.complete
    values = certificate.as_values(SCENES[name], found)
    assert proved(values)
    assert isinstance(found, Contact if name in MEETING else NoContact)
    if name in MEETING:
        assert found.t_s == pytest.approx(MEETING[name][0], abs=1e-9)
        assert found.benches == MEETING[name][1]
        assert smallest(SCENES[name], found.t_s + 1e-8) == 0 < smallest(SCENES[name], found.t_s - 1e-8)


def test_the_turn_of_the_contest_takes_few_looks():
    found = first_contact(Scene(track=STurn(before_m=100.0), run=Run(0, 200)))
    assert isinstance(found, NoContact)
    assert found.states < 440


@pytest.fixture(scope='module')
def tight():
    return first_contact(TIGHT)


def test_steps_join_up_to_the_contact(tight):
    found = tight
    steps = found.certificate.intervals
    assert all(one.stop_m == other.start_m for one, other in pairwise(steps))
    assert steps[0].start_m == pytest.approx(-20.0, abs=1e-12)
    assert 0 < found.t_s - 100.0 - steps[-1].stop_m <= 1e-9


links = st.floats(0.3, 2.5)
tracks = st.builds(lambda radius, turned, line, other, back: Composite(
    (Line(60.0), Arc(radius, turned), Line(line), Arc(other, back)), start_m=55.0),
    st.floats(1.6, 5), st.floats(60, 500) | st.floats(-500, -60), st.floats(0.1, 5), st.floats(1.6, 5),
    st.floats(60, 500) | st.floats(-500, -60)) | st.builds(
        STurn, st.floats(0.6, 2), st.floats(7, 10), st.floats(0.6, 2))


@examples(10)
@given(st.integers(3, 14), links, links, st.floats(0.05, 0.5), tracks, st.sampled_from([
    Head(1.0), Head(1.0, 'tail'), BACK_AND_FORTH]), st.floats(0, 1))
def test_no_gap_between_two_looks_is_below_the_bound(benches, head, body, width, track, law, share):
    try:
        scene = Scene(Dragon(benches, 0.4 + head, 0.4 + body, width, 0.2), track, law, Run(0, 25))
        end_s = compile_scene(scene).end.t_s
    except DragonError:     # the dragon does not fit the track
        assume(False)
    found = first_contact(scene)
    last_s = found.t_s - 1e-6 if isinstance(found, Contact) else end_s
    for t_s in np.linspace(0, max(last_s, 0.0), 40):
        gap_m, bounds_m = spoken_for(scene, found.certificate.intervals, t_s)
        assert bounds_m or found.t_s == 0.0 or t_s in (0.0, last_s)
        assert all(bound_m <= gap_m + 1e-11 for bound_m in bounds_m)
    proved(certificate.as_values(scene, found))


def spoken_for(scene, intervals, t_s):
    """Return the smallest gap at a time, computed by shapely, and the lowest bounds of the intervals up to then.

    A pair that repeats an earlier one has the gap of that pair, so all intervals since the start count.
    """
    chain, bounds_m, least_m, last_m = state(replace(scene, solver='march'), t_s), [], np.inf, None
    head_m = float(chain.track.distances(chain.segment, chain.u)[0])
    for one in intervals:
        least_m = min(one.bound_m, least_m if one.start_m == last_m else np.inf)
        last_m = one.stop_m
        if min(one.start_m, one.stop_m) <= head_m <= max(one.start_m, one.stop_m):
            bounds_m.append(least_m)
    return smallest(scene, t_s), bounds_m


@pytest.fixture(scope='module')
def written(tight):
    return certificate.as_values(TIGHT, tight)


@pytest.mark.parametrize('change', [{'t_s': 113.2}, {'t_s': 113.29}, {'t_s': 150.0}, {'benches': [0, 14]},
                                    {'benches': [3, 3]}, {'t_s': None}])
def test_the_checker_rejects_a_contact_that_is_none_or_not_the_first(written, change):
    values = copy.deepcopy(written)
    values['contact'].update(change)
    assert refusal(values)


@pytest.mark.parametrize(('section', 'key', 'value'), [
    ('track', 'pitch_m', 0.81), ('track', 'ratio', 1.9), ('track', 'diameter_m', 9.01), ('track', 'before_m', 99.0),
    ('head', 'speed_m_s', 0.99), ('dragon', 'width_m', 0.31), ('dragon', 'body_length_m', 2.21),
    ('run', 'start_s', 114)])
def test_the_checker_rejects_a_proof_of_another_scene(written, section, key, value):
    values = copy.deepcopy(written)
    values['scene'][section][key] = value
    assert refusal(values)


def test_benches_that_touch_from_the_start_need_no_steps_and_a_false_claim_of_none_is_refused():
    scene = replace(SCENES['loop'], track=replace(LOOP, start_m=25.0), run=Run(0, 1))
    found = first_contact(scene)
    assert (found.t_s, found.certificate.intervals) == (0, ())
    assert proved(certificate.as_values(scene, found))
    still = replace(scene, head=Head(0.0))
    values = {**certificate.as_values(still, first_contact(still)), 'contact': {'t_s': None}}
    assert refusal(values)


@pytest.mark.parametrize('knots', [((0.0, 0.0), (2.0, 0.0), (4.0, 1.0)), ((0.0, 0.0), (4.0, 1.0))])
@pytest.mark.parametrize('start_s', [0.0, 1.0])
def test_benches_that_touch_while_the_leader_still_rests_touch_from_the_start(knots, start_s):
    scene = replace(SCENES['loop'], track=replace(LOOP, start_m=25.0), run=Run(start_s, 4), head=Profile(knots))
    assert first_contact(scene).t_s == start_s


def passing(width):
    """Return a scene in which the head passes through a turn, and the nearest miss in this scene."""
    scene = Scene(dragon=Dragon(24, width_m=width), track=STurn(1.2, before_m=100.0), run=Run(113, 115))
    none = NoContact(compile_scene(scene).end, 0, Certificate())
    return scene, near_misses(scene, none, 1.0).nearest[0]


def test_what_cannot_be_told_from_a_contact_is_grazing_with_bounds():
    width, step = 0.39388385675258, 0.0
    for _ in range(5):      # the gap decreases by about three quarters per unit of width
        width += step
        scene, miss = passing(width)
        step = (miss.gap_m - 1e-12) / 0.75
        if abs(step) < 4e-13:
            break
    assert abs(miss.gap_m - 1e-12) < 1e-12
    found = first_contact(scene)
    assert isinstance(found, Contact)
    assert found.benches == miss.benches
    # The bound is the sum of the gap and the tolerance, each at most 4 x 1.6 (lever of the corners) x 2e-12 m.
    assert found.grazing_m[0] < miss.gap_m < found.grazing_m[1] < 2 * (4 * 1.6 * 2e-12)
    assert found.t_s == pytest.approx(miss.t_s, abs=1e-3)
    assert found.certificate.complete
    for t_s in np.linspace(113, found.t_s - 1e-3, 10):
        assert smallest(scene, t_s) > 0
    wider = first_contact(replace(scene, dragon=replace(scene.dragon, width_m=width + 1e-9)))
    assert (wider.benches, wider.grazing_m) == (miss.benches, None)
    narrower = first_contact(replace(scene, dragon=replace(scene.dragon, width_m=width - 1e-9)))
    assert isinstance(narrower, NoContact)


def test_looks_that_round_to_one_place_are_no_division_by_zero():
    dragon = Mixed((Group(2.323), Group(1.9, 9), Group(2.2), Group(1.9, 10)), 0.6)
    law = Profile(((0.0, 0.0), (10.0, -1.0), (19.0, 0.0), (57.0, 0.0)), 'smooth', 'tail')
    first_contact(Scene(dragon=dragon, track=STurn(diameter_m=13.76, ratio=1.14), head=law, run=Run(0, 30)))


BODY = 0.6656475528472773
SLOW = Scene(Dragon(4, BODY, BODY, 0.07223569678879954, 0.1708583716359521), Composite((
    SpiralArc(0.13740346498287273, 3.8629815801000524, 3.720325994032288, 'right'), Arc(0.7115484880164162, 180),
    Arc(0.6918192159803151, -180), Arc(0.38277113723873546, -151.32482830200112), Arc(0.2705041364243826, 90)),
    start_m=0.0661639170863419), Head(3.9546631438456665, 'tail'), Run(0, 0.8359422470506156))
RIGID = Scene(Dragon(4, 4.119728142305396, 4.119728142305396, 0.3, 1.059864071152698),
              Composite((Arc(4.0, 360.0),), 1.0),
              run=Run(0, 10))


def test_a_contact_that_closes_by_millimetres_a_metre_is_found_in_few_states():
    """A search whose steps depend only on the gap would never end: at a fixed position, its bound is too small."""
    found = first_contact(SLOW)
    assert found.benches == (1, 3)
    assert found.approach_m_s / SLOW.head.speed_m_s < 8e-3
    assert found.grazing_m is None
    assert found.certificate.complete
    assert found.states < 70
    assert smallest(SLOW, found.t_s - 1e-8) > 0 == smallest(SLOW, found.t_s + 1e-8)


def test_benches_that_keep_a_micrometre_apart_on_a_circle_are_cleared_in_few_states():
    found = first_contact(RIGID)
    assert isinstance(found, NoContact)
    assert found.certificate.complete
    assert found.states < 10
    assert min(smallest(RIGID, t_s) for t_s in (0.0, 5.0, 10.0)) == pytest.approx(1e-6, abs=1e-9)
    assert all(0 < each.bound_m < 1e-6 for each in found.certificate.intervals)


links_of = st.floats(0.3, 2.5)


@examples(30)
@given(st.integers(3, 14), links_of, links_of, st.floats(0.05, 0.5), tracks, st.sampled_from(['head', 'tail']),
       st.floats(0.05, 20), st.sampled_from([0.01, 0.1, 0.4]))
def test_no_corner_leaves_a_line_by_more_than_the_bound(benches, head, body, width, track, lead, travel_m, further_m):
    try:
        scene = Scene(Dragon(benches, 0.4 + head, 0.4 + body, width, 0.2), track, Head(1.0, lead), Run(0, 25))
        simulation = compile_scene(scene)
        domain = SearchDomain(simulation, RangeOfTravel.of(simulation), 1, lambda states: None)
        assume(travel_m + further_m < domain.stop_m)
    except DragonError:     # the dragon does not fit the track
        assume(False)
    i, j = np.triu_indices(benches, 2)
    most = np.stack(bounds_of(domain, travel_m, further_m, i, j))
    for place_m in np.linspace(travel_m, travel_m + further_m, 12)[1:-1]:
        step = 0.1 * further_m * 0.5
        before, here, after = (seen(domain, place_m + k * step, i, j) for k in (-1, 0, 1))
        second = np.max(np.hypot(*(before - 2 * here + after)), axis=-1) / step**2
        assert np.all(second <= most * (1 + 1e-6) + 5e-11 / step**2)


def bounds_of(domain, travel_m, further_m, i, j):
    chain = domain.chains(np.array([travel_m, travel_m + further_m]))
    along_m, bend = domain.track.distances(chain.segment, chain.u), domain.track.curvatures(chain.segment, chain.u)
    axis, row = axes_of(chain), np.zeros_like(i)
    ends = [link_states(along_m[[n]], chain.segment[[n]], bend[[n]], chain.headings[[n]], axis[[n]], chain.leader)
            for n in (0, 1)]
    moving = kinematics(*ends, chain.links_m, domain.track.bends, chain.leader, 0.0)
    pairs = [views(chain.p[[n]], axis[[n]], chain.headings[[n]], row, i, j) for n in (0, 1)]
    dragon = domain.dragon
    arm = np.hypot(0.5 * dragon.bench_lengths_m, 0.5 * dragon.width_m)
    return second_derivatives(moving, *pairs, row, i, j, np.full(i.size, further_m), arm)


def seen(domain, travel_m, i, j):
    """Return second benches' corners in first benches' frames, and vice versa, with coordinates along and across."""
    benches = domain.benches(travel_m)
    out = []
    for one, two in ((i, j), (j, i)):
        u, corner = benches.axis[one][:, None], benches.corners[two] - benches.centre[one][:, None]
        out.append(np.stack((np.sum(u * corner, axis=-1), u[..., 0] * corner[..., 1] - u[..., 1] * corner[..., 0])))
    return np.stack(out, axis=1)


@pytest.mark.parametrize('lead', ['head', 'tail'])
def test_on_a_circle_nothing_moves_as_benches_see_each_other(lead):
    scene = Scene(Dragon(8), Composite((Line(60.0), Arc(4.0, 700.0)), start_m=100.0), Head(1.0, lead), Run(0, 5))
    domain = SearchDomain(compile_scene(scene), RangeOfTravel(scene.head, 0.0, 5.0), 1, lambda states: None)
    assert np.max(bounds_of(domain, 0.5, 0.3, *np.triu_indices(8, 2))) < 1e-5


def motions_of(domain, travel_m, further_m, count=40):
    """Return the bounds on the travel of benches on an interval, and the sampled travel of their farthest corners."""
    intervals = conservative_advancement.ChainIntervals(domain)
    samples = intervals.sample(np.array([travel_m, travel_m + further_m]))
    places_m = np.linspace(travel_m, travel_m + further_m, count)
    corners = np.stack([domain.benches(place_m).corners for place_m in places_m])
    most = intervals._moved(samples.rows(np.array([0])), samples.rows(np.array([1])))[0]
    return most, np.max(np.sum(np.linalg.norm(np.diff(corners, axis=0), axis=-1), axis=0), axis=-1)


def domain_of(dragon, track, lead, stop_s=25.0):
    scene = Scene(dragon, track, Head(1.0, lead), Run(0, stop_s))
    travel = RangeOfTravel(scene.head, 0.0, min(stop_s, compile_scene(scene).end.t_s))
    return SearchDomain(compile_scene(scene), travel, 1, lambda states: None)


@examples(20)
@given(st.integers(3, 10), links_of, links_of, st.floats(0.05, 0.8), tracks, st.sampled_from(['head', 'tail']),
       st.floats(0.05, 20), st.sampled_from([0.01, 0.1, 0.4]))
def test_no_corner_goes_further_than_the_bound_on_its_way(benches, head, body, width, track, lead, travel_m, further_m):
    try:
        domain = domain_of(Dragon(benches, 0.4 + head, 0.4 + body, width, 0.2), track, lead)
        assume(travel_m + further_m < domain.stop_m)
    except DragonError:     # the dragon does not fit the track
        assume(False)
    most, true = motions_of(domain, travel_m, further_m)
    assert np.all(true <= most + 1e-10)


@pytest.mark.parametrize('lead', ['head', 'tail'])
@pytest.mark.parametrize('turn_deg', [700.0, -700.0])
def test_on_a_circle_the_bound_on_the_way_of_a_corner_is_within_a_hundredth(lead, turn_deg):
    track = Composite((Line(60.0), Arc(4.0, turn_deg)), start_m=100.0)
    domain = domain_of(Dragon(8, 0.5, 0.5, 1.0, 0.0), track, lead, 5)
    most, true = motions_of(domain, 0.5, 0.3)
    assert np.all((true <= most + 1e-10) & (most <= 1.01 * true))


@pytest.mark.parametrize('travel_m', [2.0, 8.0, 14.0])
def test_the_bound_on_how_corners_leave_lines_is_within_a_fifth_for_a_tenth_of_the_pairs_on_a_short_way(travel_m):
    domain = domain_of(Dragon(12), STurn(), 'head')
    i, j = np.triu_indices(12, 2)
    step = 1e-3
    most = np.stack(bounds_of(domain, travel_m - step, 2 * step, i, j))
    before, here, after = (seen(domain, travel_m + k * step, i, j) for k in (-1, 0, 1))
    second = np.max(np.hypot(*(before - 2 * here + after)), axis=-1) / step**2
    assert np.percentile(most / second, 10) <= 1.2


@pytest.mark.parametrize(('travel_m', 'track'), [(3.0, STurn()), (5.0, STurn()), (9.0, BENT)])
def test_bounds_between_states_leave_room_for_how_corners_leave_lines_and_for_hardly_more(travel_m, track):
    domain, step = domain_of(Dragon(12), track, 'head'), 1e-3
    i, j = np.triu_indices(12, 2)
    space, row = conservative_advancement.ChainIntervals(domain), np.zeros_like(i)
    ends = [space.sample(np.array([travel_m + k * step])) for k in (-1, 1)]
    bound_m, _ = space._by_acceleration(*ends, row, i, j)
    before, here, after = (seen(domain, travel_m + k * step, i, j) for k in (-1, 0, 1))
    sag_m = np.max(np.hypot(*(0.5 * (before + after) - here)), axis=-1)
    placed = [placement(*space._rectangles(end, row, i, j)) for end in ends]
    true_m, _ = parted_between(placed, tuple(sag_m))
    straight_m, _ = parted_between(placed, tuple(np.zeros_like(sag_m)))
    assert np.all(bound_m <= true_m)
    assert np.min((straight_m - bound_m) / (straight_m - true_m)) <= 1.01
