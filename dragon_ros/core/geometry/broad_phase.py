"""Find pairs of benches that could touch, by their directions about the origin or by their bounding boxes.

For each bench, the paper draws the lines from the centre through the two handles and intersects them with the next
layer out, at theta + 2 pi (the paper prints theta - 2 pi; see docs/errata.md). It then takes the three benches
nearest to each of the two points of intersection. This choice is complete only if no bench extends beyond its
neighbours on the next layer, and no bench meets its own layer or the second layer out. ``candidates`` instead finds,
turn by turn, the benches that share a direction and a distance from the origin. This choice is complete for any
positions of the benches, and finds the same few benches whenever the paper's choice is complete.
"""
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.errors import CrowdError
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.numerics.types import Array, Floats, Ints

_TOGETHER = 4           # number of steps whose boxes are queried together
_AT_ONCE = 256          # number of boxes per query of the tree
_MOST_PAIRS = 1_000_000     # maximum number of pairs, unless the limit per bench allows more
_MOST_EACH = 16             # maximum number of pairs per bench
_FEW_PAIRS = 2**14      # number of pairs on a step up to which all boxes are compared
_MOST_TURNS = 8         # maximum number of layers within reach of a bench; with more layers, boxes are faster
_MARGIN = 1e-9          # tolerance of angles (rad), and of lengths (relative to the dragon's size), far above rounding


@dataclass(frozen=True)
class _Sectors:
    """The sectors about the origin that contain the benches, as ranges of directions and of distances."""

    low: Floats
    high: Floats
    inner: Floats
    outer: Floats


def candidates(p: Floats, benches: Benches, reach_m: float | None = None) -> tuple[Ints, Ints]:
    """Return sorted pairs (i, j), j >= i + 2, including all that touch or have a gap of at most ``reach_m``.

    ``p`` holds the handle positions (m, shape (N+1, 2)) relative to the centre. By default, ``reach_m`` is the largest
    width or a twentieth of the largest length, whichever is larger. If the smallest gap of the candidates is at most
    ``reach_m``, it is the smallest gap of all pairs; otherwise, the gaps of all pairs exceed ``reach_m``. The result
    always includes the pairs with |i - j| = 2 or 3 and, at any distance, pairs of benches on adjacent layers that share
    a direction.

    The search takes O(N) time if the handles wind outwards about the origin: the directions of the benches increase (or
    decrease) towards the tail, no bench turns back by more than half a turn, and few layers are within reach of each
    other. If a bench is within reach of other layers or of its own layer, its candidates include those layers. A bench
    that covers the origin spans all directions. All these conditions are checked; if one of them fails, the candidates
    are found by ``box_pairs``, which is complete for any layout.
    """
    reach = default_reach_m(benches) if reach_m is None else reach_m
    sectors = _sectors(p, benches, reach)
    pairs = _polar_pairs(sectors) if sectors else None
    return box_pairs(benches, reach) if pairs is None else pairs


def default_reach_m(benches: Benches) -> float:
    """Return the gap (m) up to which ``candidates`` finds every pair by default."""
    return float(2 * np.max(np.maximum(benches.half_width, 0.05 * benches.half_length)))


def _sectors(p: Floats, benches: Benches, reach: float) -> _Sectors | None:
    """Return the sectors of the benches, enlarged by half the reach, or None if their directions cannot be ordered.

    The directions of the centres are unwrapped so that each is within half a turn of the direction of the middle of
    the bench's handles.
    """
    centre, axis = benches.centre, benches.axis
    size = float(np.max(np.abs(centre))) + float(np.max(benches.half_length + benches.half_width))
    x, y, c, s = centre[:, 0], centre[:, 1], axis[:, 0], axis[:, 1]
    margin = 0.5 * reach + _MARGIN * size
    half, side = benches.half_length + margin, benches.half_width + margin
    along, aside = x * c + y * s, y * c - x * s
    far_along, far_aside = np.abs(along) + half, np.abs(aside) + side
    near_along, near_aside = np.maximum(np.abs(along) - half, 0), np.maximum(np.abs(aside) - side, 0)
    inner, outer = np.hypot(near_along, near_aside), np.hypot(far_along, far_aside)
    low, high = _spread(along, aside, half, side)
    over = inner <= 0
    low, high = np.where(over, -np.pi, low - _MARGIN), np.where(over, np.pi, high + _MARGIN)
    middle = _directions(p, x, y)
    if middle[-1] < middle[0]:
        middle, low, high = -middle, -high, -low
    low, high = middle + low, middle + high
    low = np.minimum.accumulate(low[::-1])[::-1]
    return None if np.any(low < high - 2 * np.pi - 0.5 * _MARGIN) else _Sectors(low, high, inner, outer)


