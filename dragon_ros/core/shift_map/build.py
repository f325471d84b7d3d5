"""Build the tables of a tile: cut the span into parts, map them back row by row, and fit series to their images."""
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, groupby, pairwise
from math import ceil, floor, inf

import numpy as np

from dragon_ros.core.chain.forward import FEWEST_ROWS, Block, by_segment, forward, forward_many, next_place, placed
from dragon_ros.core.errors import ChainLockError, TrackEndError
from dragon_ros.core.numerics.chebyshev import inverse_series, powers_of, series_of, transform
from dragon_ros.core.numerics.types import Floats, Ints, complex_of, dot, read_only
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import AHEAD, BEHIND, Segment, reach_m
from dragon_ros.core.tracks.spiral import SpiralSegment

NODES = 24            # number of terms of a series before truncation
_MOST_STEPS = 100_000       # maximum total number of links from the joints to the span
_MOST_BYTES = 256_000_000   # maximum total size of the series of all tables of a span
# The maximum number of parts of one table, before parts are cut into thirds. On a street of 300 pieces, the table for
# the first position then takes a third of the time of a table with all parts, and all tables together take 1.3 to 1.7
# times as long.
_MOST_PARTS = 48
_WIDEST_RAD = 1.3   # approximate limit on a link's span on an inward spiral; a wider link may be close to locking
_MANY_JOINTS = 16           # minimum number of joints for moving them ahead together; fewer are faster one by one
_PULLS = 2                  # number of times that many joints are moved ahead together; few links are left after two
_ROUNDS = 5                 # maximum number of times that parts are cut into thirds
NOISE = 4                  # the largest effect of rounding on the last terms, in units of the error
# The largest effect of rounding that is allowed where cutting a part does not reduce it; it is a sixth of the promise.
_MOST_NOISE = 16
_SAME = 1e-12               # positions closer than this, relative to the distance along the track, are treated as equal
_HALF_ULP = 2.0**-53        # rounding of coordinates, relative to a coordinate
TRUNCATION = 1e-15      # error at which series are truncated, relative to the coordinates


@dataclass(frozen=True, eq=False)
class Table:
    """The images of a span in R rows of S parts, for links of one length; L rows from ``first`` on can hold leaders.

    Part s of row r is on the segment ``segment[r, s]``; ``middle[r, s]`` holds the segment's coordinate in the middle
    of the part and a scale, such that x = (coordinate - middle) * scale lies in [-1, 1]. Rounding may make
    |x| exceed 1 by up to ``slack`` (L, S). ``inverse`` (L, S, K) holds the coefficients of u(x), the highest power
    first. The series are ``coordinates`` (S, K, R) of the scaled coordinates x, ``places`` (S, K, 2 R) of positions in
    m, and ``motions`` (S, K, 2 R) of velocities for unit speed in row 0. From row r on, the first ``terms[s, r]`` terms
    are accurate to ``error_m`` (R,).
    """

    segment: Ints
    middle: Floats
    first: int
    slack: Floats
    inverse: Floats
    coordinates: Floats
    places: Floats
    motions: Floats
    terms: Ints
    error_m: Floats

    @property
    def rows(self) -> int:
        """The number of images of the span."""
        return int(self.segment.shape[0])

    @property
    def parts(self) -> int:
        """The number of parts of the span."""
        return int(self.segment.shape[1])

    @property
    def nodes(self) -> int:
        """The number of terms of the series."""
        return int(self.places.shape[1])

    @property
    def memory_bytes(self) -> int:
        """The size of all arrays in bytes."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))


@dataclass(frozen=True)
class Stretch:
    """The range of a tile's leaders, as two distances along the track; ``links`` handles follow in ``direction``."""

    low_m: float
    high_m: float
    links: int
    direction: int


@dataclass(frozen=True)
class SpanPart:
    """A part of the span: its segment, and the coordinates of its two ends, the foremost first."""

    segment: int
    fore: float
    rear: float

    def nodes(self) -> Floats:
        """Return the coordinates of the nodes (K,)."""
        out: Floats = self.fore + 0.5 * (1 + transform(NODES)[0]) * (self.rear - self.fore)
        return out


