"""The first contact is proved: the bound of every interval holds, and the checker rejects every forgery."""
import copy
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from certificates import proved, refusal
from properties import thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Certificate, Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.near_misses import near_misses
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes import certificate
from dragon_ros.scenes.load import load_scene

CLASSIC = Scene(solver='march')


@cache
def contact():
    return first_contact(CLASSIC)


def test_the_classic_run_in_is_proved_with_few_looks():
    assert isinstance(contact(), Contact)
    assert contact().t_s == pytest.approx(412.473837682115, abs=1e-9)
    assert contact().approach_m_s == pytest.approx(0.0263, abs=1e-4)
    assert contact().uncertainty_s == pytest.approx(2.32e-10, rel=0.01)
    assert contact().certificate.complete
    assert contact().states < 190
    assert contact().grazing_m is None
    seen = contact().witness
    assert (seen.owner, seen.corner, seen.other, seen.edge) == (0, 'front left', 8, 'right')
    assert contact().simultaneous == ()


def test_the_certificate_joins_from_the_start_to_a_nanometre_before_the_contact():
    parts = contact().certificate.intervals
    assert all(before.stop_m == after.start_m for before, after in pairwise(parts))
    assert parts[0].start_m == pytest.approx(0.0, abs=1e-12)
    assert 0 < contact().t_s - parts[-1].stop_m <= 1e-9


@pytest.mark.parametrize('scene', [Scene(run=Run(400.0)), Scene(load_scene('mixed').dragon, run=Run(390.0)), Scene(
    Dragon(30, 0.9, 2.9, 0.2), Spiral(0.55, 4.28), Head(-1.0), Run(0, 5))], ids=['classic', 'mixed', 'out'])
def test_no_gap_is_below_the_lowest_bound_up_to_its_place(scene):
    """A pair that repeats an earlier one has the gap of that pair, so the bounds of all earlier intervals count."""
    found, least_m = first_contact(scene), np.inf
    i, j = np.triu_indices(scene.dragon.benches, 2)
    for one in found.certificate.intervals:
        least_m = min(least_m, one.bound_m)
        for along_m in np.linspace(one.start_m, one.stop_m, 3):
            chain = compile_scene(scene).model.march(along_m)
            benches = benches_of(chain, scene.dragon, axes_of(chain))
            assert np.min(gaps(benches, i, j)) >= least_m - 2e-12


def test_the_corner_meets_bench_8_where_the_true_figures_say():
    chain = state(CLASSIC, contact().t_s)
    benches = benches_of(chain, CLASSIC.dragon, axes_of(chain))
    along = (np.array(contact().point_m) - benches.centre[8]) @ benches.axis[8]
    assert along == pytest.approx(-0.265180642799, abs=1e-9)
    assert contact().point_m == pytest.approx((1.474394671648, 2.110664876932), abs=1e-9)


def test_near_misses_are_reported_on_request():
    first, second, *_ = near_misses(CLASSIC, contact(), 0.01).nearest
    assert (first.bench, second.bench) == (11, 9)
    assert first.gap_m == pytest.approx(0.865235e-3, abs=1e-9)
    assert first.t_s == pytest.approx(409.831989, abs=2e-5)
    assert second.gap_m == pytest.approx(2.957e-3, abs=1e-6)


def test_a_run_that_ends_in_the_lock_is_proved_too():
    found = first_contact(Scene(dragon=Dragon(width_m=0.01)))
    assert isinstance(found, NoContact)
    assert found.end.reason == 'lock'
    assert found.certificate.complete


def nearest(width):
    """Return the near miss between the head and bench 11 near 409.83 s."""
    scene = Scene(dragon=Dragon(20, width_m=width), run=Run(409.5, 410.2))
    none = NoContact(compile_scene(scene).end, 0, Certificate())
    return next(miss for miss in near_misses(scene, none, 0.01).nearest if miss.bench == 11)


