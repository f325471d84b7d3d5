"""Building a shift table on a track of pieces: where to cut the span, and its images, row after row."""
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, inf

import numpy as np

from dragon_ros.core.angle import plus
from dragon_ros.core.errors import TrackEndError
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.placed import AHEAD, BACK, PlacedSpiral
from dragon_ros.core.table_rows import inverse_series, powers_of, push, transform
from dragon_ros.core.track_table import TrackTable
from dragon_ros.core.walk import Place, Walk
from dragon_ros.core.walk_many import Places, next_places

_NODES = 20
_MOST_ROWS = 20_000
_MOST_STEPS = 40_000        # from joints to their places in the span
_MOST_BYTES = 64_000_000
_ROUNDS = 5                 # of cutting parts in two whose series do not end
_NOISE = 4                  # what rounding may add to the last terms, in units of the error
_STEP = 1e-8                # the error of a Newton step is about half its square
_HAIR = 1e-12               # of a distance along the track: places that far apart are one


@dataclass(frozen=True)
class _Part:
    """A part of the span: its piece, and its ends there, the foremost first."""

    piece: int
    fore: Floats
    rear: Floats

    def nodes(self) -> tuple[Floats, Floats]:
        """Return the coordinates (hi, lo) of the nodes (K,)."""
        share = 0.5 * (1 + transform(_NODES)[0])
        high, low = np.broadcast_to(self.fore[:, None], (2, _NODES))
        return plus(high, low, share * ((self.rear[0] - self.fore[0]) + (self.rear[1] - self.fore[1])))


@dataclass(frozen=True)
class _Rows:
    """Series of R rows of S parts: of coordinates less ``origin`` (S, K, R), places and motions (S, K, 2 R)."""

    piece: Ints                 # (R, S)
    origin: tuple[Floats, Floats]     # (R, S)
    coordinates: Floats
    places: Floats
    motions: Floats


def track_table(walk: Walk, link_m: float, stretch_m: tuple[float, float], error_m: float) -> TrackTable | None:
    """Return the table for the handles of links of ``link_m`` on a stretch of a walk, its series cut at ``error_m``.

    None where no table serves: the links have no length, it would be too large, or series do not end.
    """
    low_m, high_m = stretch_m
    if not link_m or (high_m - low_m) / link_m > _MOST_ROWS:
        return None
    try:
        front = _front(walk, link_m, high_m)
        parts = _parts(walk, link_m, front, low_m)
    except TrackEndError:
        return None
    count = ceil((walk.distance_of(front)[0] - low_m) / link_m) + 1
    return _built(walk, link_m, parts, count, error_m) if parts else None


def _front(walk: Walk, link_m: float, high_m: float) -> Place:
    """Return the foremost place; on a spiral that winds in from afar, where a link spans about a radian at most."""
    front, first = walk.place_at(min(walk.end_m, high_m + _HAIR * (1 + abs(high_m)))), walk.pieces[0]
    if front.piece == 0 and walk.afar and isinstance(first, PlacedSpiral):
        return Place.of(0, *max(front.u, (link_m / walk.afar.b_m, 0.0)))
    return front


def _parts(walk: Walk, link_m: float, front: Place, low_m: float) -> list[_Part]:
    """Return the parts of the span behind ``front``: it is cut at every place that a joint is whole links behind of."""
    rear = walk.next(front, link_m, BACK, _STEP)[0]
    here_m, back_m = walk.distance_of(front)[0], walk.distance_of(rear)[0]
    inside = [k for k, metres in enumerate(walk.joints_m, 1) if low_m < metres < here_m]
    if sum(here_m - walk.joints_m[k - 1] for k in inside) / link_m > _MOST_STEPS:
        return []
    cuts = sorted((_pulled(walk, link_m, Place.of(k, walk.pieces[k].first, 0.0), back_m) for k in inside),
                  key=walk.distance_of, reverse=True)
    ends = [front]
    for cut in [*cuts, rear]:
        if walk.distance_of(ends[-1])[0] - walk.distance_of(cut)[0] > _HAIR * (link_m + abs(here_m)):
            ends.append(cut)
    return [_part(walk, fore, rear) for fore, rear in pairwise(ends)]


