"""A dragon led along a walk, by its head or by its tail."""
from dataclasses import dataclass
from functools import cached_property
from math import inf

from dragon_ros.core.angle import plus
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.head import Head, Profile
from dragon_ros.core.march import Effort
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.placed import AHEAD, BACK
from dragon_ros.core.walk import Place, Walk
from dragon_ros.core.walk_chain import WalkChain, chain_on
from dragon_ros.core.walk_many import Places, places_at

_PRECISE = Effort(1e-8)


@dataclass(frozen=True, eq=False)
class Led:
    """The chain whose head lies ``start_m`` along a walk when the leader has gone 0.

    Led by the head, followers lie back along the way. Led by the tail (``way`` AHEAD), the leader is the last handle:
    it walks back along the way, and each handle lies ahead of the one nearer the tail, so links follow in reverse.
    The track then ends where the head lies at the start.
    """

    walk: Walk
    links_m: Floats
    start_m: float
    way: int

    def __post_init__(self) -> None:
        """Refuse links that could lock on joined pieces, and a start without track for the whole chain."""
        if not self.walk.may_lock:
            self.walk.check_links(self.links_m)
        if self._least_m > self.start_m:
            raise FieldError('track.start_m', self.start_m, 'the track behind the head is too short for the dragon, '
                             f'which fits from {self._least_m:.9g} m on', 'start there, or lengthen the track')

    @cached_property
    def _least_m(self) -> float:
        """Distance of the head where the tail lies at the beginning of the track; -inf if that is open."""
        if self.walk.begin_m == -inf:
            return -inf
        try:
            head = self._behind(self.walk.place_at(self.walk.begin_m), AHEAD)[-1]
        except TrackEndError:
            return inf
        return self.walk.distance_of(head)[0]

    def _behind(self, leader: Place, way: int) -> list[Place]:
        return self.walk.follow(self.links_m if way == BACK else self.links_m[::-1], leader, way, _PRECISE)[0]

    @cached_property
    def _origin_m(self) -> tuple[float, float]:
        """Distance of the leader along the walk when it has gone 0, as (hi, lo)."""
        if self.way == BACK:
            return self.start_m, 0.0
        return self.walk.distance_of(self._behind(self.walk.place_at(self.start_m), BACK)[-1])

    def leader(self, gone_m: tuple[float, float]) -> Place:
        """Return the place of the leader after (hi, lo) metres."""
        high, low = plus(*self._origin_m, -self.way * gone_m[0])
        return self.walk.place_at(*plus(high, low, -self.way * gone_m[1]))

    def leaders(self, gone_m: tuple[Floats, Floats]) -> Places:
        """Return ``leader`` of many."""
        high, low = plus(*self._origin_m, -self.way * gone_m[0])
        return places_at(self.walk, *plus(high, low, -self.way * gone_m[1]))

    def gone_m(self, leader: Place) -> float:
        """Return how far the leader has gone when it is at a place."""
        high, low = plus(*self.walk.distance_of(leader), -self._origin_m[0])
        return float(-self.way * (high + (low - self._origin_m[1])))

    def chain(self, gone_m: tuple[float, float], effort: Effort) -> WalkChain:
        """Return all handles when the leader has gone (hi, lo) metres, marched. Raises TrackEndError off the track."""
        return chain_on(self.walk, self.links_m, self.leader(gone_m), self.way, effort)

    def end_s(self, head: Head | Profile) -> float | None:
        """Return the first time at which a handle would leave the track; None if never."""
        if self.way == BACK:
            onwards, back = self.walk.end_m - self.start_m, self._least_m - self.start_m
        else:
            onwards, back = self._origin_m[0] - self.walk.begin_m, 0.0
        times = [head.passage_s(distance, sense) for distance, sense in ((onwards, 1), (back, -1))
                 if abs(distance) < inf]
        return min((t_s for t_s in times if t_s is not None), default=None)

    def size_m(self, extent_m: tuple[float, float]) -> float:
        """Return a bound on how far from the origin a handle is while the leader goes between two distances."""
        return max(piece.far_m(u0, u1) for piece, u0, u1 in self.walk.between(*self.span_m(extent_m)))

    def span_m(self, extent_m: tuple[float, float]) -> tuple[float, float]:
        """Return the stretch of the walk on which handles are while the leader goes between two distances.

        Every handle moves on as the leader moves on, so the tail's least distance is that of the leader's least.
        """
        (least, most), origin, walk = extent_m, self._origin_m[0], self.walk
        if self.way == BACK:
            first = walk.place_at(max(origin + least, self._least_m))
            low, high = walk.distance_of(self._behind(first, BACK)[-1])[0], min(origin + most, walk.end_m)
        else:
            low, high = max(origin - most, walk.begin_m), self.start_m
        return min(low, high), high     # the tail's distance rounds, and may pass that of a leader next to it
