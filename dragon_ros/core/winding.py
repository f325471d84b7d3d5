"""Spirals of any pitch at once: how the benches of a chain move with the head's place and with the pitch.

All is seen in units of b = pitch / 2 pi, where there is one spiral, r = theta, and a dragon ``scale`` = 1 / b times as
large: a smaller pitch is a larger dragon. A place is x = r^2 / 2 of the leading handle, r in metres, so that a metre of
its way is about b of x, whatever the radius. Derivatives are by x and by the scale, each with the other held.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.dragon import Dragon
from dragon_ros.core.march import Effort
from dragon_ros.core.march_many import steps
from dragon_ros.core.motion import carried, curvature, dot, left
from dragon_ros.core.path import points, tangents
from dragon_ros.core.types import Floats


@dataclass(frozen=True)
class Windings:
    """M windings, in units of b: handles, and the links' unit directions ``axis`` (M, N, 2) from rear to front."""

    theta: Floats
    p: Floats
    axis: Floats
    scale: Floats
    links: Floats


@dataclass(frozen=True)
class Change:
    """First and second derivatives of bench centres (M, N, 2) and of their directions' angle (M, N)."""

    velocity: Floats
    acceleration: Floats
    turning: Floats
    turning_rate: Floats


@dataclass(frozen=True)
class Sights:
    """The leading bench and the K benches from the second behind it on, M times, in units of b.

    ``apart`` (M, K, 8): separation along four edges, on either side; a pair is apart where any is positive. ``bend``
    (M, K, 2, 2): largest second derivative of a corner, in the frame of the leading bench and of the other, by x and
    by scale. ``reach`` (M,) is the largest distance of the leading bench from the centre, ``clearance`` (M,) the
    smallest of the last bench.
    """

    apart: Floats
    bend: Floats
    reach: Floats
    clearance: Floats


def windings(dragon: Dragon, first: int, follow: int, x: Floats, scale: Floats, effort: Effort) -> Windings:
    """Place ``follow`` benches behind places x (M,) on spirals of the given scales; the first is bench ``first``.

    Raises ChainLockError where a link finds no place.
    """
    links = dragon.link_lengths_m[first:first + follow]
    theta, delta = [scale * np.sqrt(2 * x)], list[Floats]()
    for i, link in enumerate(links.tolist()):
        chord = link * scale
        if i < 2 or link != links[i - 1]:
            guess = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta[i] + np.pi)))
        else:
            square = delta[-1] * (theta[i] + theta[i - 1])
            guess = square / (theta[i] + np.sqrt(theta[i] ** 2 + square))
        delta.append(steps(theta[i], chord, guess, effort.newton)[0])
        theta.append(theta[i] + delta[i])
    places = np.stack(theta, axis=1)
    p = points(1.0, places, np.zeros_like(places))
    axis = p[:, :-1] - p[:, 1:]
    return Windings(places, p, axis / np.hypot(axis[..., 0], axis[..., 1])[..., None], scale, links)


def by_place(winding: Windings) -> Change:
    """Return how a winding changes with x."""
    scale, theta = winding.scale, winding.theta[:, 0]
    w, slope = np.sqrt(1 + theta * theta), scale * scale / theta
    # theta = scale sqrt(2 x): theta' = scale^2 / theta, theta'' = -scale^4 / theta^3; the arc has the slope w.
    return _change(winding, w * slope, theta / w * slope * slope - w * slope * slope / theta, 0.0)


def by_scale(winding: Windings) -> Change:
    """Return how a winding changes with the scale, at a given radius of the leading handle in metres."""
    theta = winding.theta[:, 0]
    w, slope = np.sqrt(1 + theta * theta), theta / winding.scale
    return _change(winding, w * slope, theta / w * slope * slope, 1.0)


