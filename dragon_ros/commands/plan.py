"""``plan``: draw a scene as pages to print, as an area for a map, or as marks to chalk on the ground."""
from argparse import Namespace
from pathlib import Path

from dragon_ros.cli import command_line, figures
from dragon_ros.cli.language import language_of
from dragon_ros.commands.plan_contents import Plan, chalk_marks, geojson
from dragon_ros.commands.plan_pages import write_pdf
from dragon_ros.core.errors import InputError

_KINDS = {'pdf': {'--scale', '--paper', '--title'}, 'geojson': set[str](), 'csv': set[str]()}   # options of each format


def run(arguments: Namespace) -> int:
    """Write the plan of a scene; return the exit code."""
    path: Path = arguments.output
    suffix = path.suffix.lower().lstrip('.')
    kind = arguments.format or suffix
    if kind not in _KINDS:
        raise InputError(f'--output {path}: the suffix must be .pdf, .geojson or .csv; rename it, or give --format')
    if suffix in _KINDS and suffix != kind:
        raise InputError(f'--format: {kind} conflicts with --output {path}; give only one of them')
    command_line.check_taken(f'a plan in {kind}', {
        '--scale': arguments.plan_scale is not None, '--paper': arguments.paper is not None,
        '--title': arguments.title is not None}, _KINDS[kind])
    scene = command_line.scene_from(arguments)
    plan = Plan(scene, figures.drawable(arguments.title or Path(arguments.scene).stem), language_of(arguments.lang))
    lines = [str(path)]
    if kind == 'pdf':
        write_pdf(arguments, plan, path)
    elif kind == 'csv':
        command_line.write_output(path, chalk_marks(plan))
    else:
        command_line.write_output(path, geojson(plan))
        lines = [f'{path}: {plan.say("metres" if plan.origin is None else "degrees")}']
    if kind != 'csv':
        lines += map(plan.exact_gap, plan.gaps)
    command_line.write_output(None, '\n'.join(lines))
    return command_line.OK
