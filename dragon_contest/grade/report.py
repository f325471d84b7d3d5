"""The report as a self-contained HTML file, light or dark, with a row and a page for each team, and pictures of errors.

The page has no script and loads nothing; its content policy forbids both. The fragment of the address selects a team's
page (``:target``).
"""
from base64 import b64encode
from collections.abc import Iterable, Iterator
from html import escape
from io import BytesIO
from itertools import starmap
from math import floor, log10
from pathlib import Path

import dragon_ros as dr
from dragon_contest.grade.heat import LEAST, MOST, Heat
from dragon_contest.grade.tables import (
    UNITS,
    cause_line,
    causes_of,
    lacks_of,
    looks_like,
    place_of,
    reason_of,
    verdict_key,
)
from dragon_contest.grade.team import BOUNDS, QUESTIONS, SHEETS, UNREAD, AnswerGrade, SheetGrade, TeamGrade
from dragon_contest.grade.truth import RESULTS
from dragon_contest.grade.words import joined, sentence, titled

# Anchor colours of the colour map viridis by Smith and van der Walt (CC0). Its lightness increases evenly, and
# colour-blind people can read it.
_VIRIDIS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
_WIDE, _HIGH = 448, 304         # width and height of a picture of errors, in the picture's units
_LINE_HIGH = 110
_STYLE = Path(__file__).with_name('report.css')


def page(teams: list[TeamGrade], whole: int, lang: str) -> str:
    """Return the page for all teams; ``whole`` is the number of teams, including those that were not graded."""
    many = len(teams) != 1
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
    title = _said('title', lang)
    head = (f'<!DOCTYPE html>\n<html lang="{"zh-CN" if lang == "zh" else "en"}">\n<head>\n<meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f'<meta name="color-scheme" content="light dark">\n<title>{title}</title>\n'
            f'<style>\n{_STYLE.read_text(encoding="utf-8")}</style>\n</head>\n')
    body = [f'<body class="{"many" if many else "one"}">', '<main>', '<div id="overview">', f'<h1>{title}</h1>',
            f'<p class="quiet">{_said("made_by", lang, version=dr.__version__)}</p>']
    if len(teams) < whole:
        body.append(f'<p class="problem">{_said("interrupted", lang, done=len(teams), whole=whole)}</p>')
    if many:
        body += _overview(teams, lang)
    body.append('</div>')
    for number, team in enumerate(teams, 1):
        body += _team(number, team, many, lang)
    return head + '\n'.join([*body, '</main>', '</body>', '</html>'])


def _said(key: str, lang: str, **parameters: object) -> str:
    """Return an escaped sentence for the page."""
    return escape(sentence(key, parameters, lang))


def _overview(teams: list[TeamGrade], lang: str) -> Iterator[str]:
    columns = [(result, sheet) for result in RESULTS for sheet in SHEETS]
    given = {one.question for team in teams for one in team.answers}
    asked = [question for question in QUESTIONS if question in given]
    heads = [*(f'{result} {_said(sheet, lang)}' for result, sheet in columns),
             *(_said(f'short_{question}', lang) for question in asked)]
    yield '<div class="wide"><table><thead><tr>'
    yield f'<th>{_said("team", lang)}</th>{"".join(f"<th>{head}</th>" for head in heads)}</tr></thead><tbody>'
    for number, team in enumerate(teams, 1):
        sheets = {(one.result, one.sheet): one for one in team.sheets}
        answers = {one.question: one for one in team.answers}
        cells = [_pill_of(sheets.get(column), lang) for column in columns]
        cells += [_pill(answers[one].verdict, lang) if one in answers else _pill('missing', lang) for one in asked]
        more = [*_problems(team, lang), *_causes(team, lang)]
        graded = (''.join(map(_cell, heads, cells)) if sheets or answers else
                  f'<td colspan="{len(heads)}">{"".join(more)}</td>')
        yield (f'<tr><td class="name"><a href="#team-{number}">{escape(team.name)}</a></td>{graded}</tr>')
        if more and (sheets or answers):
            yield f'<tr class="more"><td></td><td colspan="{len(heads)}">{"".join(more)}</td></tr>'
    yield '</tbody></table></div>'


def _pill_of(one: SheetGrade | None, lang: str) -> str:
    """Return the verdict on a sheet with its worst error."""
    if one is None:
        return _pill('missing', lang)
    more = {'right': '', 'incomplete': f'{one.cells} / {one.expected}'}.get(
        one.verdict, '' if one.worst is None else f'{one.worst:.2g} {UNITS[one.sheet]}')
    return _pill(one.verdict, lang) + (f'<small>{more}</small>' if more else '')


def _problems(team: TeamGrade, lang: str) -> Iterator[str]:
    """Yield what was not graded, and why."""
    for one in team.problems:
        verdict = sentence(verdict_key(UNREAD.get(one.key, 'not_readable')) if one.path else 'problems', None, lang)
        line = titled(verdict, one._replace(path=Path(one.path).name if one.path else '').line(lang), lang)
        yield f'<p class="problem">{escape(line)}</p>'


