"""Recomputes what a certificate of first contact claims, with none of the solver's code.

It has its own chain (secant steps on the law of cosines), its own rectangles (corners and edge normals), its own
intervals, and halves a stretch where its bound is smaller than the one claimed. docs/contact.md proves the formulas. It
shares only the scene's plain numbers with the solver.
"""
from dataclasses import dataclass
from math import cos, hypot, inf, pi, sin, sqrt

import numpy as np

from dragon_ros.commands.certificate_checkers.bends import bends_of
from dragon_ros.commands.certificate_checkers.geometry import Geometry, least
from dragon_ros.commands.certificate_checkers.intervals import hull
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats

_AGREE_M = 1e-9         # between a recorded bound and the checker's, whose chain is no better beside a lock
_HALVINGS = 6
_HAIR_RAD = 1e-8        # between the checker's places and the recorded ones
_LOOSE_RAD = 1e-6       # between an end of a way and that of an interval
_STILL = 1e-9           # of a turn of the follower: nearer to it nothing moves


@dataclass(frozen=True)
class Row:
    """One interval of a certificate: the leading bench, ends, the claimed bound, and how many benches behind."""

    lead: int
    start_rad: float
    stop_rad: float
    bound_m: float
    behind: int


def name_of(lead: int) -> str:
    """Return how a certificate names a leading bench; 'body' is bench 1."""
    return ('head', 'body')[lead] if lead < 2 else f'bench {lead}'


@dataclass(frozen=True)
class _End:
    """One end of a stretch: handle angles (K+1,), corners in both frames, their separations (K-2,)."""

    angles: Floats
    frames: list[Floats]
    apart: Floats


