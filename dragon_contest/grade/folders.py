"""Assign workbooks to teams, and grade all teams on all cores."""
import re
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from threading import Event

import dragon_ros as dr
from dragon_contest.grade.reading import CSV_SUFFIXES
from dragon_contest.grade.team import Problem, Team, TeamGrade, grade_team, named_result
from dragon_contest.limits import GRADED_BOOKS
from dragon_ros.cli.pool import Pool, WorkerKilledError, workers_of

_BOOKS = ('.xlsx', '.xlsm', '.xls', '.xlsb', '.xltx')
_ANSWERS = ('.yaml', '.yml')
_RESULT = re.compile(r'[\s_\-]*(?:result|结果|附件|res)[\s_\-]*0?[124](?!\d)[\s_\-]*', re.IGNORECASE)
_QUANTITY = re.compile(r'[\s_\-]*(?:positions?|speeds?|velocit(?:y|ies)|位置|坐标|速度)[\s_\-]*', re.IGNORECASE)
_MOST_FOLDERS = 100_000
_MOST_NAMES = 5         # largest number of names that say what a folder without results contains
_ALONE = 2              # for at most this many teams, starting processes would take longer than grading


def teams_of(paths: list[Path]) -> list[Team]:
    """Return the teams in the given files and folders.

    The given files form one team. In a given folder, each subfolder is a team, also one without results; files in one
    folder belong to several teams if their names differ in more than the number of the result. Raises InputError or
    dr.MissingError.
    """
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise dr.MissingError(f'{missing[0]}: it does not exist; give workbooks, or a folder with one subfolder per '
                              'team')
    files = [path for path in paths if not path.is_dir()]
    teams = _split(_key(files[0].stem) or files[0].resolve().parent.name or 'team', files) if files else []
    for path in paths:
        if path.is_dir():
            teams += _Walk(path).teams()
    if not teams:
        raise dr.InputError(f'{paths[0]}: it contains no workbook (.xlsx); give result1.xlsx, result2.xlsx, '
                         f'result4.xlsx, or a folder with one subfolder per team')
    return teams


def _key(stem: str) -> str:
    """Return a file's name without the number of the result and the quantity."""
    return _QUANTITY.sub('', _RESULT.sub('', stem))


class _Walk:
    """A walk through a folder of teams, which follows links to folders."""

    def __init__(self, root: Path) -> None:
        """Start at the given folder."""
        self._root, self._room, self._folders = root, GRADED_BOOKS, _MOST_FOLDERS

    def teams(self) -> list[Team]:
        """Return the teams in the order of their folders' names. Raises InputError if there are too many files."""
        return self._below(self._root, '', ())

    def _below(self, folder: Path, name: str, above: tuple[Path, ...]) -> list[Team]:
        """Return the teams in a folder; a team of a folder without any results says what the folder contains."""
        real = folder.resolve()
        self._folders -= 1
        if real in above or self._folders < 0:
            return []
        try:
            entries = sorted(one for one in folder.iterdir() if not one.name.startswith(('.', '~$', '__MACOSX')))
            inner = [one for one in entries if one.is_dir()]
        except OSError as error:
            return [Team(name, [], problems=(Problem('', 'folder_unreadable', {'said': error.strerror}),))]
        files = [one for one in entries if one not in inner]
        own = self._own(folder, name, files)
        below = [self._below(one, f'{name}/{one.name}' if name else one.name, (*above, real)) for one in inner]
        with_results = [teams for teams in below if any(_gives_results(team) for team in teams)]
        if len(with_results) > 1 or (not own and not name):     # a folder of teams
            return [*own, *(team for teams in below for team in teams)]
        if own or with_results:
            return [*own, *(team for teams in with_results for team in teams)]
        names = [one.name + '/' * one.is_dir() for one in entries]
        shown = ', '.join(names[:_MOST_NAMES]) + (', ...' if len(names) > _MOST_NAMES else '')
        problem = Problem('', 'found_instead', {'files': shown}) if names else Problem('', 'found_nothing', {})
        return [Team(name, [], problems=(problem,))] if name else []

    def _own(self, folder: Path, name: str, files: list[Path]) -> list[Team]:
        """Return the teams whose files are in a folder itself."""
        books = [one for one in files if _is(one, _BOOKS)]
        tables = [one for one in files if _is(one, CSV_SUFFIXES)]
        books += [one for one in tables if not books or named_result(one.stem)]
        self._room -= len(books)
        if self._room < 0:
            raise dr.InputError(f'{self._root}: it contains more than {GRADED_BOOKS} workbooks; grade the folder in '
                                'parts')
        answers = [one for one in files if _is(one, _ANSWERS) or one.name.lower() == 'answers.json']
        if not books and not answers:
            return []
        teams = _split(name or folder.resolve().name, books)
        for team in teams:
            team.answers_file = answers[0] if answers and len(teams) == 1 else None
        return teams


def _gives_results(team: Team) -> bool:
    return bool(team.files or team.answers_file)


def _is(path: Path, suffixes: tuple[str, ...]) -> bool:
    return path.name.lower().endswith(suffixes)


def _split(name: str, books: list[Path]) -> list[Team]:
    """Return the teams in a folder: several teams if file names differ in more than the number of the result."""
    groups: dict[str, list[Path]] = {}
    for path in books:
        groups.setdefault(_key(path.stem) if _RESULT.search(path.stem) else '', []).append(path)
    if len(groups) <= 1 or sum(len(group) > 1 for group in groups.values()) < 2:
        return [Team(name, books)]
    return [Team(key or name, group) for key, group in groups.items()]


def grade_all(teams: list[Team], stop: Event, done: Callable[[], object],
              ) -> tuple[list[TeamGrade], bool]:
    """Return the teams' grades in order, and whether they are complete; ``done()`` is called after each team.

    When a signal sets ``stop``, the remaining teams are not graded. If a workbook crashes a process, each remaining
    team is graded in a process of its own.
    """
    grades = list[TeamGrade]()
    try:
        with closing(Pool(1 if len(teams) <= _ALONE else _workers()).in_order(grade_team, teams)) as results:
            for grade in results:
                grades.append(grade)
                done()
                if stop.is_set():
                    break
    except WorkerKilledError:
        for team in teams[len(grades):]:
            if stop.is_set():
                break
            grades.append(_graded_apart(team))
            done()
    return grades, len(grades) == len(teams)


def _workers() -> int:
    """Return the number of processes; this process cannot survive a crash, so it grades no team."""
    return max(2, workers_of(None))


def _graded_apart(team: Team) -> TeamGrade:
    """Return the grade of a team whose workbooks may crash a process."""
    try:
        return next(Pool(_workers()).in_order(grade_team, [team]))
    except WorkerKilledError:
        return TeamGrade(team.name, tuple(path.name for path in team.files), (), (), (), (Problem('', 'crashed', {}),))