def _pulled(walk: Walk, link_m: float, place: Place, back_m: float) -> Place:
    """Return a place moved ahead, link by link, into the span that ends at ``back_m``."""
    while walk.distance_of(place)[0] <= back_m:
        place = walk.next(place, link_m, AHEAD, _STEP)[0]
    return place


def _part(walk: Walk, fore: Place, rear: Place) -> _Part:
    """Return the part between two places, with the one piece that it is on."""
    middle = 0.5 * (walk.distance_of(fore)[0] + walk.distance_of(rear)[0])
    k = walk.place_at(middle).piece
    piece = walk.pieces[k]
    ends = (fore.u if fore.piece == k else (piece.last, 0.0), rear.u if rear.piece == k else (piece.first, 0.0))
    return _Part(k, *(np.array(end) for end in ends))


def _halves(part: _Part) -> list[_Part]:
    middle = np.array(plus(part.fore[0], part.fore[1], 0.5 * (part.rear[0] - part.fore[0])))
    return [_Part(part.piece, part.fore, middle), _Part(part.piece, middle, part.rear)]


def _built(walk: Walk, link_m: float, parts: list[_Part], count: int, error_m: float) -> TrackTable | None:
    """Return the table, once all series end; parts whose do not are cut in two."""
    for _ in range(_ROUNDS):
        if 8 * 6 * _NODES * len(parts) * count > _MOST_BYTES:
            return None
        rows = _series(walk, link_m, parts, count)
        inverse = inverse_series(_scaled(rows)[0].transpose(1, 0, 2).reshape(_NODES, -1))
        left = _left_m(rows, inverse, link_m)
        if np.max(left) <= _NOISE * error_m:
            return _table(walk, link_m, rows, inverse, error_m)
        parts = [one for part, over in zip(parts, left, strict=True)
                 for one in (_halves(part) if over > _NOISE * error_m else [part])]
    return None


