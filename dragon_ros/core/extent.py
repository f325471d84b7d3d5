"""How much room a run takes: the largest x, -x, y and -y that any corner of any bench reaches, between bounds.

On a stretch of length h of the head's way a coordinate of a corner exceeds the larger of its values at the two ends by
at most A h^2 / 8, A the largest second derivative; for A stands twice the larger at the ends, as in ``stretches``. It
never exceeds the distance of the bench's handles from the centre at the ends, plus the bench's overhang. Stretches
whose bound exceeds the best value that was met are halved. What positions may err is added in the end.
"""
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np

from dragon_ros.core.benches import axes_of, benches_of
from dragon_ros.core.contact import CORNERS
from dragon_ros.core.errors import DragonError, FieldError
from dragon_ros.core.march_many import place_many
from dragon_ros.core.motion import motion
from dragon_ros.core.scene import Scene
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.types import Floats

SIDES = ('x', '-x', 'y', '-y')
_SAFETY = 2.0
_WAY_M, _AT_ONCE, _MOST = 1.0, 64, 200_000


@dataclass(frozen=True)
class Reach:
    """The farthest corner on one side: at least ``low_m`` at ``t_s``, and nowhere in the run above ``high_m``."""

    side: str
    low_m: float
    high_m: float
    bench: int
    corner: str
    t_s: float
    point_m: tuple[float, float]


@dataclass(frozen=True)
class Extent:
    """The reaches on the four sides, in the order of SIDES; ``states`` counts the chains looked at."""

    reaches: tuple[Reach, ...]
    states: int

    @property
    def centred_m(self) -> float:
        """Side of the smallest square about the spiral's centre, along the axes, that holds the run."""
        return 2 * max(reach.high_m for reach in self.reaches)

    @property
    def free_m(self) -> float:
        """Side of the smallest square along the axes that holds the run, wherever its centre is."""
        right, left, up, down = (reach.high_m for reach in self.reaches)
        return max(right + left, up + down)

    @property
    def touching(self) -> Reach:
        """The reach that makes the centred square as large as it is."""
        return max(self.reaches, key=lambda reach: reach.low_m)


def extent(scene: Scene, within_m: float = 1e-10, progress: Callable[[int], object] = lambda states: None) -> Extent:
    """Return the room that the scene's run takes; bounds differ by ``within_m`` at most, and what positions may err.

    ``progress(states)`` is called with every number of chains just looked at. Raises FieldError for a scene that is not
    one spiral led by the head at a constant speed or whose way is too long, DragonError where the bounds do not meet.
    """
    search = _Search(scene, progress)
    return Extent(tuple(search.side(n, within_m) for n in range(len(SIDES))), search.states)


@dataclass(frozen=True)
class _Looks:
    """Corners (M, 4N, 2), bounds (M, 4N) on their accelerations, and bounds (M, 4N) of their distance, at places."""

    corners: Floats
    bend: Floats
    radius: Floats


