"""How far corners of benches deviate from straight lines while a spiral's pitch changes at a constant head radius.

In units of b (see ``min_pitch``), a smaller pitch makes the chain larger: its size is multiplied by ``scale``, with
handle 0 at theta = scale r. A prime denotes scale times the derivative with respect to the scale, and two primes denote
scale^2 times the second derivative, so c' = c and c'' = 0, and the leading handle has p = theta' = theta and a =
theta'' = 0. Let m = theta - p, which is 0 for the leading handle. Then F = c^2 / 2 gives

    delta'  = (delta^2 + (1 - cos delta) (theta delta + (2 theta + delta) m)) / F_delta,
    m_next  = (1 + d1) m + theta (theta + delta) delta sin delta / F_delta,
    delta'' = d1 a + (delta^2 + 2 (1 - cos delta) (theta delta + m (2 theta - m)) - 2 F_td p delta' - F_dd delta'^2)
              / F_delta,

where no large terms cancel, because c^2 was replaced by 2 F. The link's direction is theta + psi, where, as in
``on_spiral``,

    psi' = delta' / 2 + N / c^2,     N = sin delta (delta p - theta delta') + (theta + delta / 2) delta delta',
    psi'' = delta'' / 2 + (N' - 2 N) / c^2.

A handle turns by p, the sum of theta_0 and the delta' of all links before it; theta_0 is common to all handles and
cancels in differences.

The ranges of theta and delta follow from the assumption that the product of every curvature and every link is below 2,
so that 1 + d1 > 0 and delta < pi. Each theta increases with r and with the scale (p_next = (1 + d1) p + c^2 / F_delta).
The formula above gives m >= 0, so delta increases with the scale; delta decreases as r increases (docs/contact.md,
lemma 1). Over a rectangle of r and scale, theta is therefore smallest where both are smallest and largest where both
are largest; delta is smallest at the largest r and smallest scale, and largest at the opposite corner.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import Ball, side_by_side
from dragon_ros.core.enclosures.on_spiral import Spans, SpiralMotion, corners, spans
from dragon_ros.core.numerics.types import Floats


def bend_by_scale(theta: Ball, delta: Ball, chord: Ball, arm: Floats) -> Floats:
    """Return bounds, as ``bend`` does, on scale^2 times second derivatives with respect to the scale, in units of b."""
    with np.errstate(all='ignore'):
        return corners(_motion(theta, delta, chord), arm, growth=1.0)


@dataclass(frozen=True)
class _Growth:
    """The values of m and a for handles (M, K+1), and of delta' and delta'' for links (M, K)."""

    m: Ball
    a: Ball
    delta_1: Ball
    delta_2: Ball


def _growth(link: Spans) -> _Growth:
    theta, delta, both = link.theta, link.delta, link.both
    ratio = 1 + link.delta_1
    m = _carried(ratio, link.area * delta * link.sin * link.inverse)
    late = m[:, :-1]
    one = (delta.squared() + link.less * (theta * delta + both * late)) * link.inverse
    mixed, square = link.less + both * link.sin, 1 + 2 * theta * link.sin + link.area * link.cos
    pull = (delta.squared() + 2 * link.less * (theta * delta + late * (2 * theta - late))
            - 2 * mixed * (theta - late) * one - square * one.squared()) * link.inverse
    a = _carried(ratio, pull)
    return _Growth(m, a, one, link.delta_1 * a[:, :-1] + pull)


def _carried(ratio: Ball, added: Ball) -> Ball:
    """Return y (M, K+1) with y[0] = 0 and y[m+1] = ratio[m] y[m] + added[m]."""
    after = ratio.running_product()
    return _from_nothing(after * (added * after.inverse()).running_sum())


def _from_nothing(ball: Ball) -> Ball:
    none = np.zeros_like(ball.mid[:, :1])
    return side_by_side([Ball(none, none), ball])


def _motion(theta: Ball, delta: Ball, chord: Ball) -> SpiralMotion:
    link = spans(theta, delta)
    grown = _growth(link)
    late, one, two = grown.m[:, :-1], grown.delta_1, grown.delta_2
    p, half, rest = link.theta - late, 0.5 * link.both, link.theta * (delta - one) - delta * late
    turns = link.sin * rest + half * delta * one
    rate = (link.cos * one * rest + link.sin * (delta * grown.a[:, :-1] - link.theta * two)
            + (p + 0.5 * one) * delta * one + half * (one.squared() + delta * two))
    share, turned = chord.squared().inverse(), _from_nothing(one.running_sum())
    w = turned[:, :-1] + 0.5 * one + share * turns
    return SpiralMotion(theta, theta - grown.m, grown.a, turned, w,
                        grown.a[:, :-1] + 0.5 * two + share * (rate - 2 * turns))
