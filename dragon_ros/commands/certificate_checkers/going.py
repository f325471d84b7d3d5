"""How far a leader has gone, for the checker of certificates, with none of the solver's code.

A ramp's speed is at most a cubic of time, which Simpson's rule integrates exactly.
"""
from collections.abc import Iterator
from itertools import pairwise

from dragon_ros.core.scene import Scene


class Going:
    """A scene's head law, from its plain numbers."""

    def __init__(self, scene: Scene) -> None:
        """Take (time, speed) of the knots; a steady speed is one knot."""
        head = scene.head
        self._knots: tuple[tuple[float, float], ...] = getattr(head, 'knots', None) or ((0.0, scene.steady_m_s),)
        self._smooth = getattr(head, 'ramps', 'linear') == 'smooth'

    def _ramps(self, until_s: float) -> Iterator[tuple[float, float, float, float]]:
        """Yield (start, end, speeds there) of every ramp that starts before a time, the last speed being one too."""
        for (t0, v0), (t1, v1) in pairwise((*self._knots, (until_s + 1, self._knots[-1][1]))):
            if t0 < min(t1, until_s):
                yield t0, t1, v0, v1

    def _speed(self, ramp: tuple[float, float, float, float], t_s: float) -> float:
        t0, t1, v0, v1 = ramp
        x = (t_s - t0) / (t1 - t0)
        return v0 + (v1 - v0) * (x * x * (3 - 2 * x) if self._smooth else x)

    def gone_m(self, t_s: float) -> float:
        """Return how far the leader has gone since t = 0."""
        return sum(self._by_simpson(ramp, min(ramp[1], t_s)) for ramp in self._ramps(t_s))

    def _by_simpson(self, ramp: tuple[float, float, float, float], end_s: float) -> float:
        start_s = ramp[0]
        ends = self._speed(ramp, start_s) + self._speed(ramp, end_s)
        return (end_s - start_s) / 6 * (ends + 4 * self._speed(ramp, 0.5 * (start_s + end_s)))

    def extent_m(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Return the least and the greatest distance gone between two times: there, at knots, or where it rests."""
        times = [start_s, end_s]
        for ramp in self._ramps(end_s):
            times += [ramp[0], self._rest_s(ramp)]
        gone = [self.gone_m(t_s) for t_s in times if start_s <= t_s <= end_s]
        return min(gone), max(gone)

    def _rest_s(self, ramp: tuple[float, float, float, float]) -> float:
        """Return when the speed changes its sign on a ramp, by bisection; the ramp's start where it does not."""
        low, high, sign = *ramp[:2], -1 if ramp[2] < 0 else 1
        if ramp[2] * ramp[3] >= 0:
            return low
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if sign * self._speed(ramp, middle) > 0 else (low, middle)
        return low