class Checker(Geometry):
    """Recomputes what a certificate claims for a scene."""

    touch_m = 1e-9          # what benches may be apart at the contact

    def check_cover(self, rows: list[Row], start_s: float, end_s: float, slack_s: float) -> None:
        """Refuse intervals that leave out a part of what has to be cleared, but the last ``slack_s``, or that overhang.

        Each end of an interval has to meet another one, or an end of some bench's way.
        """
        start, before, last = self.angle(start_s), self.reached(start_s, end_s - slack_s), self.reached(start_s, end_s)
        if last[0] < start:     # a run ends a hair before a lock
            last = last[0] + 5e-10 * (1 + last[0]), last[1]
        count = len(self.links)
        ways = np.array([self.chain(0, angle, count) for angle in self._extremes(*before)])
        own = [(place, place) for place in (start, *self._extremes(*before))]
        ends = np.array([[self.chain(0, angle, count) for angle in both]
                         for both in (*own, *zip(before, last, strict=True))])
        self._check_turns(ends.reshape(-1, ends.shape[-1]))
        self.check_ways(rows, ways, ends)

    def check_ways(self, rows: list[Row], ways: Floats, ends: Floats) -> None:
        """Refuse rows that leave out a part of some bench's way, of angles (M, N+1), or whose ends are no others'."""
        count = len(self.links)
        parts: dict[int, list[Row]] = {}
        for row in rows:
            parts.setdefault(row.lead, []).append(row)
        spoken: dict[int, list[int]] = {lead: [] for lead in parts}
        for bench in range(count - 2):
            leads = [lead for lead in parts if self._speaks(lead, bench)]
            for lead in leads:
                spoken[lead].append(bench)
            self._covers(f'{name_of(min(bench, 1))} (bench {bench})', [row for lead in leads for row in parts[lead]],
                         count - 1 - bench, ways[:, bench])
        for lead, part in parts.items():
            self._meet(name_of(lead), part, ends[..., spoken[lead]])

    def _speaks(self, lead: int, bench: int) -> bool:
        """Return whether what one bench meets tells of another one: if what is behind that is also behind the one."""
        if not lead or lead >= bench:
            return lead == bench
        return not self.uneven or self.lengths[bench:] == self.lengths[lead:lead + len(self.lengths) - bench]

    def _check_turns(self, ways: Floats) -> None:
        """Refuse chains whose links, from the third on, may turn back: places between the ends would be left out."""
        front, span = ways[:, 2:-1], np.diff(ways[:, 2:])
        if self.uneven and np.any((span > 0) & ((span > pi) | (_comes_in(front, span) <= 0))):
            raise InputError('a link behind the second may turn back on the way; such runs have no certificate')

    @staticmethod
    def _meet(what: str, rows: list[Row], ends: Floats) -> None:
        """Refuse rows that end neither where another one does nor between any of the ends (M, 2, K) of ways."""
        low, high = np.min(ends, axis=1), np.max(ends, axis=1)
        starts, stops = {row.start_rad for row in rows}, {row.stop_rad for row in rows}
        for end in [row.start_rad for row in rows if row.start_rad not in stops] + [
                row.stop_rad for row in rows if row.stop_rad not in starts]:
            if not np.any((low - _LOOSE_RAD < end) & (end < high + _LOOSE_RAD)):
                raise InputError(f'{what}: an interval ends at {end!r} rad, where no other one starts')

    @staticmethod
    def _covers(what: str, rows: list[Row], behind: int, way: Floats) -> None:
        """Refuse rows of which those that count ``behind`` benches leave out places on a way."""
        low, high = float(np.min(way)) + _HAIR_RAD, float(np.max(way)) - _HAIR_RAD
        for left, right in sorted(sorted((row.start_rad, row.stop_rad)) for row in rows if row.behind >= behind):
            if left > low:
                break
            low = max(low, right)
        if low < high:
            raise InputError(f'{what}: the intervals leave out the place {low!r} rad')

    def _extremes(self, first: float, last: float) -> list[float]:
        """Return the head's places between which every handle moves one way, and the two that it goes between."""
        turn = self._lowest(1, first, last)
        return [first, self._lowest(2, first, turn), turn, self._lowest(2, turn, last), last]

    def _lowest(self, handle: int, left: float, right: float) -> float:
        """Return where a handle is nearest to the centre, by golden sections."""
        return least(lambda angle: self.chain(0, angle, handle)[-1], left, right)

    def check_bound(self, row: Row, halvings: int = _HALVINGS) -> None:
        """Refuse an interval of which some gap may be less than its bound, or whose bound is not positive."""
        bound = self.bound(row)
        if 0 < row.bound_m <= bound + _AGREE_M:
            return
        if row.bound_m <= 0 or halvings == 0:
            raise InputError(f'{name_of(row.lead)}: from {row.start_rad!r} to {row.stop_rad!r} rad the '
                             f'bound is {bound:.9g} m, not {row.bound_m!r} m')
        middle = 0.5 * (row.start_rad + row.stop_rad)
        for start, stop in ((row.start_rad, middle), (middle, row.stop_rad)):
            self.check_bound(Row(row.lead, start, stop, row.bound_m, row.behind), halvings - 1)

    def gap(self, t_s: float, i: int, j: int) -> float:
        """Return the separation of two benches at a time."""
        if not 0 <= i < j - 1 < len(self.links):
            return inf
        rectangles = self.rectangles(0, self.angle(t_s), j + 1)
        return float(self.apart(np.array([rectangles[i], rectangles[i], rectangles[j]]),
                                 0.5 * np.array([self.lengths[i], 0.0, self.lengths[j]]))[0])

    def bound(self, row: Row) -> float:
        """Return a lower bound of every gap of the leading bench on a stretch between two places."""
        benches = self._within_reach(row)
        one, two = (self._end(row.lead, angle, benches) for angle in (row.start_rad, row.stop_rad))
        if benches < 3:
            return inf
        if self._turns_back(row.lead, one.angles, two.angles):
            return -inf
        sag = self._sag(row.lead, one.angles, two.angles)
        low = np.full(benches - 2, -inf)
        halves = 0.5 * np.array(self.lengths[row.lead:row.lead + benches])
        for frame, half_length in enumerate((halves[0], halves[2:])):
            for axis, half in ((0, half_length), (1, self.half_width)):
                for side in (1, -1):
                    apart = [np.min(side * end.frames[frame][..., axis], axis=1) - half for end in (one, two)]
                    low = np.maximum(low, np.minimum(*apart) - sag[frame])
        gone = self._gone(row.lead, one.angles, two.angles)
        low = np.maximum(low, np.maximum(one.apart, two.apart) - gone[0] - gone[2:])
        circle = [self._outside(row.lead, n, one.angles, two.angles) for n in range(2, benches)]
        return float(np.min(np.maximum(low, circle)))

    def _end(self, lead: int, theta: float, benches: int) -> _End:
        angles = np.array(self.chain(lead, theta, benches))
        rectangles = self.corners_at(lead, angles)
        return _End(angles, self.frames(rectangles),
                    self.apart(rectangles, 0.5 * np.array(self.lengths[lead:lead + benches])))

    def _within_reach(self, row: Row) -> int:
        """Return how many benches can matter: all further ones lie outside the leading bench's circle."""
        most = min(row.behind + 1, len(self.links) - row.lead)
        chains = [np.array(self.chain(row.lead, angle, most)) for angle in (row.start_rad, row.stop_rad)]
        for number in range(3, most):
            if (self._further if self.uneven else self._outside)(row.lead, number, *chains) > 0:
                return number + 1
        return most

    def _further(self, lead: int, number: int, one: Floats, two: Floats) -> float:
        """Return how far a bench and all behind it stay outside that circle, whatever their lengths.

        A link's points are at least half of the longest from its front handle's circle, by Pythagoras.
        """
        inner, outer = self.b * float(min(one[number], two[number])), self.b * float(max(one[1], two[1]))
        overhang = 0.5 * (self.lengths[lead] - self.links[lead])
        away = sqrt(max(inner * inner - 0.25 * max(self.links[lead:]) ** 2, 0.0))
        return away - outer - 2 * hypot(overhang, self.half_width)

    def _outside(self, lead: int, number: int, one: Floats, two: Floats) -> float:
        """Return how far a bench's line stays outside the circle about the centre that holds the leading bench."""
        link, span = self.links[lead + number], float(max(end[number + 1] - end[number] for end in (one, two)))
        inner = float(min(one[number], two[number]))
        chord = link / self.b
        away = inner * inner / hypot(1, inner) if not link else (
            (chord - span) * (chord + span) * cos(0.5 * span) / sin(0.5 * span) / (2 * chord))
        overhang = 0.5 * (self.lengths[lead] - self.links[lead])
        return self.b * away - self.half_width - self.b * float(max(one[1], two[1])) - hypot(overhang, self.half_width)

    def _gone(self, lead: int, one: Floats, two: Floats) -> Floats:
        """Return how far a corner of each bench can have come."""
        links = np.array(self.links[lead:lead + one.size - 1])
        handle = self.b * np.abs(one - two) * np.hypot(1, np.maximum(one, two))
        overhang = 0.5 * (np.array(self.lengths[lead:lead + links.size]) - links)
        lever = 1 + 2 * (overhang + self.half_width) / np.maximum(links, 1e-12)
        out: Floats = lever * np.maximum(handle[:-1], handle[1:])
        return out

    def _turns_back(self, lead: int, one: Floats, two: Floats) -> bool:
        """Return whether the second or third handle comes in at one end and goes out at the other."""
        ends = [_comes_in(angles[:2], np.diff(angles[:3])) for angles in (one, two)]
        return bool(np.any((np.minimum(*ends) < -_STILL) & (np.maximum(*ends) > _STILL)))

    def _sag(self, lead: int, one: Floats, two: Floats) -> list[Floats]:
        """Return how far corners can leave straight lines, in the leading bench's frame and in the others'."""
        links = np.array(self.links[lead:lead + one.size - 1])
        arms = np.hypot(0.5 * np.array(self.lengths[lead:lead + links.size]), self.half_width) / self.b
        bends = bends_of(hull(one, two), hull(np.diff(one), np.diff(two)), links / self.b, arms)
        return [bend * (self.b * float(one[0] - two[0]) ** 2 / 8) for bend in bends]


def _comes_in(front: Floats, span: Floats) -> Floats:
    """Return numbers that are positive where a link's rear handle follows its front handle inwards."""
    out: Floats = span * np.cos(span) + front * ((front + span) * np.sin(span) + np.cos(span) - 1)
    return out
