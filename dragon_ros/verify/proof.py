"""Prove a certificate, and state in a sentence what is proved."""
from dataclasses import dataclass
from fractions import Fraction
from math import ulp

from flint import arb

from dragon_ros.verify.approach import Approach, approaches
from dragon_ros.verify.balls import exact, size
from dragon_ros.verify.cover import Budget, Cover, Progress, ways
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.posture import Dragon, Pose, Posture, gap, overlap
from dragon_ros.verify.ranges import Range, ranges
from dragon_ros.verify.reading import Claims, Contact, Venue
from dragon_ros.verify.run import Leader, Run, run_of
from dragon_ros.verify.segments import SpiralSegment
from dragon_ros.verify.track import Track, track_of
from dragon_ros.verify.venue import Edges, ObstacleCover, check_sides, ways_by_length

_PROMISE_M, _PER_METRE, _ALONG = 2e-12, 1e-13, 2.0**-49     # position error of a solver: at least, per metre from the
                                                            # origin, and per metre along the track
_SLACK_M, _PROMISES = 1e-9, 8           # slack in the leader's travel, or this many promises if that is more
_WIDEST, _NEAR = 1000, 100              # largest slack if benches meet slowly, and distance of a grazing, in slacks
_STEP = 1000                # step for the rate at which a gap closes, in slacks
_ERRORS = 2                 # errors of a corner in the stated uncertainty of a contact: those of two benches
_LAST_PLACES = 4            # rounding error of a contact's time, in ulps
_STEPS = 300_000            # links and pairs: fifteen to thirty seconds; 173,000 suffice for 390 of 391 random runs


@dataclass(frozen=True)
class Proved:
    """The sentence that is proved, and the numbers of intervals and steps in the proof."""

    sentence: str
    intervals: int
    steps: int


def prove(claims: Claims, effort: float, progress: Progress) -> Proved:
    """Return what a certificate proves. Raises Refused if the proof fails or exceeds its budget.

    ``progress(done_m, whole_m, advice)`` is called with the metres of track that are cleared, the metres in total,
    and advice if the budget is too small at the current rate.
    """
    budget = Budget(int(effort * _STEPS), effort)
    sentence = _Proof(claims, budget, progress).sentence()
    return Proved(sentence, budget.intervals, budget.spent)


