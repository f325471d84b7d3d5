"""Grades as text, CSV and JSON; the CSV and JSON formats are stable and described in ``docs/grading.md``."""
import json
from collections.abc import Iterable
from typing import Any

from dragon_contest.grade.diagnosis import CAUSES, EXPLAINED, Finding
from dragon_contest.grade.team import BOUNDS, QUESTIONS, SHEETS, AnswerGrade, SheetGrade, TeamGrade
from dragon_contest.grade.truth import RESULTS
from dragon_contest.grade.words import bracketed, handle_name, joined, listed, sentence, titled
from dragon_ros.cli.command_line import csv_of

UNITS = {'positions': 'm', 'speeds': 'm/s'}
FORMAT = 1      # version of the JSON and CSV formats


def json_text(teams: list[TeamGrade]) -> str:
    """Return all grades as one JSON object."""
    return json.dumps({'format': FORMAT, 'bounds': BOUNDS, 'teams': [_values(team) for team in teams]},
                      ensure_ascii=False, indent=1)


def _values(team: TeamGrade) -> dict[str, Any]:
    return {'team': team.name, 'files': list(team.files), 'results': [_sheet_values(one) for one in team.sheets],
            'answers': [{'question': one.question, 'given': one.given, 'truth': one.truth, 'error': one.error,
                         'verdict': one.verdict, 'findings': list(map(_finding_values, one.findings))}
                        for one in team.answers],
            'causes': [{**_finding_values(cause), 'explains': None, 'in': [
                {'result': one.result, 'sheet': one.sheet, 'explains': share} for one, share in where]}
                for cause, where in causes_of(team)],
            'notes': [{'key': key, 'parameters': parameters, 'text': sentence(key, parameters)}
                      for key, parameters in team.notes], 'problems': [one.line() for one in team.problems]}


def _sheet_values(one: SheetGrade) -> dict[str, Any]:
    return {'result': one.result, 'sheet': one.sheet, 'verdict': one.verdict, 'cells': one.cells,
            'expected': one.expected, 'worst': one.worst, 'handle': one.handle, 't_s': one.t_s,
            'within': list(one.within), 'explains': one.explains, 'findings': list(map(_finding_values, one.findings)),
            'lacks': list(map(_finding_values, one.lacks)),
            'reason': None if one.reason is None else _finding_values(one.reason)}


def _finding_values(one: Finding) -> dict[str, Any]:
    return {'key': one.key, 'parameters': one.parameters, 'text': sentence(one.key, one.parameters),
            'explains': one.explains}


COLUMNS = ('team', *(f'{result}_{sheet}_{what}' for result in RESULTS for sheet in SHEETS for what in (
    'verdict', 'cells', 'worst', *(f'within_{bound:g}' for bound in BOUNDS), 'diagnosis', 'explains')),
    *(f'{question}_{what}' for question in QUESTIONS for what in ('given', 'error', 'verdict', 'diagnosis')),
    'problems')


def csv_text(teams: list[TeamGrade]) -> str:
    """Return the grades as CSV, with one row per team."""
    return csv_of(COLUMNS, map(_row, teams)).rstrip('\n')


def _row(team: TeamGrade) -> Iterable[object]:
    sheets = {(one.result, one.sheet): one for one in team.sheets}
    answers = {one.question: one for one in team.answers}
    row: list[object] = [_harmless(team.name)]
    for result in RESULTS:
        for sheet in SHEETS:
            one = sheets.get((result, sheet))
            row += [one.verdict if one else 'missing', 0, '', *[''] * len(BOUNDS), *(
                [keys_of([one.reason]) if one and one.reason else '', ''])] if one is None or one.worst is None else [
                one.verdict, one.cells, '' if one.worst is None else one.worst, *one.within, keys_of(one.findings),
                '' if one.explains is None else one.explains]
    for question in QUESTIONS:
        answer = answers.get(question)
        row += ['', '', 'missing', ''] if answer is None else [answer.given, answer.error, answer.verdict,
                                                               keys_of(answer.findings)]
    return [*row, _harmless('; '.join(one.line() for one in team.problems))]


def _harmless(text: str) -> str:
    """Return a string in a form that a spreadsheet does not mistake for a formula."""
    return f"'{text}" if text.startswith(('=', '+', '-', '@', '\t', '\r')) else text


def keys_of(findings: Iterable[Finding]) -> str:
    """Return the keys of findings with their numbers, such as ``euler(step=1)``."""
    out = []
    for one in findings:
        values = ', '.join(f'{name}={value:.6g}' if isinstance(value, float) else f'{name}={value}'
                           for name, value in one.parameters.items())
        out.append(f'{one.key}({values})' if values else one.key)
    return ' + '.join(out)


def causes_of(team: TeamGrade) -> list[tuple[Finding, list[tuple[SheetGrade, float | None]]]]:
    """Return the causes found in a team's tables, each with the tables that it explains and its share there.

    A sheet's share is that of all its causes together.
    """
    out: dict[str, tuple[Finding, list[tuple[SheetGrade, float | None]]]] = {}
    for one in team.sheets:
        explained = one.explains is not None and one.explains >= EXPLAINED
        for finding in one.findings:
            if finding.key != 'unknown' and (explained or finding.key in CAUSES):
                out.setdefault(keys_of([finding]), (finding, []))[1].append((one, one.explains))
    return list(out.values())