@dataclass(frozen=True, eq=False)
class _Pushed:
    """Series for R rows of one part: coordinates minus ``origin`` (K, R), positions and motions (K, R, 2).

    ``along_m`` (R, 2) holds the distances of the part's rear and front along the track, ``far_m`` (R,) bounds the
    part's distance from the origin, and ``rounding_m`` (R,) is the effect of rounding coordinates up to each row.
    """

    segment: Ints           # (R,)
    origin: Floats          # (R,)
    along_m: Floats
    far_m: Floats
    rounding_m: Floats
    coordinates: Floats
    places: Floats
    motions: Floats


@dataclass(frozen=True)
class _RowSeries:
    """Series for R rows of S parts: coordinates minus ``origin`` (S, K, R), positions and motions (S, K, 2 R)."""

    segment: Ints                     # (R, S)
    origin: Floats                    # (R, S)
    leading: slice                    # rows that can hold leaders
    error_m: Floats                   # (R,): the error at which series are truncated
    coordinates: Floats
    places: Floats
    motions: Floats


class Groups:
    """A lookup of the group of parts that covers a position, by the positions at which groups begin, from the front."""

    def __init__(self, track: Track, begins: list[tuple[Place, int]], count: int) -> None:
        """Arrange the positions by segment; each comes with the number of its group, from 0 to ``count`` - 1."""
        self._track = track
        # For each segment, a sign, and the beginnings of groups in order of this sign times the coordinate, which
        # increases towards the rear; the first of the groups has no beginning on the segment.
        self.sides = dict[int, tuple[float, list[float], list[int]]]()
        before = (begins[0][1] - 1) % count
        for k in reversed(range(len(track.segments))):
            on = [(place.u, group) for place, group in begins if place.segment == k]
            sense = -1.0 if track.segments[k].rate(track.segments[k].last) > 0 else 1.0
            self.sides[k] = sense, [sense * u for u, _ in on], [before, *(group for _, group in on)]
            before = self.sides[k][2][-1]

    def of(self, place: Place) -> int:
        """Return the group that covers a position."""
        sense, begins, groups = self.sides[place[0]]
        return groups[bisect_right(begins, sense * place[1])]

    def of_many(self, places: Places) -> Ints:
        """Return the groups that cover many positions."""
        (segment, u), out = places, np.empty_like(places[0])
        for k in self._track.present(segment):
            (sense, begins, groups), on = self.sides[k], segment == k
            out[on] = np.array(groups)[np.searchsorted(begins, sense * u[on], side='right')]
        return out


@dataclass(frozen=True, eq=False)
class Span:
    """The span of a tile for links of length ``link_m``: its parts, and the number of rows of their images.

    The parts are in ``groups``, from the front. Each group has a table of its own.
    """

    track: Track
    link_m: float
    stretch: Stretch
    groups: list[list[SpanPart]]
    rows: int

    @cached_property
    def lookup(self) -> Groups | None:
        """The groups that cover leaders, or None if there is a single group."""
        return Groups(self.track, self.begins(), len(self.groups)) if len(self.groups) > 1 else None

    def begins(self) -> list[tuple[Place, int]]:
        """Return where groups begin in the rows that can hold leaders on the stretch, and their numbers, in order."""
        track, link_m = self.track, self.link_m
        fronts = [Place(parts[0].segment, parts[0].fore) for parts in self.groups]
        length_m = track.distance_of(fronts[0]) - max(self.stretch.low_m, track.begin_m)
        links = min(self.rows - 1, ceil(length_m / link_m) + 1)
        rows = [[(front, group) for group, front in enumerate(fronts)]]
        try:
            for _ in range(links):
                rows.append([(next_place(track, place, link_m, BEHIND)[0], group) for place, group in rows[-1]])
        except TrackEndError:       # the track begins before the last row
            pass
        return [*chain.from_iterable(rows)]