class _Proof:
    """The scene of a certificate in balls, and the claims about the scene."""

    def __init__(self, claims: Claims, budget: Budget, progress: Progress) -> None:
        self._claims, scene = claims, claims.scene
        self._scene, self._budget = scene, budget
        self._track, self._dragon = track_of(scene), Dragon(scene)
        bend = None if self._track.to_centre else _bend(self._track, self._dragon)
        self._leader = Leader(self._track, self._dragon, scene.tail_leads, budget)
        self._cover = Cover(self._track, self._dragon, bend, budget, progress)
        self._obstacles = ObstacleCover(self._track, self._dragon, bend, budget, progress)
        self._obstacles.edges = Edges(scene.venue or Venue((), None), self._dragon.longest_m)
        self._met: list[Pose] = []
        start = complex(self._track.point(self._track.place_at(self._track.start)))
        self._promise_m = _promise_m(self._track, abs(start))

    def sentence(self) -> str:
        """Return the sentence that is proved."""
        contact = self._claims.contact
        return self._none() if contact is None else self._before(contact)

    def _none(self) -> str:
        """Prove that no benches touch during the run."""
        run = self._run(None)
        self._clear(run.whole, run.part)
        less = f', less {_metres(run.slack_m)} of leader travel' if run.slack_m else ''
        return (f'{self._clear_words} from {self._scene.start_s!r} s to the end of the run at {run.end_s:.12g} s '
                f'({run.why}){less}')

    def _before(self, contact: Contact) -> str:
        """Prove that no benches touch before a contact, and that the named benches touch at the time of the contact."""
        start_s, t_s = self._scene.start_s, contact.t_s
        gone, run = exact(self._scene.law.travel_m(Fraction(t_s))), self._run_to(t_s)
        poses = self._poses(contact, gone)
        self._promise_m = max(self._promise_m, *(
            _promise_m(self._track, abs(pose.near) + pose.shape.arm_m) for pose in poses))
        slack_m = Fraction(_NEAR * self._slack_m if contact.grazing else self._slack_at_m(contact, gone))
        ways = [way for way in approaches(self._scene.law, start_s, t_s) if way.was_beyond_m <= slack_m]
        if not ways:
            raise Refused(f'contact.t_s: before {t_s!r} s the leader has already been beyond its position at that time')
        way = ways[0]
        if contact.grazing:
            self._check_grazing(contact, poses, slack_m)
            touching = f'{_pair(contact)} come within {_metres(slack_m)} of each other there'
        else:
            way, touching = self._overlapping(contact, ways, slack_m)
        part = _up_to(run.part, way, slack_m)
        self._clear(run.whole, part)
        if part is None:
            return f'the run starts with its contact at {t_s!r} s: {touching}'
        takes = way.takes_s(start_s, slack_m)
        when = f' (travelled from {takes[0]!r} to {takes[1]!r} s)' if takes else ''
        return (f'{self._clear_words} from {start_s!r} s to the contact at {t_s!r} s, less {_metres(slack_m)} of '
                f'leader travel{when}, and {touching}')

    @property
    def _clear_words(self) -> str:
        """The part of the proved sentence that concerns all benches."""
        venue = self._scene.venue
        if venue is None:
            return 'no two benches touch'
        also = ' and '.join([*(['touches an obstacle'] if venue.obstacles else []),
                             *(['leaves the inside polygon'] if venue.inside else [])])
        return f'no two benches touch, and none {also.replace(" and ", " or ")},'

    def _run(self, until_s: float | None) -> Run:
        return run_of(self._scene.law, self._leader, self._scene, until_s, self._slack_m)

    def _run_to(self, t_s: float) -> Run:
        """Return the run up to a contact. Raises Refused if the run ends earlier."""
        stop_s = self._scene.stop_s
        if stop_s is not None and t_s > stop_s:
            raise Refused(f'contact.t_s: {t_s!r} s is after the run stops, at {stop_s!r} s')
        run = self._run(t_s)
        if run.end_s < t_s:
            raise Refused(f'contact.t_s: {t_s!r} s is after the end of the run at {run.end_s:.12g} s: {run.why}')
        return run

    @property
    def _slack_m(self) -> float:
        """One slack: the leader's travel before a contact, and at the end of the model, for which nothing is proved."""
        return max(_SLACK_M, _PROMISES * self._promise_m)

    def _slack_at_m(self, contact: Contact, gone: arb) -> float:
        """Return the slack at a contact.

        It is wider if the leader is so fast that the time of the contact does not determine its position that
        precisely, or if the benches approach so slowly that errors of their corners correspond to more travel.
        """
        step, gaps = _STEP * self._slack_m, []
        for sense in (-1, 1):
            try:
                gaps.append(float(gap(*self._poses(contact, gone + exact(sense * step)))))
            except Refused:     # beyond the end of the track or of the model
                continue
        slope = abs(gaps[0] - gaps[-1]) / (2 * step) if gaps else 0.0
        lever = max(bench.lever for bench in self._dragon.benches)
        slow_m = _ERRORS * lever * self._promise_m / slope if slope else 0.0
        speed = abs(float(self._scene.law.speed_m_s(Fraction(contact.t_s))))
        return min(max(self._slack_m, _LAST_PLACES * ulp(contact.t_s) * speed, slow_m), _WIDEST * self._slack_m)

    def _poses(self, contact: Contact, gone: arb) -> tuple[Pose, Pose]:
        """Return the two benches of a contact (or a bench and an edge) when the leader has travelled a distance.

        The chosen edge is the one nearest to the bench at the contact itself, for which this method is called first.
        """
        first, second = contact.benches[0], contact.benches[-1]
        self._budget.spend(second)
        posture = Posture(self._track, self._dragon, 0, self._track.place_at(self._leader.head(gone)))
        if contact.obstacle is None:
            return posture.pose(first), posture.pose(second)
        pose = posture.pose(first)
        self._met = self._met or self._obstacles.edges.met(pose, contact.obstacle)
        if not self._met:
            raise Refused(f'contact: {_pair(contact)} are far from each other at that time')
        return pose, self._met[0]

    @staticmethod
    def _check_grazing(contact: Contact, poses: tuple[Pose, Pose], near_m: Fraction) -> None:
        """Reject a grazing contact of benches that are not close to each other."""
        away = gap(*poses)
        if not size(away) < near_m:
            raise Refused(f'contact: {_pair(contact)} do not graze: they are {float(away):.3g} m apart')

    def _overlapping(self, contact: Contact, ways: list[Approach], slack_m: Fraction) -> tuple[Approach, str]:
        """Return the approach on which the benches of a contact provably overlap, and a phrase about the overlap."""
        for way in ways:
            after_m = way.after_m(slack_m)
            try:
                poses = self._poses(contact, exact(way.travel_m + after_m * way.sense))
            except Refused:     # the model ends before
                after_m = Fraction(0)
                poses = self._poses(contact, exact(way.travel_m))
            if overlap(*poses) or any(overlap(poses[0], edge) for edge in self._met):
                return way, f'{_pair(contact)} overlap {_metres(max(after_m, Fraction(0)))} after it'
        raise Refused(f'contact: {_metres(after_m)} of leader travel after {contact.t_s!r} s '
                      f'{_pair(contact)} do not overlap: they are {float(gap(*poses)):.3g} m apart')

    def _clear(self, whole: Range, part: Range | None) -> None:
        """Prove that the chain exists throughout the leader's travel, and that no benches touch on a part of it."""
        places = self._places(whole)
        if part is None:
            return
        if part != whole:
            places = self._places(part)
        self._cover.clear(ways(self._dragon, places))
        if self._scene.venue is not None:
            gone = exact(self._scene.law.travel_m(Fraction(self._scene.start_s)))
            head = Posture(self._track, self._dragon, 0, self._track.place_at(self._leader.head(gone)))
            self._obstacles.clear(ways_by_length(self._dragon, places))
            check_sides(self._scene.venue, head.pose(0))

    def _places(self, gone: Range) -> list[Range]:
        """Return the ranges of all front handles while the leader's distance is between two values."""
        ends = [self._leader.head(end) for end in gone]
        low, high = ends if not self._scene.tail_leads else ends[::-1]
        self._budget.spend(2 * len(self._dragon.benches))
        return ranges(self._track, self._dragon, low.lower(), high.upper())