def _directions(p: Floats, x: Floats, y: Floats) -> Floats:
    """Return the directions (N,) of the centres, unwrapped along the handles (N+1, 2)."""
    handle = np.arctan2(p[:, 1], p[:, 0])
    turns = np.zeros(handle.size)
    np.cumsum(np.rint(np.diff(handle) / (2 * np.pi)), out=turns[1:])
    handle -= 2 * np.pi * turns
    direction = np.arctan2(y, x)
    out: Floats = direction + 2 * np.pi * np.rint((0.5 * (handle[1:] + handle[:-1]) - direction) / (2 * np.pi))
    return out


def _spread(along: Floats, aside: Floats, half: Floats, side: Floats) -> tuple[Floats, Floats]:
    """Return the smallest and largest directions of the corners of each bench, relative to the direction of its centre.

    ``along`` and ``aside`` are the coordinates of the centre in the axes of the bench. A convex figure that excludes
    the origin spans less than half a turn.
    """
    square = along * along + aside * aside
    cross = np.stack((along * side - aside * half, along * side + aside * half))
    dot = np.stack((along * half + aside * side, aside * side - along * half))
    # Opposite corners are at (cross, dot) and at the negatives of these values.
    angles = np.concatenate((np.arctan2(cross, square + dot), np.arctan2(-cross, square - dot)))
    return angles.min(axis=0), angles.max(axis=0)


def _polar_pairs(sectors: _Sectors) -> tuple[Ints, Ints] | None:
    """Return the pairs whose sectors meet, found from one window per bench and turn, or None if there are too many.

    Because ``low`` increases and ``high`` is replaced by its running maximum, the benches that share a direction with
    bench i after k turns form one window. The windows of bench i end where all later benches are further out than
    bench i; only the window of the first turn is not shortened.
    """
    low, high, count = sectors.low, sectors.high, sectors.low.size
    highest = np.maximum.accumulate(high)
    further = np.minimum.accumulate(sectors.inner[::-1])[::-1]
    stop = np.searchsorted(further, sectors.outer, side='right')
    own = np.arange(count)
    own_layer = np.minimum(np.searchsorted(low, high, side='right'), stop)
    starts, ends = [own + 2], [np.minimum(np.maximum(own + 4, own_layer), count)]
    for turn in range(1, _MOST_TURNS + 2):
        limit = count if turn == 1 else stop
        start = np.maximum(np.searchsorted(highest, low + turn * 2 * np.pi), ends[-1])
        if np.all(start >= limit):
            break
        end = np.minimum(np.searchsorted(low, high + turn * 2 * np.pi, side='right'), limit)
        starts.append(start)
        ends.append(np.maximum(start, end))
    else:
        return None
    start, size = np.stack(starts, 1), np.maximum(np.stack(ends, 1) - np.stack(starts, 1), 0)
    return None if np.sum(size) > max(_MOST_PAIRS, _MOST_EACH * count) else _spelt(start, size)


def _spelt(start: Ints, size: Ints) -> tuple[Ints, Ints]:
    """Return the pairs (i, j) for K windows of j per i, given as ``start`` and ``size`` of shape (N, K)."""
    i = np.repeat(np.arange(start.shape[0]), size.sum(axis=1))
    ends = np.cumsum(size)
    j = np.arange(i.size) + np.repeat(start.ravel() - ends + size.ravel(), size.ravel())
    return i, j


def box_pairs(benches: Benches, reach_m: float = 0.0) -> tuple[Ints, Ints]:
    """Return every pair whose axis-aligned boxes are within ``reach_m`` of each other, for any layout of the benches.

    The boxes are searched with shapely's STRtree. Pairs with |i - j| = 2 or 3 are always included. Raises CrowdError if
    there would be too many pairs.
    """
    corners = benches.corners
    (found,) = pairs_on_steps(corners.min(axis=1)[None], corners.max(axis=1)[None], np.array([reach_m]))
    return found


