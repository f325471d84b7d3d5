"""Bounds on the gap between two benches at any two positions on a spiral, over boxes of the gap's variables.

In units of b = pitch / 2 pi all spirals have the equation r = theta, and a dragon is ``scale`` = 1 / b times as large.
The gap between two benches depends on five variables, the rows of a box:

    THETA   polar angle of the front handle of the inner bench
    AHEAD   polar angle from this handle to the front handle of the other bench
    SCALE   1 / b
    LINK    distance in metres between the handles of the inner bench
    OTHER   distance in metres between the handles of the other bench

The number and the lengths of the benches in between only affect which angles AHEAD occur. A bench extends ``overhang``
metres beyond its handles and half its width to either side.

A link with chord c and its front handle at theta spans delta, the root of F(theta, delta) = c^2 / 2 (docs/contact.md).
F_delta > 0 up to delta = pi, so there is exactly one root. The root decreases as theta increases (lemma 1), increases
with c, and has the derivatives -F_theta / F_delta and c / F_delta. A span is enclosed by two floats: F is proved to be
too small at one float and too large at the other.
"""
from typing import NamedTuple

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import Ball, between
from dragon_ros.core.enclosures.gradients import Graded, Vector, polar, variables
from dragon_ros.core.errors import DragonError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.tracks.spiral import first_guesses, steps

THETA, AHEAD, SCALE, LINK, OTHER = range(5)
_WIDER = 2.0**-30       # relative widening of spans, larger than the errors of Newton's method and of balls (2^-36)
_ABOVE = 1 + 2.0**-40   # covers the rounding of a sum of positive numbers


class Separations(NamedTuple):
    """Lower bounds ``low`` (n,) on the gaps in boxes, in units of b, which are positive if the benches are apart.

    In the middle of a box, ``middle`` (n,) is the distance of the nearest corner from the edge that separates the
    benches most. ``slope`` (5, n) holds the derivatives of this distance, and ``spread`` (5, n) bounds, for each
    variable, the change of this distance from the middle of a box to its ends.
    """

    low: Floats
    middle: Floats
    slope: Floats
    spread: Floats


def least_span(theta: Floats, chord: Floats) -> Floats:
    """Return lower bounds on the spans of links with given chords (in units of b) and front handles at polar angles."""
    return _proved_span(theta, chord, -_WIDER)


def largest_span(theta: Floats, chord: Floats) -> Floats:
    """Return upper bounds on the spans of links with given chords (in units of b) and front handles at polar angles."""
    return _proved_span(theta, chord, _WIDER)


def span_bounds(least_at: Floats, shortest: Floats, most_at: Floats, longest: Floats) -> tuple[Floats, Floats]:
    """Return the lower bounds of ``least_span`` and the upper bounds of ``largest_span``, computed together."""
    count = least_at.size
    spans = _proved_span(np.concatenate((least_at, most_at)), np.concatenate((shortest, longest)),
                         np.repeat((-_WIDER, _WIDER), count))
    return spans[:count], spans[count:]


def gaps(places: Floats, half_width_m: float, overhang_m: float) -> Floats:
    """Return the approximate gaps (n,), in units of b, between two benches in given positions (5, n)."""
    with np.errstate(all='ignore'):
        edges = _edges(places, places, half_width_m, overhang_m)
    out: Floats = np.max([np.min([corner.value.mid for corner in edge], axis=0) for edge in edges], axis=0)
    return out


def separations(low: Floats, high: Floats, half_width_m: float, overhang_m: float) -> Separations:
    """Return the separation of two benches in boxes from ``low`` to ``high`` (5, n).

    The benches are apart on a box if all corners of one bench are beyond one edge of the other. The middles of the
    boxes are computed together with the boxes.
    """
    middle, count = 0.5 * (low + high), low.shape[1]
    reach = _ABOVE * np.maximum(high - middle, middle - low)
    with np.errstate(all='ignore'):
        edges = _edges(np.hstack((middle, low)), np.hstack((middle, high)), half_width_m, overhang_m)
        there = [[corner.value[:count] for corner in edge] for edge in edges]
        slopes = [[corner.slope[:, count:] for corner in edge] for edge in edges]
        value = np.array([[corner.mid for corner in edge] for edge in there])
        spread = np.array([[corner.most * reach for corner in edge] for edge in slopes])
        least = value - np.array([[corner.rad for corner in edge] for edge in there]) - _ABOVE * np.sum(spread, axis=2)
    least = np.where(np.isnan(least), -np.inf, least)
    each = np.arange(value.shape[-1])
    edge = np.argmax(np.min(value, axis=1), axis=0)
    corner = np.argmin(value[edge, :, each], axis=1)
    steep = np.array([[one.mid for one in row] for row in slopes])
    return Separations(np.max(np.min(least, axis=1), axis=0), value[edge, corner, each],
                       steep[edge, corner, :, each].T, np.nan_to_num(spread[edge, corner, :, each].T, nan=np.inf))


