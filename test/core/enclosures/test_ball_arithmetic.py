"""The result of each operation on balls contains arb's result at 200 bits, since floats are rounded outwards."""
import numpy as np
import pytest
from arb_balls import ArbBall, each_exact, each_upper, in_arb
from properties import thinned

from dragon_ros.core.enclosures.ball_arithmetic import LEAST, OUTWARDS, Ball, between

COUNT = 3000
OPERATIONS = {
    'sum': lambda x, y: x + y, 'difference': lambda x, y: x - y, 'product': lambda x, y: x * y,
    'sum with a number': lambda x, y: x + 0.3, 'product with a number': lambda x, y: 0.7 * x,
    'inverse': lambda x, y: x.inverse(), 'square': lambda x, y: x.squared(), 'sine': lambda x, y: x.sin_cos()[0],
    'cosine': lambda x, y: x.sin_cos()[1],
    'running sum': lambda x, y: x.running_sum(), 'running product': lambda x, y: x.running_product()}


def random_balls(seed, scale):
    """Return balls of both signs and many magnitudes, with radii from the least possible to the size of the centre."""
    dice = np.random.default_rng(seed)
    mid = dice.choice((-1, 1), (COUNT // 20, 20)) * 10 ** dice.uniform(-scale, scale, (COUNT // 20, 20))
    return Ball(mid, OUTWARDS * np.abs(mid) * 10 ** dice.uniform(np.log10(LEAST), 0, mid.shape))


@pytest.mark.parametrize('name', OPERATIONS)
@pytest.mark.parametrize('scale', thinned([0.05, 3], lambda scale: scale == 3))
def test_an_operation_holds_what_it_does_in_exact_arithmetic(name, scale):
    x, y = random_balls(1, scale), random_balls(2, scale)
    with np.errstate(all='ignore'):
        mine = OPERATIONS[name](x, y)
    with in_arb():
        exact = OPERATIONS[name](*(ArbBall.of(each.mid, each.rad) for each in (x, y)))
        known = np.isfinite(mine.rad) & np.isfinite(mine.mid)
        off = each_upper(exact.values[known] - each_exact(mine.mid[known]))
    assert np.count_nonzero(known) > COUNT // 3
    assert np.all(off <= mine.rad[known])
    assert np.all(mine.rad[known] >= LEAST * np.abs(mine.mid[known]))


def test_running_sums_and_products_go_along_the_last_axis_of_any_array():
    x = random_balls(7, 0.05)
    cube = Ball(x.mid.reshape(5, 30, 20), x.rad.reshape(5, 30, 20))
    for name in ('running_sum', 'running_product'):
        flat, deep = getattr(x, name)(), getattr(cube, name)()
        assert np.array_equal(deep.mid.reshape(flat.mid.shape), flat.mid)
        assert np.array_equal(deep.rad.reshape(flat.rad.shape), flat.rad)


@pytest.mark.parametrize('error', [0.0, 1e-9])
def test_all_numbers_between_two_are_held(error):
    a, b = (random_balls(seed, 2).mid for seed in (3, 4))
    mine = between(a, b, error)
    with in_arb():
        for end in (a, b):
            assert np.all(each_upper(each_exact(end) - each_exact(mine.mid)) + error <= mine.rad * (1 + 1e-15))
