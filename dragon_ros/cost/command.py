"""``cost``: measure the cost of accuracy, effects, contact and bags for a scene on this machine."""
import json
from argparse import ArgumentParser, Namespace
from functools import partial
from pathlib import Path

from dragon_ros.cli import command_line, figures
from dragon_ros.core.checks import number
from dragon_ros.core.errors import MissingError

_BUDGET_S = 6.0
_ABOUT = """Measure the cost of accuracy, effects, contact and bags for a scene on this machine.

  cost --scene NAME     measure a scene in less than a minute; output: tables, JSON or a picture
  ./dragon cost PAGE    renew a page of docs/cost; requires a checkout, which contains the benchmarks
                        (pages and options: ./dragon cost all --help)"""


def main(argv: list[str]) -> int:
    """Measure a scene; return the exit code. Without arguments, print the help."""
    options = _options()
    arguments = options.parse_args(argv)        # comes first, because parsing also handles shell completion
    if not argv:
        options.print_help()
        return command_line.BAD_INPUT
    return command_line.guarded('cost', partial(_run, arguments))


def _options() -> ArgumentParser:
    options = command_line.parser('cost', _ABOUT, 'cost --scene winding --output cost.png')
    command_line.add_scene_options(options)
    options.add_argument('--budget', type=float, default=_BUDGET_S, metavar='S',
                         help='approximate seconds for each of the four parts (%(default)g)')
    command_line.add_format_option(options, ('text', 'json'), figures.FORMATS)
    options.add_argument('--output', type=Path, metavar='FILE', help='file for a picture (suffix '
                         f'{", ".join(figures.FORMATS)}), or for the tables (any other suffix)')
    return options


def _check_folder(output: Path | None) -> None:
    """Reject an output file whose folder does not exist, before the measurements start."""
    if output is not None and not output.parent.is_dir():
        raise MissingError(f'--output {output}: it cannot be written, because there is no folder {output.parent}')


def _run(arguments: Namespace) -> int:
    _check_folder(arguments.output)
    budget_s = number('--budget', arguments.budget, low=0.01, high=1e5)
    from dragon_ros.cli.progress import Progress
    from dragon_ros.cost.costs import measure, text_of, values_of
    scene = command_line.scene_from(arguments)
    with Progress('cost', 'steps') as bar:
        def done(what: str) -> None:
            bar.update()
            bar.note(what)
        costs = measure(scene, str(arguments.scene), budget_s, done)
    text = json.dumps(values_of(costs)) if arguments.format == 'json' else text_of(costs)
    output: Path | None = arguments.output
    if output is None or output.suffix.lower() not in figures.FORMATS:
        command_line.write_output(output, text)
        return command_line.OK
    command_line.write_output(None, text)
    from dragon_ros.cost.picture import picture
    with figures.style(log_ticks=True):
        figures.write(picture(costs), output)
    return command_line.OK
