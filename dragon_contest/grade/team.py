"""Grade one team: compare its workbooks and answers with the truth.

The grades are plain values that processes can exchange.
"""
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import dragon_ros as dr
from dragon_contest.grade.diagnosis import (
    RIGHT,
    Booleans,
    Diagnosis,
    Finding,
    answer_findings,
    diagnose_positions,
    diagnose_speeds,
)
from dragon_contest.grade.heat import Heat, heat_of
from dragon_contest.grade.layout import HANDLES, QUANTITIES, GivenResult, Note, given_by, joined
from dragon_contest.grade.reading import Refused, WorkbookSheet, read_book
from dragon_contest.grade.truth import RESULTS, TrueStates, contact_s, truth_at
from dragon_contest.grade.words import sentence, titled
from dragon_contest.mistakes import turning
from dragon_ros.cli.inputs import Document, Floats, number, plain_number, read_document

CLOSE = 1e-2        # largest error of a close table or answer, in its unit
BOUNDS = (1e-6, 1e-4, CLOSE)     # error bounds for which the share of cells is reported
QUESTIONS = ('t_s', 'pitch_m', 'turn_m', 'speed_m_s')
SHEETS = ('positions', 'speeds')
_TIMES = {'result1': 301, 'result2': 1, 'result4': 201}
_FIRST_S = {'result1': 0.0, 'result4': -100.0}
_MOST_RANGES = 8        # largest number of ranges of missing handles or times that are listed
_LEAST_DECIMALS, _ASKED_DECIMALS = 2, 6     # of a right answer, and those that the contest asks for
_NAMED = re.compile(r'(?:result|结果|附件|res)[\s_\-]*0?([124])(?!\d)', re.IGNORECASE)
_LATEST_4_S = 200.0             # last time (s) in result 4 if its times count from 0
UNREAD = {'not_understood': 'not_understood', 'contradictory': 'not_understood', 'no_result': 'not_understood',
           'template': 'missing'}       # notes about a sheet that gives nothing: verdict
_HALF_ULP = 0.5000001           # above 0.5, because differences between numbers with six decimals are not exact


@dataclass(frozen=True)
class SheetGrade:
    """The grade for one quantity in a result: its errors (m or m/s), and the mistakes that explain them.

    ``lacks`` says which cells are missing. ``worst`` and its place are None if nothing is given; ``within`` contains
    the share of cells within each of ``BOUNDS``.
    """

    result: str
    sheet: str
    cells: int
    expected: int
    worst: float | None
    handle: int | None
    t_s: float | None
    within: tuple[float, ...]
    findings: tuple[Finding, ...]
    explains: float | None
    heat: Heat | None
    unread: str = 'missing'
    reason: Finding | None = None
    lacks: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> str:
        """The verdict: ``right``, ``incomplete``, ``close``, ``wrong``, or ``unread`` if no value is given.

        A sheet is incomplete if it lacks cells and the others are right, and close if all errors are within ``CLOSE``,
        unless all speeds are 1 m/s. ``unread`` is ``missing``, ``not_understood`` or ``not_readable``, and ``reason``
        says why.
        """
        if self.worst is None:
            return self.unread
        if self.worst <= RIGHT:
            return 'right' if self.cells == self.expected else 'incomplete'
        constant = any(one.key == 'all_one' for one in self.findings)
        return 'close' if self.worst <= CLOSE and not constant else 'wrong'


@dataclass(frozen=True)
class AnswerGrade:
    """The grade of a single-number answer to questions 2 to 5."""

    question: str
    given: float
    truth: float
    verdict: str
    findings: tuple[Finding, ...]

    @property
    def error(self) -> float:
        """The given answer minus the right answer."""
        return self.given - self.truth


class Problem(NamedTuple):
    """Input that was not graded: its path, the key of the reason in ``words``, and the parameters of its sentence."""

    path: str
    key: str
    parameters: dict[str, object]

    def line(self, lang: str = 'en') -> str:
        """Return the problem as text."""
        said = sentence(self.key, self.parameters, lang)
        return titled(self.path, said, lang) if self.path else said


@dataclass(frozen=True)
class TeamGrade:
    """A team's grades; ``notes`` contains keys of ``words`` with parameters."""

    name: str
    files: tuple[str, ...]
    sheets: tuple[SheetGrade, ...]
    answers: tuple[AnswerGrade, ...]
    notes: tuple[Note, ...] = ()
    problems: tuple[Problem, ...] = ()


