"""The first contact on a joined track: followed along the leader's way, in steps that are proved clear.

Handles only move on as the leader does (``walk``), so between two looks handle i goes the way D_i between its places at
both, and no more. A point of a bench that is t of the way between its handles goes (1 - t) D_i + t D_(i+1) at most; one
that is e beside or beyond them goes e times the bench's turning more, which is at most (D_i + D_(i+1)) / 2 times the
track's largest curvature (``rising``). If two benches met in between, the same two points of theirs would have been
apart by their gaps at both looks: they would have gone at least the sum of both gaps. docs/contact.md has the proof.
"""
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.chain.first_passage import Course
from dragon_ros.core.chain.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.contact.broad_phase import box_pairs
from dragon_ros.core.contact.certificate import Certificate, Contact, Step
from dragon_ros.core.contact.signed_distance import gaps, witness
from dragon_ros.core.errors import FieldError
from dragon_ros.core.led import Led
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.tiers import EXACT

_SPACING = 0.3          # of the longest bench, between first looks
_FINEST = 1e-8          # of a metre, or of the longest bench if it is shorter
_SLACK_M = 1e-7         # of the leader's way before a contact: what may be left out at most
_SHORTEST = 1e-11       # step before a contact
_MOST = 2_000_000
_SHARE, _SHRINK, _GROW = 0.9, 0.1, 2.0      # of the room for a step, and of the last one
_FAR = 4.0              # times a step: pairs further apart than that are not looked at one by one
_AHEAD = 24
_STILL_M = 1e-200       # two looks may round to one place


@dataclass(frozen=True)
class _Look:
    """A chain when the leader has gone so far: distances (N+1,) along the track, benches, and pairs as i N + j.

    The gaps of all other pairs exceed ``reach_m``.
    """

    gone_m: float
    along_m: Floats
    benches: Benches
    pairs: Ints
    reach_m: float


