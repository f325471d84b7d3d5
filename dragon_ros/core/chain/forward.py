"""Place handles along a track, starting at the leader, in blocks of equal links, at one instant or at many.

``forward`` handles one leader and ``forward_many`` handles many leaders; their docstrings explain why there are two
functions. ``forward_many`` calls ``together`` for up to ``_MOST_LEADERS`` chains on a spiral and ``by_segment`` for
tracks of several segments.
"""
from collections.abc import Callable
from itertools import pairwise
from math import pi
from typing import NamedTuple

import numpy as np

from dragon_ros.core.errors import ChainLockError, TrackEndError
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import AHEAD, BEHIND, NEW, Past
from dragon_ros.core.tracks.spiral import TIGHT, SpiralSegment, newton_steps

FEWEST_ROWS = 8        # minimum number of rows of handles for simultaneous placement
_AT_ONCE = 2**14        # number of handles whose intermediate results fit in the cache
_MOST_LEADERS = 512     # maximum number of leaders for simultaneous placement; with more, placing row by row is as fast
_FAR_RAD = 2.0          # smallest polar angle for which the positions of all rows can be guessed
_NEWTON_STEPS = 8       # limit on the number of Newton steps for all rows at once
_STEEP = 0.05           # smallest slope of the map from row to row; below it, a follower has almost turned back


class Block(NamedTuple):
    """Links ``start`` to ``stop - 1``, counted from the leader, of equal length."""

    start: int
    stop: int
    link_m: float


class Handles(NamedTuple):
    """Handles at one instant, in order from the leader: segments, coordinates and the evaluation count."""

    segment: list[int]
    u: list[float]
    evaluations: int

    def place(self, n: int) -> Place:
        """Return the position of one handle."""
        return Place(self.segment[n], self.u[n])


def blocks_of(links_m: Floats, direction: int) -> tuple[Block, ...]:
    """Return the blocks of equal links in order from the leader; links (N,) are given from head to tail."""
    links = links_m[::-direction]
    if not links.size:
        return ()
    ends = [0, *(np.flatnonzero(np.diff(links)) + 1).tolist(), links.size]
    return tuple(Block(start, stop, links.item(start)) for start, stop in pairwise(ends))


def in_order(links_m: Floats, direction: int) -> list[float]:
    """Return link lengths (N,), given from head to tail, in order from the leader."""
    out: list[float] = links_m[::-direction].tolist()
    return out


def forward(track: Track, links_m: list[float], leader: Place, direction: int, first: int = 0) -> Handles:
    """Return the leader and the handles that follow it; ``links_m`` holds their links in order from the leader.

    For one instant, plain floats take 1 us per handle, whereas one-element arrays take 30 us. ``first`` is the number
    of the first link, for errors.

    Raises ChainLockError if a link cannot be placed near the centre of a spiral, and TrackEndError if the track is
    too short.
    """
    k, u = leader
    segments, us, spent, i = [k], [u], 0, 0
    while i < len(links_m):
        found, more = track.segments[k].march(u, links_m[i:], direction, track.edge(k, direction))
        segments += [k] * len(found)
        us += found
        spent += more
        i += len(found)
        if i < len(links_m):
            (k, u), more = _beyond(track, Place(k, us[-1]), links_m[i], direction, first + i)
            segments.append(k)
            us.append(u)
            spent += more
            i += 1
    return Handles(segments, us, spent)


def next_place(track: Track, place: Place, link_m: float, direction: int, number: int = 0) -> tuple[Place, int]:
    """Return the handle that follows a handle, and the evaluation count: ``forward`` for one link, in half the time."""
    k, u = place
    found, spent = track.segments[k].march(u, [link_m], direction, track.edge(k, direction))
    if found:
        return Place(k, found[0]), spent
    there, more = _beyond(track, place, link_m, direction, number)
    return there, spent + more


def _beyond(track: Track, place: Place, link_m: float, direction: int, number: int) -> tuple[Place, int]:
    """Return the handle that follows a handle on another segment, and the evaluation count; see ``forward``."""
    if direction == BEHIND and place.segment == 0 and track.from_afar:
        raise locked(track, number, place.u, link_m)
    return track.across(place, link_m, direction)


