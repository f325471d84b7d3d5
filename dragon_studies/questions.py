"""The questions that a study can ask about a scene, each with its options, answer columns and computation.

Answers include brackets if the search provides them; a column ``..._proved`` states whether they are proved
(docs/model.md). Rows of a batch share work: scenes with the same dragon and track share a compiled model, and the
smallest pitch of a dragon is searched for only once.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import dragon_ros as dr
from dragon_ros.cli.inputs import COORDINATE, PITCH, SPEED, FieldError, InputError, number

Tell = Callable[[int], object]
Values = dict[str, Any]
_NEAR_M = 1.0       # largest threshold for near misses
_SHARED = 64        # largest number of cached answers, which other rows of a batch can use


class Asked:
    """A scene, and the results that several questions need, so that the first contact is computed only once."""

    def __init__(self, scene: dr.Scene, tell: Tell) -> None:
        """Store the scene. ``tell(states)`` is called during the work, and may raise an exception to stop it."""
        self.scene, self.compiled, self.tell = scene, dr.compile(scene), tell

    @cached_property
    def contact(self) -> dr.Contact | dr.NoContact:
        """The first contact of the run."""
        return self.compiled.contact(progress=self.tell)


@dataclass(frozen=True)
class FirstContactQuestion:
    """The first contact of the run: its time, pair (benches, or bench and obstacle) and point; or the run's end."""

    columns: ClassVar[dict[str, type]] = {
        'contact': bool, 'contact_t_s': float, 'contact_low_s': float, 'contact_high_s': float, 'contact_inner': int,
        'contact_outer': int, 'contact_obstacle': str, 'contact_x_m': float, 'contact_y_m': float,
        'contact_approach_m_s': float, 'contact_grazing': bool, 'contact_proved': bool, 'run_end_s': float,
        'run_end': str}

    def answer(self, asked: Asked) -> Values:
        """Return the answer. The time bounds follow from the position error; the proof excludes earlier contacts."""
        found, proved = asked.contact, asked.contact.certificate.complete
        if isinstance(found, dr.NoContact):
            return {'contact': False, 'contact_proved': proved, 'run_end_s': found.end.t_s, 'run_end': found.end.reason}
        (x_m, y_m), obstacle = found.point_m, found.obstacle
        other: Values = {'contact_obstacle': obstacle.name} if obstacle else {'contact_outer': found.benches[1]}
        grazing = found.grazing_m is not None
        return {'contact': True, 'contact_t_s': found.t_s, 'contact_low_s': found.t_s - found.uncertainty_s,
                'contact_high_s': found.t_s + found.uncertainty_s, 'contact_inner': found.benches[0], **other,
                'contact_x_m': x_m, 'contact_y_m': y_m, 'contact_approach_m_s': found.approach_m_s,
                'contact_grazing': grazing, 'contact_proved': proved and not grazing}


@dataclass(frozen=True)
class NearMissesQuestion:
    """Near misses closer than ``below_m`` before the first contact: their number, and the closest one."""

    below_m: float = 0.01
    columns: ClassVar[dict[str, type]] = {
        'near_misses': int, 'near_miss_gap_m': float, 'near_miss_t_s': float, 'near_miss_inner': int,
        'near_miss_outer': int, 'near_miss_obstacle': str, 'near_miss_proved': bool}

    def __post_init__(self) -> None:
        """Reject an invalid threshold."""
        number('ask.near_misses.below_m', self.below_m, above=0.0, high=_NEAR_M)

    def answer(self, asked: Asked) -> Values:
        """Return the answer. Near misses are found by sampling and are not proved."""
        found = asked.compiled.near_misses(self.below_m, contact=asked.contact, progress=asked.tell)
        nearest = found.nearest[0] if found.nearest else None
        out = {'near_misses': found.count, 'near_miss_proved': False}
        if nearest is None:
            return out
        other: Values = ({'near_miss_outer': nearest.bench} if nearest.obstacle is None else
                         {'near_miss_obstacle': nearest.obstacle})
        return out | other | {'near_miss_gap_m': nearest.gap_m, 'near_miss_t_s': nearest.t_s,
                              'near_miss_inner': nearest.benches[0]}


