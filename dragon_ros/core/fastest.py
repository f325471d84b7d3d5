"""How fast the fastest handle is, over a whole run, and so how fast the leader may go under a limit.

Speeds over the leader's depend on where the leader is, not on when. They are smooth in its way except where a handle
passes a joint, where their slope jumps. Where the first piece winds in, no handle on it is faster than the one before
it: curvature grows to the front, and of a chord's two angles with such an arc the one at the more curved end is the
larger (Vogt 1914). So only the handles beyond it are looked at.
"""
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, inf

import numpy as np

from dragon_ros.core.errors import FieldError
from dragon_ros.core.led import Led
from dragon_ros.core.march import Effort
from dragon_ros.core.placed import BACK
from dragon_ros.core.scene import Scene
from dragon_ros.core.types import Floats
from dragon_ros.core.walk_chain import chain_on

_SPACING_M = 0.1        # of the first looks
_CLOSER = 8             # looks for one, where there may be a summit
_SAME = 1e-12           # speeds within this, in parts, are the same
_PRECISE = Effort(1e-8)
_MOST = 2_000_000


@dataclass(frozen=True)
class Fastest:
    """The largest speed of any handle over the leader's: which (the first of equals) and when.

    ``gone_m`` is what the leader has gone since t = 0 then, ``along_m`` its distance along the track (of a turn: from
    the entry). No handle exceeds ``bound`` anywhere on the run, if between two looks speeds change no more than the
    most that they do from look to look there and next to it: tested, not derived.
    """

    ratio: float
    handle: int
    gone_m: float
    along_m: float
    bound: float
    looks: int


def fastest(scene: Scene, progress: Callable[[int], object] = lambda looks: None) -> Fastest:
    """Return the fastest handle over the scene's run, on a track of pieces.

    ``progress(looks)`` is called with every number of places just looked at. Raises FieldError for a single spiral led
    by its head: the head is the fastest there until it nears the lock, where speeds have no bound.
    """
    if scene.led is None:
        raise FieldError('track.kind', 'spiral', 'on a single spiral the head is the fastest, and near the lock speeds '
                         'have no bound', 'ask about a track of pieces, such as track.kind: turn')
    search = _Search(scene.led, progress)
    low, high = scene.head.extent_m(scene.end.t_s)
    if (high - low) / _SPACING_M > _MOST:
        raise FieldError('run.stop_s', scene.run.stop_s, f'the leader goes {high - low:.3g} m and no more than '
                         f'{_MOST * _SPACING_M:.3g} m can be searched', 'stop earlier')
    return search.best(low, high)


class _Search:
    """Looks at speeds by the leader's way."""

    def __init__(self, led: Led, progress: Callable[[int], object]) -> None:
        self.led, self.looks, self._tell = led, 0, progress

    def ratios(self, gone_m: float) -> Floats:
        """Return the speeds of the handles that can be the fastest over the leader's, with the leader first."""
        self.looks += 1
        led, leader = self.led, self.led.leader((gone_m, 0.0))
        links = led.links_m
        if led.way == BACK and led.walk.winds_in:
            beyond = max(0.0, led.walk.distance_of(leader)[0] - led.walk.end_of_first_m)
            links = links[:2 + ceil(beyond / max(float(np.min(links)), 1e-3))]
        v = chain_on(led.walk, links, leader, led.way, _PRECISE).velocities(1.0)
        speed: Floats = np.hypot(v[:, 0], v[:, 1])
        return speed if led.way == BACK else speed[::-1]

    def best(self, low: float, high: float) -> Fastest:
        """Return the summit over a stretch of the leader's way: stretches that may hold a higher one are cut up."""
        summit, place, bound = 0.0, low, 0.0
        low = min(high, max(low, self._out_m))
        work = [(low, high, max(3, ceil((high - low) / _SPACING_M) + 1))]
        while work:
            scanned = [self._scan(*stretch) for stretch in work]
            top, at = max((float(np.max(tops)), float(places[np.argmax(tops)])) for places, tops, _ in scanned)
            summit, place = max((summit, place), (top, at))
            work = []
            for places, _, above in scanned:
                higher = above > summit * (1 + _SAME)
                bound = max(bound, float(np.max(above[~higher], initial=0.0)))
                work += [(float(places[n]), float(places[n + 1]), _CLOSER + 1) for n in np.flatnonzero(higher)]
        return self._told(place, max(bound, summit))

    @property
    def _out_m(self) -> float:
        """How far the leader has gone at the end of the first piece, if none is faster than the head before."""
        first = self.led.way == BACK and self.led.walk.winds_in
        return self.led.walk.end_of_first_m - self.led.start_m if first else -inf

    def _scan(self, low: float, high: float, count: int) -> tuple[Floats, Floats, Floats]:
        """Return places, the largest ratio at each, and bounds between them."""
        places: Floats = np.linspace(low, high, count, dtype=np.float64)
        tops = np.array([np.max(self.ratios(place)) for place in places.tolist()])
        self._tell(count)
        rise = np.abs(np.diff(tops))
        steep = np.max(np.stack((rise, np.append(rise[1:], 0.0), np.insert(rise[:-1], 0, 0.0))), axis=0)
        return places, tops, np.maximum(tops[1:], tops[:-1]) + steep

    def _told(self, place: float, bound: float) -> Fastest:
        ratios = self.ratios(place)
        ratio = float(np.max(ratios))
        handle = int(np.argmax(ratios >= ratio * (1 - _SAME)))
        if self.led.way != BACK:
            handle = self.led.links_m.size - handle
        along = self.led.walk.distance_of(self.led.leader((place, 0.0)))[0]
        return Fastest(ratio, handle, place, along, bound, self.looks)
