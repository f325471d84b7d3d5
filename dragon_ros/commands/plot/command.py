"""``plot``: pictures of a scene or a bag."""
import argparse
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dragon_ros.cli import command_line, figures
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import times_of
from dragon_ros.core.errors import FieldError, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dragon_ros.commands.sources import Source
    from dragon_ros.core.numerics.types import Floats

_KINDS = {      # what each draws, and an example
    'dragon': ('the dragon at one time, or up to six side by side', '--times 60,240 --output dragon.png'),
    'contact': ('the first contact, with a close-up', '--bag run.mcap --output contact.svg'),
    'clearance': ('the smallest gap of all benches over time', '--output clearance.png --output clearance.svg'),
    'speeds': ('the speed along the chain at some times', '--times 0,60,120,180,240,300'),
    'animation': ('the run as an animation: .gif, .html (the web view in one file), .mp4 where ffmpeg is installed',
                  '--start 400 --stop 413 --pace 2 --output run.html'),
}


def main(argv: list[str]) -> int:
    """Draw one picture; return the exit code."""
    return command_line.guarded('plot', partial(_run, options().parse_args(argv)))


def options() -> argparse.ArgumentParser:
    """Return the parser."""
    parser = command_line.parser('plot', 'Draw a scene or a bag. For more: `plot KIND --help`.',
                                 f'plot dragon {_KINDS["dragon"][1]}')
    kinds = parser.add_subparsers(dest='kind', required=True, metavar='KIND')
    for kind, (text, example) in _KINDS.items():
        one = kinds.add_parser(kind, help=text, description=f'Draw {text}.', allow_abbrev=False,
                               epilog=f'example: {command_line.program()} plot {kind} {example}')
        command_line.add_source_options(one)
        default = Path('run.gif' if kind == 'animation' else f'{kind}.png')
        formats = '.gif, .html, .mp4' if kind == 'animation' else ', '.join(figures.FORMATS)
        one.add_argument('--output', type=Path, action='append', metavar='FILE',
                                  help=f'{formats}; repeatable ({default})')
        one.set_defaults(default=default)
        one.add_argument('--dpi', type=int, default=130, help='dots per inch (%(default)s)')
        if kind in ('dragon', 'speeds'):
            command_line.add_times_option(one, 'seconds (the start of the run)')
    _add_animation_options(kinds.choices['animation'])
    return parser


def _add_animation_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--start', type=float, metavar='S', help='first time (of the run)')
    parser.add_argument('--stop', type=float, metavar='S', help='last time (of the run)')
    parser.add_argument('--pace', type=float, default=20.0, help='seconds of the run per second (%(default)g)')
    parser.add_argument('--fps', type=int, default=20, help='frames per second (%(default)s)')


def _run(arguments: Namespace) -> int:
    paths: list[Path] = arguments.output or [arguments.default]
    if not 10 <= arguments.dpi <= 1200:
        raise FieldError('--dpi', arguments.dpi, 'it must lie between 10 and 1200', 'leave it out for 130')
    if arguments.kind != 'animation':
        for path in paths:
            if path.suffix.lower() not in figures.FORMATS:
                raise InputError(f'--output {path}: is no picture; end it in {", ".join(figures.FORMATS)}')
    from dragon_ros.commands.sources import opened
    with opened(arguments) as source, figures.style():
        for path in _draw(arguments, source, paths):
            print(path)
    return command_line.OK


def _draw(arguments: Namespace, source: 'Source', paths: list[Path]) -> list[Path]:
    """Draw and write one kind of picture."""
    if arguments.kind == 'animation':
        from dragon_ros.commands.plot.animation import frame_times
        times_s = frame_times(source, arguments.start, arguments.stop, arguments.pace, arguments.fps)
        return [_moving(arguments, source, times_s, path) for path in paths]
    figure = _FIGURES[arguments.kind](arguments, source)
    return [figures.write(figure, path, arguments.dpi) for path in paths]


def _moving(arguments: Namespace, source: 'Source', times_s: 'Floats', path: Path) -> Path:
    if path.suffix.lower() == '.html':
        from dragon_ros.commands.view.page import write_page
        return write_page(source, times_s, arguments.pace, path, _shown('states'))
    from dragon_ros.commands.plot.animation import animate
    return animate(source, times_s, arguments.fps, path, arguments.dpi, _shown('frames', len(times_s)))


def _dragon(arguments: Namespace, source: 'Source') -> 'Figure':
    from dragon_ros.commands.plot.dragon import dragon_picture
    return dragon_picture(source, _times(arguments, source))


def _contact(arguments: Namespace, source: 'Source') -> 'Figure':
    from dragon_ros.commands.plot.dragon import contact_picture
    touch = source.first_touch(_shown('ticks'))
    if touch is None:
        raise InputError(f'{source.name}: no benches touch, so there is no contact to draw')
    return contact_picture(source, touch)


def _clearance(arguments: Namespace, source: 'Source') -> 'Figure':
    from dragon_ros.commands.plot.series import clearance_picture
    return clearance_picture(source, _shown('states'))


def _speeds(arguments: Namespace, source: 'Source') -> 'Figure':
    from dragon_ros.commands.plot.series import speeds_picture
    return speeds_picture(source, _times(arguments, source))


_FIGURES: dict[str, Callable[[Namespace, 'Source'], 'Figure']] = {
    'dragon': _dragon, 'contact': _contact, 'clearance': _clearance, 'speeds': _speeds}


def _times(arguments: Namespace, source: 'Source') -> list[float]:
    return [source.span_s[0]] if arguments.times is None else times_of(arguments.times)


def _shown(unit: str, total: int | None = None) -> Progress:
    return Progress('plot', unit, total)