class Follower:
    """Follows a scene on a joined track while the leader goes one way; ``states`` counts the looks."""

    def __init__(self, scene: Scene, course: Course, sense: int, progress: Callable[[int], object]) -> None:
        """Take the way. Raises FieldError where it is too long to search."""
        assert scene.led
        self.scene, self.states, self._course, self._sense, self._tell = scene, 0, course, sense, progress
        self._led: Led = scene.led
        dragon, longest = scene.dragon, float(np.max(scene.dragon.bench_lengths_m))
        self._start, self._stop = (course.gone_m(t_s) for t_s in (course.start_s, course.farthest_s(sense)))
        self._spacing, self._finest, self._reach_m = _SPACING * longest, _FINEST * min(1.0, longest), 0.5 * longest
        self._slack_m, self._stuck = self._finest, False
        length_m = abs(self._stop - self._start)
        if length_m > _MOST * self._spacing:
            raise FieldError('run.stop_s', scene.run.stop_s, f'the leader goes {length_m:.3g} m and no more than '
                             f'{_MOST * self._spacing:.3g} m can be searched', 'stop earlier')
        self._effort = EXACT.effort(scene.size_m, scene.length_m)
        self._tolerance_m = 4 * EXACT.promise_for_m(scene.size_m)       # two benches may be off, at two looks
        overhang = np.hypot(0.5 * (dragon.bench_lengths_m - dragon.link_lengths_m), 0.5 * dragon.width_m)
        self._turning = 0.5 * self._led.walk.bend * overhang
        self._steps: list[Step] = []
        self._hits: list[tuple[float, int]] = []
        self._first = self._look(self._start)

    def first(self) -> Contact | None:
        """Return the first contact on the way, which is cleared up to it."""
        stuck = self._clear()
        if self._hits:
            return self._contact(self._hits, None)
        return self._grazing(*stuck) if stuck else None

    def cleared(self) -> Certificate:
        """Return the certificate of the way, which has no contact."""
        self._clear()
        return self.certificate()

    def certificate(self) -> Certificate:
        """Return what is cleared."""
        near = self._gaps(self._first, self._first.pairs)
        return Certificate((), (), float(np.min(near, initial=self._reach_m)), not self._stuck, tuple(self._steps))

    def _clear(self) -> tuple[_Look, _Look] | None:
        """Clear the way, up to the first contact; return looks between which nothing is known where it gets stuck.

        A step is as long as the last one says that the next can be.
        """
        here, step_m = self._first, self._spacing
        self._meet(here, here)
        while (rest_m := self._rest_m(here)) > 0:
            way_m = min(step_m, rest_m)
            there = self._look(here.gone_m + self._sense * way_m, _FAR * step_m)
            bound_m, room = self._bound(here, there)
            least_m = 0.0 if self._hits else self._finest
            step_m = max(way_m * min(max(_SHARE * room, _SHRINK), _GROW), least_m)
            if bound_m > self._tolerance_m:
                self._steps.append(Step(float(here.along_m[0]), float(there.along_m[0]), bound_m))
                here = there
            elif not self._meet(here, there) and way_m <= max(least_m, _SHORTEST):
                if self._hits or not any(self._meet(here, ahead) for ahead in self._ahead(here)):
                    self._stuck = bool(self._hits)
                    return here, there
        return None

    def _rest_m(self, here: _Look) -> float:
        """Return how far the leader has to go yet: to its end, or to just before the contact."""
        ends = [self._sense * self._stop, *(self._sense * gone_m - self._slack_m for gone_m, _ in self._hits)]
        return min(ends) - self._sense * here.gone_m

    def _ahead(self, here: _Look) -> Iterator[_Look]:
        """Yield looks further and further ahead."""
        for power in range(_AHEAD):
            gone_m = here.gone_m + self._sense * self._finest * 2**power
            if self._sense * gone_m < self._sense * self._stop:
                yield self._look(gone_m)

    def _meet(self, before: _Look, after: _Look) -> bool:
        """Note when the pairs that touch at a look begin to, if there are any; before it none does."""
        touching = after.pairs[self._gaps(after, after.pairs) <= 0].tolist()
        if touching:
            self._hits = sorted((self._touch(pair, before, after), pair) for pair in touching)
            self._hits.sort(key=lambda hit: self._sense * hit[0])
            # Closer than this a gap cannot be told from zero.
            slope = max(self._slope(self._hits[0][1], self._hits[0][0]), 4 * self._tolerance_m / _SLACK_M)
            self._slack_m = max(self._finest, 4 * self._tolerance_m / slope)
        return bool(touching)

    def _look(self, gone_m: float, reach_m: float = np.inf) -> _Look:
        self.states += 1
        self._tell(1)
        chain, reach_m = self._led.chain((gone_m, 0.0), self._effort), min(reach_m, self._reach_m)
        benches = benches_of(chain, self.scene.dragon, axes_of(chain))
        i, j = box_pairs(benches, reach_m)
        along_m = chain.walk.distances(chain.piece, chain.u)
        return _Look(gone_m, along_m, benches, i * benches.half_length.size + j, reach_m)

    def _gaps(self, look: _Look, pairs: Ints) -> Floats:
        return gaps(look.benches, *np.divmod(pairs, look.benches.half_length.size))

    def _bound(self, a: _Look, b: _Look) -> tuple[float, float]:
        """Return a lower bound of all gaps between two looks (not positive: not clear), and the room for longer steps.

        Room is how many times as far benches could have gone: gaps over ways.
        """
        way_m = np.abs(b.along_m - a.along_m)
        moved_m = np.maximum(way_m[:-1], way_m[1:]) + self._turning * (way_m[:-1] + way_m[1:])
        pairs = np.union1d(a.pairs, b.pairs)
        i, j = np.divmod(pairs, moved_m.size)
        apart_m, moving_m = self._gaps(a, pairs) + self._gaps(b, pairs), moved_m[i] + moved_m[j]
        far_m, most_m = a.reach_m + b.reach_m, 2 * float(np.max(moved_m))     # of all other pairs
        return (0.5 * float(np.min(apart_m - moving_m, initial=far_m - most_m)),
                float(np.min(apart_m / np.maximum(moving_m, _STILL_M), initial=far_m / max(most_m, _STILL_M))))

    def _contact(self, hits: list[tuple[float, int]], grazing_m: tuple[float, float] | None) -> Contact:
        """Return the contact of the first of some hits, or the grazing with bounds of the smallest gap."""
        times = [self._course.arrival_s(gone_m, self._sense) for gone_m, _ in hits]
        (gone_m, code), *later = hits
        speed = self._slope(code, gone_m) * abs(self.scene.head.speed_at_m_s(times[0]))
        unsure = EXACT.promise_for_m(self.scene.size_m) / speed if speed > 0 else float('inf')
        others = tuple(self._pair(other) for t_s, (_, other) in zip(times[1:], later, strict=True)
                       if t_s - times[0] <= unsure)
        pair = self._pair(code)
        return Contact(times[0], pair, witness(self._look(gone_m).benches, *pair), grazing_m, others, speed, unsure,
                       self.states, self.certificate())

    def _pair(self, code: int) -> tuple[int, int]:
        i, j = divmod(code, self.scene.dragon.benches)
        return i, j

    def _grazing(self, before: _Look, after: _Look) -> Contact:
        """Return where nobody can say if the closest pair touches, between two looks at which it does not."""
        pairs = np.union1d(before.pairs, after.pairs)
        least = np.minimum(self._gaps(before, pairs), self._gaps(after, pairs))
        closest, error = int(np.argmin(least)), self._tolerance_m
        bounds = self._bound(before, after)[0] - error, float(least[closest]) + error
        return self._contact([(before.gone_m, int(pairs[closest]))], bounds)

    def _gap(self, pair: int, gone_m: float) -> float:
        return float(self._gaps(self._look(gone_m), np.array([pair]))[0])

    def _touch(self, pair: int, before: _Look, after: _Look) -> float:
        """Return how far the leader has gone when the gap of a pair vanishes."""
        low, high = (float(self._gaps(look, np.array([pair]))[0]) for look in (before, after))
        if before is after or low <= 0:
            return before.gone_m
        return illinois(lambda gone_m: self._gap(pair, gone_m), before.gone_m, after.gone_m, low, high)

    def _slope(self, pair: int, gone_m: float) -> float:
        """Return how much a gap closes for each metre of the leader's way."""
        low, high = sorted((self._start, self._stop))
        early, late = max(low, gone_m - 1e-6), min(high, gone_m + 1e-6)
        return self._sense * (self._gap(pair, early) - self._gap(pair, late)) / (late - early) if late > early else 0.0