def locked(track: Track, link: int, theta: float, link_m: float) -> ChainLockError:
    """Return the error for a link that cannot be placed; its front handle is at ``theta`` on the first segment."""
    spiral = track.from_afar
    assert spiral
    radius = spiral.curve.b_m * theta
    return ChainLockError(
        f'the chain locks: link {link} of {link_m:.6g} m cannot be placed behind its front handle at radius '
        f'{radius:.6f} m; end the scene earlier, or use shorter benches or a larger pitch',
        link=link, radius_m=radius, theta_rad=theta)


def forward_many(track: Track, blocks: tuple[Block, ...], leaders: Places, direction: int,
                 settle: Callable[[Places], Places] | None = None) -> tuple[Places, int]:
    """Return the handles behind many leaders (M,) as arrays (links + 1, M), and the number of evaluations.

    With one array per row and 300 leaders, this takes 0.16 us per handle. The handles agree with ``forward`` except in
    the last digits. ``settle`` may adjust each row; if it is given, the result ends at the last row that fits on
    the track. Raises the same errors as ``forward``.
    """
    if not settle and blocks and (found := together(track, _links_of(blocks), leaders, direction)):
        return found
    if settle or (len(track.segments) == 1 and isinstance(track.segments[0], SpiralSegment)):
        return row_by_row(track, blocks, leaders, direction, settle)
    return by_segment(track, blocks, leaders, direction)


def _links_of(blocks: tuple[Block, ...]) -> Floats:
    """Return the link lengths (N,) of the blocks in order from the leader."""
    return np.repeat([block.link_m for block in blocks], [block.stop - block.start for block in blocks])


def row_by_row(track: Track, blocks: tuple[Block, ...], leaders: Places, direction: int,
               settle: Callable[[Places], Places] | None = None) -> tuple[Places, int]:
    """Return the result of ``forward_many``, computed handle by handle with one array per row."""
    rows, spent, past = [leaders], 0, NEW
    for block in blocks:
        past = Past((), past.rest)
        for i in range(block.start, block.stop):
            try:
                following, past, more = next_places(track, rows[-1], block.link_m, direction, past)
            except ChainLockError as error:
                raise locked(track, i, error.fields['theta_rad'], block.link_m) from None
            except TrackEndError:
                if settle:
                    return _stacked(rows), spent
                raise
            rows.append(settle(following) if settle else following)
            spent += more
    return _stacked(rows), spent


def by_segment(track: Track, blocks: tuple[Block, ...], leaders: Places, direction: int,
               starts: Ints | None = None) -> tuple[Places, int]:
    """Return the result of ``forward_many``, computed segment by segment for all handles of a block at once.

    If ``starts`` (M,) is given, each leader takes the place of the handle with this index instead of the first one;
    the rows before it are undefined.

    On a track of several segments, the handles of one row lie on many different segments. For 500 leaders with 223
    links on 50 lines and arcs, this takes a fifth of the time of ``row_by_row``. On a line or an arc, equal links span
    equal lengths of the track, so all handles there are computed directly.
    """
    size, (first, stop) = leaders[1].size, (blocks[0].start, blocks[-1].stop) if blocks else (0, 0)
    rows: Places = np.empty((stop + 1, size), dtype=np.int64), np.empty((stop + 1, size))     # from ``first`` on
    at, spent, ahead = np.full(size, first), 0, min if direction == AHEAD else max
    rest = np.zeros(size)       # what rounding has left out of the last handles (Kahan's summation)
    if starts is not None:
        at += starts
    for out, values in zip(rows, leaders, strict=True):
        out[at, np.arange(size)] = values
    for block in blocks:
        while (left := np.flatnonzero(at < block.stop)).size:
            number = rows[0][at[left], left]
            k = ahead(track.present(number))        # no leader enters this segment later
            through = _on_curve if isinstance(track.segments[k], SpiralSegment) else _evenly
            spent += through(track, k, rows, rest, at, left[number == k], block, direction)
    return (rows[0][first:], rows[1][first:]), spent


