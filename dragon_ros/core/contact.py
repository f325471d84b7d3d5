"""The signed gap of two rectangles: their distance when apart, minus the smallest parting translation when not.

The parting translation of two convex polygons is normal to an edge, so the separating-axis value gives it; when they
are apart that value is only a lower bound and the nearest corner decides.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.benches import Benches
from dragon_ros.core.types import Floats, Index


@dataclass(frozen=True)
class Placement:
    """Pairs of rectangles A and B; B seen from A: centre (x, y), axis (cos, sin), and half sizes."""

    x: Floats
    y: Floats
    cos: Floats
    sin: Floats
    a: tuple[Floats, Floats]
    b: tuple[Floats, Floats]

    def mirrored(self) -> 'Placement':
        """Return A seen from B."""
        return Placement(-self.x * self.cos - self.y * self.sin, self.x * self.sin - self.y * self.cos,
                         self.cos, -self.sin, self.b, self.a)

    def axis_gap(self) -> Floats:
        """Return the larger separation along A's two axes; negative where both overlap."""
        c, s = np.abs(self.cos), np.abs(self.sin)
        along = np.abs(self.x) - (self.a[0] + self.b[0] * c + self.b[1] * s)
        aside = np.abs(self.y) - (self.a[1] + self.b[0] * s + self.b[1] * c)
        out: Floats = np.maximum(along, aside)
        return out

    def corner_offsets(self) -> tuple[Floats, Floats]:
        """Return how far B's four corners lie outside A along A's axes, signed, shapes (4, ...)."""
        u = np.stack([self.b[0] * self.cos, self.b[0] * self.sin])
        v = np.stack([-self.b[1] * self.sin, self.b[1] * self.cos])
        corners = np.stack([u + v, v - u, -u - v, u - v])
        return np.abs(self.x + corners[:, 0]) - self.a[0], np.abs(self.y + corners[:, 1]) - self.a[1]

    def corner_distance(self) -> Floats:
        """Return the distance of A from the nearest corner of B."""
        x, y = self.corner_offsets()
        out: Floats = np.sqrt(np.min(np.maximum(x, 0) ** 2 + np.maximum(y, 0) ** 2, axis=0))
        return out


def placement(benches: Benches, i: Index, j: Index) -> Placement:
    """Return benches j as seen from benches i; the last axes but one are benches, i and j may be any indices."""
    offset = benches.centre[j] - benches.centre[i]
    u, w = benches.axis[i], benches.axis[j]
    return Placement(
        offset[..., 0] * u[..., 0] + offset[..., 1] * u[..., 1],
        offset[..., 1] * u[..., 0] - offset[..., 0] * u[..., 1],
        u[..., 0] * w[..., 0] + u[..., 1] * w[..., 1], u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0],
        (benches.half_length[i], benches.half_width[i]), (benches.half_length[j], benches.half_width[j]))


def signed_gap(pairs: Placement) -> Floats:
    """Return the signed gap of each pair in metres."""
    other = pairs.mirrored()
    gap = np.maximum(pairs.axis_gap(), other.axis_gap())
    apart = np.minimum(pairs.corner_distance(), other.corner_distance())
    out: Floats = np.where(gap > 0, np.maximum(apart, gap), gap)
    return out


def gaps(benches: Benches, i: Index, j: Index) -> Floats:
    """Return the signed gaps of benches i and j in metres."""
    return signed_gap(placement(benches, i, j))


def witness(benches: Benches, i: int, j: int) -> tuple[float, float]:
    """Return the point of contact of two benches: halfway between the closest corner and the other's edge."""
    best: tuple[float, tuple[float, float]] | None = None
    for owner, other in ((i, j), (j, i)):
        view = placement(benches, np.array(other), np.array(owner))
        x, y = view.corner_offsets()
        outside = np.hypot(np.maximum(x, 0), np.maximum(y, 0)) + np.minimum(np.maximum(x, y), 0)
        corner = benches.corners[owner, int(np.argmin(outside))]
        if best is None or float(np.min(outside)) < best[0]:
            best = float(np.min(outside)), _halfway(benches, other, corner)
    assert best is not None
    return best[1]


def _halfway(benches: Benches, bench: int, point: Floats) -> tuple[float, float]:
    """Return the middle between a point and the nearest point of a bench (the point itself where it is inside)."""
    axis = benches.axis[bench]
    frame = np.array([axis, [-axis[1], axis[0]]])
    half = np.array([benches.half_length[bench], benches.half_width[bench]])
    local = frame @ (point - benches.centre[bench])
    nearest = benches.centre[bench] + np.clip(local, -half, half) @ frame
    middle = 0.5 * (nearest + point)
    return float(middle[0]), float(middle[1])
