"""Benches as rectangles that extend from handle to handle, plus the hole inset at both ends."""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.chain.dragon import AnyDragon
from dragon_ros.core.numerics.types import Floats, Ints, left, read_only


@dataclass(frozen=True)
class Benches:
    """Rectangles in metres: centres (..., N, 2), unit axes (..., N, 2) from rear to front, and half sizes (N,)."""

    centre: Floats
    axis: Floats
    half_length: Floats
    half_width: Floats

    @property
    def yaw_rad(self) -> Floats:
        """Heading of each bench, from handle i + 1 to handle i, in (-pi, pi]."""
        yaw: Floats = np.arctan2(self.axis[..., 1], self.axis[..., 0])
        return yaw

    @property
    def sizes(self) -> bytes:
        """The half sizes as bytes, which are compared in one step."""
        return self.half_length.tobytes() + self.half_width.tobytes()

    def some(self, index: Ints | slice) -> 'Benches':
        """Return a subset of the benches, all of which must belong to a single instant."""
        return Benches(self.centre[index], self.axis[index], self.half_length[index], self.half_width[index])

    @property
    def corners(self) -> Floats:
        """Corners (..., N, 4, 2): front left, rear left, rear right, front right."""
        along = self.half_length[..., None] * self.axis
        side = self.half_width[..., None] * left(self.axis)
        c = self.centre
        return np.stack((c + along + side, c - along + side, c - along - side, c + along - side), axis=-2)


def corner_levers(dragon: AnyDragon) -> Floats:
    """Return the largest error of any corner of each bench (N,), relative to the position error of its handles.

    Let s be the length of a bench divided by that of its link, w its width, and e the error of both handles. Across the
    link, the error of a corner is (1 + s) / 2 times the error of one handle plus (1 - s) / 2 times that of the other;
    along the link, it is the mean of both errors. The largest norm of this sum is s e, or 2 e / sqrt(4 - s^2) if s^2 <
    2. The link turns by at most 2 e over its length, which moves the corners along the link by another w e / link.
    These are the terms of first order in e / link.
    """
    length, link, width = dragon.bench_lengths_m, dragon.link_lengths_m, dragon.width_m
    ratio = length / link
    out: Floats = np.maximum(ratio, 2 / np.sqrt(4 - np.minimum(ratio * ratio, 2.0))) + width / link
    return out


def together(one: Benches, other: Benches) -> Benches:
    """Return the rectangles of both arguments, those of ``one`` first."""
    return Benches(np.concatenate((one.centre, other.centre)), np.concatenate((one.axis, other.axis)),
                   np.concatenate((one.half_length, other.half_length)),
                   np.concatenate((one.half_width, other.half_width)))


def axes_of(chain: Chain) -> Floats:
    """Return unit vectors (..., N, 2) from handle i + 1 to handle i."""
    axis = chain.p[..., :-1, :] - chain.p[..., 1:, :]
    length = np.hypot(axis[..., 0], axis[..., 1])
    for part in (axis[..., 0], axis[..., 1]):
        part /= length
    return read_only(axis)


def benches_of(chain: Chain, dragon: AnyDragon, axis: Floats) -> Benches:
    """Return the rectangles of a chain whose links have the directions ``axis``."""
    centre = chain.p[..., :-1, :] + chain.p[..., 1:, :]
    centre *= 0.5
    return Benches(read_only(centre), axis, *dragon.half_sizes_m)
