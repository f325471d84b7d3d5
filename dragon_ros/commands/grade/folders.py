"""Assign workbooks to teams, and grade all teams on all cores."""
import re
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from os import cpu_count, walk
from pathlib import Path
from threading import Event

from dragon_ros.cli.signals import interrupts_blocked
from dragon_ros.commands.grade.team import Team, TeamGrade, grade_team
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.limits import GRADED_BOOKS

_BOOKS = ('.xlsx', '.xlsm', '.xls', '.xlsb', '.xltx')
_ANSWERS = ('.yaml', '.yml')
_RESULT = re.compile(r'[\s_\-]*(?:result|结果|附件|res)[\s_\-]*0?[124](?!\d)[\s_\-]*', re.IGNORECASE)
_AT_ONCE_S = 0.2        # interval (s) between checks for a signal to stop
_ALONE = 2              # for at most this many teams, starting processes would take longer than grading


def teams_of(paths: list[Path]) -> list[Team]:
    """Return the teams in the given files and folders.

    The given files form one team. In a given folder, each subfolder with workbooks is a team; workbooks in one folder
    belong to several teams if their names differ in more than the number of the result. Raises InputError or
    MissingError.
    """
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise MissingError(f'{missing[0]}: it does not exist; give workbooks, or a folder with one subfolder per team')
    files = [path for path in paths if not path.is_dir()]
    teams = _split(_name_of(files), files) if files else []
    for path in paths:
        if path.is_dir():
            teams += list(_in_folder(path))
    if not teams:
        raise InputError(f'{paths[0]}: it contains no workbook (.xlsx); give result1.xlsx, result2.xlsx, '
                         f'result4.xlsx, or a folder with one subfolder per team')
    return teams


def _name_of(files: list[Path]) -> str:
    """Return a team's name: the common part of its files' names, or the name of their folder."""
    shared = _RESULT.sub('', files[0].stem)
    return shared or files[0].resolve().parent.name or 'team'


def _in_folder(root: Path) -> Iterator[Team]:
    """Yield the teams of a folder in the order of their names."""
    room = GRADED_BOOKS
    for folder, folders, names in walk(root):
        folders.sort()
        here = Path(folder)
        books = [here / name for name in sorted(names) if _is(name, _BOOKS)]
        room -= len(books)
        if room < 0:
            raise InputError(f'{root}: it contains more than {GRADED_BOOKS} workbooks; grade the folder in parts')
        answers = [here / name for name in sorted(names) if _is(name, _ANSWERS)]
        if books or answers:
            name = here.relative_to(root).as_posix()
            teams = _split(root.resolve().name if name == '.' else name, books)
            for team in teams:
                team.answers_file = answers[0] if answers and len(teams) == 1 else None
            yield from teams


def _is(name: str, kinds: tuple[str, ...]) -> bool:
    return name.lower().endswith(kinds) and not name.startswith(('~$', '.'))


def _split(name: str, books: list[Path]) -> list[Team]:
    """Return the teams in a folder: several teams if file names differ in more than the number of the result."""
    if not books:
        return [Team(name, [])]
    groups: dict[str, list[Path]] = {}
    for path in books:
        groups.setdefault(_RESULT.sub('', path.stem) if _RESULT.search(path.stem) else '', []).append(path)
    if len(groups) <= 1 or sum(len(group) > 1 for group in groups.values()) < 2:
        return [Team(name, books)]
    return [Team(key or name, group) for key, group in groups.items()]


def grade_all(teams: list[Team], stop: Event, done: Callable[[], object],
              ) -> tuple[list[TeamGrade], bool]:
    """Return the teams' grades in order, and whether they are complete; ``done()`` is called after each team.

    When a signal sets ``stop``, unfinished grades are abandoned, and finished grades are kept.
    """
    grades: dict[int, TeamGrade] = {}
    if len(teams) <= _ALONE:
        for n, team in enumerate(teams):
            if stop.is_set():
                break
            grades[n] = grade_team(team)
            done()
    else:
        _in_processes(teams, grades, stop, done)
    return [grades[n] for n in sorted(grades)], len(grades) == len(teams)


def _in_processes(teams: list[Team], grades: dict[int, TeamGrade], stop: Event, done: Callable[[], object]) -> None:
    """Grade teams on all cores; if a workbook crashes a process, retry each remaining team in its own process."""
    workers = min(len(teams), cpu_count() or 1)
    if _run(teams, list(range(len(teams))), workers, grades, stop, done):
        return
    for n in range(len(teams)):
        if n not in grades and not stop.is_set() and not _run(teams, [n], 1, grades, stop, done):
            grades[n] = TeamGrade(teams[n].name, tuple(path.name for path in teams[n].files), (), (), (),
                                  ('a workbook crashed the process that read it; save it again as .xlsx',))
            done()


def _run(teams: list[Team], numbers: list[int], workers: int, grades: dict[int, TeamGrade], stop: Event,
         done: Callable[[], object]) -> bool:
    """Grade teams in processes; return False if a process has died."""
    with ProcessPoolExecutor(workers, get_context('spawn')) as pool:
        with interrupts_blocked():      # the first jobs start the processes
            waiting: dict[Future[TeamGrade], int] = {pool.submit(grade_team, teams[n]): n for n in numbers}
        while waiting and not stop.is_set():
            for future in wait(waiting, _AT_ONCE_S, FIRST_COMPLETED).done:
                try:
                    grades[waiting[future]] = future.result()
                except BrokenProcessPool:
                    return False
                del waiting[future]
                done()
        pool.shutdown(wait=True, cancel_futures=True)
    return True