@pytest.mark.parametrize(('wanted', 'grazes'), thinned([(1e-12, True), (1e-10, False)], lambda case: case[1]))
def test_a_gap_within_what_positions_may_err_is_grazing_with_both_bounds(wanted, grazes):
    width, step = 0.30097406879637, 0.0
    for _ in range(5):      # the gap decreases by slightly more than one per unit of width
        width += step
        step = nearest(width).gap_m - wanted
        if abs(step) < 1e-13:
            break
    assert abs(step) < 1e-13
    found = first_contact(Scene(dragon=Dragon(20, width_m=width), run=Run(409.5, 410.2)))
    if grazes:
        assert isinstance(found, Contact)
        assert found.benches == (0, 11)
        # The bound is the sum of the gap and the tolerance, each at most 4 x 1.54 (lever of the corners) x 2e-12 m.
        assert found.grazing_m[0] < 0 < found.grazing_m[1] < 2 * (4 * 1.54 * 2e-12)
        assert found.t_s == pytest.approx(nearest(width).t_s, abs=1e-4)
    else:
        assert isinstance(found, NoContact)


def test_all_that_touches_at_the_start_is_one_set():
    scene = Scene(dragon=Dragon(100), track=Spiral(0.28))
    found = first_contact(scene)
    assert found.t_s == 0.0
    chain = state(scene, 0.0)
    benches = benches_of(chain, scene.dragon, axes_of(chain))
    i, j = np.triu_indices(100, 2)
    touching = set(zip(i[gaps(benches, i, j) <= 0], j[gaps(benches, i, j) <= 0], strict=True))
    assert {found.benches, *found.simultaneous} == touching
    assert len(touching) > 10


SHORT = Scene(dragon=Dragon(12), run=Run(411.5, 413.0))


@pytest.fixture(scope='module')
def written():
    return certificate.as_values(SHORT, first_contact(SHORT))


def test_the_checker_accepts_what_the_solver_proved(written):
    assert proved(written)


@pytest.mark.parametrize('change', [{'t_s': 412.4}, {'t_s': 412.6}, {'t_s': 500.0}, {'benches': [0, 9]},
                                    {'benches': [3, 3]}, {'t_s': None}])
def test_the_checker_rejects_a_contact_that_is_none_or_not_the_first(written, change):
    values = copy.deepcopy(written)
    values['contact'].update(change)
    assert refusal(values)


EVERY_KIND = {
    'body out': Scene(dragon=Dragon(30, 0.9, 2.9, 0.2), track=Spiral(0.55, 4.28), head=Head(-1.0), run=Run(0, 5)),
    'body in': Scene(dragon=Dragon(30, 0.9, 2.9, 0.2), track=Spiral(0.55, 4.28), run=Run(0, 5)),
    'body from afar': Scene(dragon=Dragon(30, 0.9), run=Run(420.0)),
    'lock': Scene(dragon=Dragon(12, width_m=0.01), run=Run(425.0)),
    'lock of a joined head': Scene(dragon=Dragon(6, 0.6, 1.5, 0.02), track=Spiral(0.9, 1.5)),
    'centre': Scene(dragon=Dragon(6, 0.8, 0.8, 0.02), track=Spiral(0.55, 1.5), head=Head(3.0)),
    'at the start': Scene(run=Run(413.0)),
    'two benches': Scene(dragon=Dragon(2))}


@pytest.mark.parametrize('name', thinned(EVERY_KIND, (
    'body from afar', 'lock of a joined head', 'centre').__contains__))     # the others are in test/verify, too
def test_the_checker_accepts_every_kind_of_certificate(name):
    scene = EVERY_KIND[name]
    found = first_contact(scene)
    assert found.certificate.complete
    values = certificate.as_values(scene, found)
    assert proved(values)


def test_a_contact_at_the_start_has_no_intervals_but_states_the_gap():
    scene = Scene(run=Run(413.0))
    found = first_contact(scene)
    assert found.certificate.intervals == ()
    assert found.witness.gap_m == pytest.approx(-0.01117, abs=1e-5)
