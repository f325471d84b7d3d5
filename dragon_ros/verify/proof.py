"""The proof of a certificate, and the one sentence that it proves."""
from dataclasses import dataclass
from fractions import Fraction
from math import ulp

from flint import arb

from dragon_ros.verify.balls import above, below, exact, precise, size
from dragon_ros.verify.cover import Budget, Cover, Progress, Way, ways
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.posture import Dragon, Posture, gap, overlap
from dragon_ros.verify.ranges import Range, ranges
from dragon_ros.verify.reading import Claims, Contact, Row, Scene
from dragon_ros.verify.run import Leader, run_of
from dragon_ros.verify.track import Track, track_of

_SLACK = 1e-9               # of a metre of the leader's way, or of the longest bench if that is shorter
_WIDEST = 1e-6              # likewise: no slack is wider, however slowly benches come together
_GRAZING = 1e-7             # likewise, before a grazing; and as near as benches come there
_PROMISE = 2e-12            # what solvers' positions may err, for coordinates up to 20 m and in proportion beyond
_PROMISED_M = 20.0          # ... which is what the head's start is held against
_OVERHANG_M = 1e-6          # an interval may reach so far beyond what the run goes through


_STEPS, _STEPS_EACH = 150_000, 300     # links and pairs: about ten seconds, and more for each interval of a certificate
_MOST_STEPS = 2_000_000


@dataclass(frozen=True)
class Proved:
    """What is proved, in a sentence, and in how many intervals."""

    sentence: str
    intervals: int
    steps: int


def prove(claims: Claims, effort: float, progress: Progress) -> Proved:
    """Return what a certificate proves. Raises Refused where it does not hold, or not within the effort."""
    return _Proof(claims, effort, progress).proved()


