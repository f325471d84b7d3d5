"""A track as a line to draw: points along its segments, as close together as their bends ask for."""
from math import sqrt

import numpy as np

from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.tracks.composite import Track

SAG_M = 0.002               # a screen shows no less of a dragon of tens of metres
_MOST_POINTS = 100_000      # of a segment
_MOST_IN_ALL = 1_000_000


def polyline(track: Track, low_m: float, high_m: float, sag_m: float = SAG_M) -> Floats:
    """Return points (n, 2) in metres along a track between two distances, in the order of the head's way.

    The line between them strays ``sag_m`` from the track at most (s = R phi^2 / 8), unless that takes over 100,000
    points for a segment, or over its share of 1,000,000 for all. Each segment's points are
    as close as its tightest bend there asks for.
    """
    parts, segments = [], list(track.between(low_m, high_m))
    most = min(_MOST_POINTS, max(2, _MOST_IN_ALL // len(segments)))
    for segment, first, last in segments:
        bend = float(np.max(np.abs(segment.curvature(np.array([first, last])))))
        count = float(segment.metres_between(first, last)) * sqrt(bend / (8 * sag_m))
        places = segment.at(np.linspace(first, last, min(most, 2 + int(count))))
        parts.append(np.stack((places.real, places.imag), axis=1))
    out: Floats = np.concatenate(parts)
    return out