def _evenly(track: Track, k: int, rows: Places, rest: Floats, at: Ints, on: Ints, block: Block, direction: int) -> int:
    """Place the handles of leaders ``on`` on a line or an arc and the first handle beyond; return the evaluation count.

    ``at`` (M,) holds the rows of the last handles placed so far, and ``rest`` (M,) what rounding has left out of them;
    both are updated.
    """
    u = rows[1][at[on], on]
    edge, left = track.edge(k, direction), block.stop - at[on]
    step = float(track.segments[k].shifts(u[:1], block.link_m, direction)[0][0])
    most = np.minimum(left, (edge - u) / step + 1)
    steps = 1.0 + np.arange(int(np.max(most)))[:, None]
    change = steps * step + rest[on]
    placed_at = u + change
    stays = (steps <= left) & (np.minimum(u, edge) <= placed_at) & (placed_at <= np.maximum(u, edge))
    row, column = np.nonzero(stays)
    there = at[on[column]] + row + 1, on[column]
    rows[0][there], rows[1][there] = k, placed_at[stays]
    count = np.count_nonzero(stays, axis=0)
    moved, last = np.flatnonzero(count), count[count > 0] - 1
    at[on] += count
    rest[on[moved]] = change[last, moved] - (placed_at[last, moved] - u[moved])
    return _across(track, k, rows, rest, at, on[at[on] < block.stop], block, direction)


def _on_curve(track: Track, k: int, rows: Places, rest: Floats, at: Ints, on: Ints, block: Block,
              direction: int) -> int:
    """Place handles on a spiral, link by link (``_evenly`` places all handles on a line or an arc together)."""
    spent, past = 0, Past((), rest[on])
    while on.size:
        here = rows[1][at[on], on]
        try:
            u, stays, past, more = _stepped(track, k, here, block.link_m, direction, past)
        except ChainLockError as error:
            theta = error.fields['theta_rad']
            raise locked(track, int(at[on[here == theta][0]]), theta, block.link_m) from None
        over, past, on = on[~stays], past.some(stays), on[stays]
        at[on] += 1
        rows[0][at[on], on], rows[1][at[on], on] = k, u[stays]
        rest[on] = past.rest
        spent += more + _across(track, k, rows, rest, at, over, block, direction)
        goes = at[on] < block.stop
        past, on = past.some(goes), on[goes]
    return spent


def _across(track: Track, k: int, rows: Places, rest: Floats, at: Ints, on: Ints, block: Block, direction: int) -> int:
    """Place one handle beyond segment k for each leader in ``on``."""
    if not on.size:
        return 0
    found, spent = track.across_many(k, rows[1][at[on], on], block.link_m, direction)
    at[on] += 1
    rest[on] = 0.0
    for out, values in zip(rows, found, strict=True):
        out[at[on], on] = values
    return spent


def together(track: Track, links_m: Floats, leaders: Places, direction: int) -> tuple[Places, int] | None:
    """Return the result of ``forward_many``, solved simultaneously, or None if handles must be placed row by row.

    With few leaders of long chains, arrays of one row are too short to be efficient: 30 chains of 223 links take a
    fifth of the time of ``row_by_row``, and a single chain takes as long as with ``forward``. The solver supports
    leaders on a spiral that winds in from infinity, unless handles almost turn back. Links (N,) are given in order from
    the leader.
    """
    (number, begin), spiral = leaders, track.from_afar
    if direction != BEHIND or not spiral or np.any(number):
        return None
    if not 0 < begin.size <= _MOST_LEADERS or len(links_m) < FEWEST_ROWS:
        return None
    found = placed(spiral, begin, links_m[:, None] / spiral.curve.b_m)
    return ((np.broadcast_to(number, found[0].shape), found[0]), found[1]) if found else None


