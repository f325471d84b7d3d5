"""The first contact of a run: this one exactly, and a certificate that none came before.

Benches follow each other on one track at one spacing, so whether bench i >= 1 meets a bench behind it depends only on
where bench i is: the body's whole stretch of track is cleared once, and the head's pairs along the head's way. Where
the body's track does not clear, each bench's part of it is, up to the first place that one of them touches at. Where
lengths are mixed, that holds for benches behind which the dragon goes on alike; each such set has stretches of its own.
"""
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import floor

import numpy as np

from dragon_ros.core.chain.first_passage import Course, course_of
from dragon_ros.core.contact.broad_phase import candidates
from dragon_ros.core.contact.certificate import Certificate, Contact, NoContact, together
from dragon_ros.core.contact.conservative_advancement import Follower
from dragon_ros.core.contact.interval_clearing import Stretch
from dragon_ros.core.contact.signed_distance import gaps, witness
from dragon_ros.core.contact.way import Way
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.tracks.spec import Spiral

_BEFORE_M = 1e-9        # of the head's way, before a contact: so far the certificate goes


def first_contact(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> Contact | NoContact:
    """Return the first contact of the scene's run, at the exact tier, or how the run ended without one.

    ``progress(states)`` is called with every number of states just looked at. Raises FieldError where the way is so
    long that the search would not end.
    """
    course = course_of(scene)
    searches = {sense: _search(scene, course, sense, progress) for sense in course.senses or [1]}
    hits = {sense: hit for sense, search in searches.items() if (hit := search.first())}
    if not hits:
        proof = together([search.certificate() for search in searches.values()])
        return NoContact(scene.end, sum(search.states for search in searches.values()), proof)
    sense = min(hits, key=lambda sense: hits[sense].t_s)
    hit, before = hits[sense], course.until(hits[sense].t_s)
    # What the leader has gone through the other way by then is proved apart.
    rest = [_search(scene, before, other, progress) for other in before.senses if other != sense]
    proof = together([hit.certificate, *(search.cleared() for search in rest)])
    return replace(hit, certificate=proof, states=sum(search.states for search in (*searches.values(), *rest)))


def _search(scene: Scene, course: Course, sense: int, progress: Callable[[int], object]) -> '_Search | Follower':
    """Return the search along one way from the start: on a single spiral by stretches, on a joined track by steps."""
    if isinstance(scene.track, Spiral):
        return _Search(Way(scene, course, sense, progress))
    return Follower(scene, course, sense, progress)


class _Search:
    """What is cleared of a way so far, and where the first place is that is not."""

    def __init__(self, way: Way) -> None:
        self.way, self.scene = way, way.scene
        self.start_gap_m = float(np.min(self._near(way.start)[1], initial=np.inf))
        self.head: list[Stretch] = []
        self.body: list[Stretch] = []
        self.hit: tuple[float, float] | None = None
        self.body_hit: tuple[float, float] | None = None

    @property
    def states(self) -> int:
        """How many chains were looked at."""
        return self.way.states

    def first(self) -> Contact | None:
        """Return the first contact on the way."""
        if self.start_gap_m <= 0:
            return self.contact((self.way.start, self.way.start))
        self._clear_all()
        return self.contact(self.hit) if self.hit else None

    def cleared(self) -> Certificate:
        """Return the certificate of the way, which has no contact."""
        self._clear_all()
        return replace(self.certificate(), complete=self.hit is None)

    def _clear_all(self) -> None:
        """Clear the way, or up to the first place that is not clear. Raises FieldError where no proof goes so far."""
        way = self.way
        if way.provable == way.stop or way.provable != way.start:
            self.clear(way.provable)
        if self.hit is None and way.provable != way.stop:
            last_s = way.time(way.provable)
            raise FieldError('run.stop_s', self.scene.run.stop_s, f'from {last_s:.6f} s on a long bench behind the '
                             'second may turn back near the centre, and contacts cannot be ruled out there',
                             f'stop at {floor(last_s * 1e6) / 1e6:.6f} s or before')

    def clear(self, stop: float) -> None:
        """Clear from the start to a place, or to the first place before it that is not clear."""
        head = self.way.clear_head(stop)
        self.hit = head.hit
        self.body, self.body_hit = self.way.clear_body(head.hit[1] if head.hit else stop)
        self.head, self.hit = head.stretches, self.body_hit or head.hit

    def certificate(self) -> Certificate:
        """Return what is cleared."""
        return Certificate(tuple(self.head), tuple(self.body), self.start_gap_m)

    def contact(self, bracket: tuple[float, float]) -> Contact:
        """Return the contact in a bracket of places (clear end, other end)."""
        way, scene = self.way, self.scene
        pairs, gap = self._near(bracket[1])
        touching = np.flatnonzero(gap <= 0) if np.min(gap) <= 0 else np.array([np.argmin(gap)])
        touching = touching[np.argsort(gap[touching], kind='stable')]
        found = sorted(((way.sign * self._touch(pair, *bracket), pair) for pair in pairs[touching].tolist()),
                       key=lambda row: row[0])
        theta, (i, j) = way.sign * found[0][0], found[0][1]
        slope, error = self._slope((i, j), theta), EXACT.promise_for_m(scene.size_m)
        times = [way.time(way.sign * x) for x, _ in found]
        speed = slope * way.speed_m_s(theta, times[0])
        unsure = error / speed if speed > 0 else float('inf')
        others = tuple((one, other) for t_s, (_, (one, other)) in zip(times[1:], found[1:], strict=True)
                       if t_s - times[0] <= unsure)
        least = float(np.min(gap))
        grazing = (least - way.tolerance_m, least + way.tolerance_m) if least > 0 else None
        proof = self._proof(bracket[0], bracket[0] if grazing else theta, slope)
        if self.hit and way.sign * self.hit[0] < way.sign * bracket[0]:
            return self.contact(self.hit)       # the proof found an earlier one
        return Contact(times[0], (i, j), witness(way.benches(theta), i, j), grazing, others, speed, unsure, way.states,
                       proof)

    def _proof(self, clear_end: float, theta: float, slope: float) -> Certificate:
        """Return the certificate up to a nanometre before a contact, or as near as its gap can be told from zero."""
        way = self.way
        back = max(_BEFORE_M, 4 * way.tolerance_m / slope if slope > 0 else np.inf) * way.metre(theta)
        end = way.sign * max(way.sign * clear_end, min(way.sign * theta - back, way.sign * theta))
        self.head = [one for one in self.head if way.sign * one.stop_rad <= way.sign * end]
        last = self.head[-1].stop_rad if self.head else way.start
        rest = way.clear_head(end, last) if last != end else None
        self.head += rest.stretches if rest else []
        if self.body_hit:
            self.body, self.body_hit = way.clear_body(end)
        else:
            self.body = way.trimmed(self.body, end)
        self.hit = self.body_hit or (rest.hit if rest else None)
        return Certificate(tuple(self.head), tuple(self.body), self.start_gap_m, self.hit is None)

    def _near(self, theta: float) -> tuple[Ints, Floats]:
        """Return the pairs (M, 2) that can touch at a place, and their gaps."""
        chain, benches = self.way.chain(theta), self.way.benches(theta)
        i, j = candidates(chain.p, benches)
        return np.stack((i, j), axis=1), gaps(benches, i, j)

    def _gap(self, pair: Sequence[int], theta: float) -> float:
        return float(gaps(self.way.benches(theta), *(np.array([bench]) for bench in pair))[0])

    def _touch(self, pair: Sequence[int], clear_end: float, other_end: float) -> float:
        """Return where the gap of a pair vanishes in a bracket."""
        if clear_end == other_end or self._gap(pair, other_end) > 0:
            return other_end
        return illinois(lambda theta: self._gap(pair, theta), clear_end, other_end, self._gap(pair, clear_end),
                        self._gap(pair, other_end))

    def _slope(self, pair: Sequence[int], theta: float) -> float:
        """Return how much the gap closes at a place for each metre of the head's way."""
        step = 1e-6 * self.way.sign
        slope = (self._gap(pair, theta - step) - self._gap(pair, theta + step)) / 2e-6
        return float(slope * self.way.metre(theta))
