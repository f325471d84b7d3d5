"""The balls of ``ball_arithmetic``, implemented in arb at 200 bits as references for enclosures computed in floats.

An arb's radius is rounded outwards at each operation, so its enclosures are rigorous. The radius has 30 bits, so it
exceeds the exact value by about a billionth, which is less than the amount that ``Ball`` adds for its own rounding.
"""
from contextlib import contextmanager
from functools import partial
from unittest.mock import patch

import numpy as np
from flint import arb, ctx

BITS = 200


@contextmanager
def in_arb(*modules):
    """Make modules compute with these balls, except in bounds that they combine in floats."""
    before, ctx.prec = ctx.prec, BITS
    names = {'Ball': ArbBall.of, 'between': between, 'side_by_side': side_by_side, 'ABOVE': 1.0}
    patches = [patch.object(module, name, new) for module in modules for name, new in names.items()
               if hasattr(module, name)]
    try:
        for each in patches:
            each.start()
        yield
    finally:
        for each in patches:
            each.stop()
        ctx.prec = before


def upper(x):
    """Return a float that is at least |x|, or infinity if x has no finite bound."""
    most = x.abs_upper()
    return float(np.nextafter(float(most), np.inf)) if most.is_finite() else np.inf


each_upper = np.vectorize(upper, otypes=[float])
each_exact = np.vectorize(lambda x: arb(float(x)), otypes=[object])
each_ball = np.vectorize(lambda mid, rad: arb(float(mid), float(rad)) if np.isfinite(mid + rad) else arb('nan'),
                         otypes=[object])
each_mid = np.vectorize(lambda x: float(x.mid()) if x.is_finite() else np.nan, otypes=[float])


@partial(np.vectorize, otypes=[object])
def _inverse(x):
    """Return the reciprocal, computed by the formula of ``Ball`` because arb's own radius may be larger."""
    mid, rad = abs(x.mid()), x.rad()
    return 1 / x.mid() + arb(0, 1) * rad / (mid * (mid - rad)) if mid > rad else arb('nan')


@partial(np.vectorize, otypes=[object, object])
def _trig(x):
    """Return sine and cosine, computed by the formulas of ``Ball``."""
    mid, rad, some = x.mid(), x.rad(), arb(0, 1)
    sin, cos, bow = mid.sin(), mid.cos(), rad * rad / 2
    return sin + some * (abs(cos) * rad + bow), cos + some * (abs(sin) * rad + bow)


class ArbBall:
    """An array of arbs with the interface of ``Ball``."""

    __array_ufunc__ = None

    def __init__(self, values):
        self.values = values

    @classmethod
    def of(cls, mid, rad):
        return cls(each_ball(*np.broadcast_arrays(mid, rad)))

    @property
    def mid(self):
        return each_mid(self.values)

    @property
    def rad(self):
        return each_upper(self.values - each_exact(self.mid))

    @property
    def most(self):
        return each_upper(self.values)

    def __add__(self, other):
        return ArbBall(self.values + values_of(other))

    def __mul__(self, other):
        return ArbBall(self.values * values_of(other))

    def __neg__(self):
        return ArbBall(-self.values)

    def __sub__(self, other):
        return ArbBall(self.values - values_of(other))

    __radd__, __rmul__ = __add__, __mul__

    def __getitem__(self, index):
        return ArbBall(self.values[index])

    def inverse(self):
        return ArbBall(_inverse(self.values))

    def squared(self):
        return ArbBall(self.values * self.values)

    def sin_cos(self):
        return tuple(map(ArbBall, _trig(self.values)))

    def running_product(self):
        return ArbBall(np.multiply.accumulate(self.values, axis=-1, dtype=object))

    def running_sum(self):
        return ArbBall(np.add.accumulate(self.values, axis=-1, dtype=object))


def values_of(number):
    return number.values if isinstance(number, ArbBall) else each_exact(number)


def between(a, b, error=0.0):
    low, high, error = (each_exact(np.asarray(x, dtype=float)) for x in np.broadcast_arrays(a, b, error))
    return ArbBall(np.vectorize(lambda x, y, e: (x + y) / 2 + arb(0, 1) * (abs(x - y) / 2 + e), otypes=[object])(
        low, high, error))


def side_by_side(balls):
    return ArbBall(np.concatenate([ball.values for ball in balls], axis=-1))