def pairs_on_steps(low: Floats, high: Floats, reach_m: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Yield, for each of M steps, the pairs whose boxes come within ``reach_m`` (M,), as in ``box_pairs``.

    ``low`` and ``high`` (M, N, 2) are the corners of the boxes. The boxes of several steps are queried together, unless
    this would yield too many pairs.
    """
    margin = (0.5 * reach_m + _MARGIN * float(max(np.max(np.abs(low)), np.max(np.abs(high)))))[:, None, None]
    low, high = low - margin, high + margin
    for start in range(0, reach_m.size, _TOGETHER):
        some = low[start:start + _TOGETHER], high[start:start + _TOGETHER]
        try:
            yield from _on_steps(*some)
        except CrowdError:
            for one in zip(*some, strict=True):
                yield from _on_steps(*(each[None] for each in one))


def boxes_within(low: Floats, high: Floats, reach_m: Floats, first: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Yield, for each of M steps, the pairs of ``pairs_on_steps`` with j >= ``first`` (M, N) of i and j >= i + 2.

    Where few pairs are left, all are compared without a tree.
    """
    count = low.shape[1]
    first = np.maximum(first, np.arange(count) + 2)
    few = np.maximum(count - first, 0).sum(axis=1) <= _FEW_PAIRS
    by_tree = pairs_on_steps(low[~few], high[~few], reach_m[~few]) if not np.all(few) else iter(())
    for n, compare in enumerate(few):
        if compare:
            yield _meeting_pairs(low[n], high[n], reach_m[n], first[n])
        else:
            i, j = next(by_tree)
            keep = j >= first[n, i]
            yield i[keep], j[keep]


def _meeting_pairs(low: Floats, high: Floats, reach_m: float, first: Ints) -> tuple[Ints, Ints]:
    """Return the pairs (i, j) with j >= ``first`` (N,) of i whose boxes come within ``reach_m``, or with j <= i + 3."""
    size = np.maximum(first.size - first, 0)
    i = np.repeat(np.arange(first.size), size)
    j = np.arange(i.size) - np.repeat(np.cumsum(size) - size - first, size)
    margin = 0.5 * reach_m + _MARGIN * float(max(np.max(np.abs(low)), np.max(np.abs(high))))
    keep = (j - i <= 3) | _meet(low - margin, high + margin, i, j)
    return i[keep], j[keep]


def _on_steps(low: Floats, high: Floats) -> list[tuple[Ints, Ints]]:
    """Return the pairs whose boxes (M, N, 2) meet on each of M steps."""
    i, j = np.divmod(_meeting(np.min(low, axis=0), np.max(high, axis=0)), low.shape[1])
    beside = j - i <= 3
    kept = (beside | _meet(one, other, i, j) for one, other in zip(low, high, strict=True))
    return [(i[keep], j[keep]) for keep in kept]


def _meet(low: Floats, high: Floats, i: Ints, j: Ints) -> Array:
    """Return whether boxes (N, 2) i and j meet, one coordinate at a time, because numpy is slow along short axes."""
    meet: Array = np.ones(i.size, dtype=bool)
    for one, other in zip(low.T.copy(), high.T.copy(), strict=True):
        meet &= one[i] <= other[j]
        meet &= one[j] <= other[i]
    return meet


def _meeting(low: Floats, high: Floats) -> Ints:
    """Return, as sorted numbers i N + j, the pairs of boxes (N, 2) that meet and the pairs with |i - j| = 2 or 3."""
    import shapely  # not needed for dragons that wind about the origin
    count = low.shape[0]
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    tree, total, most = shapely.STRtree(boxes), 0, max(_MOST_PAIRS, _MOST_EACH * count)
    found = [own * count + own + step for step in (2, 3) for own in [np.arange(max(0, count - step))]]
    for start in range(0, count, _AT_ONCE):
        i, j = tree.query(boxes[start:start + _AT_ONCE])
        keep = j >= i + start + 4
        found.append((i[keep] + start) * count + j[keep])
        if (total := total + int(np.sum(keep))) > most:
            raise CrowdError(f'{count} benches are so close together that more than {most:,} pairs may touch; '
                             'spread them out, or use fewer', benches=count, limit=most)
    return np.sort(np.concatenate(found))
