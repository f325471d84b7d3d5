"""Clear whole stretches of track of contact, with the bound that clears each.

On a stretch of length h the corners of a bench, seen in the frame of another, leave the straight lines between their
places at its ends by at most B h^2 / 8, B the largest second derivative. Along straight lines the separation from a
fixed edge is concave, so it is nowhere less than the smaller of its values at the two ends. Hence a pair is apart
on the whole stretch if, for one edge and one side of it, that smaller value exceeds B h^2 / 8. For B stands twice the
larger value at the ends, on stretches shorter than half the radius there; a test samples inside.

Close to a lock, where that derivative has no bound, what counts is how far the handles of both benches go at all.
Benches further out are cleared by the circle about the centre that parts them: all move inwards, or all outwards.
"""
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.lookout import View, joined
from dragon_ros.core.types import Array, Floats

Look = Callable[[Floats], View]
_SAFETY = 2.0


@dataclass(frozen=True)
class Stretch:
    """A cleared stretch: polar angles of the leading handle, and a lower bound of all its gaps in metres."""

    start_rad: float
    stop_rad: float
    bound_m: float


@dataclass(frozen=True)
class Cleared:
    """What was cleared from the start on; ``hit`` brackets the first place that is not (clear end, other end)."""

    stretches: list[Stretch]
    hit: tuple[float, float] | None
    touching: bool


def bounds(a: View, b: View, b_m: float) -> Floats:
    """Return lower bounds (n,) of the gaps on stretches between the places of two views; not positive: not cleared."""
    outer = np.maximum(a.theta, b.theta)
    length = b_m * np.abs(a.theta - b.theta) * np.sqrt(1 + outer * outer)
    sag = _SAFETY * np.maximum(a.bend, b.bend) * (length * length / 8)[:, None, None]
    sides = [np.minimum(side * a.offset - a.extent, side * b.offset - b.extent) for side in (1, -1)]
    separation = np.maximum(*sides)
    low = np.maximum(np.max(separation[..., :2], axis=-1) - sag[..., 0],
                     np.max(separation[..., 2:], axis=-1) - sag[..., 1])
    step = np.max(np.abs(a.moved - b.moved), axis=-1)
    low = np.maximum(low, np.maximum(a.apart, b.apart) - step[:, :1] - step[:, 1:])
    circle = np.minimum(a.clearance, b.clearance) - np.maximum(a.reach, b.reach)[:, None]
    out: Floats = np.min(np.maximum(low, circle), axis=1, initial=np.inf)
    wide = length > 0.5 * b_m * (1 + np.minimum(a.theta, b.theta))
    return np.where(wide, -np.inf, out)


def clear(look: Look, b_m: float, places: Floats, finest_m: float, tolerance_m: float) -> Cleared:
    """Clear the stretches between consecutive ``places`` (monotone), halving those that need it down to ``finest_m``.

    A stretch is clear if its bound exceeds ``tolerance_m``, what the positions may err. Stops at the first touching
    place that it finds, and clears everything before it or reports the first that it cannot clear.
    """
    view = look(places)
    sign = 1.0 if places.size < 2 or places[-1] >= places[0] else -1.0
    if _touches(view)[0]:
        return Cleared([], (float(places[0]), float(places[0])), True)
    first = np.arange(places.size - 1)
    pairs, done, stuck = np.stack((first, first + 1)), [], []
    hit = np.inf
    while pairs.size:
        touching = _touches(view)
        hit = min(hit, float(np.min(sign * view.theta[touching], initial=np.inf)))
        pairs = pairs[:, sign * view.theta[pairs[0]] < hit]
        low = bounds(view.rows(pairs[0]), view.rows(pairs[1]), b_m)
        ends = view.theta[pairs]
        good = low > tolerance_m
        done += [Stretch(*row) for row in np.stack((*ends[:, good], low[good]), axis=1).tolist()]
        fine = b_m * np.abs(ends[0] - ends[1]) * (1 + np.max(np.abs(ends), axis=0)) <= finest_m
        stuck += ends[:, ~good & fine].T.tolist()
        pairs = pairs[:, ~good & ~fine]
        view, pairs = _halved(look, view, pairs)
    return _result(done, stuck, hit, sign)


def _touches(view: View) -> Array:
    out: Array = np.any(view.apart <= 0, axis=1)
    return out


def _halved(look: Look, view: View, pairs: Array) -> tuple[View, Array]:
    """Return the view with the middles of the stretches added, and their halves."""
    if not pairs.size:
        return view, pairs
    used, where = np.unique(pairs, return_inverse=True)
    pairs = where.reshape(2, -1)
    view = view.rows(used)
    middles = look(0.5 * (view.theta[pairs[0]] + view.theta[pairs[1]]))
    new = used.size + np.arange(pairs.shape[1])
    halves = np.concatenate((np.stack((pairs[0], new)), np.stack((new, pairs[1]))), axis=1)
    return joined([view, middles]), halves


def _result(done: list[Stretch], stuck: list[list[float]], hit: float, sign: float) -> Cleared:
    """Return what is cleared up to the first stretch that is not."""
    stuck = sorted((row for row in stuck if sign * row[0] < hit), key=lambda row: sign * row[0])
    end = sign * stuck[0][0] if stuck else hit
    kept = sorted((row for row in done if sign * row.start_rad < end), key=lambda row: sign * row.start_rad)
    if not stuck and hit == np.inf:
        return Cleared(kept, None, False)
    bracket = (stuck[0][0], stuck[0][1]) if stuck else (sign * hit, sign * hit)
    return Cleared(kept, bracket, sign * bracket[1] >= hit)
