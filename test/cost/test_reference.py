"""The reference of ``cost --scene`` agrees with 50 digits in every hard case, and with mpmath in the same process."""
import importlib
import json
from decimal import Context, Decimal, localcontext
from pathlib import Path

import mpmath
import numpy as np
import pytest
from properties import thinned

import hard_cases.truth
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import DragonError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral
from dragon_ros.cost.reference import chain_at, cos_sin, reference
from hard_cases import hard_cases as all_cases

FOLDER = Path(hard_cases.truth.__file__).parent
TRUTH = json.loads((FOLDER / 'reference.json').read_text())['problems']
CASES = {case.name: case for case in all_cases()}
LAST_DIGIT = Decimal('1e-24')       # relative error of the values in the files, which have 25 digits
MOST = 1001                         # number of handles of the longest dragon
DIGITS = 60


def digits(case, t_s):
    with localcontext(Context(prec=DIGITS)):
        return chain_at(case.scene, t_s, MOST)


def far(vectors):
    return max(max(abs(x), abs(y)) for x, y in vectors)


@pytest.mark.parametrize('name', thinned(
    CASES, lambda name: [*CASES].index(name) % 3 == 1
    and name not in ('most-benches', 'longest-chain', 'law', 'turning')))
def test_every_hard_case_is_met_to_the_last_digit_of_its_file(name):
    case, row = CASES[name], TRUTH[name]
    for t_s, wanted in zip(row['times_s'], row['states'], strict=True):
        found = digits(case, t_s)
        with localcontext(Context(prec=DIGITS)):
            known = [(k, n) for n, k in enumerate(row['handles']) if k < len(found)]
            size = far(found[k][:2] for k, _ in known)
            for k, n in known:
                x, y, vx, vy = found[k]
                off = (x - Decimal(wanted['x'][n])), (y - Decimal(wanted['y'][n]))
                assert far([off]) <= LAST_DIGIT * size
                if 'speed' in wanted:
                    speed = Decimal(wanted['speed'][n])
                    assert abs((vx * vx + vy * vy).sqrt() - abs(speed)) <= LAST_DIGIT * (1 + abs(speed))
                else:
                    off = (vx - Decimal(wanted['vx'][n])), (vy - Decimal(wanted['vy'][n]))
                    assert far([off]) <= LAST_DIGIT * (1 + far([(vx, vy)]))


@pytest.mark.parametrize('name', thinned(['wiggle', 'spirals', 'law', 'unwinding', 'far-joined', 'lock-1e-4'],
                                         ('wiggle', 'spirals', 'far-joined').__contains__))
def test_mpmath_at_50_digits_agrees_to_40(name):
    walk = importlib.import_module('hard_cases.make_reference')
    case = CASES[name]
    t_s = case.times_s[-1]
    with mpmath.workdps(65):
        wanted = walk.chain_at(case.scene, t_s)[:40]
        found = digits(case, t_s)
        size = max(abs(point) for point, _ in wanted)
        for (x, y, vx, vy), (point, velocity) in zip(found, wanted, strict=False):
            assert abs(mpmath.mpc(str(x), str(y)) - point) < mpmath.mpf(10) ** -40 * size
            assert abs(mpmath.mpc(str(vx), str(vy)) - velocity) < mpmath.mpf(10) ** -40 * (1 + abs(velocity))


@pytest.mark.parametrize('angle', ['0', '1e-30', '0.7853981', '1.5707963267948966', '-2.5', '6283185307.17958'])
def test_cosine_and_sine_have_45_digits_up_to_a_billion_turns(angle):
    with mpmath.workdps(80), localcontext(Context(prec=DIGITS)):
        wanted = mpmath.cos(mpmath.mpf(angle)), mpmath.sin(mpmath.mpf(angle))
        for found, value in zip(cos_sin(Decimal(angle)), wanted, strict=True):
            assert abs(mpmath.mpf(str(found)) - value) < mpmath.mpf(10) ** -45


def test_a_reference_is_rounded_once_to_double_doubles():
    case = CASES['classic']
    one, exact = reference(case.scene, 300.0), digits(case, 300.0)
    with localcontext(Context(prec=DIGITS)):
        for k, (x, y, vx, vy) in enumerate(exact):
            for n, value in enumerate((x, y)):
                assert one.high[k, n] == float(value)
                assert abs(Decimal(one.high[k, n]) + Decimal(one.low[k, n]) - value) <= abs(value) * Decimal('1e-31')
            assert one.velocity_m_s[k].tolist() == [float(vx), float(vy)]
    assert one.error_m(one.high) < 1e-15
    moved = one.high.copy()
    moved[100, 0] += 3e-9
    assert one.error_m(moved) == pytest.approx(3e-9, rel=1e-6)


def test_fewer_handles_are_the_first_ones():
    scene = Scene()
    few, every = reference(scene, 60.0, 11), reference(scene, 60.0)
    assert np.array_equal(few.high, every.high[:11])


def test_a_track_begins_where_its_first_piece_says():
    pieces = Line(5.0), Arc(4.0, 90.0), Line(9.0)
    placed = Line(5.0, (3.0, -2.0), 90.0), *pieces[1:]
    here, there = (reference(Scene(track=Composite(each), run=Run(0, 9)), 9.0) for each in (pieces, placed))
    turned = np.stack((3.0 - here.high[:, 1], here.high[:, 0] - 2.0), axis=1)
    assert np.allclose(there.high, turned, rtol=0, atol=1e-12)


def test_a_chain_beyond_its_lock_is_refused():
    with pytest.raises(DragonError, match='the reference cannot place a link'):
        reference(Scene(track=Spiral(0.55, 16.0), head=Head(1.0)), 433.5)