def _proved_span(theta: Floats, chord: Floats, wider: float | Floats) -> Floats:
    span: Floats = (1 + wider) * steps(theta, chord, first_guesses(theta, chord))[0]
    place, delta = between(theta, theta), between(span, span)
    excess = delta.squared() * 0.5 + place * (place + delta) * delta.versine() - between(chord, chord).squared() * 0.5
    if not np.all(np.copysign(1.0, wider) * excess.mid >= excess.rad) or np.any(span > np.pi):
        raise DragonError('a link is too long for its position on the spiral: its span cannot be bounded')
    return span


def _edges(low: Floats, high: Floats, half_width_m: float, overhang_m: float) -> list[list[Graded]]:
    """Return how far, in units of b, the four corners of each bench are beyond each of the other bench's four edges.

    Polar angles are measured from the front handle of the inner bench.
    """
    theta, ahead, scale, link, other = variables(low, high)
    chord, far_chord, far = scale * link, scale * other, theta + ahead
    span = _span(theta, chord, low[THETA], high[THETA], low[SCALE] * low[LINK], high[SCALE] * high[LINK])
    far_span = _span(far, far_chord, low[THETA] + low[AHEAD], high[THETA] + high[AHEAD], low[SCALE] * low[OTHER],
                     high[SCALE] * high[OTHER])
    front, rear = Vector(theta, _nothing(theta)), polar(theta + span, span)
    far_front, far_rear = polar(far, ahead), polar(far + far_span, ahead + far_span)
    sizes = scale.times(overhang_m), scale.times(half_width_m)
    return [*_beyond(front, rear, chord, far_front, far_rear, far_chord, *sizes),
            *_beyond(far_front, far_rear, far_chord, front, rear, chord, *sizes)]


def _nothing(like: Graded) -> Graded:
    return Graded(*(Ball(np.zeros_like(ball.mid), np.zeros_like(ball.mid)) for ball in (like.value, like.slope)))


def _span(theta: Graded, chord: Graded, theta_low: Floats, theta_high: Floats, chord_low: Floats,
          chord_high: Floats) -> Graded:
    """Return enclosures of the spans of links, given bounds on their starting polar angles and on their lengths."""
    out, off = 1 + 2.0**-50, 2.0**-50 * theta_high      # cover the rounding of sums and products of floats
    delta = between(*span_bounds(theta_high + off, chord_low / out, theta_low - off, chord_high * out))
    sin, less = delta.sin_cos()[0], delta.versine()
    by_theta = (2 * theta.value + delta) * less
    by_delta = (delta + theta.value * less + theta.value * (theta.value + delta) * sin).inverse()
    return Graded(delta, chord.slope * (chord.value * by_delta) - theta.slope * (by_theta * by_delta))


def _beyond(front: Vector, rear: Vector, chord: Graded, other_front: Vector, other_rear: Vector, other_chord: Graded,
            overhang: Graded, half_width: Graded) -> list[list[Graded]]:
    """Return how far the corners of the other bench are beyond the left, right, front and rear edges of a bench."""
    axis = (front - rear) * chord.inverse()
    ahead, behind = ((handle - front).seen_along(axis) for handle in (other_front, other_rear))
    along = (ahead - behind) * other_chord.inverse()
    longer, side = along * overhang, along.left() * half_width
    corners = [ahead + longer + side, ahead + longer - side, behind - longer + side, behind - longer - side]
    return [[corner.y - half_width for corner in corners], [-corner.y - half_width for corner in corners],
            [corner.x - overhang for corner in corners], [-corner.x - chord - overhang for corner in corners]]