def _up_to(part: Range, way: Approach, slack_m: Fraction) -> Range | None:
    """Return the range to clear up to a contact, which excludes the slack but includes all earlier positions."""
    if not way.sense:
        return None
    low, high = part
    if way.sense > 0:
        high = high.min(exact(way.travel_m - slack_m)).upper()
        high = high if way.earlier is None else high.max(exact(way.earlier[1])).upper()
    else:
        low = low.max(exact(way.travel_m + slack_m)).lower()
        low = low if way.earlier is None else low.min(exact(way.earlier[0])).lower()
    return (low, high) if low <= high else None


def _promise_m(track: Track, away_m: float) -> float:
    """Return the position error of a solver at a distance from the origin; on spirals, it grows with their length.

    Long runs on lines and arcs do not count, although a solver's promise grows with them: errors along the track move
    a contact's place by no more than themselves (0.1 nm was measured), whatever the rate of approach.
    """
    along = [abs(float(track.start))]
    for segment in track.segments:
        if isinstance(segment, SpiralSegment):
            b, ends = float(segment.b), [float(u) for u in (segment.first, segment.last) if u is not None]
            along += [0.5 * b * u * u for u in ends]
            if segment.first is None or segment.last is None:
                along.append((away_m + abs(complex(segment.centre)))**2 / (2 * b))
    return max(_PROMISE_M, _PER_METRE * away_m, _ALONG * max(along))


def _bend(track: Track, dragon: Dragon) -> float:
    """Return the largest curvature of the track. Raises Refused if a link may lock there."""
    longest = max((bench.link for bench in dragon.benches), key=lambda link: link.near)
    if not exact(track.bend) * longest.length < 2:
        raise Refused('scene.track: it bends so tightly that links could lock')
    return track.bend


def _pair(contact: Contact) -> str:
    if contact.obstacle is not None:
        return f'bench {contact.benches[0]} and {contact.obstacle!r}'
    return f'benches {contact.benches[0]} and {contact.benches[1]}'


def _metres(value: float | Fraction) -> str:
    return f'{float(value) * 1e9:.3g} nm'
