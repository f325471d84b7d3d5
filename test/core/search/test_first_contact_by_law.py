"""On one spiral the first contact is proved for every head law, and behind a leading tail."""
import copy
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from apart import smallest
from certificates import proved, refusal
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.search_domain import RangeOfTravel
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes import certificate
from dragon_ros.scenes.load import load_scene

OUT_AND_IN = Profile(((0.0, 0.0), (5.0, -1.0), (15.0, -1.0), (25.0, 1.0), (60.0, 1.0)), 'smooth')
CROSSING = Dragon(14, 0.9, 2.9, 0.2)       # at 4.28 turns, the head is between two positions at which the body touches
SCENES = {
    'steady': Scene(run=Run(405, 413), head=Profile(((0.0, 1.0),))),
    'out and in': Scene(track=Spiral(0.55, 5.0), head=OUT_AND_IN, run=Run(2, 200)),
    'in, then out to the contact': Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), run=Run(0, 9),
                                         head=Profile(((0.0, 0.3), (1.0, -1.0), (9.0, -1.0)))),
    'tail': Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), head=Head(1.0, 'tail'), run=Run(0, 5)),
    'unwinding': load_scene('unwinding', ['run.stop_s=40', 'dragon.benches=40']),
    'lock': Scene(dragon=Dragon(12, width_m=0.01), head=Profile(((0.0, 1.0),)), run=Run(425.0)),
    'rest': Scene(dragon=Dragon(30), head=Head(0.0), run=Run(0, 5))}


@cache
def answer(name):
    return first_contact(SCENES[name])


@pytest.mark.parametrize('name', thinned(SCENES, ('tail', 'lock', 'rest').__contains__))
def test_every_law_on_a_spiral_has_a_certificate_that_holds(name):
    found = answer(name)
    assert found.certificate.complete
    assert bool(found.certificate.intervals) == (name != 'rest')
    assert proved(certificate.as_values(SCENES[name], found))
    assert isinstance(found, NoContact if name in ('unwinding', 'lock', 'rest') else Contact)


def test_a_law_changes_when_and_not_where():
    proved, steady = first_contact(Scene(run=Run(405, 413))), answer('steady')
    assert steady.t_s == pytest.approx(proved.t_s, abs=1e-12)
    assert (steady.benches, steady.witness.corner) == (proved.benches, proved.witness.corner)
    assert steady.approach_m_s == pytest.approx(proved.approach_m_s, rel=1e-9)
    slower = first_contact(Scene(run=Run(810, 826), head=Profile(((0.0, 0.5),))))
    assert slower.t_s == pytest.approx(2 * proved.t_s, abs=1e-11)
    assert slower.approach_m_s == pytest.approx(0.5 * proved.approach_m_s, rel=1e-9)


def test_behind_a_tail_the_contact_is_where_the_head_meets_it_moving_out():
    led, tail = SCENES['tail'], answer('tail')
    head = first_contact(Scene(dragon=led.dragon, track=led.track, head=Head(-1.0), run=Run(0, 5)))
    assert (tail.benches, tail.witness.corner) == (head.benches, head.witness.corner)
    assert tail.point_m == pytest.approx(head.point_m, abs=1e-9)
    step = 1e-7
    slope = (smallest(led, tail.t_s - 2 * step) - smallest(led, tail.t_s - step)) / step
    assert tail.approach_m_s == pytest.approx(slope, rel=1e-4)


@examples(15)
@given(st.integers(3, 10), st.floats(0.1, 3), st.floats(0.1, 3), st.floats(0.02, 0.5), st.floats(0.3, 1.5),
       st.floats(0.6, 8), st.lists(st.tuples(st.floats(0.1, 5), st.floats(-2, 2)), min_size=1, max_size=4),
       st.sampled_from(['linear', 'smooth']), st.sampled_from(['head', 'tail']), st.floats(0, 3))
def test_nothing_touches_before_the_contact_whatever_the_law(benches, head, body, width, pitch, turns, rows, ramps,
                                                             lead, start_s):
    times = np.cumsum([0.0, *(gap for gap, _ in rows)]).tolist()
    law = Profile(tuple(zip(times, [0.5, *(speed for _, speed in rows)], strict=True)), ramps, lead)
    try:
        scene = Scene(Dragon(benches, 0.4 + head, 0.4 + body, width, 0.2), Spiral(pitch, turns), law,
                      Run(start_s, start_s + 12.0))
        end_s = compile_scene(scene).end.t_s
    except DragonError:      # the dragon does not fit the track
        assume(False)
    found = first_contact(scene)
    before_s = found.t_s - 1e-6 if isinstance(found, Contact) else end_s - 1e-6
    assert all(smallest(scene, t_s) > 0 for t_s in np.linspace(start_s, before_s, 40) if before_s > start_s)
    if isinstance(found, Contact) and not found.grazing_m:
        assert smallest(scene, found.t_s) < 1e-9
    if found.certificate.complete:
        proved(certificate.as_values(scene, found))


@pytest.fixture(scope='module')
def written():
    name = 'in, then out to the contact'
    return certificate.as_values(SCENES[name], answer(name))


@pytest.mark.parametrize(('key', 'value'), [('knots', [[0.0, 0.3], [1.0, -1.0], [9.0, -1.1]]),
                                            ('knots', [[0.0, 0.5], [1.0, -1.0], [9.0, -1.0]]), ('lead', 'tail')])
def test_the_checker_follows_the_law_itself(written, key, value):
    values = copy.deepcopy(written)
    values['scene']['head'][key] = value
    assert refusal(values)


@examples(40)
@given(st.lists(st.tuples(st.floats(0, 5), st.floats(-2, 2)), min_size=1, max_size=5), st.sampled_from(
    ['linear', 'smooth']), st.floats(0, 10), st.floats(0, 10), st.floats(0, 1))
@example([(1.0, -1.0), (0.0, 1.0)], 'linear', 0.0, 5.0, 1.0)
def test_a_range_of_travel_finds_first_arrivals(rows, ramps, start_s, run_s, share):
    times = np.cumsum([0.0, *(gap for gap, _ in rows)]).tolist()
    law = Profile(tuple(zip(times, [0.5, *(speed for _, speed in rows)], strict=True)), ramps)
    scene = Scene(Dragon(3), Spiral(0.55, 700.0), law, Run(start_s, start_s + run_s))
    course = RangeOfTravel(law, start_s, compile_scene(scene).end.t_s)
    here = course.travel_m(start_s)
    ends = [course.travel_m(course.farthest_s(sense)) for sense in (-1, 1)]
    scanned = [course.travel_m(t_s) for t_s in np.linspace(start_s, compile_scene(scene).end.t_s, 200).tolist()]
    assert ends[0] <= min(scanned) <= max(scanned) <= ends[1]
    for sense, end in zip((-1, 1), ends, strict=True):
        wanted = here + share * (end - here)
        t_s = course.arrival_s(wanted, sense)
        assert course.travel_m(t_s) == pytest.approx(wanted, abs=1e-9)
        assert all(sense * (course.travel_m(t) - wanted) <= 1e-9 for t in np.linspace(start_s, t_s, 20).tolist())


def test_what_is_cleared_on_both_ways_starts_at_one_place():
    found = answer('in, then out to the contact')
    head = found.certificate.intervals
    turns = [n for n, (one, other) in enumerate(pairwise(head)) if one.stop_m != other.start_m]
    assert len(turns) == 1
    assert head[0].start_m == head[turns[0] + 1].start_m
