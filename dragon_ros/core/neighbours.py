"""Which benches can touch: the paper's adjacent-layer model, corrected, and a broad phase for any layout.

For each bench the lines from the centre through its two handles meet the next layer out at theta + 2 pi (the paper
prints theta - 2 pi). The three benches nearest to each of the two points, all between them, and the next but one and
two in the chain are its candidates.
"""
import numpy as np
import shapely

from dragon_ros.core.benches import Benches
from dragon_ros.core.errors import CrowdError
from dragon_ros.core.types import Floats, Ints

_AT_ONCE = 256
_MOST_PAIRS = 1_000_000


def polar_angles(p: Floats) -> Floats | None:
    """Return the handles' polar angles about the origin, unwrapped and growing to the tail; None where they do not.

    They must grow (or shrink: the mirror image) by less than half a turn a link.
    """
    angle: Floats = np.unwrap(np.arctan2(p[:, 1], p[:, 0]))
    if angle[-1] < angle[0]:
        angle = -angle
    steps = np.diff(angle)
    return angle if np.all(steps >= 0) and np.all(steps < 0.95 * np.pi) else None


def layer_windows(angle: Floats) -> tuple[Ints, Ints]:
    """Return first and last candidate (N,) in the next layer out for each bench, from handle angles (N+1,)."""
    count = angle.size - 1
    over: Ints = np.searchsorted(angle, angle + 2 * np.pi, side='right') - 1
    first, last = over[:-1] - 1, over[1:] + 1
    beyond = first >= count
    return np.where(beyond, count, first), np.where(beyond, count - 1, np.minimum(last, count - 1))


def candidates(p: Floats, benches: Benches) -> tuple[Ints, Ints]:
    """Return pairs (i, j), j >= i + 2, of benches that may touch.

    The adjacent layer where the handles wind about the origin, else every pair whose bounding boxes meet.
    """
    angle = polar_angles(p)
    return box_pairs(benches) if angle is None else layer_pairs(angle)


def layer_pairs(angle: Floats) -> tuple[Ints, Ints]:
    """Return the candidates of the adjacent-layer model, with |i - j| = 2 and 3."""
    count = angle.size - 1
    first, last = layer_windows(angle)
    first = np.maximum(first, np.arange(count) + 4)
    width = max(0, int(np.max(last - first)) + 1)
    j = np.concatenate((np.arange(count)[:, None] + [2, 3], first[:, None] + np.arange(width)), axis=1)
    valid = j < count
    valid[:, 2:] &= j[:, 2:] <= last[:, None]
    i, column = np.nonzero(valid)
    return i, j[i, column]


def box_pairs(benches: Benches) -> tuple[Ints, Ints]:
    """Return every pair whose axis-aligned boxes meet, for any layout (shapely STRtree)."""
    corners = benches.corners
    low, high = corners.min(axis=-2), corners.max(axis=-2)
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    tree, found, count = shapely.STRtree(boxes), [], 0
    for start in range(0, boxes.size, _AT_ONCE):
        i, j = tree.query(boxes[start:start + _AT_ONCE])
        keep = j >= i + start + 2
        found.append(np.stack((i[keep] + start, j[keep])))
        if (count := count + int(np.sum(keep))) > _MOST_PAIRS:
            raise CrowdError(f'{boxes.size} benches lie so close that more than {_MOST_PAIRS:,} pairs may touch; '
                             'spread them out, or use fewer', benches=boxes.size, limit=_MOST_PAIRS)
    i, j = np.concatenate(found, axis=1)
    order = np.lexsort((j, i))
    return i[order], j[order]
