"""``plan``: draw a scene as pages to print, as an area for a map, or as marks to chalk on the ground.

Of a drawing, also make the scene, write a page to share, and say whether the dragon fits.
"""
from argparse import Namespace
from pathlib import Path

import dragon_ros as dr
from dragon_ros.cli import command_line, figures
from dragon_ros.cli.inputs import number
from dragon_ros.cli.language import language_of
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.plan_contents import Plan, chalk_marks, geojson
from dragon_ros.commands.plan_pages import exact_gap, pages, sheets, write_pages

_KINDS = {'pdf': {'--scale', '--paper', '--title'}, 'geojson': set[str](), 'csv': set[str]()}   # options of each format
_PAGE_TICKS = 2000
_PACE = 10.0            # simulated seconds per second of the page
_DOES_NOT_FIT = 1       # exit code


def run(arguments: Namespace) -> int:
    """Write the plan of a scene; return the exit code."""
    path: Path = arguments.output
    suffix = path.suffix.lower().lstrip('.')
    kind = arguments.format or suffix
    if kind not in _KINDS:
        raise dr.InputError(f'--output {path}: the suffix must be .pdf, .geojson or .csv; rename it, or give --format')
    if suffix in _KINDS and suffix != kind:
        raise dr.InputError(f'--format: {kind} conflicts with --output {path}; give only one of them')
    command_line.check_taken(f'a plan in {kind}', {
        '--scale': arguments.plan_scale is not None, '--paper': arguments.paper is not None,
        '--title': arguments.title is not None}, _KINDS[kind])
    plan = _plan(arguments, command_line.scene_from(arguments), Path(arguments.scene).stem)
    lines = [str(path)]
    if kind == 'pdf':
        _write_pdf(arguments, plan, path)
    elif kind == 'csv':
        command_line.write_output(path, chalk_marks(plan))
    else:
        command_line.write_output(path, geojson(plan))
        lines = [f'{path}: {plan.say("metres" if plan.scene.origin is None else "degrees")}']
    if kind != 'csv':
        lines += [exact_gap(plan, gap) for gap in plan.gaps]
    command_line.write_output(None, '\n'.join(lines))
    return command_line.OK


def run_drawing(arguments: Namespace) -> int:
    """Write the plan of a drawing, the marks, the page and the scene; print the answer; return the exit code."""
    from dragon_ros.commands.drawn_scene import TOLERANCE_M, drawn_scene
    from dragon_ros.commands.route import write_scene
    drawing: Path = arguments.drawing
    pdf: Path = arguments.output or drawing.with_suffix('.pdf')
    if pdf.suffix.lower() != '.pdf' or arguments.format == 'geojson':
        raise dr.InputError(f'--output {pdf}: the plan of a drawing is a .pdf; for an area, give the scene '
                            'that is written')
    marks, page, scene_path = pdf.with_name(f'{pdf.stem}-marks.csv'), pdf.with_suffix('.html'), pdf.with_suffix('.yaml')
    for path in (pdf, marks, page, scene_path):
        command_line.check_keeps('--output', path, drawing, arguments.obstacles)
    arguments.overrides = [*_dragon(arguments), *arguments.overrides]
    drawn = drawn_scene(arguments)
    write_scene(arguments, drawn, scene_path)
    plan = _plan(arguments, drawn.scene, drawing.stem)
    _write_pdf(arguments, plan, pdf)
    command_line.write_output(marks, chalk_marks(plan))
    _write_page(plan, page)
    notes = [*drawn.notes, *([drawn.deviation] if drawn.tolerance_m > TOLERANCE_M else [])]
    command_line.write_output(None, '\n'.join([*notes, answer(plan), *map(str, (pdf, marks, page, scene_path))]))
    return _DOES_NOT_FIT if any(gap.is_broken for gap in plan.gaps) else command_line.OK


def _plan(arguments: Namespace, scene: dr.Scene, name: str) -> Plan:
    return Plan(scene, figures.drawable(arguments.title or name), language_of(arguments.lang))


def _write_pdf(arguments: Namespace, plan: Plan, path: Path) -> None:
    write_pages([plan], path, lambda: list(pages(plan, sheets(plan, arguments.paper, arguments.plan_scale))))


def _write_page(plan: Plan, path: Path) -> None:
    from dragon_ros.commands.view.page import write_page
    from dragon_ros.pictures.sources import SceneSource
    source = SceneSource(plan.title, plan.scene)
    write_page(source, source.ticks_s(*source.span_s, _PAGE_TICKS), _PACE, path, Progress('plan', 'ticks'))


def _dragon(arguments: Namespace) -> list[str]:
    """Return the options for the dragon as changes of the scene."""
    changes = [] if arguments.benches is None else [f'dragon.benches={arguments.benches}']
    for option, keys in (('bench_length', ('head_length_m', 'body_length_m')), ('bench_width', ('width_m',))):
        if (value := getattr(arguments, option)) is not None:
            number(f'--{option.replace("_", "-")}', value, above=0.0)
            changes += [f'dragon.{key}={value!r}' for key in keys]
    return changes


def answer(plan: Plan) -> str:
    """Return whether the dragon fits, and the closest obstacle, in a sentence."""
    if not plan.gaps:
        return plan.say('no_obstacles')
    one, venue = plan.gaps[0], plan.scene.venue
    key = 'touches' if one.gap_m <= 0 else 'fits_not' if one.is_broken else 'fits'
    return plan.say(key, name=one.name, gap=one.gap_m, t=one.after_s, margin=venue.margin_m if venue else 0.0)
