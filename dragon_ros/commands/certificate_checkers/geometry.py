"""Positions and rectangles for the checker of certificates, with none of the solver's code."""
from collections.abc import Callable
from itertools import pairwise
from math import asinh, atan2, cos, hypot, inf, pi, sin, sqrt

import numpy as np

from dragon_ros.commands.certificate_checkers.going import Going
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene


class Geometry:
    """A scene's chain and benches, from its plain numbers."""

    def __init__(self, scene: Scene, pitch_m: float | None = None) -> None:
        """Take plain numbers from the scene; ``pitch_m`` is that of a composite track's first spiral."""
        d, self.scene = scene.dragon, scene
        self.b = (scene.spiral.pitch_m if pitch_m is None else pitch_m) / (2 * pi)
        self.lengths: list[float] = d.bench_lengths_m.tolist()
        self.links = [length - 2 * d.hole_inset_m for length in self.lengths]
        self.uneven = any(length != self.lengths[-1] for length in self.lengths[1:])
        self.half_width = 0.5 * d.width_m
        self._going = Going(scene)

    def angle(self, t_s: float) -> float:
        """Return the head's polar angle at a time."""
        return self._angle_after(self._going.gone_m(t_s))

    def reached(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Return the head's least and greatest polar angle between two times."""
        one, other = (self._angle_after(gone_m) for gone_m in self._going.extent_m(start_s, end_s))
        return min(one, other), max(one, other)

    def _angle_after(self, gone_m: float) -> float:
        """Return the head's polar angle when the leader has gone so far, by bisection; a tail goes outwards."""
        start, count = 2 * pi * self.scene.spiral.start_turns, len(self.links)
        if self.scene.head.lead == 'head':
            return self._at_arc(self._arc(start) - gone_m / self.b)
        wanted = self._at_arc(self._arc(self.chain(0, start, count)[-1]) + gone_m / self.b)
        low, high = start, wanted
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if self.chain(0, middle, count)[-1] < wanted else (low, middle)
        return high

    @staticmethod
    def _arc(theta: float) -> float:
        """Return the length of the track from the centre, in units of b."""
        return 0.5 * (theta * sqrt(1 + theta * theta) + asinh(theta))

    def _at_arc(self, wanted: float) -> float:
        low, high = 0.0, sqrt(max(2 * wanted, 0.0)) + 1
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if self._arc(middle) < wanted else (low, middle)
        return high

    def chain(self, first: int, theta: float, benches: int) -> list[float]:
        """Return polar angles of the handles of some benches behind a front handle."""
        angles = [theta]
        for link in self.links[first:first + benches]:
            angles.append(self._next(angles[-1], link / self.b) if link else angles[-1])
        return angles

    @staticmethod
    def _next(theta: float, chord: float) -> float:
        """Return the next handle's angle: secant steps on the law of cosines, kept in a bisection bracket."""
        def over(delta: float) -> float:
            return hypot(theta - (theta + delta) * cos(delta), (theta + delta) * sin(delta)) - chord
        low, high = 0.0, _beyond(over)
        if over(high) < 0:
            raise InputError(f'the chain is locked with a front handle at {theta!r} rad')
        x, slope = min(high, chord / sqrt(1 + theta * theta)), sqrt(1 + theta * theta)
        for _ in range(100):
            value = over(x)
            low, high = (x, high) if value < 0 else (low, x)
            following = x - value / slope
            if not low < following < high:
                following = 0.5 * (low + high)
            if abs(following - x) < 1e-15 * x:
                break
            change = over(following) - value
            slope = change / (following - x) if change and following != x else slope
            x = following
        return theta + x

    def rectangles(self, first: int, theta: float, benches: int) -> Floats:
        """Return corners (benches, 4, 2): front left, rear left, rear right, front right."""
        return self.corners_at(first, np.array(self.chain(first, theta, benches)))

    def corners_at(self, first: int, angles: Floats) -> Floats:
        """Return the same for handles at known angles."""
        p = self.b * angles[:, None] * np.stack((np.cos(angles), np.sin(angles)), axis=1)
        out = []
        for number, (front, rear) in enumerate(pairwise(p)):
            angle = float(angles[number])
            yaw = atan2(front[1] - rear[1], front[0] - rear[0]) if self.links[first + number] else (
                angle + atan2(angle, 1) + pi)
            u, n = np.array([cos(yaw), sin(yaw)]), np.array([-sin(yaw), cos(yaw)])
            along, side = 0.5 * self.lengths[first + number] * u, self.half_width * n
            middle = 0.5 * (front + rear)
            out.append([middle + along + side, middle - along + side, middle - along - side, middle + along - side])
        return np.array(out)

    @staticmethod
    def frames(rectangles: Floats) -> list[Floats]:
        """Return corners (K, 4, 2) of the others in the frame of the first, and of the first in theirs."""
        def inside(owner: Floats, points: Floats) -> Floats:
            middle = 0.5 * (owner[..., 0, :] + owner[..., 2, :])
            u = owner[..., 0, :] - owner[..., 1, :]
            u = u / np.hypot(u[..., 0], u[..., 1])[..., None]
            d = points - middle[..., None, :]
            along = d[..., 0] * u[..., None, 0] + d[..., 1] * u[..., None, 1]
            aside = d[..., 1] * u[..., None, 0] - d[..., 0] * u[..., None, 1]
            return np.stack((along, aside), axis=-1)
        lead, others = rectangles[:1], rectangles[2:]
        lead = np.broadcast_to(lead, others.shape)
        return [inside(lead, others), inside(others, lead)]

    def apart(self, rectangles: Floats, half_lengths: Floats) -> Floats:
        """Return the largest separation of the first bench and each of the others along any edge normal."""
        out: Floats = np.full(len(rectangles) - 2, -inf)
        for corners, half_length in zip(self.frames(rectangles), (half_lengths[0], half_lengths[2:]), strict=True):
            for axis, half in enumerate((half_length, self.half_width)):
                for side in (1, -1):
                    out = np.maximum(out, np.min(side * corners[..., axis], axis=1) - half)
        return out


def least(function: Callable[[float], float], left: float, right: float) -> float:
    """Return where a function with one lowest place has it, by golden sections."""
    share = 0.5 * (sqrt(5) - 1)
    for _ in range(60):
        a, b = right - share * (right - left), left + share * (right - left)
        if function(a) < function(b):
            right = b
        else:
            left = a
    return 0.5 * (left + right)


def _beyond(over: Callable[[float], float]) -> float:
    """Return a place up to which a chord only grows and where it is long enough, or the first one it turns back at."""
    high = pi
    while over(high) < 0:
        following = high + 0.1
        if over(following) < over(high) or following > 2000:
            return least(lambda delta: -over(delta), high - 0.1, following)
        high = following
    return high