def span_of(track: Track, link_m: float, stretch: Stretch) -> Span | None:
    """Return the span for blocks of links of length ``link_m`` whose leaders are on a stretch.

    The result is None if the tables would be too large.
    """
    try:
        front = _front(track, link_m, stretch)
        low_m, front_m = max(stretch.low_m, track.begin_m), track.distance_of(front)
        count = ceil((front_m - low_m) / link_m) + 1 + (stretch.links if stretch.direction == BEHIND else 0)
        if front_m <= low_m or 8 * 5 * NODES * count > _MOST_BYTES:
            return None
        parts = _parts(track, link_m, front, front_m - count * reach_m(min(track.bend, 1 / link_m), link_m))
    except (TrackEndError, ChainLockError):
        return None
    if not parts or 8 * 5 * NODES * len(parts) * count > _MOST_BYTES:
        return None
    groups = ceil(len(parts) / _MOST_PARTS)
    ends = [len(parts) * n // groups for n in range(groups + 1)]
    return Span(track, link_m, stretch, [parts[a:b] for a, b in pairwise(ends)], count)


def build(span: Span, group: int) -> Table | None:
    """Return the table for one group of a span's parts, or None if the series do not converge."""
    track, link_m, stretch, parts, count = span.track, span.link_m, span.stretch, span.groups[group], span.rows
    try:
        pieces = [*zip(parts, _series(track, link_m, parts, count), strict=True)]
        return _built(track, link_m, pieces, count, stretch)
    except (TrackEndError, ChainLockError):
        return None


def _front(track: Track, link_m: float, stretch: Stretch) -> Place:
    """Return the foremost position of the span: that of the leader or, if the tail leads, that of the head ahead."""
    high_m = stretch.high_m
    if stretch.direction == AHEAD:
        high_m += stretch.links * reach_m(track.bend, link_m)
    front = track.place_at(min(track.end_m, high_m + _SAME * (1 + abs(high_m))))
    if front.segment == 0 and track.from_afar:
        return Place(0, max(front.u, link_m / (_WIDEST_RAD * track.from_afar.curve.b_m)))
    return front


def _parts(track: Track, link_m: float, front: Place, low_m: float) -> list[SpanPart]:
    """Return the parts of the span behind ``front``, cut at all positions a whole number of links ahead of a joint."""
    rear = next_place(track, front, link_m, BEHIND)[0]
    here_m, back_m = track.distance_of(front), track.distance_of(rear)
    inside = [k for k, metres in enumerate(track.joints_m, 1) if low_m < metres < here_m]
    if sum(here_m - track.joints_m[k - 1] for k in inside) / link_m > _MOST_STEPS:
        return []
    same_m, ends = 3 * _SAME * (1 + abs(here_m)), (*track.joints_m, track.end_m)
    if any(ends[k] - ends[k - 1] <= same_m for k in inside):    # the segment's two joints would coincide
        return []
    joints = [Place(k, track.segments[k].first) for k in inside]
    cuts = sorted((_pulled(track, link_m, place, back_m) for place in _nearly_pulled(track, link_m, joints, back_m)),
                  key=track.distance_of, reverse=True)
    places = [front]
    for cut in [*cuts, rear]:
        if track.distance_of(places[-1]) - track.distance_of(cut) > same_m:
            places.append(cut)
    return [part_between(track, fore, rear) for fore, rear in pairwise(places)]


def _nearly_pulled(track: Track, link_m: float, places: list[Place], back_m: float) -> list[Place]:
    """Move many positions ahead by the numbers of links that certainly fit (see ``_pulled``); return few unchanged."""
    if len(places) < _MANY_JOINTS:
        return places
    longest_m = reach_m(min(track.bend, 1 / link_m), link_m)
    for _ in range(_PULLS):
        sure = np.array([max(0, floor((back_m - track.distance_of(place)) / longest_m)) for place in places])
        begin: Places = np.array([place.segment for place in places]), np.array([place.u for place in places])
        most = int(np.max(sure))
        rows, _ = by_segment(track, (Block(0, most, link_m),), begin, AHEAD, most - sure)
        places = [Place.of(*each) for each in zip(*(values[-1] for values in rows), strict=True)]
    return places


def _pulled(track: Track, link_m: float, place: Place, back_m: float) -> Place:
    """Move a position ahead, link by link, into the span that ends at ``back_m``, and return it."""
    sure = floor((back_m - track.distance_of(place)) / reach_m(min(track.bend, 1 / link_m), link_m))
    if sure > 0:        # the number of links that certainly fit, given the longest arc of a link
        place = forward(track, [link_m] * sure, place, AHEAD).place(-1)
    while track.distance_of(place) <= back_m:
        place = next_place(track, place, link_m, AHEAD)[0]
    return place


def part_between(track: Track, fore: Place, rear: Place) -> SpanPart:
    """Return the part between two positions; the part is on a single segment."""
    middle = 0.5 * (track.distance_of(fore) + track.distance_of(rear))
    k = fore.segment if fore.segment == rear.segment else track.place_at(middle).segment
    segment = track.segments[k]
    return SpanPart(k, fore.u if fore.segment == k else segment.last, rear.u if rear.segment == k else segment.first)


def equal_parts(part: SpanPart, count: int) -> list[SpanPart]:
    """Cut a part into ``count`` parts of equal length."""
    step = (part.rear - part.fore) / count
    cuts = [part.fore + n * step for n in range(1, count)]
    return [SpanPart(part.segment, *ends) for ends in pairwise((part.fore, *cuts, part.rear))]


def _built(track: Track, link_m: float, first: list[tuple[SpanPart, _Pushed]], count: int,
           stretch: Stretch) -> Table | None:
    """Cut parts into thirds until all series converge, and return the table; None if they do not converge."""
    # Each piece is a part, its series if they are known, and the error of the part that it was cut from.
    pieces: list[tuple[SpanPart, _Pushed | None, float]] = [(*piece, inf) for piece in first]
    for _ in range(_ROUNDS):
        if 8 * 5 * NODES * len(pieces) * count > _MOST_BYTES:
            return None
        unknown = [part for part, one, _ in pieces if not one]
        new = iter(_series(track, link_m, unknown, count) if unknown else ())
        pushed = [one or next(new) for _, one, _ in pieces]
        rows = _together_in_rows(pushed, link_m, stretch)
        if rows.leading.start == rows.leading.stop:
            return None
        with np.errstate(all='ignore'):     # a part as short as its rounding error has no scale and no inverse
            x, middle, scale = scaled(rows.coordinates)
            some = x[:, :, rows.leading].transpose(1, 0, 2)
            inverse = inverse_series(some.reshape(NODES, -1)).reshape(some.shape).transpose(1, 0, 2)
            left = _left(rows, x, inverse, link_m)
        by_rounding = left >= 0.5 * np.array([whole for _, _, whole in pieces])     # cutting would not reduce it
        if np.any(by_rounding & (left > _MOST_NOISE)):
            return None
        ends = by_rounding | (left <= NOISE)
        if np.all(ends):
            return _table(rows, (x, middle, scale), inverse, link_m)
        before, pieces = pieces, []
        for (part, _, whole), one, over, done in zip(before, pushed, left.tolist(), ends.tolist(), strict=True):
            # Halves would need more rounds, which would take longer than the additional parts.
            pieces += [(part, one, whole)] if done else [(third, None, over) for third in equal_parts(part, 3)]
    return None


def _series(track: Track, link_m: float, parts: list[SpanPart], count: int) -> list[_Pushed]:
    """Map the nodes of parts back through ``count`` rows, or to the end of the track, and return their series."""
    segment, u = _pushed(track, link_m, parts, count)
    rows = segment.shape[0]
    p, heading = track.poses(segment, u)
    axis = p[:-1] - p[1:]
    ratio = dot(axis, heading[:-1]) / dot(axis, heading[1:])
    speed = np.cumprod(np.concatenate((np.ones((1, *u.shape[1:])), ratio)), axis=0)
    origin = u[..., NODES // 2]
    coordinates = series_of(np.ascontiguousarray((u - origin[..., None]).transpose(1, 2, 0)))
    places, motions = (series_of(np.ascontiguousarray(complex_of(values).transpose(1, 2, 0)).view(np.float64))
                       for values in (p, speed[..., None] * heading))
    # Nodes are ordered from the rear of a part to its front.
    along, far_m = track.distances(segment, u[..., [0, -1]]), np.max(np.abs(p), axis=(2, 3))
    rounding_m = np.maximum.accumulate(_HALF_ULP * np.max(np.abs(u * track.rates(segment, u)), axis=2))
    return [_Pushed(segment[:, n], origin[:, n], along[:, n], far_m[:, n], rounding_m[:, n], coordinates[n],
                    places[n].reshape(NODES, rows, 2), motions[n].reshape(NODES, rows, 2)) for n in range(len(parts))]


def _together_in_rows(pushed: list[_Pushed], link_m: float, stretch: Stretch) -> _RowSeries:
    """Return the series of all parts, in the rows that these have in common."""
    rows = min(one.segment.size for one in pushed)
    low_m, high_m = stretch.low_m - link_m, stretch.high_m + link_m
    along = np.stack([one.along_m[:rows] for one in pushed], axis=1)
    reached = np.flatnonzero(np.any((along[..., 1] > low_m) & (along[..., 0] < high_m), axis=1))
    leading = slice(int(reached[0]), int(reached[-1]) + 1) if reached.size else slice(0, 0)
    # Rows near the origin use the errors of a spiral that holds the whole dragon in turns one link apart.
    far_m = np.max([one.far_m[:rows] for one in pushed], axis=0)
    size_m = np.maximum(far_m, link_m * np.sqrt(stretch.links))
    error_m = np.maximum(TRUNCATION * size_m, np.max([one.rounding_m[:rows] for one in pushed], axis=0))
    origin = np.stack([one.origin[:rows] for one in pushed], axis=-1)
    return _RowSeries(np.stack([one.segment[:rows] for one in pushed], axis=1), origin, leading,
                 error_m, np.stack([one.coordinates[:, :rows] for one in pushed]),
                 *(np.stack([getattr(one, name)[:, :rows].reshape(NODES, -1) for one in pushed])
                   for name in ('places', 'motions')))


def _pushed(track: Track, link_m: float, parts: list[SpanPart], count: int) -> Places:
    """Return the segments (R, S) of the nodes in all rows, and their coordinates (R, S, K)."""
    nodes: Floats = np.array([part.nodes() for part in parts])
    numbers: Ints = np.repeat([part.segment for part in parts], NODES)
    first: Places = numbers, nodes.ravel()

    def settle(places: Places) -> Places:
        return on_one_segment(track, places) if len(track.segments) > 1 else places

    # ``count`` rows, or fewer if the track ends earlier
    rows: list[Places] = [(numbers[None], nodes.reshape(1, -1))]
    for k, many in _spans(track, link_m, first, count):
        last: Places = rows[-1][0][-1], rows[-1][1][-1]
        found = None if k is None else _along(track.segments[k], link_m, last, many)
        if found is None:
            (segment, u), _ = forward_many(track, (Block(0, many, link_m),), last, BEHIND, settle)
            found = segment[1:], u[1:]
        rows.append(found)
        if len(found[0]) < many:
            break
    shape = -1, len(parts), NODES
    segment, u = (np.concatenate(values) for values in zip(*rows, strict=True))
    return segment.reshape(shape)[..., 0], u.reshape(shape)


def _spans(track: Track, link_m: float, first: Places, count: int) -> list[tuple[int | None, int]]:
    """Return the steps through the rows behind the first row of nodes, as pairs (segment index or None, row count).

    None means that the rows are solved one by one. If the foremost and the rearmost node are on the same segment, all
    other nodes are on it too.
    """
    if len(track.segments) == 1:
        return [(0, count - 1)]
    front = Place.of(*(values[NODES - 1].item() for values in first))
    links = count
    if track.begin_m == -inf:       # nodes on the first segment stay on it
        links = min(count, max(1, ceil((track.distance_of(front) - track.joints_m[0]) / link_m) + 2))
    try:
        fore = forward(track, [link_m] * links, front, BEHIND).segment
    except (TrackEndError, ChainLockError):     # the track ends before the last row
        return [(None, count - 1)]
    # The rearmost node is one link behind the foremost node.
    on = [a if a == b else None for a, b in pairwise(fore)] + [0] * (count - links)
    out, row = list[tuple[int | None, int]](), 0
    for k, group in groupby(range(count), on.__getitem__):
        numbers = [*group]
        begin, last = numbers[0], numbers[-1]
        if k is not None and last - begin >= (FEWEST_ROWS if isinstance(track.segments[k], SpiralSegment) else 1):
            out += [(None, begin - row), (k, last - begin)]
            row = last
    return [(k, many) for k, many in (*out, (None, count - 1 - row)) if many]


def _along(segment: Segment, link_m: float, first: Places, count: int) -> Places | None:
    """Return the rows (count, S K) of nodes that follow a row (S K,), all on one segment.

    The result is None if the rows cannot be solved simultaneously.
    """
    number, begin = first
    numbers = np.broadcast_to(number, (count, number.size))
    if isinstance(segment, SpiralSegment):
        found = placed(segment, begin, np.full((count, 1), link_m / segment.curve.b_m))
        return (numbers, found[0][1:]) if found else None
    step, _ = segment.shifts(begin[:1], link_m, BEHIND)        # on a line or an arc, all shifts are equal
    u = begin + np.arange(1.0, count + 1)[:, None] * step[0]
    return (numbers, u) if np.min(u) >= segment.first else None


def on_one_segment(track: Track, places: Places) -> Places:
    """Return positions with each part on one segment; a node that rounding put beyond a joint is moved to the joint."""
    shape = -1, NODES
    segment, u = places[0].reshape(shape), places[1].reshape(shape)
    if np.all(segment == segment[:, :1]):
        return places
    most: Ints = np.repeat(segment[:, NODES // 2], NODES).reshape(shape)
    for part, node in np.argwhere(segment != most).tolist():
        own = track.segments[int(most[part, node])]
        u[part, node] = own.first if segment[part, node] < most[part, node] else own.last
    return most.ravel(), u.ravel()


def scaled(coordinates: Floats) -> tuple[Floats, Floats, Floats]:
    """Return series (S, K, R) scaled to x in [-1, 1], with the subtracted middles (S, R) and the scales (S, R)."""
    sign = np.where(np.arange(coordinates.shape[1]) % 2, -1.0, 1.0)[:, None]
    fore, rear = np.sum(sign * coordinates, axis=1), np.sum(coordinates, axis=1)
    middle, scale = 0.5 * (fore + rear), 2 / (rear - fore)
    x = coordinates * scale[:, None]
    x[:, 0] -= middle * scale
    return x, middle, scale


def _left(rows: _RowSeries, x: Floats, inverse: Floats, link_m: float) -> Floats:
    """Return an estimate of each part's truncation error (S,) from its last terms, in units of the rows' errors."""
    half, twice = _half_widths_m(rows) / rows.error_m, np.repeat(rows.error_m, 2)
    last = (rows.places[:, -2:] / twice, link_m * rows.motions[:, -2:] / twice, half * x[:, -2:],
            half[:, :, rows.leading] * inverse[:, -2:])
    out: Floats = np.max([np.max(np.abs(values), axis=(1, 2)) for values in last], axis=0)
    out[~np.isfinite(out)] = inf
    return out


def _half_widths_m(rows: _RowSeries) -> Floats:
    """Return the approximate half lengths (m, shape (S, 1, R)) of the parts in all rows."""
    out: Floats = np.hypot(rows.places[:, 1:2, ::2], rows.places[:, 1:2, 1::2])
    return out


def _table(rows: _RowSeries, scaled: tuple[Floats, Floats, Floats], inverse: Floats, link_m: float) -> Table:
    """Return the table with as many terms as its longest series needs."""
    (x, middle, scale), half, leading = scaled, _half_widths_m(rows) / rows.error_m, rows.leading
    parts, twice = rows.segment.shape[1], np.repeat(rows.error_m, 2)
    places, motions = np.abs(rows.places) / twice, np.abs(link_m * rows.motions) / twice
    # A velocity is a product of many ratios, so its rounding error may exceed the error at which its series is
    # truncated.
    noise = max(1.0, 2 * float(np.max(motions[:, -2:])))
    size = np.maximum(places, np.where(motions > noise, motions, 0.0))
    terms = _enough(np.maximum(size[..., ::2], size[..., 1::2]))
    charts = half[:, :, leading] * np.maximum(np.abs(inverse), np.abs(x[:, :, leading]))
    nodes = max(int(np.max(terms)), int(np.max(_enough(charts))))
    powers = powers_of(inverse[:, :nodes].transpose(1, 0, 2).reshape(nodes, -1)).reshape(parts, -1, nodes)
    x, p, v = (read_only(np.ascontiguousarray(series[:, :nodes])) for series in (x, rows.places, rows.motions))
    slack, centre = NOISE / half[:, 0, leading].T, np.stack((rows.origin + middle.T, scale.T), axis=-1)
    return Table(rows.segment, read_only(centre), leading.start, read_only(slack),
                 read_only(powers.transpose(1, 0, 2).copy()), x, p, v, terms, rows.error_m)


def _enough(size: Floats) -> Ints:
    """Return the number of terms (S, R) that suffice from each row on; ``size`` (S, K, R) is in units of the error."""
    needed = size.shape[1] - np.argmax(size[:, ::-1] > 1, axis=1)
    return np.maximum.accumulate(needed[:, ::-1], axis=1)[:, ::-1]
