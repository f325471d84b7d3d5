"""Recomputes what a certificate of first contact on a joined track claims, with none of the solver's code.

It has its own track (``curve``), its own chain (Newton in a bracket, on distances along the track) and gaps by shapely.
docs/contact.md proves the bound. It shares only the scene's plain numbers with the solver.
"""
from dataclasses import dataclass
from itertools import pairwise
from math import asin, inf

import numpy as np
import shapely

from dragon_ros.commands.certificate_checkers.checker import Checker, Row
from dragon_ros.commands.certificate_checkers.curve import Curve
from dragon_ros.commands.certificate_checkers.going import Going
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.scene import Scene

_AGREE_M = 1e-10        # between a recorded bound and the checker's
_HAIR_M = 1e-7          # of the head's way: between its places and the recorded ones, and before a contact
_CLOSE = 1e-12          # a step of Newton, of the link: the next one is about its square
_AT_ONCE = 256


@dataclass(frozen=True)
class Part:
    """One interval of a certificate: distances of the head along the track, and the claimed bound."""

    start_m: float
    stop_m: float
    bound_m: float


@dataclass(frozen=True)
class _Seen:
    """A chain: distances of the handles along the track, and the benches' shapes."""

    along: Floats
    shapes: Array


class WalkChecker:
    """Recomputes what a certificate claims for a scene on a joined track."""

    touch_m = 1e-7          # what benches may be apart at the contact, or where they graze

    def __init__(self, scene: Scene) -> None:
        """Take plain numbers from the scene. Raises InputError where links could lock."""
        dragon, self._scene, self._going = scene.dragon, scene, Going(scene)
        self._curve = Curve(scene)
        self._links, self._lengths = np.array(dragon.link_lengths_m), np.array(dragon.bench_lengths_m)
        self._half_width = 0.5 * dragon.width_m
        self._places: Floats = np.empty(0)
        track = scene.chained.walk
        self._first, self._joint_m = track.pieces[0], track.joints_m[0] if track.afar and track.joints_m else -inf
        self._spiral = Checker(scene, track.afar.pitch_m) if track.afar else None
        self._blocks: dict[int, list[_Seen]] = {}
        if self._curve.bend * float(np.max(self._links)) >= 2:
            raise InputError('the track bends so tightly that links could lock on it')

    def gap(self, t_s: float, i: int, j: int) -> float:
        """Return the distance of two benches at a time."""
        if not 0 <= i < j - 1 < len(self._links):
            return inf
        shapes = self._see(np.array([self._head_at(self._going.gone_m(t_s))]))[0].shapes
        return float(shapely.distance(shapes[i], shapes[j]))

    def check_cover(self, every: list[Part | Row], start_s: float, end_s: float, slack_s: float) -> None:
        """Refuse intervals that leave out a part of the head's way, but the last ``slack_s``, or that overhang."""
        low, high = self._reached(start_s, end_s - slack_s)
        least, most = self._reached(start_s, end_s)
        rows = [row for row in every if isinstance(row, Part)]
        if self._spiral:
            on_spiral = [row for row in every if isinstance(row, Row)]
            start = self._head_at(self._going.gone_m(start_s))
            ends_m = np.array([[start, start], [low, low], [high, high], [low, least], [high, most]])
            angles = self._angles(self._chains(ends_m.ravel(), self._links, -1)).reshape(5, 2, -1)
            self._spiral.check_ways(on_spiral, angles[1:3, 0], angles)
            low, least = max(low, self._joint_m), max(least, self._joint_m)
            if high <= self._joint_m:
                if rows:
                    raise InputError('intervals: the head stays on the first spiral')
                return
        ends = sorted(tuple(sorted((row.start_m, row.stop_m))) for row in rows)
        for (_, right), (left, _) in pairwise(ends):
            if left != right:
                raise InputError(f'intervals: one ends at {right!r} m and the next one starts at {left!r} m')
        if ends and not (least - _HAIR_M <= ends[0][0] and ends[-1][1] <= most + _HAIR_M):
            raise InputError(f'intervals: the head only goes from {least!r} to {most!r} m')
        here = self._see(np.array([self._head_at(self._going.gone_m(start_s))]))[0]
        if self._near(here, here, 0.0)[0].size:
            raise InputError('benches touch at the start')
        first, last = (ends[0][0], ends[-1][1]) if ends else (low, low)
        if first > low + _HAIR_M or last < high - _HAIR_M:
            raise InputError(f'the intervals go from {first!r} to {last!r} m and leave out a part of {low!r} to '
                             f'{high!r} m')
        self._places = np.unique([place for pair in ends for place in pair])

    def _angles(self, along: Floats) -> Floats:
        """Return polar angles of handles on the first spiral, its end's for those beyond."""
        return np.array([[self._first.after(one).hi if one < self._joint_m else self._first.last for one in row]
                         for row in along.tolist()])

    def check_bound(self, row: Part | Row) -> None:
        """Refuse an interval of which some gap may be less than its bound, or whose bound is not positive."""
        if isinstance(row, Row):
            assert self._spiral
            self._spiral.check_bound(row)
            return
        one, two = (self._at(place) for place in (row.start_m, row.stop_m))
        bound = self._bound(one, two, row.bound_m)
        if not 0 < row.bound_m <= bound + _AGREE_M:
            raise InputError(f'from {row.start_m!r} to {row.stop_m!r} m the bound is {bound:.9g} m, not '
                             f'{row.bound_m!r} m')

    def _bound(self, one: _Seen, two: _Seen, claimed: float) -> float:
        """Return a lower bound of all gaps between two looks, or one that is no less than what is claimed."""
        way = np.abs(one.along - two.along)
        beside = np.hypot(0.5 * (self._lengths - self._links), self._half_width)
        gone = np.maximum(way[1:], way[:-1]) + beside * self._curve.bend * 0.5 * (way[1:] + way[:-1])
        far = claimed + float(np.max(gone))
        i, j = self._near(one, two, far)
        beyond = np.maximum(one.along, two.along)[i] > self._joint_m
        i, j = i[beyond], j[beyond]
        sums = shapely.distance(one.shapes[i], one.shapes[j]) + shapely.distance(two.shapes[i], two.shapes[j])
        return 0.5 * float(np.min(sums - gone[i] - gone[j], initial=2 * claimed))

    def _near(self, one: _Seen, two: _Seen, far: float) -> tuple[Ints, Ints]:
        """Return all pairs that are within a distance at either look."""
        pairs = []
        for seen in (one, two):
            i, j = shapely.STRtree(seen.shapes).query(seen.shapes, predicate='dwithin', distance=far)
            pairs.append(np.stack((i, j))[:, j > i + 1])
        i, j = np.unique(np.concatenate(pairs, axis=1), axis=1)
        return i, j

    def _reached(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Return the head's least and greatest distance along the track between two times."""
        one, other = (self._head_at(gone_m) for gone_m in self._going.extent_m(start_s, end_s))
        return min(one, other), max(one, other)

    def _head_at(self, gone_m: float) -> float:
        """Return the head's distance along the track when the leader has gone so far."""
        start = self._scene.track.start_m       # type: ignore[union-attr]
        if self._scene.head.lead == 'head':
            return float(start + gone_m)
        tail = float(self._chains(np.array([start]), self._links, -1)[0, -1])
        return float(self._chains(np.array([tail - gone_m]), self._links[::-1], 1)[0, -1])

    def _at(self, place: float) -> _Seen:
        """Return the look at a place of the head; those at places near it are made with it."""
        block, within = divmod(int(np.searchsorted(self._places, place)), _AT_ONCE)
        if block not in self._blocks:
            kept = list(self._blocks.items())[-1:]
            self._blocks = dict([*kept, (block, self._see(self._places[block * _AT_ONCE:(block + 1) * _AT_ONCE]))])
        return self._blocks[block][within]

    def _see(self, heads: Floats) -> list[_Seen]:
        along = self._chains(heads, self._links, -1)
        points, tangents = self._curve.at(along)
        link = points[:, :-1] - points[:, 1:]
        axis = np.where(self._links > 0, link / np.where(self._links > 0, np.abs(link), 1.0), tangents[:, :-1])
        middle, ahead, left = 0.5 * (points[:, :-1] + points[:, 1:]), 0.5 * self._lengths * axis, (
            1j * self._half_width * axis)
        corners = np.stack((middle + ahead + left, middle - ahead + left, middle - ahead - left,
                            middle + ahead - left), axis=-1)
        shapes = shapely.polygons(np.stack((corners.real, corners.imag), axis=-1))
        return [_Seen(*one) for one in zip(along, shapes, strict=True)]

    def _chains(self, leaders: Floats, links: Floats, way: int) -> Floats:
        """Return distances (M, N+1) of handles behind leaders (``way`` -1), or ahead of them."""
        out = [leaders]
        for link in links.tolist():
            out.append(out[-1] + way * self._reach(out[-1], link, way) if link else out[-1])
        along = np.stack(out, axis=1)
        if np.min(along) < self._curve.begin - _HAIR_M:
            raise InputError('a handle would lie before the beginning of the track')
        return along

    def _reach(self, along: Floats, link: float, way: int) -> Floats:
        """Return how far along the track the next handle is: chords grow up to there (docs/contact.md)."""
        bend, here = self._curve.bend, self._curve.at(along)[0]
        longest = 2 * asin(0.5 * bend * link) / bend if bend else link
        low, high = np.full(along.shape, link), np.full(along.shape, longest)
        x = low
        for _ in range(100):
            there, tangent = self._curve.at(along + way * x)
            chord = there - here
            over = np.abs(chord) - link
            low, high = np.where(over < 0, x, low), np.where(over < 0, high, x)
            slope = way * (chord.conjugate() * tangent).real / np.abs(chord)
            following = x - over / np.maximum(slope, 1e-3)
            following = np.where((following < low) | (following > high), 0.5 * (low + high), following)
            done = np.abs(following - x) <= _CLOSE * link
            x = following
            if np.all(done):
                break
        return x
