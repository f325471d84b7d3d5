"""How fast the fastest handle is, over a whole run, and so how fast the leader may go under a limit.

Speeds over the leader's depend on where the leader is, not on when. They are smooth in its way except where a handle
passes a joint, where their slope jumps. Where the first piece winds in, no handle on it is faster than the one before
it: curvature grows to the front, and of a chord's two angles with such an arc the one at the more curved end is the
larger (Vogt 1914). So only the handles beyond it are looked at.
"""
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, exp, inf

import numpy as np

from dragon_ros.core.errors import FieldError
from dragon_ros.core.led import Led
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.placed import BACK
from dragon_ros.core.rising import Looks, looks_at, tops
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.segments import Effort
from dragon_ros.core.walk_chain import chain_on

_SPACING_M = 0.1        # of the first looks
_AT_ONCE = 32           # looks
_CLOSER = 4             # looks for one, where there may be a summit
_SAME = 1e-12           # speeds within this, in parts, are the same
_FINEST = 1e-14         # of the leader's way: closer looks are the same
_PRECISE = Effort(1e-8)
_MOST = 2_000_000


@dataclass(frozen=True)
class Fastest:
    """The largest speed of any handle over the leader's: which (the first of equals) and when.

    ``gone_m`` is what the leader has gone since t = 0 then, ``along_m`` its distance along the track (of a turn: from
    the entry). No handle exceeds ``bound`` anywhere on the run: proved (``rising``).
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

    def look(self, places: Floats) -> Looks:
        """Return looks at the handles that can be the fastest up to the last place, with the leader first."""
        self.looks += places.size
        self._tell(places.size)
        led, links = self.led, self.led.links_m
        if led.way == BACK and led.walk.winds_in:
            head = led.walk.distance_of(led.leader((float(places[-1]), 0.0)))[0]
            beyond = max(0.0, head - led.walk.end_of_first_m)
            links = links[:2 + ceil(beyond / max(float(np.min(links)), 1e-3))]
        return looks_at([chain_on(led.walk, links, led.leader((place, 0.0)), led.way, _PRECISE)
                         for place in places.tolist()], places, led.way)

    def best(self, low: float, high: float) -> Fastest:
        """Return the summit over a stretch of the leader's way: parts that may hold a higher one are cut up."""
        low, bound, best = min(high, max(low, self._out_m)), 0.0, (0.0, low, 0)
        ends = np.linspace(low, high, max(1, ceil((high - low) / _SPACING_M / _AT_ONCE)) + 1).tolist()
        work = [(*pair, _AT_ONCE) for pair in pairwise(ends)]
        while work:
            seen = [self.look(np.linspace(start, stop, count + 1, dtype=np.float64)) for start, stop, count in work]
            best = max(best, *(_summit(looks) for looks in seen))
            work = []
            for looks in seen:
                above, places = tops(looks), looks.gone_m
                higher = (above > best[0] + _SAME) & (np.diff(places) > _FINEST * (1 + np.abs(places[1:])))
                bound = max(bound, float(np.max(above[~higher], initial=0.0)))
                work += [(float(places[n]), float(places[n + 1]), _CLOSER) for n in np.flatnonzero(higher)]
        return self._told(*best, max(bound, best[0]))

    @property
    def _out_m(self) -> float:
        """How far the leader has gone at the end of the first piece, if none is faster than the head before."""
        first = self.led.way == BACK and self.led.walk.winds_in
        return self.led.walk.end_of_first_m - self.led.start_m if first else -inf

    def _told(self, top: float, place: float, handle: int, bound: float) -> Fastest:
        if self.led.way != BACK:
            handle = self.led.links_m.size - handle
        along = self.led.walk.distance_of(self.led.leader((place, 0.0)))[0]
        return Fastest(exp(top), handle, place, along, exp(bound), self.looks)


def _summit(looks: Looks) -> tuple[float, float, int]:
    """Return the log of the largest speed seen, where the leader was, and which handle it was, from the leader on."""
    row = int(np.argmax(np.max(looks.log, axis=1)))
    top = float(np.max(looks.log[row]))
    return top, float(looks.gone_m[row]), int(np.argmax(looks.log[row] > top - _SAME))