def _causes(team: TeamGrade, lang: str) -> Iterator[str]:
    """Yield the causes that a team's tables suggest, and which tables have other errors."""
    yield from (f'<p class="why">{escape(cause_line(cause, where, lang))}</p>' for cause, where in causes_of(team))
    explained = {(one.result, one.sheet) for _, where in causes_of(team) for one, _ in where}
    for one in team.sheets:
        if (why := looks_like(one, lang)) and (one.result, one.sheet) not in explained:
            yield f'<p class="why">{escape(titled(f"{one.result} {sentence(one.sheet, None, lang)}", why, lang))}</p>'


def _cell(head: str, content: str, kind: str = '') -> str:
    """Return a table cell; on a narrow screen, the cell also shows its column's heading (escaped)."""
    return f'<td{kind} data-head="{head}">{content}</td>'


def _pill(verdict: str, lang: str) -> str:
    return f'<span class="pill {verdict}">{_said(verdict_key(verdict), lang)}</span>'


def _team(number: int, team: TeamGrade, many: bool, lang: str) -> Iterator[str]:
    yield f'<section class="team" id="team-{number}">'
    if many:
        yield f'<p class="back"><a href="#overview">← {_said("back", lang)}</a></p>'
    yield f'<h1 class="name">{escape(team.name)}</h1>'
    if team.files:
        yield f'<p class="quiet">{escape(", ".join(team.files))}</p>'
    if team.problems:
        yield f'<h2>{_said("problems", lang)}</h2>'
        yield from _problems(team, lang)
    if causes := list(_causes(team, lang)):
        yield f'<h2>{_said("causes", lang)}</h2>'
        yield from causes
    if team.sheets:
        yield from _results(team.sheets, lang)
    if team.answers:
        yield from _answers(team.answers, lang)
    if team.notes:
        yield f'<h2>{_said("notes", lang)}</h2><ul>'
        yield from (f'<li>{_said(key, lang, **parameters)}</li>' for key, parameters in team.notes)
        yield '</ul>'
    pictures = [one for one in team.sheets if one.heat is not None and one.verdict in ('close', 'wrong')]
    if pictures:
        yield f'<h2>{_said("pictures", lang)}</h2><div class="cards">'
        for one in pictures:
            yield f'<div class="card"><h3>{one.result} {_said(one.sheet, lang)}</h3>'
            yield from _picture(one, lang)
            yield '</div>'
        yield '</div>'
    yield '</section>'


def _results(sheets: Iterable[SheetGrade], lang: str) -> Iterator[str]:
    heads = [_said('results', lang), '', _said('cells', lang), _said('worst', lang), _said('where', lang),
             *(_said('within', lang, bound=bound) for bound in BOUNDS)]
    numbers = {2, 3, *range(5, 5 + len(BOUNDS))}
    yield f'<h2>{_said("results", lang)}</h2><div class="wide"><table><thead><tr>'
    yield '<td></td><td></td>' + ''.join(f'<th{" class=n" if n in numbers else ""}>{heads[n]}</th>'
                                         for n in range(2, len(heads)))
    yield '</tr></thead><tbody>'
    for one in sheets:
        name = f'{one.result} {_said(one.sheet, lang)}'
        if one.worst is None:
            yield (f'<tr><td class="name">{name}</td><td>{_pill(one.verdict, lang)}</td>'
                   f'<td colspan="{len(heads) - 2}">{escape(reason_of(one, lang))}</td></tr>')
            continue
        cells = [f'{one.cells} / {one.expected}', f'{one.worst:.3g} {UNITS[one.sheet]}', escape(place_of(one, lang)),
                 *(f'{share:.2%}' for share in one.within)]
        shown = (_cell(heads[n], cell, ' class="n"' if n in numbers else '') for n, cell in enumerate(cells, 2))
        yield f'<tr><td class="name">{name}</td><td>{_pill(one.verdict, lang)}</td>{"".join(shown)}</tr>'
        if why := escape(joined('; ', filter(None, (looks_like(one, lang), lacks_of(one, lang))), lang)):
            yield f'<tr class="more"><td></td><td colspan="{len(heads) - 1}"><p class="why">{why}</p></td></tr>'
    yield '</tbody></table></div>'


def _answers(answers: Iterable[AnswerGrade], lang: str) -> Iterator[str]:
    yield f'<h2>{_said("answers", lang)}</h2><div class="wide"><table><thead><tr><td></td><td></td>'
    heads = [_said(key, lang) for key in ('given', 'truth', 'error', 'diagnosis')]
    yield ''.join(f'<th class="n">{head}</th>' for head in heads[:3])
    yield f'<th>{heads[3]}</th></tr></thead><tbody>'
    for one in answers:
        values = [f'{one.given:.10g}', f'{one.truth:.10g}', f'{one.error:.3g}']
        shown = (_cell(head, value, ' class="n"') for head, value in zip(heads[:3], values, strict=True))
        yield (f'<tr><td class="name">{_said(one.question, lang)}</td><td>{_pill(one.verdict, lang)}</td>'
               f'{"".join(shown)}{_cell(heads[3], escape(looks_like(one, lang)))}</tr>')
    yield '</tbody></table></div>'