@dataclass
class Team:
    """A team to grade: its name, its files, its single-number answers by question, and what cannot be graded."""

    name: str
    files: list[Path]
    answers: dict[str, float] = field(default_factory=dict)
    answers_file: Path | None = None
    problems: tuple[Problem, ...] = ()


class _Claim(NamedTuple):
    """A table that may be a result: by the name of its file, by its content, or by both."""

    result: str
    named: str | None
    table: GivenResult
    path: Path

    @property
    def by_both(self) -> bool:
        return self.named == self.result


class _Taken(NamedTuple):
    """What a team's files contain: tables, notes, and why the results that files are named after were not read."""

    claims: list[_Claim]
    notes: list[Note]
    problems: list[Problem]
    unread: dict[str, tuple[str, Finding]]      # result: verdict and reason


def grade_team(team: Team) -> TeamGrade:
    """Return the grade of a team; ``problems`` contains one entry per input that cannot be read."""
    taken = _Taken([], [], list(team.problems), {})
    for path in team.files:
        _take(path, taken)
    answers = dict(team.answers)
    if team.answers_file is not None:
        try:
            answers = {**answers_of(team.answers_file), **answers}
        except dr.InputError as error:
            taken.problems.append(Problem('', 'as_said', {'said': ' '.join(str(error).split())}))
    given = _settled(taken)
    sheets: list[SheetGrade] = []
    for result in RESULTS:
        grades = grades_of(result, given[result]) if result in given else []
        verdict, reason = taken.unread.get(result, ('missing', None))
        if reason is not None:
            grades = [replace(one, unread=verdict, reason=reason) for one in grades or _nothing(result)]
        sheets += grades
    graded = [answer_grade(question, answers[question]) for question in QUESTIONS if question in answers]
    return TeamGrade(team.name, tuple(path.name for path in team.files), tuple(sheets), tuple(graded),
                     tuple(taken.notes), tuple(taken.problems))


def _nothing(result: str) -> list[SheetGrade]:
    """Return the grades of a result of which nothing is given."""
    nan = np.full((1, HANDLES, 3), np.nan)
    times_s = np.zeros(1)
    return [_grade(result, sheet, times_s, nan[..., some], nan[..., some], None)
            for sheet, some in (('positions', slice(0, 2)), ('speeds', slice(2, 3)))]


def _take(path: Path, taken: _Taken) -> None:
    """Add the contents of a file. A sheet may be named after another result than its file."""
    of_file = named_result(path.stem)

    def refuse(key: str, parameters: dict[str, object]) -> Refused:
        return Refused(path, key, **parameters)
    try:
        sheets: dict[str | None, list[WorkbookSheet]] = {}
        for sheet in read_book(path):
            sheets.setdefault(named_result(sheet.name) or of_file, []).append(sheet)
        for named, group in sheets.items():
            _claim(path, named, given_by(group, refuse), taken, alone=len(sheets) == 1)
    except Refused as error:
        taken.problems.append(Problem(str(path), error.key, error.parameters))
        if of_file:
            taken.unread.setdefault(of_file, ('not_readable', Finding(error.key, error.parameters)))
    except dr.InputError as error:
        taken.problems.append(Problem('', 'as_said', {'said': ' '.join(str(error).split())}))
    except MemoryError:
        taken.problems.append(Problem(str(path), 'memory', {}))


def named_result(name: str) -> str | None:
    """Return the result that a file or sheet is named after."""
    found = _NAMED.search(name)
    return f'result{found[1]}' if found else None


def _claim(path: Path, named: str | None, found: GivenResult, taken: _Taken, alone: bool) -> None:
    """Add the results in the sheets with one name, or why there are none."""
    said = [note for note in found.notes if note[0] in UNREAD]
    if found.times_s.size:
        taken.notes.extend(found.notes)
    else:
        said = said or ([('no_result', {})] if alone or named else [])
        taken.notes.extend(note for note in found.notes if note not in said)
        taken.problems.extend(Problem(str(path), *note) for note in said)
    if named and said:
        taken.unread.setdefault(named, (UNREAD[said[0][0]], Finding(*said[0])))
    for held, part in _by_result(found, named):
        if named and held == 'result2' and held != named:
            taken.unread.setdefault(named, ('not_understood', Finding('untimed', {'named': path.name})))
            continue
        taken.claims.append(_Claim(held, named, part, path))


