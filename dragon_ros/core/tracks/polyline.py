"""Tracks as polylines for drawing, with points as dense as the curvature requires."""
from math import sqrt

import numpy as np

from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.tracks.composite import Track

SAG_M = 0.002               # on a screen that shows tens of metres, smaller deviations are invisible
_MOST_POINTS = 100_000      # maximum number of points per segment
_MOST_IN_ALL = 1_000_000


def polyline(track: Track, low_m: float, high_m: float, sag_m: float = SAG_M) -> Floats:
    """Return points (m, shape (n, 2)) along a track between two distances, in the head's direction.

    The polyline deviates from the track by at most ``sag_m`` (R phi^2 / 8 for an angle phi), unless this requires
    more than 100,000 points in a segment, or more than an equal share of 1,000,000 points. The largest curvature on
    each segment determines the density of its points.
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