def _series(walk: Walk, link_m: float, parts: list[_Part], count: int) -> _Rows:
    """Push the nodes of all parts back through ``count`` rows, as far as there is track, and return their series."""
    piece, u, lo = _pushed(walk, link_m, parts, count)
    matrix, rows = transform(_NODES)[1], piece.shape[0]
    p, forward = walk.points(np.broadcast_to(piece[..., None], u.shape), u, lo)
    axis = p[:-1] - p[1:]
    ratio = np.sum(axis * forward[:-1], axis=-1) / np.sum(axis * forward[1:], axis=-1)
    speed = np.cumprod(np.concatenate((np.ones((1, *u.shape[1:])), ratio)), axis=0)
    origin = u[..., _NODES // 2], lo[..., _NODES // 2]
    from_origin = (u - origin[0][..., None]) + (lo - origin[1][..., None])
    by_part = [values.transpose(1, 2, 0, 3).reshape(len(parts), _NODES, 2 * rows)
               for values in (p, speed[..., None] * forward)]
    return _Rows(piece, origin, matrix @ from_origin.transpose(1, 2, 0), *(matrix @ values for values in by_part))


def _pushed(walk: Walk, link_m: float, parts: list[_Part], count: int) -> tuple[Ints, Floats, Floats]:
    """Return the pieces (R, S) and coordinates (R, S, K) as (hi, lo) of the nodes in all rows."""
    nodes: Floats = np.array([part.nodes() for part in parts])
    pieces: Ints = np.repeat([part.piece for part in parts], _NODES)
    here: Places = pieces, nodes[:, 0].reshape(-1), nodes[:, 1].reshape(-1)
    rows = [here]
    while len(rows) < count:
        if walk.afar and not np.any(here[0]):
            rest = push(link_m / walk.afar.b_m, here[1:], count - len(rows) + 1)
            if rest:
                rows += [(here[0], *row) for row in zip(rest.theta.T[1:], rest.low.T[1:], strict=True)]
                break
        try:
            here = _together(walk, next_places(walk, here, link_m, BACK, _STEP)[0])
        except TrackEndError:       # the last handle may be there, and is marched
            break
        rows.append(here)
    shape = len(rows), len(parts), _NODES
    piece, u, lo = (np.array(values).reshape(shape) for values in zip(*rows, strict=True))
    return piece[..., 0], u, lo


def _together(walk: Walk, places: Places) -> Places:
    """Return places of parts, each part on one piece: a node beyond a joint by rounding is put on the joint."""
    shape = -1, _NODES
    piece, u, lo = places[0].reshape(shape), places[1].reshape(shape), places[2].reshape(shape)
    most: Ints = np.repeat(piece[:, _NODES // 2], _NODES).reshape(shape)
    for part, node in np.argwhere(piece != most).tolist():
        own = walk.pieces[int(most[part, node])]
        u[part, node] = own.first if piece[part, node] < most[part, node] else own.last
        lo[part, node] = 0.0
    return most.reshape(-1), u.reshape(-1), lo.reshape(-1)


def _scaled(rows: _Rows) -> tuple[Floats, Floats, Floats]:
    """Return the series of x (S, K, R), the middle of each chart less its origin, and its scale, (S, R) each."""
    sign = np.where(np.arange(_NODES) % 2, -1.0, 1.0)[:, None]
    fore, rear = np.sum(sign * rows.coordinates, axis=1), np.sum(rows.coordinates, axis=1)
    middle, scale = 0.5 * (fore + rear), 2 / (rear - fore)
    x = rows.coordinates * scale[:, None]
    x[:, 0] -= middle * scale
    return x, middle, scale


def _left_m(rows: _Rows, inverse: Floats, link_m: float) -> Floats:
    """Return about what the series of each part (S,) leave out, in metres: their last terms."""
    half_m, charts = _half_widths_m(rows), (_scaled(rows)[0], _by_part(inverse, rows))
    last = (rows.places[:, -2:], link_m * rows.motions[:, -2:], *(half_m * series[:, -2:] for series in charts))
    out: Floats = np.max([np.max(np.abs(values), axis=(1, 2)) for values in last], axis=0)
    out[~np.isfinite(out)] = inf
    return out


def _half_widths_m(rows: _Rows) -> Floats:
    """Return about half the length of each part in each row in metres, (S, 1, R)."""
    out: Floats = np.hypot(rows.places[:, 1:2, ::2], rows.places[:, 1:2, 1::2])
    return out


def _by_part(inverse: Floats, rows: _Rows) -> Floats:
    """Return series (K, S R) as (S, K, R)."""
    out: Floats = inverse.reshape(_NODES, rows.piece.shape[1], -1).transpose(1, 0, 2)
    return out


def _table(walk: Walk, link_m: float, rows: _Rows, inverse: Floats, error_m: float) -> TrackTable:
    """Return the table with as many terms as any series needs."""
    parts, count = rows.piece.shape[1], rows.piece.shape[0]
    x, middle, scale = _scaled(rows)
    size = np.maximum(np.abs(rows.places), link_m * np.abs(rows.motions)).reshape(parts, _NODES, count, 2).max(axis=3)
    terms = _enough(size, error_m)
    charts = _half_widths_m(rows) * np.maximum(np.abs(_by_part(inverse, rows)), np.abs(x))
    nodes = max(int(np.max(terms)), int(np.max(_enough(charts, error_m))))
    centre = plus(rows.origin[0], rows.origin[1], middle.T)
    slack = _NOISE * error_m / _half_widths_m(rows)[:, 0].T
    powers = powers_of(inverse[:nodes]).reshape(parts, count, nodes).transpose(1, 0, 2)
    chart = np.concatenate((np.stack((slack, *centre, scale.T), axis=-1), powers), axis=-1)
    x, p, v = (read_only(np.ascontiguousarray(series[:, :nodes])) for series in (x, rows.places, rows.motions))
    return TrackTable(walk, rows.piece, read_only(chart), x, p, v, terms)


def _enough(size: Floats, error_m: float) -> Ints:
    """Return how many terms of sizes (S, K, R) are enough from each row on, (S, R)."""
    needed = size.shape[1] - np.argmax(size[:, ::-1] > error_m, axis=1)
    return np.maximum.accumulate(needed[:, ::-1], axis=1)[:, ::-1]
