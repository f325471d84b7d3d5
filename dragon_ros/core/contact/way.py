"""The head's way through a run, in polar angles of its front handle, and what can be cleared of contact along it."""
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from dragon_ros.core.chain.dragon import goes_on_alike, is_even
from dragon_ros.core.chain.first_passage import Course
from dragon_ros.core.chain.lock import turning_places
from dragon_ros.core.chain.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.contact import interval_clearing as stretches
from dragon_ros.core.contact.interval_clearing import Cleared, Stretch, Window, comes_in
from dragon_ros.core.contact.narrow_phase import Lookout
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.old_chain import SpiralChain
from dragon_ros.core.paper import place
from dragon_ros.core.scene import Scene
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.tracks.composite import Place

_FIRST_M = 4.0          # distance of the places looked at first
_FINEST_M = 1e-3, 1e-8  # stretches are not halved below this: next to a contact, and next to a grazing
_LONGEST_M = 1e6
_MOST_PLACES = 200_000
_CLOSER = 20        # halvings of a way, to find up to where it can be proved
Bracket = tuple[float, float]


class Way:
    """The head's way from ``start`` to ``stop``; ``sign`` is -1 inwards. ``states`` counts the looks."""

    def __init__(self, scene: Scene, course: Course, sense: int, progress: Callable[[int], object]) -> None:
        """Take the way while the leader goes on (``sense`` 1) or back. Raises FieldError where it is too long."""
        self.scene, self.dragon, self.spiral, self.states = scene, scene.dragon, scene.spiral, 0
        self._course, self._sense, self._tell = course, sense, progress
        stop_s = course.farthest_s(sense)
        length_m = abs(course.gone_m(stop_s) - course.gone_m(course.start_s))
        if length_m > _LONGEST_M:
            raise FieldError('run.stop_s', scene.run.stop_s, f'the head goes {length_m:.3g} m and no more than '
                             f'{_LONGEST_M:.3g} m can be searched', 'stop earlier, or start later')
        self._effort = EXACT.effort(scene.size_m, scene.length_m)
        self.tolerance_m = 2 * EXACT.promise_for_m(scene.size_m)     # both benches may be off
        self.start, self.stop = self._theta(course.start_s), self._theta(stop_s)
        if stop_s == scene.end.t_s and scene.end.reason != 'stop' and not scene.led:
            # The model's own end is left out by a hair: speeds are infinite at a lock.
            end = 0.0 if scene.end.reason == 'track' else self.stop
            self.stop = min(self.start, end + 1e-9 * (1 + end))
        self.sign = -1.0 if self.stop <= self.start else 1.0
        self._chords = (scene.dragon.link_lengths_m / self.spiral.b_m).tolist()

    def _theta(self, t_s: float) -> float:
        """Return where the head is at a time."""
        gone = self.scene.head.travelled_m(t_s)
        led = self.scene.led
        return float(led.chain(gone, self._effort).u[0]) if led else self.spiral.inward(*gone).hi

    def time(self, theta: float) -> float:
        """Return when the head is at a place for the first time, in s."""
        if theta == self.start:
            return float(self.scene.run.start_s)
        led = self.scene.led
        gone_m = led.gone_m(Place(0, DoubleDouble(float(self.chain(theta).theta[-1]), 0.0))) if led else (
            self.spiral.distance_to(theta))
        return self._course.arrival_s(gone_m, self._sense)

    def speed_m_s(self, theta: float, t_s: float) -> float:
        """Return how fast the head is when it is at a place at a time."""
        speed = abs(self.scene.head.speed_at_m_s(t_s))
        return float(speed / np.hypot(*self.chain(theta).velocities(1.0)[-1])) if self.scene.led else speed

    def metre(self, theta: float) -> float:
        """Return how far the polar angle goes for a metre of the track."""
        return float(1 / (self.spiral.b_m * np.hypot(1.0, theta)))

    def chain(self, theta: float, benches: int | None = None) -> SpiralChain:
        """Return the chain, or its first benches, with the head's front handle at ``theta``."""
        return place(self.spiral, self.dragon.link_lengths_m[:benches], DoubleDouble(theta, 0.0), self._effort)

    def benches(self, theta: float) -> Benches:
        """Return all benches with the head's front handle at ``theta``."""
        chain = self.chain(theta)
        return benches_of(chain, self.dragon, axes_of(chain))

    def clear_head(self, stop: float, start: float | None = None) -> Cleared:
        """Clear the head's pairs on its way up to ``stop``."""
        behind = self.dragon.benches - 1
        if behind < 2:
            return Cleared([], None, False)
        return self._clear(0, [self._window(0, self.start if start is None else start, stop, behind)])[0]

    def clear_body(self, stop: float) -> tuple[list[Stretch], Bracket | None]:
        """Clear the body's pairs while the head goes up to ``stop``.

        Returns the stretches of track, and the first bracket of the head's places at which a pair is not clear.
        """
        behind = self.dragon.benches - 2
        if behind < 2:
            return [], None
        phases, ends = self._phases(stop)
        found = [self._clear_kin(kin, phases, ends) for kin in self._kins]
        hits = [hit for _, hit in found if hit]
        return ([one for done, _ in found for one in done],
                min(hits, key=lambda hit: self.sign * hit[1], default=None))

    @cached_property
    def _kins(self) -> list[list[int]]:
        """The benches of the body that have others to meet; those behind which the dragon goes on alike are together.

        That is one list where all are equal: the first of a list speaks for the others.
        """
        lengths, kins = self.dragon.bench_lengths_m, list[list[int]]()
        for bench in range(1, lengths.size - 2):
            kin = next((kin for kin in kins if goes_on_alike(lengths, kin[0], bench)), None)
            if kin:
                kin.append(bench)
            else:
                kins.append([bench])
        return kins

    def _clear_kin(self, kin: list[int], phases: list[float], ends: list[Floats]
                   ) -> tuple[list[Stretch], Bracket | None]:
        """Clear what some benches meet: their whole track at once or, where that is not clear, each one's part."""
        lead = kin[0]
        whole = self._clear(lead, [self._window(lead, *_track(kin, ends), self.dragon.benches - 1 - lead)])[0]
        if whole.hit is None:
            return whole.stretches, None
        done: list[Stretch] = []
        for n in range(len(phases) - 1):
            cleared, hit = self._clear_phase(kin, phases[n], phases[n + 1], ends[n], ends[n + 1])
            done += cleared
            if hit:
                return done, hit
        return done, None

    def trimmed(self, body: list[Stretch], stop: float) -> list[Stretch]:
        """Return the stretches of the whole body's track without what it has not reached with the head at ``stop``."""
        ends = self._phases(stop)[1] if body else []
        tracks = {kin[0]: _track(kin, ends) for kin in self._kins} if body else {}
        return [replace(one, start_rad=min(one.start_rad, outer), stop_rad=max(one.stop_rad, inner)) for one in body
                for outer, inner in [tracks[one.lead]] if one.start_rad > inner and one.stop_rad < outer]

    @cached_property
    def provable(self) -> float:
        """The place up to which no handle behind the third turns back, so that each moves one way between two places.

        Where links are equal none does, and it is ``stop``.
        """
        good, bad = self.start, self.stop
        if is_even(self.dragon.link_lengths_m) or self._all_come_in(self.stop):
            return self.stop
        for _ in range(_CLOSER if self._all_come_in(self.start) else 0):
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if self._all_come_in(middle) else (good, middle)
        return good

    def _all_come_in(self, stop: float) -> bool:
        """Return whether all links from the third on come in with their front handles while the head goes to ``stop``.

        One that spans no more than half a turn and does where its front handle is nearest to the centre does wherever
        that is (docs/contact.md, lemmas 1 and 2).
        """
        for chain in map(self.chain, self._phases(stop)[0]):
            theta, delta = chain.theta[2:], chain.delta[2:]
            if not np.all((chain.links_m[2:] == 0) | (delta <= np.pi) & (comes_in(theta, delta) > 0)):
                return False
        return True

    def _phases(self, stop: float) -> tuple[list[float], list[Floats]]:
        """Return the places between which every handle moves one way, and all handles there."""
        turns = turning_places(*self._chords[:2], *sorted((self.start, stop)))
        places = [self.start, *turns[::int(self.sign)], stop]
        return places, [self.chain(place).theta for place in places]

    def _clear_phase(self, kin: list[int], start: float, stop: float, here: Floats, there: Floats
                     ) -> tuple[list[Stretch], Bracket | None]:
        """Clear the part of the track of each of some benches while the head goes from ``start`` to ``stop``."""
        windows = self._parts(kin, here, there)
        done: list[Stretch] = []
        hits = []
        for bench, cleared in zip(kin, self._clear(kin[0], windows), strict=True):
            done += cleared.stretches
            if cleared.hit:
                hits.append([self._head_at(bench, place, (start, stop), (here, there)) for place in cleared.hit])
        first = min(hits, key=lambda row: self.sign * row[1], default=None)
        return done, (first[0], first[1]) if first else None

    def _parts(self, kin: list[int], here: Floats, there: Floats) -> list[Window]:
        """Return each bench's part of the track, without what another of its kin goes through before it."""
        last = self.dragon.benches - 1
        reach = self._lookout(kin[0], np.array(_track(kin, [here, there]))).follow
        out = []
        for before, bench, after in zip([0, *kin], kin, [*kin[1:], last], strict=False):
            start, stop = float(here[bench]), float(there[bench])
            if stop < start and before and there[before] <= here[before]:
                stop = max(stop, float(here[before]))
            elif stop > start and last - after >= reach:
                stop = min(stop, float(here[after]))
            behind = last - bench if last - bench < reach else last - kin[0]
            out.append(self._window(kin[0], start, stop, behind))
        return out

    def _head_at(self, bench: int, theta: float, way: Bracket, ends: tuple[Floats, Floats]) -> float:
        """Return where the head is when a bench's front handle is at ``theta``."""
        low, high = (float(end[bench]) - theta for end in ends)
        if low == 0 or high == 0:
            return way[0] if low == 0 else way[1]
        return illinois(lambda x: float(self.chain(x, bench).theta[bench]) - theta, *way, low, high)

    def _window(self, first: int, start: float, stop: float, behind: int) -> Window:
        count = 2 + int(self.spiral.b_m * abs(start - stop) * (1 + max(start, stop)) / _FIRST_M)
        places: Floats = np.linspace(start, stop, min(count, _MOST_PLACES), dtype=np.float64)
        turns = turning_places(*self._chords[first:first + 2], *sorted((start, stop)))
        ordered = np.unique(np.concatenate((places, turns)))
        return Window(ordered if stop > start else ordered[::-1], behind, first)

    def _lookout(self, first: int, ends: Floats) -> Lookout:
        follow = self.dragon.benches - first
        return Lookout(self.spiral, self.dragon, first, follow, self._effort, self._count).reaching(ends)

    def _count(self, states: int) -> None:
        self.states += states
        self._tell(states)

    def _clear(self, first: int, windows: list[Window]) -> list[Cleared]:
        """Clear windows; where a stretch next to the finest is neither clear nor touching, on and finer from there."""
        ends = np.concatenate([window.places[[0, -1]] for window in windows])
        lookout = self._lookout(first, np.array([np.min(ends), np.max(ends)]))
        out = stretches.clear(lookout.look, lookout.sizes, windows, _FINEST_M[0], self.tolerance_m)
        again = [n for n, cleared in enumerate(out) if cleared.hit and not cleared.touching]
        if again:
            rest = [self._after(windows[n], out[n]) for n in again]
            finer = stretches.clear(lookout.look, lookout.sizes, rest, _FINEST_M[1], self.tolerance_m)
            for n, more in zip(again, finer, strict=True):
                out[n] = Cleared([*out[n].stretches, *more.stretches], more.hit, more.touching)
        return out

    @staticmethod
    def _after(window: Window, cleared: Cleared) -> Window:
        """Return what is left of a window."""
        assert cleared.hit is not None
        sign = 1.0 if window.places[-1] > window.places[0] else -1.0
        later = window.places[sign * window.places > sign * cleared.hit[0]]
        return replace(window, places=np.concatenate(([cleared.hit[0]], later)))


def _track(kin: list[int], ends: list[Floats]) -> Bracket:
    """Return the outermost and innermost place of some benches, given from the head on."""
    return max(float(theta[kin[-1]]) for theta in ends), min(float(theta[kin[0]]) for theta in ends)
