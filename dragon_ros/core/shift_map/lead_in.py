"""The position of a leader one link before a block, if the first handle of the block is in a cell of the table.

A dragon's head link is longer than its other links, so the leader is one link before the first block, outside all rows.
However, while the first handle of the block is in one cell, at u in [-1, 1], the leader's position is a smooth function
of the same u. The leader's coordinate, position and motion therefore have series in u, like all rows. The inverse of
the coordinate's series yields u without solving for the first handle, and one product then yields the whole chain,
including the leader.

If the leader passes a joint while the handle is in one cell, no such series converges. Because lines, arcs and spirals
can be extended beyond their ends, the leader is a smooth function of u on each extended segment. The cell therefore has
a chart for each of these segments, which is used while the leader is on the segment itself.
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

# The number of nodes next to a joint, where series for a longer link converge more slowly than the block's series.
_MORE_NODES = 36
_NEWTON_STEPS = 12      # maximum number of Newton steps on an extended segment
_SOLVED = 1e-14         # length of a Newton step, relative to the link, after which no further step is needed
_SAME = 1e-9            # largest distance between equal solutions, relative to the link


class Chart(NamedTuple):
    """Charts (C,) that locate cells by the coordinates of positions in them; the foremost chart comes first.

    ``cell`` (C,) holds the numbers of the cells, counted by row (from row ``first`` on) and part; a cell may have
    several charts. ``middle`` (C, 3) holds the segment's coordinate in the middle of a cell as (hi, lo), and a scale,
    such that x = (coordinate - middle) * scale lies in [-1, 1]. Rounding may make |x| exceed 1 by up to ``slack`` (C,).
    ``inverse`` (C, K) holds the coefficients of u(x), the highest power first.
    """

    first: int
    cell: Ints
    segment: Ints
    middle: Floats
    slack: Floats
    inverse: Floats


def chart_of(table: Table) -> Chart:
    """Return the charts of the rows that can hold leaders of blocks."""
    rows, cells = slice(table.first, table.first + len(table.slack)), table.slack.size
    return Chart(table.first, np.arange(cells), table.segment[rows].ravel(), table.middle[rows].reshape(cells, 3),
                 table.slack.ravel(), table.inverse.reshape(cells, -1))


@dataclass(frozen=True, eq=False)
class LeadIn:
    """The charts and the series of leaders one link before the cells of a table.

    ``places`` and ``motions`` (C, K, 2) hold series as in the table; the first ``terms`` (C,) terms are sufficient.
    """

    chart: Chart
    places: Floats
    motions: Floats
    terms: Ints

    def leader(self, chart: int) -> tuple[Floats, Floats]:
        """Return the series (terms, 2) of the position and of the motion of a chart's leader."""
        terms = self.terms[chart]
        return self.places[chart, :terms], self.motions[chart, :terms]

    @property
    def nodes(self) -> int:
        """The number of terms of the series."""
        return int(self.places.shape[1])

    @property
    def memory_bytes(self) -> int:
        """The size of all arrays in bytes."""
        return sum(values.nbytes for values in (*self.chart[1:], self.places, self.motions, self.terms))


def towards_leader(track: Track, place: Place, link_m: float, direction: int) -> Place | None:
    """Return the position of the leader whose follower in ``direction`` is at ``place``, or None if there is none."""
    tame = track.without_locks(link_m)
    if tame is None or not _has_leader(tame, track.distance_of(place)[0], link_m, direction):
        return None
    return tame.next(place, link_m, -direction)[0]


def lead_in(track: Track, table: Table, links_m: tuple[float, float], direction: int,
            stretch_m: tuple[float, float]) -> LeadIn | None:
    """Return the leaders one link before those cells of a table that are on a given stretch of the track.

    ``links_m`` holds the lengths of the leader's link and of the table's links. The result is None if no cell has a
    leader.
    """
    link_m = links_m[0]
    tame, rows = track.without_locks(link_m), _rows_on(track, table, stretch_m)
    if tame is None or not rows.size:
        return None
    followers, p, motion = _followers(track, table, rows, NODES)
    along = track.distances(followers[0][:, [0, -1]], followers[1][:, [0, -1]])     # in order from rear to front
    found = np.flatnonzero(_has_leader(tame, along[:, 1 if direction == BEHIND else 0], link_m, direction))
    leaders = _leaders(tame, followers, found, link_m, direction)
    if leaders is None:
        return None
    one = np.all(leaders[0] == leaders[0][:, :1], axis=1)
    some, longest_m = found[one], max(links_m)
    parts = [_fitted(track, table, rows, some, _some(leaders, one), (p[some], motion[some]), longest_m)]
    if not np.all(one):
        parts += _next_to_joints(track, table, rows, found[~one], links_m, direction)
    return _joined([part for part in parts if part])


