"""The first contact of a run: this one exactly, and a certificate that none came before.

Benches follow each other on one track at one spacing, so whether bench i >= 1 meets a bench behind it depends only on
where bench i is: the body's whole stretch of track is cleared once, and the head's pairs along the head's way. Where
the body does not clear, all pairs are followed along the head's way, at more cost and without a certificate.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dragon_ros.core import clearing, stretches
from dragon_ros.core.angle import Angle
from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.chain import SpiralChain
from dragon_ros.core.contact import Witness, gaps, witness
from dragon_ros.core.contact_anywhere import Follower
from dragon_ros.core.errors import FieldError
from dragon_ros.core.head import Head
from dragon_ros.core.lock import follower, follower_turns, lock_angle
from dragon_ros.core.lookout import Lookout
from dragon_ros.core.march import place
from dragon_ros.core.motion import fastest_points
from dragon_ros.core.neighbours import candidates, default_reach_m
from dragon_ros.core.root import illinois
from dragon_ros.core.scene import End, Scene
from dragon_ros.core.stretches import Cleared, Stretch
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.types import Floats

_FIRST_M = 1.0          # distance of the places looked at first
_FINEST_M = 1e-3, 1e-8  # stretches are not halved below this: next to a contact, and next to a grazing
_TAIL = 20              # halvings from the last stretch before a contact to a nanometre before it
_LONGEST_M = 1e6        # of the head's way
_SLOW_FIRST_M, _SLOW_FINEST_M = 0.25, 1e-7      # where all pairs are followed


@dataclass(frozen=True)
class Certificate:
    """Stretches that prove that nothing touched: of the head's way, and of the track under the body's front handles.

    ``complete`` is False where the body had to be followed pair by pair.
    """

    head: tuple[Stretch, ...]
    body: tuple[Stretch, ...]
    complete: bool


@dataclass(frozen=True)
class Contact:
    """A first contact: when, between which benches (the inner first), which corner and edge, and how sure.

    ``grazing_m`` are bounds on the smallest gap where it is zero to within what positions may err, so that nobody can
    say if they touch, else None. ``simultaneous`` has the other pairs that touch within the uncertainty, which is the
    position error of the exact tier over the approach speed. ``states`` counts the looks.
    """

    t_s: float
    benches: tuple[int, int]
    witness: Witness
    grazing_m: tuple[float, float] | None
    simultaneous: tuple[tuple[int, int], ...]
    approach_m_s: float
    uncertainty_s: float
    states: int
    certificate: Certificate

    @property
    def point_m(self) -> tuple[float, float]:
        """Where they touch."""
        return self.witness.point_m


@dataclass(frozen=True)
class NoContact:
    """The run ended without one."""

    end: End
    states: int
    certificate: Certificate


def first_contact(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> Contact | NoContact:
    """Return the first contact of the scene's run, at the exact tier, or how the run ended without one.

    ``progress(states)`` is called with every number of states just looked at. Raises FieldError where the way is so
    long that the search would not end.
    """
    if scene.led or not isinstance(scene.head, Head):
        return _anywhere(replace(scene, accuracy='exact'), progress)
    way = _Way(scene, progress)
    head = way.clear_head()
    last = way.start if head.hit and head.hit[0] == head.hit[1] else head.hit[1] if head.hit else way.stop
    body = way.clear_body(last)
    if body.hit:
        return way.followed(last)
    certificate = Certificate(tuple(head.stretches), tuple(body.stretches), True)
    return way.contact(*head.hit, certificate) if head.hit else NoContact(scene.end, way.states, certificate)


def _anywhere(scene: Scene, progress: Callable[[int], object]) -> Contact | NoContact:
    """Follow all pairs in time, on any track and for any head law."""
    follower, certificate = Follower(scene, progress), Certificate((), (), False)
    hit = follower.hit()
    if hit is None:
        return NoContact(scene.end, follower.states, certificate)
    found = follower.touching(*hit)
    t_s, pair = found[0]
    speed = follower.approach_m_s(pair, t_s)
    unsure = EXACT.promise_for_m(scene.size_m) / speed if speed > 0 else float('inf')
    others = tuple(other for later, other in found[1:] if later - t_s <= unsure)
    seen = witness(follower.benches(t_s)[1], *pair)
    return Contact(t_s, pair, seen, None, others, speed, unsure, follower.states, certificate)


class _Way:
    """The head's way through a run, in polar angles of its front handle."""

    def __init__(self, scene: Scene, progress: Callable[[int], object]) -> None:
        self.scene, self.dragon, self.spiral, self.states = scene, scene.dragon, scene.spiral, 0
        length_m = abs(scene.steady_m_s) * (scene.end.t_s - scene.run.start_s)
        if length_m > _LONGEST_M:
            raise FieldError('run.stop_s', scene.run.stop_s, f'the head goes {length_m:.3g} m and no more than '
                             f'{_LONGEST_M:.3g} m can be searched', 'stop earlier, or start later')
        self._tell = progress
        self.effort = EXACT.effort(scene.size_m, scene.length_m)
        self.tolerance_m = 2 * EXACT.promise_for_m(scene.size_m)     # both benches may be off
        self.start, stop = (self._theta(t_s) for t_s in (scene.run.start_s, scene.end.t_s))
        # The model's own end is left out by a hair: speeds are infinite at a lock.
        self.stop = stop if scene.end.reason == 'stop' else min(self.start, stop + 1e-9 * (1 + stop))

    def _theta(self, t_s: float) -> float:
        return self.spiral.inward(*self.scene.head.travelled_m(t_s)).hi

    def progress(self, states: int) -> None:
        """Count states, and tell."""
        self.states += states
        self._tell(states)

    def clear_head(self) -> Cleared:
        """Clear the head's pairs along its way."""
        return self._clear(0, self.start, self.stop)

    def clear_body(self, last: float) -> Cleared:
        """Clear every place where the front of a body bench is while the head goes from the start to ``last``."""
        places = self.chain(self.start).theta, self.chain(last).theta
        if self.dragon.benches < 4:
            return Cleared([], None, False)
        inner = min(float(theta[1]) for theta in places)
        chord = float(self.dragon.head_link_m / self.spiral.b_m)
        low, high = sorted((self.start, last))
        turning = follower_turns(lock_angle(chord), high, chord)
        if low < turning:       # the second handle turned back on the way
            inner = min(inner, follower(turning, chord))
        return self._clear(1, max(float(theta[-2]) for theta in places), inner)

    def _clear(self, first: int, start: float, stop: float) -> Cleared:
        follow = self.dragon.benches - first
        if follow < 3:
            return Cleared([], None, False)
        b_m = self.spiral.b_m
        count = 2 + int(b_m * abs(start - stop) * (1 + max(start, stop)) / _FIRST_M)
        places: Floats = np.linspace(start, stop, min(count, 200_000), dtype=np.float64)
        lookout = Lookout(self.spiral, self.dragon, first, follow, self.effort, self.progress)
        lookout = lookout.reaching(np.array([start, stop]))
        places = places if start != stop else places[:1]
        cleared = stretches.clear(lookout.look, b_m, places, _FINEST_M[0], self.tolerance_m)
        if cleared.hit is None or cleared.touching:
            return cleared
        rest = stretches.clear(lookout.look, b_m, np.array([cleared.hit[0], stop]), _FINEST_M[1], self.tolerance_m)
        return Cleared([*cleared.stretches, *rest.stretches], rest.hit, rest.touching)

    def chain(self, theta: float) -> SpiralChain:
        """Return the whole chain with the head's front handle at ``theta``."""
        return place(self.spiral, self.dragon.link_lengths_m, Angle(theta, 0.0), self.effort)

    def followed(self, last: float) -> Contact | NoContact:
        """Follow all pairs along the head's way up to ``last``."""
        sign = -1.0 if last <= self.start else 1.0
        metre = 1 / (self.spiral.b_m * (1 + max(self.start, last)))
        found = clearing.clear(lambda x: self._all_pairs(sign * x), sign * self.start, sign * last,
                               _SLOW_FIRST_M * metre, _SLOW_FINEST_M * metre)
        certificate = Certificate((), (), False)
        if found.hit is None:
            return NoContact(self.scene.end, self.states, certificate)
        return self.contact(sign * found.hit[0], sign * found.hit[1], certificate)

    def _all_pairs(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the smallest gap of all pairs and a bound on its rate in m/rad, at each place."""
        rows = []
        for angle in theta.tolist():
            chain, benches = self._benches(angle)
            i, j = candidates(chain.p, benches)
            speed = self.spiral.b_m * float(np.hypot(1.0, angle))
            fastest = fastest_points(self.spiral.b_m, chain, benches, speed)
            # Beyond the reach of the candidates all that is known is that every gap exceeds it.
            smallest = float(np.min(gaps(benches, i, j), initial=default_reach_m(benches)))
            rows.append((smallest, 2 * float(np.max(fastest))))
            self.progress(1)
        gap, rate = np.array(rows).T
        return gap, rate

    def _benches(self, theta: float) -> tuple[SpiralChain, Benches]:
        chain = self.chain(theta)
        return chain, benches_of(chain, self.dragon, axes_of(chain))

    def contact(self, clear_end: float, other_end: float, certificate: Certificate) -> Contact:
        """Return the contact in a bracket of places."""
        chain, benches = self._benches(other_end)
        i, j = candidates(chain.p, benches)
        gap = gaps(benches, i, j)
        touching = np.flatnonzero(gap <= 0) if np.min(gap) <= 0 else np.array([np.argmin(gap)])
        touching = touching[np.argsort(gap[touching], kind='stable')]
        sign = np.sign(other_end - clear_end) or 1.0
        pairs = [(int(i[n]), int(j[n])) for n in touching]
        places = [(sign * self._touch(pair, clear_end, other_end), pair) for pair in pairs]
        found = sorted(places, key=lambda row: row[0])
        theta, pair = sign * found[0][0], found[0][1]
        speed, error = self._approach(pair, theta), EXACT.promise_for_m(self.scene.size_m)
        unsure = error / speed if speed > 0 else float('inf')
        times = [self.scene.run.start_s if sign * x == self.start else self._time(sign * x) for x, _ in found]
        others = tuple(other for t_s, (_, other) in zip(times[1:], found[1:], strict=True) if t_s - times[0] <= unsure)
        least = float(np.min(gap))
        grazing = (least - self.tolerance_m, least + self.tolerance_m) if least > 0 else None
        if certificate.complete and clear_end != theta and not grazing:
            certificate = self._up_to(theta, clear_end, certificate)
        return Contact(times[0], pair, witness(self._benches(theta)[1], *pair), grazing, others, speed,
                       unsure, self.states, certificate)

    def _up_to(self, theta: float, clear_end: float, certificate: Certificate) -> Certificate:
        """Return the certificate with stretches that halve the way to a contact, down to a nanometre before it."""
        lookout = Lookout(self.spiral, self.dragon, 0, self.dragon.benches, self.effort, self.progress)
        halves = np.array([0.5**k for k in range(_TAIL + 1)], dtype=np.float64)
        places: Floats = theta + (clear_end - theta) * halves
        look = lookout.reaching(places[:1]).look
        tail = stretches.clear(look, self.spiral.b_m, places, _FINEST_M[1], self.tolerance_m)
        return replace(certificate, head=(*certificate.head, *tail.stretches))

    def _gap(self, pair: tuple[int, int], theta: float) -> float:
        return float(gaps(self._benches(theta)[1], *(np.array([bench]) for bench in pair))[0])

    def _touch(self, pair: tuple[int, int], clear_end: float, other_end: float) -> float:
        """Return where the gap of a pair vanishes in a bracket."""
        if clear_end == other_end or self._gap(pair, other_end) > 0:
            return other_end
        return illinois(lambda theta: self._gap(pair, theta), clear_end, other_end, self._gap(pair, clear_end),
                        self._gap(pair, other_end))

    def _approach(self, pair: tuple[int, int], theta: float) -> float:
        """Return how fast the gap closes at a place, in m/s."""
        step = 1e-6 * (1 if self.scene.steady_m_s >= 0 else -1)
        slope = (self._gap(pair, theta + step) - self._gap(pair, theta - step)) / (2 * step)
        return float(slope * abs(self.scene.steady_m_s) / (self.spiral.b_m * np.hypot(1.0, theta)) * np.sign(step))

    def _time(self, theta: float) -> float:
        return float(self.spiral.distance_to(theta) / self.scene.steady_m_s)
