"""Many places on a walk at once: where they are, and the next handle behind or ahead of each."""
from math import inf

import numpy as np

from dragon_ros.core.angle import plus
from dragon_ros.core.chord import reach_m, step_in
from dragon_ros.core.march_many import first_guesses, steps
from dragon_ros.core.placed import Placed, PlacedSpiral
from dragon_ros.core.types import Array, Floats, Ints
from dragon_ros.core.walk import Place, Walk

Places = tuple[Ints, Floats, Floats]        # numbers of the pieces, and the coordinates on them as (hi, lo)


def places_at(walk: Walk, metres: Floats, lo: Floats) -> Places:
    """Return ``walk.place_at`` of many, to the last digits and not bit for bit; all must be on the track."""
    joints = [walk.joint_m(k) for k in range(1, len(walk.pieces))]
    piece = np.searchsorted(np.array(joints), metres, side='right')
    u, u_lo = np.empty_like(metres), np.empty_like(metres)
    here, here_lo = plus(metres, lo, -np.array(walk.origins_m)[piece])
    for k in np.unique(piece).tolist():
        on = piece == k
        u[on], u_lo[on] = _after(walk.pieces[k], here[on], here_lo[on])
    return piece, u, u_lo


def _after(piece: Placed, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
    if isinstance(piece, PlacedSpiral):
        return piece.spiral.inward_many(-piece.way * metres, -piece.way * lo)
    high, low = piece.after(metres, lo)     # type: ignore[arg-type]
    return np.asarray(high), np.asarray(low)


def next_places(walk: Walk, places: Places, chord_m: float, way: int, tolerance: float) -> tuple[Places, int]:
    """Return ``walk.next`` of many, to the last digits and not bit for bit, and evaluations."""
    piece, u, lo = (values.copy() for values in places)
    spent, across = 0, []
    for k in np.unique(piece).tolist():
        on = np.flatnonzero(piece == k)
        edge = walk.edge(k, chord_m, way)
        delta, evaluations = _along(walk.pieces[k], u[on], chord_m, way, tolerance)
        spent += evaluations
        found = np.isfinite(delta)
        hi, low = plus(u[on], lo[on], np.where(found, delta, 0.0))
        stays: Array = found & (np.minimum(u[on], edge) <= hi) & (hi <= np.maximum(u[on], edge))
        across += on[~stays].tolist()
        u[on[stays]], lo[on[stays]] = hi[stays], low[stays]
    for n in across:
        place = Place.of(*(values[n] for values in places))
        (piece[n], (u[n], lo[n])), evaluations = walk.next(place, chord_m, way, tolerance)
        spent += evaluations
    return (piece, u, lo), spent


def _along(piece: Placed, u: Floats, chord_m: float, way: int, tolerance: float) -> tuple[Floats, int]:
    """Return the changes of coordinates to the next places on one curve, infinite where there is none."""
    if not isinstance(piece, PlacedSpiral):
        shift = piece.next(Place.of(0, 0.0, 0.0).u, chord_m, way, tolerance)[0].hi
        return np.full_like(u, shift), 0
    chord = chord_m / piece.spiral.b_m
    if way == piece.way:
        return steps(u, chord, first_guesses(u, chord), tolerance)
    return _steps_in(u, chord, reach_m(piece.bend, chord_m) / piece.spiral.b_m, tolerance)


def _steps_in(theta: Floats, chord: float, arc: float, tolerance: float) -> tuple[Floats, int]:
    """Return ``-chord.step_in`` of many, by Newton, and one by one where that does not settle."""
    delta = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta - np.minimum(theta, chord / theta))))
    change, spent = np.zeros_like(theta), 0
    with np.errstate(all='ignore'):
        for _ in range(8):
            s, inner = np.sin(0.5 * delta), theta - delta
            across = 2 * theta * s
            slope = delta - across * s + theta * inner * np.sin(delta)
            change = (0.5 * (delta * delta - chord * chord) + across * inner * s) / slope
            delta = delta - change
            spent += theta.size
            if np.all(np.abs(change) <= tolerance * delta):
                break
        high = theta - np.sqrt(np.maximum(theta * theta - 2 * arc, 0.0))
        settled = (np.abs(change) <= tolerance * delta) & (slope > 0) & (delta > 0) & (delta <= high)
    for n in np.flatnonzero(~settled):
        delta[n], evaluations = step_in(float(theta[n]), chord, arc, tolerance)
        spent += evaluations
    return np.where(delta < inf, -delta, -inf), spent
