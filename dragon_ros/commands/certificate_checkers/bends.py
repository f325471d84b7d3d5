"""Second derivatives of corners over a stretch, in intervals; for the checker of certificates alone."""
import numpy as np

from dragon_ros.commands.certificate_checkers.intervals import Interval
from dragon_ros.core.numerics.types import Floats


def bends_of(angle: Interval, span: Interval, chord: Floats, arm: Floats) -> list[Floats]:
    """Return bounds of the second derivatives of corners, (K-2,) in the leading bench's frame and in the others'.

    ``angle`` (K+1,) has the handles' polar angles, ``span`` (K,) what links span, ``chord`` and ``arm`` (K,) are links
    and half diagonals in units of b, as are the bounds, per square radian of the leading handle's angle.
    Infinite where nothing is known.
    """
    with np.errstate(all='ignore'):
        bends = _corners(*_handles(angle, span, chord), arm)
    return [np.where(np.isfinite(bend), bend, np.inf) for bend in bends]


def _corners(angle: Interval, p: Interval, a: Interval, turn: Interval, turn_2: Interval, arm: Floats) -> list[Floats]:
    w = p[:-1] * (turn + 1)
    w_2 = a[:-1] * (turn + 1) + p[:-1].square() * turn_2
    in_lead = _bends(angle, p, a, w[:1], w_2[:1])
    one = 0.5 * (in_lead[0] + in_lead[1] + in_lead[2:-1] + in_lead[3:])
    pieces = [_bends(angle[part], p[part], a[part], w[2:], w_2[2:])
              for part in (slice(0, 1), slice(1, 2), slice(2, -1), slice(3, None))]
    spin = np.hypot((w_2[2:] - w_2[:1]).size, (w[2:] - w[:1]).square().size)
    return [one + arm[2:] * spin, 0.5 * (pieces[0] + pieces[1] + pieces[2] + pieces[3]) + arm[0] * spin]


def _bends(angle: Interval, p: Interval, a: Interval, w: Interval, w_2: Interval) -> Floats:
    v = p - w
    out: Floats = np.hypot((a - angle * v.square()).size, (2 * p * v + angle * (a - w_2)).size)
    return out


def _links(angle: Interval, span: Interval, chord: Floats) -> tuple[Interval, Interval, Interval, Interval]:
    """Return first and second derivatives of what each link spans, and of its direction less its front's angle."""
    front, rear = angle[:-1], angle[1:]
    c, s, less = span.cosine(), span.sine(), 2 * (0.5 * span).sine().square()
    slope = span + front * less + front * rear * s
    step = -((front + rear) * less / slope)
    step_2 = -((2 * less + 2 * (less + (front + rear) * s) * step + (1 + 2 * front * s + front * rear * c)
                * step.square()) / slope)
    turn = s * (span - front * step) + 0.5 * (front + rear) * span * step
    turn_2 = (c * step * (span - front * step) - front * s * step_2 + 0.5 * (step + 2) * span * step
              + 0.5 * (front + rear) * (step.square() + span * step_2))
    share = 1 / np.where(chord == 0, 1, chord * chord)
    flat = Interval(1 / (1 + front.high**2), 1 / (1 + front.low**2))
    joined = 0.0 * front, 0.0 * front, flat, -2.0 * front * flat.square()     # a link of no length is a tangent
    linked = step, step_2, 0.5 * step + share * turn, 0.5 * step_2 + share * turn_2
    rows = [Interval(np.where(chord == 0, y.low, x.low), np.where(chord == 0, y.high, x.high))
            for x, y in zip(linked, joined, strict=True)]
    return rows[0], rows[1], rows[2], rows[3]


def _handles(angle: Interval, span: Interval, chord: Floats) -> tuple[Interval, Interval, Interval, Interval, Interval]:
    """Return the angles with their first and second derivatives, handle after handle, and those of the directions."""
    step, step_2, turn, turn_2 = _links(angle, span, chord)
    p, a = [Interval(np.array(1.0), np.array(1.0))], [Interval(np.array(0.0), np.array(0.0))]
    for n in range(chord.size):
        grow = step.at(n) + 1
        a.append(a[-1] * grow + p[-1].square() * step_2.at(n))
        p.append(p[-1] * grow)
    return angle, _row(p), _row(a), turn, turn_2


def _row(values: list[Interval]) -> Interval:
    return Interval(np.array([x.low for x in values]), np.array([x.high for x in values]))