def cause_line(cause: Finding, where: list[tuple[SheetGrade, float | None]], lang: str) -> str:
    """Return a cause as text, with the tables in which it is found and the share of their errors that is explained."""
    names = (f'{one.result} {sentence(one.sheet, None, lang)}' + ('' if share is None else f' {share:.2%}')
             for one, share in where)
    return titled(sentence(cause.key, cause.parameters, lang), listed(names, lang), lang)


def looks_like(one: SheetGrade | AnswerGrade, lang: str) -> str:
    """Return the diagnosis as text: the mistakes and the share that they explain, or the observed facts."""
    if not one.findings:
        return ''
    explains = one.explains if isinstance(one, SheetGrade) else None
    unknown = any(finding.key == 'unknown' for finding in one.findings)
    what = joined(' + ', (sentence(finding.key, finding.parameters, lang) for finding in one.findings
                          if finding.key != 'unknown'), lang)
    if unknown:
        seen = [sentence('seen', {'what': what}, lang)] if what else []
        return joined('; ', (sentence('unknown', {}, lang), *seen), lang)
    if explains is None and any(finding.key in CAUSES for finding in one.findings):
        return sentence('looks_like_this', {'what': what}, lang)
    if explains is None or explains < EXPLAINED:
        return sentence('seen', {'what': what}, lang) if isinstance(one, SheetGrade) else what
    return sentence('looks_like', {'what': what, 'share': sentence('explains', {'share': explains}, lang)}, lang)


def verdict_key(verdict: str) -> str:
    """Return the key of a verdict's name in ``words``."""
    return 'verdict_not_understood' if verdict == 'not_understood' else verdict


def reason_of(one: SheetGrade, lang: str) -> str:
    """Return why a sheet is not graded, as text."""
    return sentence(one.reason.key, one.reason.parameters, lang) if one.reason else ''


def place_of(one: SheetGrade, lang: str) -> str:
    """Return the handle and the time of the worst error, as text."""
    if one.handle is None or one.t_s is None:
        return ''
    return sentence('at_time', {'handle': handle_name(one.handle, lang), 't': one.t_s}, lang)


def text_of(teams: list[TeamGrade], lang: str) -> str:
    """Return the grades as text for a terminal."""
    return '\n\n'.join('\n'.join(_lines(team, lang)) for team in teams)


def lacks_of(one: SheetGrade, lang: str) -> str:
    """Return which cells a sheet lacks, as text."""
    return joined('; ', (sentence(finding.key, finding.parameters, lang) for finding in one.lacks), lang)


def _answer_text(answer: AnswerGrade, lang: str) -> str:
    """Return the verdict on an answer, with the right answer and the mistakes that lead to the given one."""
    why = looks_like(answer, lang)
    verdict = why if answer.verdict == 'right' and why else sentence(answer.verdict, None, lang)
    truth = listed((f'{answer.truth:.10g}', f'{sentence("error", None, lang)} {answer.error:.3g}'), lang)
    text = listed((f'{answer.given:.10g}', verdict), lang) + bracketed(truth, lang)
    return joined('; ', (text, why), lang) if why and answer.verdict != 'right' else text


def _lines(team: TeamGrade, lang: str) -> Iterable[str]:
    yield team.name
    for one in team.sheets:
        name = '  ' + titled(f'{one.result} {sentence(one.sheet, None, lang)}',
                             sentence(verdict_key(one.verdict), None, lang), lang)
        if one.worst is None:
            told = one.reason is None or any(problem[1:] == one.reason[:2] for problem in team.problems)
            yield name if told else joined('; ', (name, reason_of(one, lang)), lang)
            continue
        shares = (f'{share:.2%} {sentence("within", {"bound": bound}, lang)}'
                  for bound, share in zip(BOUNDS, one.within, strict=True))
        facts = listed((name, f'{one.cells}/{one.expected} {sentence("cells", None, lang)}',
                        f'{sentence("worst", None, lang)} {one.worst:.3g} {UNITS[one.sheet]}'
                        f'{bracketed(place_of(one, lang), lang)}'), lang)
        yield joined('; ', (facts, listed(shares, lang)), lang)
        if one.findings:
            yield f'    {looks_like(one, lang)}'
        if one.lacks:
            yield f'    {lacks_of(one, lang)}'
    for cause, where in causes_of(team):
        yield f'  {titled(sentence("cause", None, lang), cause_line(cause, where, lang), lang)}'
    for answer in team.answers:
        yield f'  {titled(sentence(answer.question, None, lang), _answer_text(answer, lang), lang)}'
    yield from (f'  - {sentence(key, parameters, lang)}' for key, parameters in team.notes)
    yield from (f'  ! {one.line(lang)}' for one in team.problems)
