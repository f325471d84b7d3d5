"""``plot``: pictures of a scene or a bag."""
import argparse
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import dragon_ros as dr
from dragon_ros.cli import command_line, figures
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import times_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dragon_ros.cli.pool import Pool
    from dragon_ros.pictures.sources import Source
    from dragon_ros.pictures.zoom import Zoom
    Drawing = tuple[Figure, str]        # a figure, and the caption's text about the run and its times

_MOST_TIMES = 8         # largest number of times listed in a caption
_DPI, _SIZE = 130, '1920x1080'
_WINDOW = {'--around', '--span', '--follow'}
_TAKES = {'.gif': {*_WINDOW, '--dpi'}, '.mp4': {*_WINDOW, '--size'}, '.html': set[str]()}
_KINDS = {      # description and example of each kind
    'dragon': ('the dragon at one time, or up to six side by side', '--times 60,240 --output dragon.png'),
    'contact': ('the first contact, with a close-up', '--bag run.mcap --output contact.svg'),
    'clearance': ('the smallest gap between benches, or to an obstacle, over time',
                  '--output clearance.png --output clearance.svg'),
    'speeds': ('the speed of each handle along the chain, at several times', '--times 0,60,120,180,240,300'),
    'animation': ('the run as an animation: .gif, .mp4 (a film with clearance and speeds), .html (the web view in one '
                  'file)', '--start 400 --stop 413 --pace 2 --around head --follow --output run.mp4'),
}


def main(argv: list[str]) -> int:
    """Draw one picture; return the exit code."""
    return command_line.guarded('plot', partial(_run, options().parse_args(argv)))


