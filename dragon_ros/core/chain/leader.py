"""The leader of a chain: its position on the track after it has travelled a distance, and its range of travel."""
from dataclasses import dataclass
from functools import cached_property
from math import hypot, inf, sqrt
from typing import Any

import numpy as np

from dragon_ros.core.chain.forward import forward, in_order
from dragon_ros.core.chain.lock import turning_places
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spiral import SpiralSegment


@dataclass(frozen=True, eq=False)
class Leader:
    """The leader of a chain whose head is initially at the distance ``start_m`` along a track.

    If the head leads, the followers are behind it. If the tail leads (``direction`` AHEAD), the leader is the last
    handle and moves back along the track. Each handle is then ahead of its neighbour nearer to the tail, so the links
    are in reverse order, and the track ends at the initial position of the head.
    """

    track: Track
    links_m: Floats
    start_m: float
    direction: int

    def __post_init__(self) -> None:
        """Reject links that could lock on a composite track, and a start too close to the beginning of the track."""
        self.track.check_links(self.links_m)
        if self.least_m > self.start_m:
            raise FieldError('track.start_m', self.start_m, 'the track behind the head is too short for the dragon, '
                             f'which fits from {self.least_m:.9g} m on', 'start there, or lengthen the track')

    @cached_property
    def least_m(self) -> float:
        """Distance of the head along the track when the tail is at the track's start; -inf if there is no start."""
        if self.track.begin_m == -inf:
            return -inf
        try:
            return head_in_front_m(self.track, self.links_m, self.track.begin_m)
        except TrackEndError:
            return inf

    @cached_property
    def _origin_m(self) -> float:
        """Distance of the leader along the track when it has travelled 0 m."""
        return self.start_m if self.direction == BEHIND else tail_behind_m(self.track, self.links_m, self.start_m)

    def place(self, travel_m: float) -> Place:
        """Return the leader's position after it has travelled ``travel_m``. Raises TrackEndError beyond an end."""
        return self.track.place_at(self.along_m(travel_m))

    def places(self, travel_m: Floats) -> Places:
        """Return the positions of the leader for many distances travelled."""
        return self.track.places_at(self.along_m(travel_m))

    def travel_m(self, leader: Place) -> float:
        """Return the distance that the leader has travelled when it is at a given position."""
        return self.direction * (self._origin_m - self.track.distance_of(leader))

    def along_m(self, travel_m: Any) -> Any:
        """Return the distance of the leader along the track when it has travelled ``travel_m``, for one or many."""
        return self._origin_m - self.direction * travel_m

    def turning_m(self, low_m: float, high_m: float, links: int | None = None) -> list[float]:
        """Return the distances travelled, between two limits, at which a handle turns back, in ascending order.

        Between consecutive distances, every handle moves in one direction. Handles turn back only near the centre of a
        single spiral, where links may lock. If ``links`` is given, only the handles of the first ``links`` links are
        considered.
        """
        spiral = self.track.from_afar
        if not (self.track.may_lock and spiral):
            return []
        low, high = sorted(self.place(travel_m).u for travel_m in (low_m, high_m))
        chords = (self.links_m[:links] / spiral.curve.b_m).tolist()
        return sorted(self.travel_m(Place(0, theta)) for theta in turning_places(chords, low, high))

    @cached_property
    def range_m(self) -> tuple[float, float]:
        """Smallest and largest distances that the leader can travel before a handle leaves the track."""
        if self.direction == BEHIND:
            return self.least_m - self.start_m, self.track.end_m - self.start_m
        return 0.0, self._origin_m - self.track.begin_m

    def size_m(self, extent_m: tuple[float, float]) -> float:
        """Return an upper bound on the distance of any handle from the origin over a range of travel."""
        spiral = self.track.from_afar
        if self.track.may_lock and spiral:  # r^2 grows by at most 2 b per metre of track
            curve, length_m = spiral.curve, float(np.sum(self.links_m))
            return curve.b_m * (1 + hypot(curve.start, sqrt(2 * (length_m - extent_m[0]) / curve.b_m)))
        return self.track.far_m(*self.span_m(extent_m))

    def longest_m(self, extent_m: tuple[float, float]) -> float:
        """Return the largest coordinate (m) along the track: from its origin and, on spirals, from their centres."""
        spiral = self.track.from_afar
        if self.track.may_lock and spiral:
            return self.size_m(extent_m) ** 2 / (2 * spiral.curve.b_m)
        low_m, high_m = self.span_m(extent_m)
        # All pieces count, because an error at the end of a piece moves the pieces behind it.
        parts = [*self.track.between(low_m, high_m), *((one, one.first, one.last) for one in self.track.segments)]
        wound = (0.5 * segment.curve.b_m * u * u for segment, *ends in parts if isinstance(segment, SpiralSegment)
                 for u in ends if u < inf)
        return max(abs(low_m), abs(high_m), *wound)

    def span_m(self, extent_m: tuple[float, float]) -> tuple[float, float]:
        """Return the interval of the track that the handles occupy over a range of travel.

        Every handle moves forward with the leader, so the tail is furthest back when the leader is furthest back.
        """
        (least, most), origin, track = extent_m, self._origin_m, self.track
        if self.direction == BEHIND:
            first = track.place_at(max(origin + least, self.least_m))
            low, high = track.distance_of(_last(track, self.links_m, first, BEHIND)), min(origin + most, track.end_m)
        else:
            low, high = max(origin - most, track.begin_m), self.start_m
        return min(low, high), high     # the tail's distance is rounded and may exceed the leader's


def head_in_front_m(track: Track, links_m: Floats, tail_m: float) -> float:
    """Return the distance of the head along a track when the tail is at ``tail_m``, or raise TrackEndError."""
    return track.distance_of(_last(track, links_m, track.place_at(tail_m), AHEAD))


def tail_behind_m(track: Track, links_m: Floats, head_m: float) -> float:
    """Return the distance of the tail along a track when the head is at ``head_m``, or raise TrackEndError."""
    return track.distance_of(_last(track, links_m, track.place_at(head_m), BEHIND))


def _last(track: Track, links_m: Floats, leader: Place, direction: int) -> Place:
    """Return the position of the last handle of a chain whose leader is at a given position."""
    return forward(track, in_order(links_m, direction), leader, direction).place(-1)
