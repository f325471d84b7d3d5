"""``plan DRAWING``: answer whether a dragon fits, with a plan to print, a page to share and the scene."""
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from dragon_ros.cli import command_line, figures
from dragon_ros.cli.language import language_of, say
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.drawn_scene import drawn_scene
from dragon_ros.commands.plan_words import WORDS
from dragon_ros.core.checks import number
from dragon_ros.core.errors import InputError

if TYPE_CHECKING:
    from dragon_ros.commands.plan_contents import Plan

EXAMPLE = """draw the way of the head in Google Earth, or record it with a phone, and save it as way.gpx or way.kml
save the town around it from openstreetmap.org (Export) as town.osm
{program} plan way.gpx --obstacles town.osm --benches 60 --bench-length 2.1"""
_PAGE_TICKS = 2000
_PACE = 10.0            # simulated seconds per second of the page
_DOES_NOT_FIT = 1       # exit code


def run(arguments: Namespace) -> int:
    """Write the plan, the page and the scene; print the answer; return the exit code."""
    from dragon_ros.commands.plan_contents import Plan, chalk_marks
    from dragon_ros.commands.plan_pages import write_pdf
    from dragon_ros.commands.route import write_scene
    drawing: Path = arguments.drawing
    pdf: Path = arguments.output or drawing.with_suffix('.pdf')
    if pdf.suffix.lower() != '.pdf' or arguments.format == 'geojson':
        raise InputError(f'--output {pdf}: the plan of a drawing is a .pdf; for an area, give the scene '
                         'that is written')
    page, scene_path = pdf.with_suffix('.html'), pdf.with_suffix('.yaml')
    marks = pdf.with_name(f'{pdf.stem}-marks.csv')
    for path in (pdf, page, scene_path, marks):
        command_line.check_keeps('--output', path, drawing, arguments.obstacles)
    arguments.overrides = [*_dragon(arguments), *arguments.overrides]
    drawn = drawn_scene(arguments)
    write_scene(arguments, drawn, scene_path)
    plan = Plan(drawn.scene, figures.drawable(arguments.title or drawing.stem), language_of(arguments.lang))
    write_pdf(arguments, plan, pdf)
    command_line.write_output(marks, chalk_marks(plan))
    _write_page(plan, page)
    command_line.write_output(None, '\n'.join([*drawn.notes, answer(plan), *map(str, (pdf, marks, page, scene_path))]))
    return _DOES_NOT_FIT if any(gap.is_broken for gap in plan.gaps) else command_line.OK


def _dragon(arguments: Namespace) -> list[str]:
    """Return the options for the dragon as changes of the scene."""
    changes = []
    if arguments.benches is not None:
        changes.append(f'dragon.benches={arguments.benches}')
    for option, keys in (('bench_length', ('head_length_m', 'body_length_m')), ('bench_width', ('width_m',))):
        if (value := getattr(arguments, option)) is not None:
            number(f'--{option.replace("_", "-")}', value, above=0.0)
            changes += [f'dragon.{key}={value!r}' for key in keys]
    return changes


def answer(plan: 'Plan') -> str:
    """Return whether the dragon fits, and the closest obstacle, in a sentence."""
    if not plan.gaps:
        return say(WORDS, 'no_obstacles', plan.lang)
    found = plan.fit
    one = found.gaps[0]
    key = 'touches' if one.high_m <= 0 else 'fits_not' if plan.gaps[0].is_broken else 'fits'
    return say(WORDS, key, plan.lang, name=one.name, gap=max(one.high_m, 0.0),
               t=one.t_s - plan.scene.run.start_s, margin=found.margin_m)


def _write_page(plan: 'Plan', path: Path) -> None:
    from dragon_ros.commands.view.page import write_page
    from dragon_ros.pictures.sources import SceneSource
    source = SceneSource(plan.title, plan.scene)
    write_page(source, source.ticks_s(*source.span_s, _PAGE_TICKS), _PACE, path, Progress('plan', 'ticks'))