def options() -> argparse.ArgumentParser:
    """Return the parser."""
    parser = command_line.parser('plot', 'Draw a scene or a bag. For the options, run `plot KIND --help`.',
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
        one.add_argument('--dpi', type=int, help=f'dots per inch ({_DPI})')
        command_line.add_workers_option(one, 'animation' if kind == 'animation' else 'picture')
        if kind in ('dragon', 'speeds'):
            command_line.add_times_option(one, 'times in seconds (the start of the run)')
        if kind in ('dragon', 'animation'):
            one.add_argument('--around', metavar='head|tail|contact|X,Y', help='show only a window around this centre')
            one.add_argument('--span', type=float, metavar='METRES', help='side length of the window (6 bench lengths)')
    _add_animation_options(kinds.choices['animation'])
    return parser


def _add_animation_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--start', type=float, metavar='S', help='time of the first frame (start of the run)')
    parser.add_argument('--stop', type=float, metavar='S', help='time of the last frame (end of the run)')
    parser.add_argument('--pace', type=float, default=20.0, help='simulated seconds per real second (%(default)g)')
    parser.add_argument('--fps', type=int, help='frames per second (20; 30 for .mp4)')
    parser.add_argument('--follow', action='store_true', help='move the window with the head, or with the tail '
                        'if --around is tail')
    parser.add_argument('--size', metavar='WIDTHxHEIGHT', help=f'frame size of an .mp4 in pixels ({_SIZE}); in a '
                        'square or tall one, the curves are below the dragon')


def _run(arguments: Namespace) -> int:
    paths: list[Path] = arguments.output or [arguments.default]
    if arguments.dpi is not None and not 10 <= arguments.dpi <= 1200:
        raise dr.FieldError('--dpi', arguments.dpi, 'it must lie between 10 and 1200', f'omit it for {_DPI}')
    if arguments.kind == 'animation':
        _check_animation(arguments, paths)
    else:
        for path in paths:
            if path.suffix.lower() not in figures.FORMATS:
                raise dr.InputError(f'--output {path}: it is not a picture; the suffix must be one of '
                                 f'{", ".join(figures.FORMATS)}')
    from dragon_ros.cli.pool import Pool
    from dragon_ros.commands.opened import opened
    pool = Pool(arguments.workers)
    with opened(arguments, pool) as source, figures.style():
        for path in _draw(arguments, source, paths, pool):
            command_line.write_output(None, str(path))
    return command_line.OK


def _check_animation(arguments: Namespace, paths: list[Path]) -> None:
    """Reject options that none of the files would use, and formats that cannot be written."""
    kinds = sorted({path.suffix.lower() for path in paths})
    if all(kind in _TAKES for kind in kinds):
        given = {f'--{name}': getattr(arguments, name) not in (None, False)
                 for name in ('around', 'span', 'follow', 'dpi', 'size')}
        command_line.check_taken(f'an animation in {" and ".join(kinds)}', given,
                                 set().union(*(_TAKES[kind] for kind in kinds)))
    from dragon_ros.pictures.film import prepared_as
    for path in paths:
        if path.suffix.lower() != '.html':
            prepared_as(path)


def _draw(arguments: Namespace, source: 'Source', paths: list[Path], pool: 'Pool') -> list[Path]:
    """Draw one kind of picture, and write it to files."""
    if arguments.kind == 'animation':
        return [_moving(arguments, source, path, pool) for path in paths]
    figure, what = _FIGURES[arguments.kind](arguments, source)
    caption = f'{figures.short(source.name)}, {what}'
    return [figures.write(figure, path, arguments.dpi or _DPI, caption) for path in paths]


def _moving(arguments: Namespace, source: 'Source', path: Path, pool: 'Pool') -> Path:
    from dragon_ros.pictures.animation import AnimatedFigure, animate, film_size, frame_times
    kind = path.suffix.lower()
    fps = arguments.fps or (30 if kind == '.mp4' else 20)
    times_s = frame_times(source, arguments.start, arguments.stop, arguments.pace, fps)
    if kind == '.html':
        from dragon_ros.commands.view.page import write_page
        return write_page(source, times_s, arguments.pace, path, _shown('states'))
    zoom = _zoom(arguments)
    size = film_size(arguments.size or _SIZE) if kind == '.mp4' else None
    drawn = AnimatedFigure(source, times_s, zoom, arguments.follow, size, arguments.dpi or _DPI, _shown('states'))
    return animate(source, times_s, fps, path, drawn, _shown('frames', len(times_s)), pool)


def _zoom(arguments: Namespace) -> 'Zoom | None':
    """Return the part of the picture to show. Raises InputError if --follow is given for a fixed centre."""
    from dragon_ros.pictures.zoom import zoom_of
    follow = getattr(arguments, 'follow', False)
    zoom = zoom_of(arguments.around or ('head' if follow else None), arguments.span)
    if follow and zoom is not None and zoom.around not in ('head', 'tail'):
        raise dr.InputError(f'--follow: nothing moves at {arguments.around}; give --around head or tail, or omit '
                            '--follow')
    return zoom


def _dragon(arguments: Namespace, source: 'Source') -> 'Drawing':
    from dragon_ros.pictures.dragon import dragon_picture
    times_s = _times(arguments, source)
    return dragon_picture(source, times_s, _zoom(arguments)), _said(times_s)


def _contact(arguments: Namespace, source: 'Source') -> 'Drawing':
    from dragon_ros.pictures.dragon import contact_picture
    touch = source.first_touch(_shown('ticks'))
    if touch is None:
        raise dr.InputError(f'{source.name}: no benches touch in this run; draw the dragon instead (plot dragon)')
    return contact_picture(source, touch), f'{touch.t_s:.6f} s'


def _clearance(arguments: Namespace, source: 'Source') -> 'Drawing':
    from dragon_ros.pictures.series import clearance_picture
    first, last = source.span_s
    return clearance_picture(source, _shown('states')), f'{first:g} to {last:g} s'


def _speeds(arguments: Namespace, source: 'Source') -> 'Drawing':
    from dragon_ros.pictures.series import speeds_picture
    times_s = _times(arguments, source)
    return speeds_picture(source, times_s), _said(times_s)


def _said(times_s: list[float]) -> str:
    """Return times as text for a caption."""
    some = ', '.join(f'{t_s:g}' for t_s in times_s[:_MOST_TIMES])
    return f'{some}{" ..." if len(times_s) > _MOST_TIMES else ""} s'


_FIGURES: dict[str, Callable[[Namespace, 'Source'], 'Drawing']] = {
    'dragon': _dragon, 'contact': _contact, 'clearance': _clearance, 'speeds': _speeds}


def _times(arguments: Namespace, source: 'Source') -> list[float]:
    return [source.span_s[0]] if arguments.times is None else times_of(arguments.times)


def _shown(unit: str, total: int | None = None) -> Progress:
    return Progress('plot', unit, total)