def _some(places: Places, which: Array) -> Places:
    return places[0][which], places[1][which], places[2][which]


def _leaders(track: Track, followers: Places, cells: Ints, link_m: float, direction: int) -> Places | None:
    """Return the leaders (C, nodes) of the followers in the given cells, or None if there are no leaders."""
    if not cells.size:
        return None
    segment, u, lo = _some(followers, cells)
    try:
        found, _, _ = next_places(track, (segment.ravel(), u.ravel(), lo.ravel()), link_m, -direction)
    except (TrackEndError, ChainLockError):
        return None
    return found[0].reshape(u.shape), found[1].reshape(u.shape), found[2].reshape(u.shape)


def _next_to_joints(track: Track, table: Table, rows: Ints, cells: Ints, links_m: tuple[float, float],
                    direction: int) -> list[LeadIn | None]:
    """Return the charts and series of cells in which the leader passes a joint, one part per segment of the leader."""
    followers, p, motion = _followers(track, table, rows, _MORE_NODES)
    leaders = _leaders(track, followers, cells, links_m[0], direction)
    if leaders is None:
        return []
    parts = list[LeadIn | None]()
    for k in track.present(leaders[0]):
        near = np.any(leaders[0] == k, axis=1)
        some = cells[near]
        on_k = _on_extended(track, k, _some(leaders, near), p[some], links_m[0])
        parts.append(_fitted(track, table, rows, some, on_k, (p[some], motion[some]), max(links_m)))
    return parts


def _on_extended(track: Track, k: int, leaders: Places, followers: Floats, link_m: float) -> Places:
    """Return the leaders (C, nodes) of followers (C, nodes, 2) on segment k, which is extended beyond its ends.

    Values are NaN for cells without a smooth solution that equals the leader wherever the leader is on the segment
    itself.
    """
    segment, (number, own, own_lo) = track.segments[k], leaders
    point = followers[..., 0] + 1j * followers[..., 1]
    with np.errstate(all='ignore'):
        u, lo = segment.after_many(track.distances(number, own) - track.origins_m[k], np.zeros_like(own))
        for _ in range(_NEWTON_STEPS):
            here, heading = segment.poses(u, lo)
            link = here - point
            slope = (link.conjugate() * heading).real * segment.rate(u)
            change = 0.5 * (link.real * link.real + link.imag * link.imag - link_m * link_m) / slope
            u, lo = plus(u, lo, -change)
            if np.all(np.abs(change * segment.rate(u)) <= _SOLVED * link_m):
                break
        off = np.abs(((u - own) + (lo - own_lo)) * segment.rate(u))
        is_one = np.all(np.isfinite(u) & ((number != k) | (off <= _SAME * link_m)), axis=1)[:, None]
    return np.full_like(number, k), np.where(is_one, u, np.nan), np.where(is_one, lo, np.nan)


def _has_leader(track: Track, along_m: Floats | float, link_m: float, direction: int) -> Array:
    """Return whether a position certainly has a leader one link away, regardless of the track in between."""
    reach = reach_m(track.bend, link_m)
    return np.asarray(along_m + reach <= track.end_m if direction == BEHIND else along_m - reach >= track.begin_m)


def _rows_on(track: Track, table: Table, stretch_m: tuple[float, float]) -> Ints:
    """Return the rows that can hold leaders of blocks and have a part on a stretch."""
    rows = np.arange(table.first, table.first + len(table.slack))
    half = 1 / table.middle[rows, :, 2]
    low, high = (track.distances(table.segment[rows], table.middle[rows, :, 0] + end) for end in (half, -half))
    out: Ints = rows[np.any((high >= stretch_m[0]) & (low <= stretch_m[1]), axis=1)]
    return out