@dataclass(frozen=True)
class ClearanceQuestion:
    """The smallest gap between benches, or to obstacles, at time ``at_s`` (by default, at the end of the run)."""

    at_s: float | None = None
    columns: ClassVar[dict[str, type]] = {
        'clearance_m': float, 'clearance_low_m': float, 'clearance_high_m': float, 'clearance_t_s': float,
        'clearance_inner': int, 'clearance_outer': int, 'clearance_obstacle': str, 'clearance_proved': bool}

    def __post_init__(self) -> None:
        """Reject an invalid time."""
        if self.at_s is not None:
            number('ask.clearance.at_s', self.at_s, low=0.0)

    def answer(self, asked: Asked) -> Values:
        """Return the answer, with bounds from the tested errors of handles. One or two benches have no gap."""
        found = asked.compiled.clearance(self.at_s)
        out: Values = {'clearance_t_s': found.t_s, 'clearance_proved': False}
        if found.gap_m is None or found.error_m is None or found.benches is None:
            return out
        other: Values = ({'clearance_outer': found.benches[1]} if found.obstacle is None else
                         {'clearance_obstacle': found.obstacle})
        return out | other | {'clearance_m': found.gap_m, 'clearance_low_m': found.gap_m - found.error_m,
                              'clearance_high_m': found.gap_m + found.error_m, 'clearance_inner': found.benches[0]}


@dataclass(frozen=True)
class MinPitchQuestion:
    """The smallest pitch at which the head reaches a circle without contact, starting at ``start_turns``.

    By default, ``start_turns`` is taken from the scene. A run at the result is proved to have no contact, as are runs
    at larger pitches one per cent apart; at the lower end of the bracket, benches overlap.
    """

    diameter_m: float = 9.0
    largest_m: float = 1.0
    within_m: float = 1e-6
    smallest_m: float | None = None
    start_turns: float | None = None
    columns: ClassVar[dict[str, type]] = {
        'min_pitch_m': float, 'min_pitch_low_m': float, 'min_pitch_high_m': float, 'min_pitch_inner': int,
        'min_pitch_outer': int, 'min_pitch_radius_m': float, 'min_pitch_proved': bool}

    def __post_init__(self) -> None:
        """Reject an invalid circle or bracket."""
        number('ask.min_pitch.diameter_m', self.diameter_m, above=0.0, high=2 * COORDINATE.high)
        if self.smallest_m is not None:
            number('ask.min_pitch.smallest_m', self.smallest_m, above=0.0)
        number('ask.min_pitch.largest_m', self.largest_m, above=self.smallest_m or 0.0, high=PITCH.high)
        number('ask.min_pitch.within_m', self.within_m, low=2e-11, high=1.0)
        if self.start_turns is not None:
            number('ask.min_pitch.start_turns', self.start_turns, above=0.0, high=1e4)

    def answer(self, asked: Asked) -> Values:
        """Return the answer. ``min_pitch_m`` is the upper, safe end of the bracket."""
        dragon = asked.scene.dragon
        if asked.scene.venue is not None:
            raise InputError('venue: min_pitch does not take obstacles into account; omit the venue or ask for contact')
        start_turns = asked.scene.spiral.start_turns if self.start_turns is None else self.start_turns
        try:
            found = _pitch_of(_Key(self, dragon, start_turns, asked.tell))
        except FieldError as error:
            known = error.fields
            name = f'ask.min_pitch.{known["field"]}' if hasattr(self, known['field']) else known['field']
            raise FieldError(name, known['value'], known['limit'], known['cure']) from None
        return {'min_pitch_m': found.high_m, 'min_pitch_low_m': found.low_m, 'min_pitch_high_m': found.high_m,
                'min_pitch_inner': found.benches[0], 'min_pitch_outer': found.benches[1],
                'min_pitch_radius_m': found.radius_m, 'min_pitch_proved': True}