class _Proof:
    def __init__(self, claims: Claims, effort: float, progress: Progress) -> None:
        self._claims, scene = claims, claims.scene
        precise(_ratio(scene))
        self._track, self._dragon, self._scene = track_of(scene), Dragon(scene), scene
        self._bend = None if self._track.to_centre else _bend(self._track, self._dragon)
        self._unit = min(1.0, self._dragon.longest_m)
        self._leader = Leader(self._track, self._dragon, scene.tail_leads)
        self._budget = Budget(int(effort * min(_STEPS + _STEPS_EACH * len(claims.rows), _MOST_STEPS)))
        start = self._track.point(self._track.place_at(self._track.start))
        self._coarse = max(1.0, (abs(complex(start)) + self._dragon.longest_m) / _PROMISED_M)
        self._cover = Cover(self._track, self._dragon, self._bend, self._budget, progress)

    def proved(self) -> Proved:
        """Return the sentence."""
        contact = self._claims.contact
        said = self._none() if contact is None else self._contact(contact)
        return Proved(said, self._budget.intervals, self._budget.spent)

    def _none(self) -> str:
        run = run_of(self._scene.law, self._leader, self._scene, None, _SLACK * self._unit)
        self._clear(run.whole, run.part)
        less = f', less {_metres(run.slack_m)} of the leader\'s way' if run.slack_m else ''
        return (f'no two benches touch from {self._scene.start_s!r} s to the end of the run at {run.end_s:.12g} s '
                f'({run.why}){less}')

    def _contact(self, contact: Contact) -> str:
        scene, t_s = self._scene, contact.t_s
        if scene.stop_s is not None and t_s > scene.stop_s:
            raise Refused(f'contact.t_s: {t_s!r} s is after the run stops, at {scene.stop_s!r} s')
        run = run_of(scene.law, self._leader, scene, t_s, _SLACK * self._unit)
        if run.end_s < t_s:
            raise Refused(f'contact.t_s: {t_s!r} s is after the end of the run, at {run.end_s:.12g} s: {run.why}')
        gone = exact(scene.law.gone_m(Fraction(t_s)))
        slack_m = _GRAZING * self._unit if contact.grazing else self._slack_m(contact, gone)
        slack = exact(slack_m)
        senses = [sense for sense, end in ((1, run.part[1]), (-1, run.part[0])) if not abs(end - gone) > slack]
        at_start = not abs(exact(scene.law.gone_m(Fraction(scene.start_s))) - gone) > slack
        since = scene.law.rests_at(Fraction(t_s))
        if since is not None and max(since, Fraction(scene.start_s)) < Fraction(t_s):
            raise Refused(f'contact.t_s: the leader has rested at that place since {float(since)!r} s')
        if not senses:
            raise Refused(f'contact.t_s: the leader has been beyond its place at {t_s!r} s before')
        sense = self._touching(contact, gone, slack, senses)
        low, high = run.part
        part = (low, high.min(gone - slack)) if sense > 0 else (low.max(gone + slack), high)
        who = f'benches {contact.benches[0]} and {contact.benches[1]}'
        after = (f'{who} come within {_metres(_GRAZING * self._unit)} of each other there, so that nobody need say if they '
                 'touch') if contact.grazing else f'{who} overlap {_metres(slack_m)} after it'
        if at_start and not part[0] < part[1]:
            self._clear(run.whole, None)
            return f'the run starts with its contact, at {t_s!r} s: {after}'
        self._clear(run.whole, part)
        return (f'no two benches touch from {scene.start_s!r} s to the contact at {t_s!r} s, less {_metres(slack_m)} of '
                f'the leader\'s way, and {after}')

    def _slack_m(self, contact: Contact, gone: arb) -> float:
        """Return how near to a contact it is shown that there is none before: as near as a solver's floats can tell.

        That is a nanometre, unless benches come together so slowly, or so far out, that positions in floats do not say
        where they do; or the leader is so fast that the contact's time does not.
        """
        step = 1e3 * _SLACK * self._unit
        gaps = []
        for sense in (-1, 1):
            try:
                one, two = self._poses(contact, gone + exact(sense * step))
            except Refused:
                continue
            gaps.append(float(gap(one, two)))
        slope = abs(gaps[0] - gaps[-1]) / (2 * step)
        promise_m = _PROMISE * self._coarse
        speed = abs(float(self._scene.law.speed_m_s(Fraction(contact.t_s))))
        slack_m = max(_SLACK * self._unit, 4 * promise_m / slope if slope else 0.0, 4 * ulp(contact.t_s) * speed)
        return min(slack_m, _WIDEST * self._unit * self._coarse)

    def _poses(self, contact: Contact, gone: arb):  # type: ignore[no-untyped-def]
        first, second = contact.benches
        posture = Posture(self._track, self._dragon, 0, self._track.place_at(self._leader.head(gone)))
        return posture.pose(first), posture.pose(second)

    def _touching(self, contact: Contact, gone: arb, slack: arb, senses: list[int]) -> int:
        """Return the sense in which the leader goes into the contact: the named benches are proved to overlap there."""
        if contact.grazing:
            one, two = self._poses(contact, gone)
            if size(gap(one, two)) > _GRAZING * self._unit:
                raise Refused(f'contact: benches {contact.benches[0]} and {contact.benches[1]} are {float(gap(one, two)):.3g} m '
                              'apart there, which is no grazing')
            return senses[0]
        for sense in senses:
            one, two = self._poses(contact, gone + slack * sense)
            if overlap(one, two):
                return sense
        away = float(gap(*self._poses(contact, gone + slack * senses[0])))
        raise Refused(f'contact: benches {contact.benches[0]} and {contact.benches[1]} do not overlap {float(slack):.3g} m '
                      f'of the leader\'s way after {contact.t_s!r} s: they are {away:.3g} m apart')

    def _clear(self, whole: Range, part: Range | None) -> None:
        """Prove that the chain stands on all of the leader's way, and that no two benches touch on a part of it."""
        self._places(whole)
        places = [] if part is None else self._places(part)
        every = ways(self._dragon, places) if places else []
        hints = self._hints(every, places[0] if places else None)
        self._cover.clear(every, hints)

    def _places(self, gone: Range) -> list[Range]:
        """Return where all front handles are while the leader has gone between two distances."""
        ends = [self._leader.head(end) for end in gone]
        low, high = ends if not self._scene.tail_leads else ends[::-1]
        self._budget.spend(2 * len(self._dragon.benches))
        return ranges(self._track, self._dragon, low.lower(), high.upper())

    def _hints(self, every: list[Way], head: Range | None) -> dict[int, list[float]]:
        """Return where intervals say to cut, by the first bench of each set.

        Refuses those of places that no bench they speak of goes through: nobody would check what they say.
        """
        count, overhang_m = len(self._dragon.benches), _OVERHANG_M * self._coarse
        known = {bench: (way.lead, way.parts) for way in every for bench, _ in way.members}
        out: dict[int, list[float]] = {}
        for number, row in enumerate(self._claims.rows):
            lead, parts = known.get(row.lead or 0, (0, [head] if head else []))
            low, high = sorted((row.start_m, row.stop_m))
            if not parts:
                raise Refused(f'intervals[{number}]: there is nothing to clear in a run that starts with its contact')
            least, most = below(parts[0][0]), above(parts[-1][1])
            if low < least - overhang_m or high > most + overhang_m:
                raise Refused(f'intervals[{number}]: it reaches from {low!r} to {high!r} m, and what it speaks of goes from '
                              f'{least:.12g} to {most:.12g} m')
            if row.behind > count - 1 - (row.lead or 0):
                raise Refused(f'intervals[{number}].behind: there are no more than {count - 1 - (row.lead or 0)} '
                              'benches behind')
            out.setdefault(lead, []).extend((row.start_m, row.stop_m))
        return out


def _ratio(scene: Scene) -> float:
    """Return about how many links long, or far out, the track is."""
    kind = scene.track
    turns = getattr(kind, 'start_turns', 1.0)
    return max(turns, 1.0) + abs(getattr(kind, 'start_m', 0.0)) / max(scene.lengths_m)


def _bend(track: Track, dragon: Dragon) -> float:
    """Return the largest curvature, with which no link may lock. Raises Refused where one may."""
    longest = max(dragon.benches, key=lambda bench: bench.link.near).link
    if not exact(track.bend) * longest.length < 2:
        raise Refused('scene.track: it bends so tightly that links could lock on it')
    return track.bend


def _metres(value: float) -> str:
    return f'{value * 1e9:.3g} nm'


