"""Many places on a walk at once: where they are, and the next handle behind or ahead of each.

The equations are those of ``walk``: results agree to the last digits and not bit for bit.
"""
from math import inf

import numpy as np

from dragon_ros.core.angle import plus
from dragon_ros.core.chord import reach_m, step_in
from dragon_ros.core.march_many import first_guesses, steps
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.path import arc_between
from dragon_ros.core.placed import BACK, Placed, PlacedSpiral, metres_between
from dragon_ros.core.walk import Place, Walk

Places = tuple[Ints, Floats, Floats]        # numbers of the pieces, and the coordinates on them as (hi, lo)


def places_at(walk: Walk, metres: Floats, lo: Floats) -> Places:
    """Return ``walk.place_at`` of many; all must be on the track."""
    piece = np.searchsorted(np.array(walk.joints_m), metres, side='right')
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
    """Return ``walk.next`` of many, and evaluations. Raises TrackEndError where any finds no track."""
    piece, u, lo = (values.copy() for values in places)
    spent = 0
    for k in np.unique(places[0]).tolist():
        on = np.flatnonzero(places[0] == k)
        edge = walk.edge(k, chord_m, way)
        delta, evaluations = _along(walk.pieces[k], u[on], chord_m, way, tolerance)
        found = np.isfinite(delta)
        hi, low = plus(u[on], lo[on], np.where(found, delta, 0.0))
        stays: Array = found & (np.minimum(u[on], edge) <= hi) & (hi <= np.maximum(u[on], edge))
        over, on = on[~stays], on[stays]
        spent += evaluations
        if over.size:
            (piece[over], u[over], lo[over]), evaluations = _across(walk, k, (u[over], lo[over]), chord_m, way,
                                                                    tolerance)
            spent += evaluations
        u[on], lo[on] = hi[stays], low[stays]
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
    change, slope, spent = np.zeros_like(theta), np.ones_like(theta), 0
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
        high = np.minimum(theta, 2 * arc / (theta + np.sqrt(np.maximum(theta * theta - 2 * arc, 0.0))))
        settled = (np.abs(change) <= tolerance * delta) & (slope > 0) & (delta > 0) & (delta <= high)
    for n in np.flatnonzero(~settled):
        delta[n], evaluations = step_in(float(theta[n]), chord, arc, tolerance)
        spent += evaluations
    return np.where(delta < inf, -delta, -inf), spent


def _across(walk: Walk, k: int, u: tuple[Floats, Floats], chord_m: float, way: int,
            tolerance: float) -> tuple[Places, int]:
    """Return the next places beyond one joint or more, of many on piece k."""
    here = np.asarray(walk.pieces[k].at(*u), dtype=np.complex128)
    start, reach, spent = k, reach_m(walk.bend, chord_m), 0
    gone = _metres_to(walk.pieces[k], u[0], walk.pieces[k].first if way == BACK else walk.pieces[k].last)
    out: Places = np.full(here.shape, k), np.empty(here.shape), np.empty(here.shape)
    left = np.arange(here.size)
    while left.size and 0 <= (k := k + way) < len(walk.pieces):
        piece = walk.pieces[k]
        near, far = piece.last if way == BACK else piece.first, walk.edge(k, chord_m, way)
        longest = metres_between(piece, near, far) if abs(far) < inf else inf
        hit = np.full(left.shape, True) if longest == inf else (
            (gone[left] + longest >= reach) | (np.abs(complex(piece.at(far)) - here[left]) >= chord_m))
        on = left[hit]
        if on.size:
            out[0][on] = k
            (out[1][on], out[2][on]), evaluations = _cuts(piece, (near, far), here[on], chord_m, way,
                                                          (gone[on], reach), tolerance)
            spent += evaluations
        gone, left = gone + longest, left[~hit]
    for n in left[:1]:      # it says what is wrong
        walk.next(Place.of(start, u[0][n], u[1][n]), chord_m, way, tolerance)
    return out, spent


def _metres_to(piece: Placed, u: Floats, edge: float) -> Floats:
    """Return ``metres_between`` of many coordinates and one."""
    if isinstance(piece, PlacedSpiral):
        return np.asarray(np.abs(piece.spiral.b_m * arc_between(edge, edge - u)))
    return np.asarray(np.abs(piece.metres(u) - piece.metres(edge)))


def _cuts(piece: Placed, ends: tuple[float, float], here: Array, chord_m: float, way: int,
          arcs_m: tuple[Floats, float], tolerance: float) -> tuple[tuple[Floats, Floats], int]:
    """Return where a piece is at a chord's length from many points, as ``walk`` does: Newton kept inside brackets."""
    (near, far), (gone, reach) = ends, arcs_m
    end = _after(piece, piece.metres(near) + way * (reach - gone), np.zeros_like(gone))[0]
    most, sense = np.minimum(np.abs(end - near), abs(far - near)), 1.0 if far > near else -1.0
    low, high = np.zeros_like(gone), most
    x, last, spent = most * np.clip((chord_m - gone) / (reach - gone), 0.0, 1.0), most, 0
    for _ in range(80):
        u = near + sense * x
        link = piece.at(u) - here
        value = 0.5 * (link.real * link.real + link.imag * link.imag - chord_m * chord_m)
        slope = (link.conjugate() * piece.heading(u)).real * _rates(piece, u) * sense
        low, high, spent = np.where(value <= 0, x, low), np.where(value >= 0, x, high), spent + x.size
        step = value / np.where(slope > 0, slope, 1e-300)
        small = np.abs(step) <= tolerance * most
        newton = small | ((low <= x - step) & (x - step <= high) & (np.abs(step) <= 0.5 * last))
        following = np.clip(np.where(newton, x - step, low + 0.5 * (high - low)), low, high)
        last, x = np.abs(following - x), following
        if np.all(small | (high - low <= 4e-16 * most)):
            break
    return plus(near, 0.0, sense * x), spent


def _rates(piece: Placed, u: Floats) -> Floats | float:
    """Return ``piece.rate`` at many coordinates."""
    if isinstance(piece, PlacedSpiral):
        return np.asarray(piece.way * piece.spiral.b_m * np.sqrt(1 + u * u))
    return piece.rate(0.0)