def placed(spiral: SpiralSegment, begin: Floats, chords: Floats) -> tuple[Floats, int] | None:
    """Return the handles (L+1, M) behind the first handles (M,) on a spiral, and the number of evaluations.

    Chords (L, 1) are in units of b. Rows are solved simultaneously, in groups whose
    intermediate results fit in the cache. The result is None if handles must be placed row by row.
    """
    sign, some = 1.0 if spiral.winding == BEHIND else -1.0, max(FEWEST_ROWS, _AT_ONCE // begin.size)
    u, spent, rows = begin, 0, [begin[None]]
    for first in range(0, len(chords), some):
        these = chords[first:first + some]
        guess = _guessed(u, these, sign)
        part = None if guess is None else _refined(spiral, guess, these)
        if part is None:
            return None
        rows.append(part[0][1:])
        u, spent = part[0][-1], spent + part[1]
    return np.vstack(rows), spent


def _guessed(begin: Floats, chords: Floats, sign: float) -> Floats | None:
    """Return approximate handles (L+1, M) behind the first handles (M,), outwards (sign 1.0) or inwards (-1.0).

    The arc from one handle to the next is about chord + chord^3 / 24 r^2. Over these arcs, the squares of polar
    angles grow by twice the arc length, minus the logarithm of the ratio of the radii. The result is None if handles
    would be too close to the centre.
    """
    squares, grown = begin * begin, sign * 2 * np.cumsum(chords, axis=0)
    if np.min(begin) < _FAR_RAD or np.min(squares + grown) < _FAR_RAD**2:
        return None
    grown = grown + sign * np.cumsum(chords**3 / (12 * (squares + grown)), axis=0) - 0.5 * np.log1p(grown / squares)
    if np.min(squares + grown) < _FAR_RAD**2:
        return None
    return np.concatenate((begin[None], begin + grown / (begin + np.sqrt(squares + grown))))


def _refined(spiral: SpiralSegment, u: Floats, chords: Floats) -> tuple[Floats, int] | None:
    """Refine guessed rows (R+1, M) of handles until they are ``chords`` apart; return them and the evaluation count.

    The chords (R, M) are in units of b. A single row is too small for efficient array operations, so Newton's method
    is applied to all rows at once. If e is the Newton step of a link and a is the slope of the map from row to row,
    errors satisfy d' = a d + e; this recurrence is solved with a cumulative product and a cumulative sum. The result
    is None if the method does not converge, leaves the spiral, or does not find the nearest positions.
    """
    low, high = min(spiral.first, spiral.last), max(spiral.first, spiral.last)
    for rounds in range(1, _NEWTON_STEPS):
        step = np.diff(u, axis=0)
        if np.min(step * step.flat[0]) <= 0 or np.max(np.abs(step)) >= pi:
            return None
        error, phi, s = newton_steps(u[:-1], step, chords)
        slope = 1 - 2 * (u[:-1] + u[1:]) * s * s / phi      # d u[1:] / d u[:-1]
        if np.min(slope) < _STEEP:
            return None
        grown = np.cumprod(slope, axis=0)
        change = grown * np.cumsum(error / grown, axis=0)
        u[1:] -= change
        if not np.all((low <= u) & (u <= high)):
            return None
        if np.max(np.abs(change) * u[1:] / chords) <= 0.5 * TIGHT:
            return (u, rounds * step.size) if spiral.reaches_once(u[:-1], step) else None
    return None


def _stacked(rows: list[Places]) -> Places:
    segment, u = (np.array(values) for values in zip(*rows, strict=True))
    return segment, u


def next_places(track: Track, places: Places, chord_m: float, direction: int,
                past: Past = NEW) -> tuple[Places, Past, int]:
    """Return the next positions behind or ahead of given positions, what is known of them, and the evaluation count.

    Nothing is known unless all positions are on one segment. Raises TrackEndError if the track is too short for a
    link, and ChainLockError with its ``theta_rad`` if a link locks.
    """
    number, u = places
    if not number.size:
        return places, NEW, 0
    numbers = track.present(number)
    if len(numbers) == 1:
        return _next_on_one(track, numbers[0], places, chord_m, direction, past)
    number, u, spent = number.copy(), u.copy(), 0
    for k in numbers:
        on = np.flatnonzero(places[0] == k)
        (number[on], u[on]), _, more = _next_on_one(track, k, (number[on], u[on]), chord_m, direction, NEW)
        spent += more
    return (number, u), NEW, spent


def _next_on_one(track: Track, k: int, places: Places, chord_m: float, direction: int,
                 past: Past) -> tuple[Places, Past, int]:
    """Return the result of ``next_places`` for positions that are all on one segment."""
    number, u = places
    following, stays, past, spent = _stepped(track, k, u, chord_m, direction, past)
    if np.all(stays):
        return (number, following), past, spent
    over, number = np.flatnonzero(~stays), number.copy()
    (number[over], following[over]), more = track.across_many(k, u[over], chord_m, direction)
    return (number, following), NEW, spent + more


def _stepped(track: Track, k: int, u: Floats, chord_m: float, direction: int,
             past: Past) -> tuple[Floats, Array, Past, int]:
    """Return the next positions, whether each is on segment k, what is known of them, and the evaluation count.

    If there is no next position, the position itself is returned.
    """
    segment, edge = track.segments[k], track.edge(k, direction)
    shift, spent = segment.shifts(u, chord_m, direction, past)
    found = np.isfinite(shift)
    shift = np.where(found, shift, 0.0)
    change = shift + past.rest
    following = u + change
    stays: Array = found & (np.minimum(u, edge) <= following) & (following <= np.maximum(u, edge))
    return following, stays, Past((segment.squares(u, shift), *past.squares[:2]), change - (following - u)), spent