def _change(winding: Windings, speed: Floats, rate: Floats, growth: float) -> Change:
    """Return the change for a leading handle with a speed and its rate, while links grow by ``growth`` link_m.

    With D = p[m] - p[m+1] = l e twice differentiating |D|^2 = l^2 gives e D' = l' and e D'' + |D'|^2 / l = l'^2 / l.
    """
    e, tangent = winding.axis, tangents(winding.theta)
    links, bend = winding.scale[:, None] * winding.links, curvature(1.0, winding.theta)
    grown = growth * winding.links
    front, rear = dot(e, tangent[:, :-1]), dot(e, tangent[:, 1:])
    s = carried(speed, front / rear, -grown / rear)
    v = s[..., None] * tangent
    spread = v[:, :-1] - v[:, 1:]
    pull = s * s * bend
    side = left(tangent)
    source = dot(e, side[:, :-1]) * pull[:, :-1] - dot(e, side[:, 1:]) * pull[:, 1:]
    source = (source + (dot(spread, spread) - grown * grown) / links) / rear
    a = carried(rate, front / rear, source)[..., None] * tangent + pull[..., None] * side
    turning = dot(left(e), spread) / links
    turning_rate = (dot(left(e), a[:, :-1] - a[:, 1:]) - 2 * grown * turning) / links
    return Change(0.5 * (v[:, 1:] + v[:, :-1]), 0.5 * (a[:, 1:] + a[:, :-1]), turning, turning_rate)


def sights(dragon: Dragon, first: int, winding: Windings) -> Sights:
    """Return what the leading bench sees behind it."""
    count = winding.links.size
    half = 0.5 * dragon.bench_lengths_m[first:first + count] * winding.scale[:, None]
    side = np.broadcast_to(0.5 * dragon.width_m * winding.scale[:, None], half.shape)
    centre, u = 0.5 * (winding.p[:, :-1] + winding.p[:, 1:]), winding.axis
    d, lead, other = centre[:, 2:] - centre[:, :1], u[:, :1], u[:, 2:]
    c, s = np.abs(dot(lead, other)), np.abs(dot(left(lead), other))
    offset = np.stack((dot(d, lead), dot(d, left(lead)), dot(d, other), dot(d, left(other))), axis=-1)
    extent = np.stack((half[:, :1] + half[:, 2:] * c + side[:, 2:] * s, side[:, :1] + half[:, 2:] * s + side[:, 2:] * c,
                       half[:, 2:] + half[:, :1] * c + side[:, :1] * s, side[:, 2:] + half[:, :1] * s
                       + side[:, :1] * c), axis=-1)
    apart = np.concatenate((offset - extent, -offset - extent), axis=-1)
    arm = np.hypot(half, side)
    bend = np.stack((_bend(d, by_place(winding), arm, 0 * winding.scale),
                     _bend(d, by_scale(winding), arm, 1 / winding.scale)), axis=-1)
    reach = np.max(np.hypot(winding.p[:, :2, 0], winding.p[:, :2, 1]), axis=1) + arm[:, 0] - 0.5 * (
        winding.scale * winding.links[0])
    last = np.abs(dot(centre[:, -1], left(u[:, -1]))) - side[:, -1]
    return Sights(apart, bend, reach, last)


def _bend(d: Floats, change: Change, arm: Floats, growth: Floats) -> Floats:
    """Return bounds (M, K, 2) as ``lookout`` does, for corners whose arms grow by ``growth`` of their length."""
    v, a, w, w_rate = change.velocity, change.acceleration, change.turning, change.turning_rate
    dv, da = v[:, 2:] - v[:, :1], a[:, 2:] - a[:, :1]
    dw = w[:, 2:] - w[:, :1]
    spin = np.hypot(w_rate[:, 2:] - w_rate[:, :1], dw * dw) + 2 * growth[:, None] * np.abs(dw)
    out = []
    for frame, rate, length in ((w[:, :1], w_rate[:, :1], arm[:, 2:]), (w[:, 2:], w_rate[:, 2:], arm[:, :1])):
        base = da - rate[..., None] * left(d) - (frame**2)[..., None] * d - 2 * frame[..., None] * left(dv)
        out.append(np.hypot(base[..., 0], base[..., 1]) + length * spin)
    return np.stack(out, axis=-1)
