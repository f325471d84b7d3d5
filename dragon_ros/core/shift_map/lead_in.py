"""One link before a block: the position of the leader if the first handle of the block is in a cell of the table.

A dragon's head link is longer than its others, so its leader is one link before the first block, outside all rows. But
while the first handle is in one cell, at u in [-1, 1], the leader is a smooth function of that same u. So its
coordinate, position and motion have series in u, as all rows have, and the inverse of the coordinate gives u without
solving for the first handle: one product then fills in the whole chain, including the leader.
"""
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from dragon_ros.core.chain.forward import next_places
from dragon_ros.core.errors import ChainLockError, TrackEndError
from dragon_ros.core.numerics.chebyshev import in_parts, inverse_series, powers_of, series_of, transform
from dragon_ros.core.numerics.double_double import plus
from dragon_ros.core.numerics.types import Array, Floats, Ints, read_only
from dragon_ros.core.numerics.vectors import dot
from dragon_ros.core.shift_map.build import NODES, NOISE, Table, scaled
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND, reach_m

_NOWHERE = -1           # segment of a cell without a chart


class Chart(NamedTuple):
    """Cells (C,) by the coordinates of the positions in them, in the order of rows, from ``first`` on, and parts.

    ``middle`` (C, 3) is the segment's coordinate in the middle as (hi, lo), and a scale, with x = (coordinate - middle)
    * scale in [-1, 1]. Rounding may put |x| beyond 1 by ``slack`` (C,). ``inverse`` (C, K) are the coefficients of
    u(x), the highest power first.
    """

    first: int
    segment: Ints
    middle: Floats
    slack: Floats
    inverse: Floats


def chart_of(table: Table) -> Chart:
    """Return the chart of the rows that can hold leaders of blocks."""
    rows, cells = slice(table.first, table.first + len(table.slack)), table.slack.size
    return Chart(table.first, table.segment[rows].reshape(-1), table.middle[rows].reshape(cells, 3),
                 table.slack.reshape(-1), table.inverse.reshape(cells, -1))


@dataclass(frozen=True, eq=False)
class LeadIn:
    """The chart of leaders one link before each cell of a table, and their own series.

    ``places`` and ``motions`` (C, K, 2) are as in the table; their first ``terms`` (C,) are sufficient.
    """

    chart: Chart
    places: Floats
    motions: Floats
    terms: Ints

    def leader(self, cell: int) -> tuple[Floats, Floats]:
        """Return the series of the position and the motion of a cell's leader, (terms, 2) each."""
        terms = self.terms[cell]
        return self.places[cell, :terms], self.motions[cell, :terms]

    @property
    def nodes(self) -> int:
        """Number of terms of the series."""
        return int(self.places.shape[1])

    @property
    def memory_bytes(self) -> int:
        """The size of the arrays."""
        return sum(values.nbytes for values in (*self.chart[1:], self.places, self.motions, self.terms))


def towards_leader(track: Track, place: Place, link_m: float, direction: int) -> Place | None:
    """Return the position of the leader whose follower at a link in ``direction`` is at ``place``, or None."""
    tame = track.without_locks(link_m)
    if tame is None or not _has_leader(tame, track.distance_of(place)[0], link_m, direction):
        return None
    return tame.next(place, link_m, -direction)[0]


def lead_in(track: Track, table: Table, links_m: tuple[float, float], direction: int,
            stretch_m: tuple[float, float]) -> LeadIn | None:
    """Return the leaders one link before the cells of a table that are on a stretch of the track.

    ``links_m`` are the leader's link and that of the table. None if no cell has a leader.
    """
    link_m = links_m[0]
    tame, rows = track.without_locks(link_m), _rows_on(track, table, stretch_m)
    if tame is None or not rows.size:
        return None
    followers, p, motion = _followers(track, table, rows)
    along = track.distances(followers[0][:, [0, -1]], followers[1][:, [0, -1]])     # from rear to front
    found = _has_leader(tame, along[:, 1 if direction == BEHIND else 0], link_m, direction)
    if not np.any(found):
        return None
    flat: Places = tuple(values[found].reshape(-1) for values in followers)     # type: ignore[assignment]
    try:
        leaders, _, _ = next_places(tame, flat, link_m, -direction)
    except (TrackEndError, ChainLockError):
        return None
    return _fitted(track, table, rows, np.flatnonzero(found), leaders, (p[found], motion[found]), max(links_m))


def _has_leader(track: Track, along_m: Floats | float, link_m: float, direction: int) -> Array:
    """Return whether a position certainly has a leader one link away, whatever the track between them."""
    reach = reach_m(track.bend, link_m)
    return np.asarray(along_m + reach <= track.end_m if direction == BEHIND else along_m - reach >= track.begin_m)