def _followers(track: Track, table: Table, rows: Ints, nodes: int) -> tuple[Places, Floats, Floats]:
    """Return the nodes of the cells in ``rows``, rear first: positions (C, nodes), points (C, nodes, 2) and motions."""
    count = table.nodes
    at: Floats = np.asarray(chebyshev.chebvander(transform(nodes)[0], count - 1), dtype=np.float64)     # (nodes, K)
    x = in_parts(at, table.coordinates[:, :, rows]).transpose(2, 0, 1)
    middle = table.middle[rows]
    segment = np.repeat(table.segment[rows][..., None], nodes, axis=-1).reshape(-1, nodes)
    high, low = plus(middle[..., :1], middle[..., 1:2], x / middle[..., 2:])
    places = segment, high.reshape(-1, nodes), low.reshape(-1, nodes)
    series = table.motions[:, :, 2 * rows[0]:2 * rows[-1] + 2]
    motion = in_parts(at, series).reshape(table.parts, nodes, -1, 2).transpose(2, 0, 1, 3).reshape(-1, nodes, 2)
    return places, track.points(*places), motion


def _fitted(track: Track, table: Table, rows: Ints, cells: Ints, leaders: Places, followers: tuple[Floats, Floats],
            longest_m: float) -> LeadIn | None:
    """Fit the series of leaders to the nodes of cells, each on one segment; omit series that do not converge."""
    segment, u, lo = leaders
    centre = u.shape[1] // 2
    origin = u[:, centre], lo[:, centre]
    with np.errstate(all='ignore'):     # a cell as short as its rounding error has no scale and no inverse
        p, heading = track.poses(segment, u, lo)
        axis = p - followers[0]
        pace = dot(axis, followers[1]) / dot(axis, heading)
        from_origin = (u - origin[0][:, None]) + (lo - origin[1][:, None])
        places, motions = map(series_of, (p, pace[..., None] * heading))
        half = np.hypot(places[:, 1, 0], places[:, 1, 1])
        # All speeds are relative to the leader's motion; a short link must not make this motion less accurate than
        # the motions of other handles.
        size = np.maximum(np.abs(places), longest_m * np.abs(motions)).max(axis=2)
        (x,), (middle,), (scale,) = scaled(series_of(from_origin.T)[None])
        inverse = inverse_series(x)
        charts = (half * np.maximum(np.abs(inverse), np.abs(x))).T
        last = np.maximum(size, charts)[:, -2:].max(axis=1)
        row = rows[cells // table.parts]
        error_m = table.error_m[row]
        on = np.flatnonzero(last <= NOISE * error_m)
        half, size, charts = half / error_m, size / error_m[:, None], charts / error_m[:, None]
    if not on.size:
        return None
    terms = _enough(size)
    nodes = max(table.nodes, int(np.max(np.maximum(terms, _enough(charts))[on])))
    coordinates = np.stack((*plus(*origin, middle), scale), axis=-1)
    chart = Chart(int(rows[0]), cells[on], segment[on, 0], coordinates[on], NOISE / half[on],
                  powers_of(inverse[:nodes, on]))
    return LeadIn(chart, places[on, :nodes], motions[on, :nodes], terms[on])


def _joined(parts: list[LeadIn]) -> LeadIn | None:
    """Join several parts into one, the foremost chart first; shorter series are padded with zeros."""
    if not parts:
        return None
    nodes = max(part.nodes for part in parts)
    order = np.argsort(np.concatenate([part.chart.cell for part in parts]), kind='stable')

    def of_all(values: list[Array]) -> Array:
        return read_only(np.concatenate(values)[order])

    def filled_up(values: Floats, before: bool = False) -> Floats:
        room = (0, 0), (nodes - values.shape[1], 0) if before else (0, nodes - values.shape[1])
        return np.pad(values, room + ((0, 0),) * (values.ndim - 2))
    charts = [part.chart for part in parts]
    chart = Chart(charts[0].first, of_all([one.cell for one in charts]), of_all([one.segment for one in charts]),
                  of_all([one.middle for one in charts]), of_all([one.slack for one in charts]),
                  of_all([filled_up(one.inverse, before=True) for one in charts]))
    return LeadIn(chart, of_all([filled_up(part.places) for part in parts]),
                  of_all([filled_up(part.motions) for part in parts]), of_all([part.terms for part in parts]))


def _enough(size: Floats) -> Ints:
    """Return the number of terms (C,) that suffice; ``size`` (C, K) is in units of the error."""
    out: Ints = size.shape[1] - np.argmax(size[:, ::-1] > 1, axis=1)
    return out
