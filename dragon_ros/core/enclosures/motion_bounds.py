"""What is known of handles and links between two states of a chain, whatever the leader does in between.

Between two states the leader goes from one place to another. Handles then move one way each, but where a handle turns
back: that happens near the centre of a single spiral only, where links may lock, and ``Leader.turning_m`` tells where
the leader is then. Cut there, every handle passes the places between its two, and no others.
"""
from collections.abc import Sequence
from functools import reduce

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import Ball, between
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.tracks.composite import Track

TOLERANCE = 1e-9        # of Newton's last step: its square is below what floats keep
_FINEST = 1e-14         # of a time or a distance: intervals this short are not cut


def divisible(starts: Floats, stops: Floats) -> Array:
    """Return which intervals of time or distance between starts and stops (M,) are long enough to be cut."""
    out: Array = np.abs(stops - starts) > _FINEST * (1 + np.maximum(np.abs(starts), np.abs(stops)))
    return out


def curvatures_between(track: Track, segments: Sequence[Ints], curvatures: Sequence[Floats]) -> Ball:
    """Return the curvatures in 1/m on the track between some places, given their segments and curvatures there.

    Curvature is monotone on a segment, so on one it lies between those at the places; else all segments count whole.
    """
    low, high = track.bends
    first, last = reduce(np.minimum, segments), reduce(np.maximum, segments)
    one = first == last
    return between(np.where(one, reduce(np.minimum, curvatures), low[first, last]),
                   np.where(one, reduce(np.maximum, curvatures), high[first, last]))


def swing_rad(most: Floats, link_m: float | Floats, moved_m: Floats) -> Floats:
    """Return how far a link turns at most, in all, while its two handles move by ``moved_m`` together.

    ``most`` is the largest curvature in 1/m between the rear handle's first place and the front handle's last. A link
    turns at (v_rear sin beta - v_front sin alpha) / link, alpha and beta its angles with the track's tangents. No sine
    exceeds 1, nor, where most * link < 2, most * link / 2 (Schur's comparison with a circle).
    """
    with np.errstate(divide='ignore'):
        out: Floats = np.minimum(0.5 * most, np.divide(1.0, link_m)) * moved_m
    return out