def _rows_on(track: Track, table: Table, stretch_m: tuple[float, float]) -> Ints:
    """Return the rows that can hold leaders of blocks and have a part on a stretch."""
    rows = np.arange(table.first, table.first + len(table.slack))
    half = 1 / table.middle[rows, :, 2]
    low, high = (track.distances(table.segment[rows], table.middle[rows, :, 0] + end) for end in (half, -half))
    out: Ints = rows[np.any((high >= stretch_m[0]) & (low <= stretch_m[1]), axis=1)]
    return out


def _followers(track: Track, table: Table, rows: Ints) -> tuple[Places, Floats, Floats]:
    """Return the nodes of the cells of rows (C, nodes), rear first: positions, points (C, nodes, 2) and motions."""
    count = table.nodes
    at: Floats = np.asarray(chebyshev.chebvander(transform(NODES)[0], count - 1), dtype=np.float64)     # (nodes, K)
    x = in_parts(at, table.coordinates[:, :, rows]).transpose(2, 0, 1)
    middle = table.middle[rows]
    segment = np.repeat(table.segment[rows][..., None], NODES, axis=-1).reshape(-1, NODES)
    high, low = plus(middle[..., :1], middle[..., 1:2], x / middle[..., 2:])
    places = segment, high.reshape(-1, NODES), low.reshape(-1, NODES)
    series = table.motions[:, :, 2 * rows[0]:2 * rows[-1] + 2]
    motion = in_parts(at, series).reshape(table.parts, NODES, -1, 2).transpose(2, 0, 1, 3).reshape(-1, NODES, 2)
    return places, track.points(*places), motion


def _fitted(track: Track, table: Table, rows: Ints, cells: Ints, leaders: Places, followers: tuple[Floats, Floats],
            longest_m: float) -> LeadIn | None:
    """Return the series of leaders at the nodes of some cells; a cell whose series do not converge gets no chart.

    Series that do not converge to the accuracy of the table may converge to that of its tier.
    """
    segment = leaders[0].reshape(-1, NODES)
    u, lo = (values.reshape(-1, NODES) for values in leaders[1:])
    p, heading = track.poses(segment, u, lo)
    axis = p - followers[0]
    pace = dot(axis, followers[1]) / dot(axis, heading)
    centre = NODES // 2
    origin = u[:, centre], lo[:, centre]
    from_origin = (u - origin[0][:, None]) + (lo - origin[1][:, None])
    places, motions = map(series_of, (p, pace[..., None] * heading))
    half = np.hypot(places[:, 1, 0], places[:, 1, 1])
    one = np.all(segment == segment[:, :1], axis=1)
    # All speeds are relative to the leader's motion: a short link must not make it less accurate than the others.
    size = np.maximum(np.abs(places), longest_m * np.abs(motions)).max(axis=2)
    with np.errstate(all='ignore'):     # a cell no longer than its rounding has no scale and no inverse
        (x,), (middle,), (scale,) = scaled(series_of(from_origin.T)[None])
        inverse = np.zeros_like(x)
        inverse[:, one] = inverse_series(x[:, one])
        charts = (half * np.maximum(np.abs(inverse), np.abs(x))).T
        last = np.maximum(size, charts)[:, -2:].max(axis=1)
        row = rows[cells // table.parts]
        error_m = np.where(last <= NOISE * table.error_m[row], table.error_m[row], table.allowed_m[row])
        served = one & (last <= NOISE * error_m)
        half, size, charts = half / error_m, size / error_m[:, None], charts / error_m[:, None]
    if not np.any(served):
        return None
    terms = _enough(size)
    nodes = max(table.nodes, int(np.max(np.maximum(terms, _enough(charts))[served])))
    numbers, count, on = cells[served], rows.size * table.parts, np.flatnonzero(served)

    def of_all(values: Array, empty: float = 0.0) -> Array:
        out = np.full((count, *values.shape[1:]), empty, dtype=values.dtype)
        out[numbers] = values
        return read_only(out)

    coordinates = np.stack((*plus(*origin, middle), scale), axis=-1)
    chart = Chart(int(rows[0]), of_all(segment[on, 0], _NOWHERE), of_all(coordinates[on], 1.0),
                  of_all(NOISE / half[on]), of_all(powers_of(inverse[:nodes, on])))
    return LeadIn(chart, of_all(places[on, :nodes]), of_all(motions[on, :nodes]), of_all(terms[on]))


def _enough(size: Floats) -> Ints:
    """Return how many terms of sizes (C, K), in units of the error, are sufficient."""
    out: Ints = size.shape[1] - np.argmax(size[:, ::-1] > 1, axis=1)
    return out