class _Key:
    """The inputs of the search for the smallest pitch; ``tell`` only reports progress and is not compared."""

    def __init__(self, question: MinPitchQuestion, dragon: Any, start_turns: float, tell: Tell) -> None:
        self.values, self.tell = (question, dragon, start_turns), tell

    def __hash__(self) -> int:
        return hash(self.values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.values == self.values


@lru_cache(maxsize=_SHARED)
def _pitch_of(key: _Key) -> Any:
    """Return the smallest pitch; rows with the same key share the cached result."""
    question, dragon, start_turns = key.values
    return dr.design.min_pitch(dragon, diameter_m=question.diameter_m, start_turns=start_turns,
                               largest_m=question.largest_m, within_m=question.within_m,
                               smallest_m=question.smallest_m, progress=key.tell)


@dataclass(frozen=True)
class FitQuestion:
    """The smallest squares around the run, and whether a given square suffices; in a venue, also the smallest gap."""

    square_m: float | None = None
    columns: ClassVar[dict[str, type]] = {
        'fit_centred_low_m': float, 'fit_centred_high_m': float, 'fit_free_low_m': float, 'fit_free_high_m': float,
        'fits_centred': bool, 'fits_free': bool, 'fit_gap_low_m': float, 'fit_gap_high_m': float, 'fit_gap_t_s': float,
        'fit_gap_bench': int, 'fit_obstacle': str, 'fits_venue': bool, 'fit_proved': bool}

    def __post_init__(self) -> None:
        """Reject an invalid square."""
        if self.square_m is not None:
            number('ask.fit.square_m', self.square_m, above=0.0)

    def answer(self, asked: Asked) -> Values:
        """Return the answer. ``fits_...`` is empty if no square is given or the bounds do not decide the question."""
        found: Any = dr.design.fit(replace(asked.scene, venue=None), progress=asked.tell)
        out: Values = {'fit_proved': True}
        for name, (low_m, high_m) in (('centred', found.centred_m), ('free', found.free_m)):
            out |= {f'fit_{name}_low_m': low_m, f'fit_{name}_high_m': high_m,
                    f'fits_{name}': None if self.square_m is None else _fits(low_m, high_m, self.square_m)}
        return out if asked.scene.venue is None else out | self._in_venue(asked)

    @staticmethod
    def _in_venue(asked: Asked) -> Values:
        found: Any = dr.design.fit(asked.scene, progress=asked.tell)
        least = found.gaps[0]
        return {'fit_gap_low_m': min(one.low_m for one in found.gaps), 'fit_gap_high_m': least.high_m,
                'fit_gap_t_s': least.t_s, 'fit_gap_bench': least.bench, 'fit_obstacle': least.name,
                'fits_venue': found.fits}


def _fits(low_m: float, high_m: float, side_m: float) -> bool | None:
    return True if high_m <= side_m else False if low_m > side_m else None


@dataclass(frozen=True)
class MaxSpeedQuestion:
    """Bounds on the leader's largest speed at which no handle exceeds ``limit_m_s``, and the fastest handle."""

    limit_m_s: float = 2.0
    columns: ClassVar[dict[str, type]] = {
        'max_speed_m_s': float, 'max_speed_low_m_s': float, 'max_speed_high_m_s': float, 'max_speed_ratio': float,
        'max_speed_handle': int, 'max_speed_along_m': float, 'max_speed_proved': bool}

    def __post_init__(self) -> None:
        """Reject an invalid limit."""
        number('ask.max_speed.limit_m_s', self.limit_m_s, above=0.0, high=SPEED.high)

    def answer(self, asked: Asked) -> Values:
        """Return the answer. At the lower bound, no handle exceeds the limit; at the upper bound, one does."""
        found = dr.design.max_speed(asked.scene, progress=asked.tell)
        low, high = self.limit_m_s / found.bound, self.limit_m_s / found.ratio
        return {'max_speed_m_s': low, 'max_speed_low_m_s': low, 'max_speed_high_m_s': high,
                'max_speed_ratio': found.ratio, 'max_speed_handle': found.handle,
                'max_speed_along_m': found.along_m, 'max_speed_proved': True}


@dataclass(frozen=True)
class LockQuestion:
    """The time and the link of the lock that would end the run if the run had no stop time."""

    columns: ClassVar[dict[str, type]] = {'locks': bool, 'lock_t_s': float, 'lock_link': int, 'lock_proved': bool}

    def answer(self, asked: Asked) -> Values:
        """Return the answer. The lock is located to float precision; this is tested, not proved."""
        limit = asked.compiled.limit
        if limit is None or limit.reason != 'lock':
            return {'locks': False, 'lock_proved': False}
        return {'locks': True, 'lock_t_s': limit.t_s, 'lock_link': limit.link, 'lock_proved': False}


Question = (FirstContactQuestion | NearMissesQuestion | ClearanceQuestion | MinPitchQuestion | FitQuestion
            | MaxSpeedQuestion | LockQuestion)
QUESTIONS: dict[str, type[Question]] = {
    'contact': FirstContactQuestion, 'near_misses': NearMissesQuestion, 'clearance': ClearanceQuestion,
    'min_pitch': MinPitchQuestion, 'fit': FitQuestion, 'max_speed': MaxSpeedQuestion, 'lock': LockQuestion}
# For each question, the column that summaries and figures show by default.
MAIN = {'contact': 'contact_t_s', 'near_misses': 'near_miss_gap_m', 'clearance': 'clearance_m',
        'min_pitch': 'min_pitch_m', 'fit': 'fit_centred_high_m', 'max_speed': 'max_speed_m_s', 'lock': 'lock_t_s'}


def name_of(question: Question) -> str:
    """Return the name of a question in a study file."""
    return next(name for name, kind in QUESTIONS.items() if isinstance(question, kind))