class _Search:
    """Branch and bound over the head's way, side by side."""

    def __init__(self, scene: Scene, progress: Callable[[int], object]) -> None:
        self.scene, self.states, self._tell = scene, 0, progress
        self._effort, self._error_m = EXACT.effort(scene.size_m, scene.length_m), EXACT.promise_for_m(scene.size_m)
        scene.check_plain()
        run, stop_s = scene.run, scene.end.t_s
        # The lock itself is left out by a hair: accelerations are infinite there.
        stop_s -= 1e-9 * (stop_s - run.start_s) if scene.end.reason == 'lock' else 0.0
        way_m = abs(scene.steady_m_s) * (stop_s - run.start_s)
        if way_m > _WAY_M * _MOST:
            raise FieldError('run.stop_s', scene.run.stop_s, f'the head goes {way_m:.3g} m and no more than '
                             f'{_WAY_M * _MOST:.3g} m can be searched', 'stop earlier, or start later')
        self._times: Floats = np.linspace(run.start_s, stop_s, 2 + ceil(way_m / _WAY_M), dtype=np.float64)

    def side(self, number: int, within_m: float) -> Reach:
        """Return the reach on one side."""
        stretches: Floats = np.stack((self._times[:-1], self._times[1:]))
        best = Reach(SIDES[number], -np.inf, np.inf, 0, '', 0.0, (0.0, 0.0))
        bound: Floats = np.full(stretches.shape[1], np.inf)
        while np.any(bound > best.low_m + within_m):
            order = np.argsort(-bound)
            stretches, bound = stretches[:, order], bound[order]
            if self.states > _MOST:
                raise DragonError(f'fit: the reach along {SIDES[number]} is between {best.low_m:.9g} and '
                                  f'{bound[0]:.9g} m; a closer answer was not found')
            best, halves, upper = self._halves(stretches[:, :_AT_ONCE], number, best)
            stretches = np.concatenate((stretches[:, _AT_ONCE:], halves), axis=1)
            bound = np.concatenate((bound[_AT_ONCE:], upper))
            keep = bound > best.low_m
            stretches, bound = stretches[:, keep], bound[keep]
        high = max([best.low_m, *bound.tolist()]) + self._error_m
        return Reach(best.side, best.low_m, high, best.bench, best.corner, best.t_s, best.point_m)

    def _halves(self, stretches: Floats, number: int, best: Reach) -> tuple[Reach, Floats, Floats]:
        """Return the best corner so far, the halves of some stretches, and bounds of the coordinate on them."""
        middle = 0.5 * (stretches[0] + stretches[1])
        halves: Floats = np.concatenate((np.stack((stretches[0], middle)), np.stack((middle, stretches[1]))), axis=1)
        times, where = np.unique(halves, return_inverse=True)
        seen, ends = self._look(times), where.reshape(2, -1)
        value = (-1) ** number * seen.corners[..., number // 2]
        if np.max(value) > best.low_m:
            best = self._reach(seen, value, times, number)
        way_m = abs(self.scene.steady_m_s) * (halves[1] - halves[0])
        sag = _SAFETY / 8 * np.maximum(*seen.bend[ends]) * (way_m * way_m)[:, None]
        upper = np.minimum(np.maximum(*value[ends]) + sag, np.maximum(*seen.radius[ends]))
        return best, halves, np.max(upper, axis=1)

    def _reach(self, seen: _Looks, value: Floats, times: Floats, number: int) -> Reach:
        instant, corner = np.unravel_index(int(np.argmax(value)), value.shape)
        x, y = seen.corners[instant, corner].tolist()
        return Reach(SIDES[number], float(value[instant, corner]), np.inf, int(corner) // 4, CORNERS[int(corner) % 4],
                     float(times[instant]), (x, y))

    def _look(self, times: Floats) -> _Looks:
        scene, spiral = self.scene, self.scene.spiral
        self.states += times.size
        self._tell(times.size)
        heads = np.array([spiral.inward(*scene.head.travelled_m(t_s)) for t_s in times.tolist()])
        chain = place_many(spiral, scene.dragon.link_lengths_m, heads[:, 0], heads[:, 1], self._effort)
        benches = benches_of(chain, scene.dragon, axes_of(chain))
        moving = motion(spiral.b_m, chain, benches.axis)
        arm = np.hypot(benches.half_length, benches.half_width)
        bend = np.hypot(*np.moveaxis(moving.acceleration, -1, 0)) + arm * np.hypot(
            moving.turning_rate, moving.turning**2)
        overhang = np.hypot(benches.half_length - 0.5 * chain.links_m, benches.half_width)
        radius = spiral.b_m * np.maximum(chain.theta[:, 1:], chain.theta[:, :-1]) + overhang
        corners = benches.corners.reshape(times.size, -1, 2)
        return _Looks(corners, np.repeat(bend, 4, axis=1), np.repeat(radius, 4, axis=1))
