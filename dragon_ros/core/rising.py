"""Between two looks at a chain on a walk, how fast its handles can be there, over the leader: derived, not sampled.

A link's direction phi makes angles alpha and beta with the tangents at its two handles, the nearer to the leader first;
the speeds v obey v_next = v cos alpha / cos beta. A prime is a derivative by the leader's way. With kappa the signed
curvature and ``way`` as in ``placed``

    phi' = (v_next sin beta - v sin alpha) / link,    alpha' = phi' + way kappa v,    beta' = phi' + way kappa v_next,
    (log v_next - log v)' = tan beta beta' - tan alpha alpha'.

All that stands on the right lies in balls (``ball``) between two looks: handles only move on, so each curvature lies
between those on the way that its handle goes. Let k be the largest curvature between where the rear handle begins and
where the front handle ends, k link < 2. A chord and the tangent at its end differ by asin(k link / 2) at most (Schur),
so |phi'| <= k (v + v_next) / 2. So an angle that is alpha_0 at one look and alpha_1 at the next is nowhere further from
their middle than half of what it turns in between: (k / 2) (way + way_next) + kappa way. With slopes between a lowest
and a highest, a speed lies below the two lines from its ends: its bound is where they meet. As looks get closer it
comes down with the square of their distance, and where a handle passes a joint, so that a curvature jumps, with it.
"""
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.numerics.ball_arithmetic import Ball, between, side_by_side
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.placed import BACK
from dragon_ros.core.walk import Walk
from dragon_ros.core.walk_chain import WalkChain, stacked


@dataclass(frozen=True)
class Looks:
    """M looks at a chain, handles in order from the leader: logs of speeds, the links' angles, and places."""

    walk: Walk
    links_m: Floats
    way: int
    gone_m: Floats
    log: Floats
    alpha: Floats
    beta: Floats
    along_m: Floats
    piece: Ints
    bend: Floats


def looks_at(chains: Sequence[WalkChain], gone_m: Floats, way: int) -> Looks:
    """Return looks at chains whose leaders have gone so far, in order."""
    chain, order = stacked(chains), slice(None, None, -way)
    link = chain.p[:, :-1] - chain.p[:, 1:]
    front, rear = _angle(chain.forward[:, :-1], link), _angle(chain.forward[:, 1:], link)
    alpha, beta = (angle[:, order] for angle in ((front, rear) if way == BACK else (rear, front)))
    log = np.cumsum(np.log(np.cos(alpha)) - np.log(np.cos(beta)), axis=1)
    piece, u, walk = chain.piece[:, order], chain.u[:, order], chain.walk
    return Looks(walk, chain.links_m[order], way, gone_m, np.insert(log, 0, 0.0, axis=1), alpha, beta,
                 walk.distances(piece, u), piece, walk.curvatures(piece, u))


def _angle(a: Floats, b: Floats) -> Floats:
    """Return the angles from vectors a to vectors b."""
    out: Floats = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], np.sum(a * b, axis=-1))
    return out


def tops(looks: Looks) -> Floats:
    """Return bounds (M-1,) of the log of the largest speed between each look and the next."""
    with np.errstate(all='ignore'):
        slope = _slopes(looks)
        low, high = slope.mid - slope.rad, slope.mid + slope.rad
        a, b, step = looks.log[:-1], looks.log[1:], np.diff(looks.gone_m)[:, None]
        meet = a + high * (b - a - low * step) / (high - low)
        bound = np.maximum(np.maximum(a, b), np.where((low < 0) & (high > 0), meet, -np.inf))
    out: Floats = np.max(np.where(np.isfinite(slope.rad), bound, np.inf), axis=1)
    return out


def _slopes(looks: Looks) -> Ball:
    """Return the derivatives of all logs by the leader's way, (M-1, K+1), between looks."""
    bend, alpha, beta = _angles(looks)
    (sin_a, cos_a, _), (sin_b, cos_b, _) = alpha.trig(), beta.trig()
    none = Ball(np.zeros_like(bend.mid[:, :1]), np.zeros_like(bend.mid[:, :1]))
    inverse_a, inverse_b = cos_a.inverse(), cos_b.inverse()
    v = side_by_side([none + 1.0, (cos_a * inverse_b).running_product()])
    share = np.where(looks.links_m > 0, 1 / np.where(looks.links_m > 0, looks.links_m, 1.0), 0.0)
    turned = looks.way * bend * v
    phi = (v[:, 1:] * sin_b - v[:, :-1] * sin_a) * share
    slopes = sin_b * inverse_b * (phi + turned[:, 1:]) - sin_a * inverse_a * (phi + turned[:, :-1])
    return side_by_side([none, slopes.running_sum()])


def _angles(looks: Looks) -> tuple[Ball, Ball, Ball]:
    """Return the curvatures at handles (M-1, K+1), and the angles of links (M-1, K), between looks."""
    bend = bends(looks.walk, looks.piece[:-1], looks.piece[1:], looks.bend[:-1], looks.bend[1:])
    way_m, start, end = np.abs(np.diff(looks.along_m, axis=0)), slice(None, -1), slice(1, None)
    # The rear handle is the follower behind a head: it begins at the first look. Ahead of a tail all is the reverse.
    rear, front = (end, start) if looks.way == BACK else (start, end)
    first, last = (start, end) if looks.way == BACK else (end, start)
    across = bends(looks.walk, looks.piece[first, rear], looks.piece[last, front], looks.bend[first, rear],
                   looks.bend[last, front]).most
    swing = 0.5 * across * (way_m[:, :-1] + way_m[:, 1:])
    turned = bend.most * way_m
    alpha, beta = (Ball(0.5 * (angle[:-1] + angle[1:]), np.where(looks.links_m > 0, 0.5 * (swing + own), 0.0))
                   for angle, own in ((looks.alpha, turned[:, :-1]), (looks.beta, turned[:, 1:])))
    return bend, alpha, beta


def bends(walk: Walk, piece: Ints, other: Ints, bend: Floats, other_bend: Floats) -> Ball:
    """Return the curvatures between places: on one piece between those there, else of all pieces from one to other."""
    low, high = walk.bends
    one = piece == other
    return between(np.where(one, np.minimum(bend, other_bend), low[piece, other]),
                   np.where(one, np.maximum(bend, other_bend), high[piece, other]))
