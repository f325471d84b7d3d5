"""``grade``: compare contest results and answers with the truth, and diagnose mistakes."""
import sys
from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.language import add_lang_option, language_of
from dragon_ros.cli.progress import Progress

if TYPE_CHECKING:       # imported lazily, so that --help does not load numpy
    from dragon_contest.grade.team import Team, TeamGrade

_ANSWERS = {'t_s': '--t', 'pitch_m': '--pitch', 'turn_m': '--turn', 'speed_m_s': '--speed'}


def main(argv: list[str]) -> int:
    """Grade teams; return the exit code (1 if a signal ended the command early)."""
    options = command_line.parser('grade', 'Grade result1, result2 and result4 of the contest (CUMCM 2024 A), and '
                                  'answers to questions 2 to 5; report errors, and the mistakes that explain them.',
                                  'grade result1.xlsx result2.xlsx --t 412.473838')
    options.add_argument('paths', nargs='*', type=Path, metavar='FILE|FOLDER',
                         help='workbooks of one team, or a folder with one subfolder per team')
    options.add_argument('--t', type=float, metavar='S', help='answer to question 2: the time of the first contact')
    options.add_argument('--pitch', type=float, metavar='M', help='answer to question 3: the smallest pitch')
    options.add_argument('--turn', type=float, metavar='M', help='answer to question 4: the length of the turn')
    options.add_argument('--speed', type=float, metavar='M/S', help='answer to question 5: the largest head speed')
    options.add_argument('--answers', type=Path, metavar='FILE', help='YAML or JSON file with the keys t_s, pitch_m, '
                         "turn_m and speed_m_s, or with these keys under each team's name")
    options.add_argument('--right-answers', action='store_true', help='write the right answers as JSON, with '
                         'uncertainties and the commands that compute them')
    add_lang_option(options, 'text and report')
    options.add_argument('--output', type=Path, metavar='FILE', help='file to write: .html is a page with pictures; '
                         '.json and .csv are tables')
    command_line.add_format_option(options, ('text', 'csv', 'json', 'html'))
    arguments = options.parse_args(argv)
    return command_line.guarded('grade', partial(_run, arguments))


def _run(arguments: Namespace) -> int:
    if arguments.right_answers:
        return _write_right_answers(arguments)
    form: str = arguments.format
    if form == 'html' and arguments.output is None:
        raise dr.InputError('--format html: this format can only be written to a file; give --output report.html')
    teams = _teams(arguments)
    from dragon_contest.grade.folders import grade_all
    from dragon_ros.cli.signals import stopped_by_signals
    with stopped_by_signals() as stop, Progress('grade', 'teams', len(teams)) as bar:
        grades, complete = grade_all(teams, stop, bar.update)
    content = _content(form, grades, len(teams), language_of(arguments.lang))
    mark = '\ufeff' if form == 'csv' and arguments.output is not None else ''       # without it, Excel assumes GBK
    command_line.write_output(arguments.output, mark + content)
    if not complete:
        from dragon_ros.cli.inputs import counted
        print(f'grade: interrupted: {len(grades)} of {counted(len(teams), "team", "was")} graded', file=sys.stderr)
        return command_line.FAILED
    if arguments.output is not None:
        command_line.write_output(None, str(arguments.output))
    refused = [one.line() for grade in grades for one in grade.problems]
    if refused and not any(grade.answers or any(one.worst is not None for one in grade.sheets) for grade in grades):
        print(f'grade: {refused[0]}', file=sys.stderr)
        return command_line.BAD_INPUT
    return command_line.OK


def _write_right_answers(arguments: Namespace) -> int:
    """Write the right answers as JSON. Raises InputError."""
    import json

    from dragon_contest.answers import right_answers
    given = {'FILE|FOLDER': bool(arguments.paths), '--answers': arguments.answers is not None,
             '--format': arguments.format not in ('text', 'json'), '--lang': arguments.lang is not None,
             **{option: getattr(arguments, option[2:]) is not None for option in _ANSWERS.values()}}
    command_line.check_taken('--right-answers', given, set())
    command_line.write_output(arguments.output, json.dumps(right_answers(), indent=1))
    return command_line.OK


def _teams(arguments: Namespace) -> 'list[Team]':
    """Return the teams with their answers. Raises InputError."""
    from dragon_contest.grade.folders import teams_of
    from dragon_contest.grade.team import Team, teams_in
    from dragon_ros.cli.inputs import number
    given = {key: number(option, value, above=0.0, high=1e6) for key, option in _ANSWERS.items()
             if (value := getattr(arguments, option[2:])) is not None}
    if not arguments.paths and not given and arguments.answers is None:
        raise dr.InputError('grade: no input; give workbooks, a folder, or an answer such as --t 412.473838')
    teams = (teams_of(arguments.paths) if arguments.paths else [Team('answers', [])] if arguments.answers is None else
             teams_in(arguments.answers))
    if given and len(teams) > 1:
        raise dr.InputError(f'{_ANSWERS[next(iter(given))]}: it is the answer of one team, but {len(teams)} teams are '
                         'given; give --answers FILE with the answers of each team')
    if arguments.answers is not None and arguments.paths:
        _add_answers(teams, arguments.answers)
    if given:
        teams[0].answers |= given
    return teams


def _add_answers(teams: 'list[Team]', path: Path) -> None:
    """Set the answers of teams from a file. Raises InputError."""
    from dragon_contest.grade.team import answers_by_team, answers_of
    if len(teams) == 1:
        teams[0].answers = answers_of(path)
        return
    by_team = answers_by_team(path)
    unknown = sorted(by_team.keys() - {team.name for team in teams})
    if unknown:
        raise dr.InputError(f'{path}: {unknown[0]} is not one of the given teams, the first of which is '
                            f'{teams[0].name}')
    for team in teams:
        team.answers = by_team.get(team.name, {})


def _content(form: str, grades: 'list[TeamGrade]', whole: int, lang: str) -> str:
    """Return the grades in the given format."""
    if form == 'html':
        from dragon_contest.grade.report import page
        return page(grades, whole, lang)
    from dragon_contest.grade import tables
    if form == 'text':
        return tables.text_of(grades, lang)
    return tables.json_text(grades) if form == 'json' else tables.csv_text(grades)