def _settled(taken: _Taken) -> dict[str, GivenResult]:
    """Return each result; a claim by name and content wins over one by content, and earlier files win over later ones.

    Files that give different quantities of one result are combined.
    """
    given: dict[str, GivenResult] = {}
    sure: set[str] = set()
    for claim in sorted(taken.claims, key=lambda one: not one.by_both):
        other = given.get(claim.result)
        if other is None:
            given[claim.result] = claim.table
            if claim.by_both:
                sure.add(claim.result)
            elif claim.named:
                taken.notes.append(('other_result', {'named': claim.path.name, 'held': claim.result}))
        elif claim.result in sure and not claim.by_both:
            taken.notes.append(('misnamed', {'name': claim.path.name, 'held': claim.result}))
        elif any(other.has(quantity) and claim.table.has(quantity) for quantity in QUANTITIES):
            taken.notes.append(('given_twice', {'result': claim.result, 'name': claim.path.name}))
        else:
            given[claim.result] = joined([(one.times_s, one.cells) for one in (other, claim.table)], [])
    return given


def _by_result(found: GivenResult, named: str | None) -> list[tuple[str, GivenResult]]:
    """Return tables by result, according to their times; cells without a time belong to the contact.

    The name decides if the times do not.
    """
    untimed = np.isnan(found.times_s)
    out = [('result2', GivenResult(found.times_s[untimed], found.cells[untimed]))] if untimed.any() else []
    timed = GivenResult(found.times_s[~untimed], found.cells[~untimed])
    if timed.times_s.size == 1 and named == 'result2':
        return [('result2', GivenResult(np.array([np.nan]), timed.cells))]
    if timed.times_s.size:
        before, late = timed.times_s.min() < 0, timed.times_s.max() > _LATEST_4_S
        kind = 'result4' if before or (named == 'result4' and not late) else 'result1'
        out.append((kind, timed))
    return out


def grades_of(result: str, given: GivenResult) -> list[SheetGrade]:
    """Return the grades for a result's positions and speeds."""
    times_s = np.full(given.times_s.size, contact_s()) if result == 'result2' else given.times_s
    truth = truth_at(result, times_s)
    known = np.isfinite(truth.speed_m_s).all(axis=1)        # the dragon has no state at the other times
    times_s, truth, cells = times_s[known], TrueStates(*(one[known] for one in truth)), given.cells[known]
    given = GivenResult(times_s, cells)
    places, speeds = cells[..., :2], cells[..., 2]
    with _any_numbers():
        positions = _fitted(partial(diagnose_positions, result, times_s, places, truth)) if (
            given.has('x') or given.has('y')) else None
        moving = _fitted(partial(diagnose_speeds, result, times_s, speeds, truth, positions or Diagnosis())) if (
            given.has('v')) else None
    out = [_grade(result, 'positions', times_s, places, truth.handles_m, positions)]
    out.append(_grade(result, 'speeds', times_s, speeds[..., None], truth.speed_m_s[..., None], moving))
    return out


def _fitted(diagnose: Callable[[], Diagnosis]) -> Diagnosis:
    """Return a diagnosis; if a fit fails, the cause is unknown: no table of numbers ends a grading."""
    try:
        return diagnose()
    except (dr.DragonError, ArithmeticError, IndexError, ValueError):
        return Diagnosis([Finding('unknown', {})], 0.0)


@contextmanager
def _any_numbers() -> Iterator[None]:
    """Let quotients and medians of given numbers be infinite or nan, which no mistake explains, without a warning."""
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'), warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)
        yield


def _grade(result: str, sheet: str, times_s: Floats, given: Floats, right: Floats, why: Diagnosis | None) -> SheetGrade:
    expected = max(_TIMES[result], times_s.size if result != 'result2' else 1) * HANDLES * given.shape[-1]
    error = np.abs(given - right)
    there = np.isfinite(error)
    if why is None or not there.any():
        return SheetGrade(result, sheet, 0, expected, None, None, None, tuple(0.0 for _ in BOUNDS), (), None, None)
    row, handle, _ = np.unravel_index(int(np.nanargmax(error)), error.shape)
    within = tuple(float(np.mean(error[there] <= bound * (1 + 1e-9))) for bound in BOUNDS)
    return SheetGrade(result, sheet, int(there.sum()), expected, float(np.nanmax(error)), int(handle),
                      float(times_s[row]), within, tuple(why.findings), why.explains,
                      heat_of(times_s, given, right),
                      lacks=tuple(_lacking(result, times_s, np.asarray(there.all(axis=-1)))))