# Pictures.
def _picture(one: SheetGrade, lang: str) -> Iterator[str]:
    """Yield a heat map of the error by handle and time, and curves of the largest error by handle and by time."""
    heat = one.heat
    assert heat is not None
    many_times = len(heat.by_time) > 1
    unit = 'axis_error' if one.sheet == 'positions' else 'axis_error_speed'
    if many_times:
        yield _colours(heat, _said('axis_time', lang), _said('axis_handle', lang), _said(unit, lang))
    yield _curve(heat.by_handle, 0, len(heat.by_handle) - 1, _said('axis_handle', lang), _said(unit, lang))
    if many_times:
        yield _curve(heat.by_time, heat.first_s, heat.last_s, _said('axis_time', lang), _said(unit, lang))


def _colours(heat: Heat, across: str, up: str, scale: str) -> str:
    left, top, width, height = 40, 8, _WIDE - 46, _HIGH - 78
    image, middle, below, steps = b64encode(_png(heat)).decode(), left + width / 2, top + height, 40
    texts = [(left, below + 14, 'start', f'{heat.first_s:g}'), (left + width, below + 14, 'end', f'{heat.last_s:g}'),
             (left - 5, below, 'end', '0'), (left - 5, top + 9, 'end', f'{len(heat.by_handle) - 1}'),
             (middle, below + 14, 'middle', across), (middle, below + 66, 'middle', scale)]
    texts += [(left + width * (decade - LEAST) / (MOST - LEAST), below + 52, 'middle' if decade < MOST else 'end',
               f'1e{decade}') for decade in range(int(LEAST), int(MOST) + 1, 2)]
    legend = ''.join(f'<rect x="{left + width * n / steps:.1f}" y="{below + 30}" width="{width / steps + 0.5:.1f}" '
                     f'height="9" fill="rgb{_shade(n / (steps - 1))}"/>' for n in range(steps))
    side = top + height / 2
    return (f'<svg viewBox="0 0 {_WIDE} {_HIGH}" role="img" aria-label="{scale}"><image x="{left}" y="{top}" '
            f'width="{width}" height="{height}" preserveAspectRatio="none" href="data:image/png;base64,{image}"/>'
            f'{"".join(starmap(_text, texts))}{legend}'
            f'<text x="12" y="{side}" text-anchor="middle" transform="rotate(-90 12 {side})">{up}</text></svg>')


def _text(x: float, y: float, anchor: str, text: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text}</text>'


def _curve(values: tuple[float, ...], first: float, last: float, across: str, up: str) -> str:
    """Return a curve of the largest errors on a logarithmic scale."""
    left, top, width, height = 40, 10, _WIDE - 46, _LINE_HIGH - 34
    levels = [max(LEAST, min(MOST + 2, log10(value))) if value > 0 else LEAST for value in values]
    low, high = floor(min(levels)), max(floor(max(levels)) + 1, floor(min(levels)) + 1)
    places = [(left + width * n / max(1, len(levels) - 1), top + height * (high - level) / (high - low))
              for n, level in enumerate(levels)]
    points = ' '.join(f'{x:.1f},{y:.1f}' for x, y in places)
    rules = ''
    for decade in range(low, high + 1, max(1, (high - low + 2) // 3)):
        y = top + height * (high - decade) / (high - low)
        rules += f'<line class="axis" x1="{left}" x2="{left + width}" y1="{y:.1f}" y2="{y:.1f}"/>'
        rules += _text(left - 5, y + 4, 'end', f'1e{decade}')
    foot = _LINE_HIGH - 8
    texts = ((left, foot, 'start', f'{first:g}'), (left + width, foot, 'end', f'{last:g}'),
             (left + width / 2, foot, 'middle', f'{across}: {up}'))
    return (f'<svg viewBox="0 0 {_WIDE} {_LINE_HIGH}" role="img" aria-label="{up}">{rules}'
            f'<polyline class="line" points="{points}"/>{"".join(starmap(_text, texts))}</svg>')


def _png(heat: Heat) -> bytes:
    """Return a heat map as PNG, with handle 0 at the bottom; missing cells are transparent."""
    from PIL import Image
    image = Image.frombytes('P', (heat.columns, heat.rows), heat.grid).transpose(Image.Transpose.FLIP_TOP_BOTTOM)
    shades = [(0, 0, 0), *(_shade(n / 62) for n in range(63))]
    image.putpalette([part for shade in shades for part in shade])
    out = BytesIO()
    image.save(out, 'PNG', transparency=0, optimize=True)
    return out.getvalue()


def _shade(share: float) -> tuple[int, int, int]:
    """Return the colour of a share from 0 to 1."""
    at = min(share, 1.0) * (len(_VIRIDIS) - 1)
    n = min(int(at), len(_VIRIDIS) - 2)
    red, green, blue = (round(a + (at - n) * (b - a)) for a, b in zip(_VIRIDIS[n], _VIRIDIS[n + 1], strict=True))
    return red, green, blue
