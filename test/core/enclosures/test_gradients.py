"""Enclosures of values and first derivatives contain all samples in a box, and are tight in a small box."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.enclosures.gradients import Graded, Vector, polar, variables

# Each formula twice, for boxes and for plain numbers; complex steps yield its derivatives without cancellation.
FORMULAS = {
    'sum': (lambda x, y: x + y, lambda x, y: x + y),
    'difference': (lambda x, y: x - y, lambda x, y: x - y),
    'negative': (lambda x, y: -x, lambda x, y: -x),
    'product': (lambda x, y: x * y, lambda x, y: x * y),
    'square': (lambda x, y: y * y, lambda x, y: y * y),
    'multiple': (lambda x, y: y.times(-3.5), lambda x, y: -3.5 * y),
    'reciprocal': (lambda x, y: x.inverse(), lambda x, y: 1 / x),
    'quotient': (lambda x, y: y * x.inverse(), lambda x, y: y / x),
    'east': (lambda x, y: polar(x, y).x, lambda x, y: x * np.cos(y)),
    'north': (lambda x, y: polar(x, y).y, lambda x, y: x * np.sin(y)),
    'left': (lambda x, y: Vector(x, y).left().x, lambda x, y: -y),
    'left of it': (lambda x, y: Vector(x, y).left().y, lambda x, y: x),
    'longer': (lambda x, y: (Vector(x, y) * y).x, lambda x, y: x * y),
    'further east': (lambda x, y: (Vector(x, y) + Vector(y, y)).x, lambda x, y: x + y),
    'further north': (lambda x, y: (Vector(x, y) + Vector(y, y)).y, lambda x, y: 2 * y),
    'less east': (lambda x, y: (Vector(x, y) - Vector(y, x)).x, lambda x, y: x - y),
    'less north': (lambda x, y: (Vector(x, y) - Vector(y, x)).y, lambda x, y: y - x),
    'along': (lambda x, y: Vector(x, y).seen_along(Vector(y, x)).x, lambda x, y: 2 * x * y),
    'across': (lambda x, y: Vector(x, y).seen_along(Vector(y, x * x)).y, lambda x, y: y * y - x * x * x),
}
BOX = st.tuples(st.floats(0.3, 3), st.floats(0.1, 1.4), st.floats(0, 0.1), st.floats(0, 0.1))


def box_of(x, y, wide, tall):
    return np.array([[x - wide], [y - tall]]), np.array([[x + wide], [y + tall]])


def true(name, x, y):
    """Return the value of a formula and its derivatives with respect to both variables."""
    _, plain = FORMULAS[name]
    step = 1e-30
    return (plain(x, y) + 0.0 * x, np.imag(plain(x + 1j * step, y + 0j)) / step + 0.0 * x,
            np.imag(plain(x + 0j, y + 1j * step)) / step + 0.0 * x)


def parts(graded: Graded):
    """Return the balls of the value and of both slopes, each as (middle, radius)."""
    slopes = zip(graded.slope.mid[:, 0], graded.slope.rad[:, 0], strict=True)
    return [(graded.value.mid[0], graded.value.rad[0]), *slopes]


@pytest.mark.parametrize('name', FORMULAS)
@given(box=BOX, seed=st.integers(0, 2**32 - 1))
@examples(20)
def test_values_and_slopes_hold_all_in_the_box(name, box, seed):
    low, high = box_of(*box)
    found = parts(FORMULAS[name][0](*variables(low, high)))
    share = np.vstack((np.random.default_rng(seed).random((20, 2)), [[0, 0], [0, 1], [1, 0], [1, 1]]))
    for (middle, radius), values in zip(found, true(name, *(low.T + share * (high - low).T).T), strict=True):
        assert np.all(np.abs(values - middle) <= radius + 1e-14)


@pytest.mark.parametrize('name', FORMULAS)
@pytest.mark.parametrize('place', [(0.7, 0.4), (2.1, 1.1)])
def test_on_a_small_box_they_hold_no_more_than_a_stated_factor_of_what_occurs(name, place):
    low, high = box_of(*place, 1e-4, 1e-4)
    found = parts(FORMULAS[name][0](*variables(low, high)))
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    seen = true(name, *(low.T + corners * (high - low).T).T)
    for (middle, radius), values, factor in zip(found, seen, (1.67, 2.0, 2.0), strict=True):
        assert radius <= factor * 0.5 * np.ptp(values) + 1e-8
        assert middle == pytest.approx(0.5 * (np.min(values) + np.max(values)), abs=1e-6)


def test_where_zero_may_be_among_the_numbers_nothing_is_known_of_the_reciprocal():
    x, _ = variables(np.array([[-0.1], [1.0]]), np.array([[0.2], [1.0]]))
    with np.errstate(invalid='ignore'):
        found = x.inverse()
    assert np.isinf(found.value.rad[0])
    assert not found.slope.rad[0, 0] < np.inf


def test_slopes_of_the_variables_are_one_by_themselves_and_nothing_by_the_others():
    for number, one in enumerate(variables(np.zeros((3, 2)), np.ones((3, 2)))):
        assert np.array_equal(one.slope.mid, np.eye(3)[number][:, None] * np.ones(2))
        assert np.all(one.slope.rad < 1e-9)