def _lacking(result: str, times_s: Floats, there: Booleans) -> list[Finding]:
    """Return which handles and times a sheet lacks: handles at all times, times of all handles, and single cells."""
    handles, times = np.array(~there.any(axis=0)), np.array(~there.any(axis=1))
    out = []
    if handles.any():
        out.append(Finding('lacks_handles', {'handles': ranges(np.flatnonzero(handles).tolist())}))
    if result != 'result2':
        wanted = np.arange(_TIMES[result], dtype=np.float64) + _FIRST_S[result]
        absent = sorted({*np.setdiff1d(wanted, times_s[~times]).tolist()} if times_s[~times].size else wanted.tolist())
        if absent:
            out.append(Finding('lacks_times', {'times': ranges(absent)}))
    single = ~there & ~handles & ~times[:, None]
    if single.any():
        row, handle = np.argwhere(single)[0].tolist()
        out.append(Finding('lacks_cells', {'count': int(single.sum()), 'handle': handle, 't': float(times_s[row])}))
    return out


def ranges(numbers: Sequence[float]) -> str:
    """Return whole numbers as text with ranges, such as ``0..5, 9``; a long list is cut after some ranges."""
    out: list[list[float]] = []
    for number_ in numbers:
        if out and number_ == out[-1][1] + 1:
            out[-1][1] = number_
        else:
            out.append([number_, number_])
    text = [f'{first:g}' if first == last else f'{first:g}..{last:g}' for first, last in out]
    return ', '.join([*text[:_MOST_RANGES], *(['...'] if len(text) > _MOST_RANGES else [])])


# Answers that are a single number.
def answers_of(path: Path) -> dict[str, float]:
    """Return the answers in a YAML or JSON file, by question.

    Raises an InputError that names the file, line and key.
    """
    document = read_document(path)
    return _answers_in(document, *_inner(document))


def answers_by_team(path: Path) -> dict[str, dict[str, float]]:
    """Return the answers of all teams in a YAML or JSON file, by team.

    Raises an InputError that names the file, line and key.
    """
    document = read_document(path)
    return {str(name): _answers_in(document, document.section(name), f'{name}.') for name in document.values}


def teams_in(path: Path) -> list[Team]:
    """Return the teams in a YAML or JSON file, with their answers; a file of one team need not name it.

    Raises an InputError that names the file, line and key.
    """
    document = read_document(path)
    values, prefix = _inner(document)
    if not values:
        raise dr.InputError(f'{path}: it contains no answers; give at least one of {", ".join(QUESTIONS)}')
    if prefix or not all(isinstance(value, Mapping) and 'value' not in value for value in values.values()):
        return [Team('answers', [], answers_of(path))]
    return [Team(name, [], answers) for name, answers in answers_by_team(path).items()]


def _inner(document: Document) -> tuple[Mapping[str, object], str]:
    """Return the answers of one team with the prefix of their keys; in ``docs/answers.json``, they are a section."""
    inner = document.values.get('answers')
    return (inner, 'answers.') if isinstance(inner, dict) and inner.keys() & {*QUESTIONS} else (document.values, '')


def _answers_in(document: Document, values: Mapping[str, object], prefix: str) -> dict[str, float]:
    """Return the answers in a mapping, whose values are numbers or mappings with a ``value``."""
    document.check_keys(prefix, values, QUESTIONS)
    plain = {key: value.get('value') if isinstance(value, dict) else value for key, value in values.items()}
    return {key: number(f'{document.place(prefix + key)}: {key}', plain_number(value), above=0.0, high=1e6)
            for key, value in plain.items()}


def answer_grade(question: str, given: float) -> AnswerGrade:
    """Return the grade of an answer, which is right if it has at least two decimals and all of them are right."""
    truth = truth_of(question)
    decimals = len(repr(given).partition('.')[2].rstrip('0')) if 'e' not in repr(given) else 9
    error = abs(given - truth)
    allowed = max(1e-6, _HALF_ULP * 10.0 ** -decimals) if decimals >= _LEAST_DECIMALS else 1e-6
    verdict = 'right' if error <= allowed else 'close' if error <= CLOSE else 'wrong'
    if verdict == 'right':
        findings = [Finding('right_to', {'digits': decimals})] if decimals < _ASKED_DECIMALS else []
    else:
        findings = answer_findings(question, given) or [Finding('unknown', {})]
    return AnswerGrade(question, given, truth, verdict, tuple(findings))


@cache
def truth_of(question: str) -> float:
    """Return the right answer to a question whose answer is a single number."""
    if question == 't_s':
        return contact_s()
    if question == 'pitch_m':
        return dr.design.min_pitch().high_m
    if question == 'turn_m':
        track = turning().track
        assert isinstance(track, dr.STurn)
        return track.length_m
    return dr.design.max_speed(turning()).leader_m_s(2.0)[0]
