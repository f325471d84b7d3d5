"""``table``: print positions and velocities of handles at given times."""
import json
from argparse import Namespace
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.inputs import COLUMNS
from dragon_ros.cli.language import add_lang_option
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import handles_of, times_of
from dragon_ros.guests import installed

if TYPE_CHECKING:
    from dragon_ros.cli.inputs import Floats

Row = tuple[float, int, float, float, float, float, float]
_SCENE = {'--scene', '--set', '--accuracy'}
_WRITTEN = {'--output', '--format'}
_TAKES = {'--paper': _WRITTEN | {'--lang'}, 'BAG': _WRITTEN | {'--times', '--handles', '--namespace'},
          '--contest': _SCENE | {'--lang'}, 'a table of a scene': _SCENE | _WRITTEN | {'--times', '--handles'}}


def _check(arguments: Namespace) -> None:
    """Reject options that would be ignored."""
    given = {f'--{name}': getattr(arguments, name) is not None
             for name in ('accuracy', 'times', 'handles', 'namespace', 'output', 'contest', 'lang')}
    given |= {'--scene': command_line.names_scene(arguments), '--set': bool(arguments.overrides),
              '--paper': arguments.paper, '--format': arguments.format != 'text', 'BAG': arguments.bag is not None}
    what = next(name for name in _TAKES if given.get(name, True))
    command_line.check_taken(what, given, _TAKES[what] | {what})


def main(argv: list[str]) -> int:
    """Print a table; return the exit code."""
    options = command_line.parser('table', 'Print positions and velocities of handles (handle 0 is the head, and '
                                  'the last handle is the tail).',
                                  'table --times 0,60,300 --handles 0,1,51,223')
    command_line.add_bag(options, 'bag to read instead of a scene; the first tick at or after each time is used')
    command_line.add_scene_options(options)
    command_line.add_namespace_option(options)
    command_line.add_times_option(options, 'times in seconds (0, or the start of the bag)')
    command_line.add_handles_option(options)
    options.set_defaults(paper=False, contest=None, lang=None)
    guests = installed()
    if 'table --paper' in guests:
        options.add_argument('--paper', action='store_true', help=guests['table --paper'].help)
    if 'table --contest' in guests:
        options.add_argument('--contest', type=Path, metavar='FOLDER', help=guests['table --contest'].help)
        add_lang_option(options, '--paper and --contest')
    command_line.add_output_options(options, ('text', 'csv', 'json', 'xlsx'))
    arguments = options.parse_args(argv)
    return command_line.guarded('table', partial(_run, arguments))


def _run(arguments: Namespace) -> int:
    """Print the requested tables; return the exit code."""
    _check(arguments)
    if arguments.paper or arguments.contest:
        from importlib import import_module
        guest = installed()['table --paper' if arguments.paper else 'table --contest']
        code: int = import_module(guest.module).run(arguments)
        return code
    rows = _bag_rows(arguments) if arguments.bag else _scene_rows(arguments)
    command_line.write_output(arguments.output, _FORMATS[arguments.format](rows))
    return command_line.OK


def _scene_rows(arguments: Namespace) -> list[Row]:
    scene = command_line.scene_from(arguments)
    handles = handles_of(arguments.handles, scene.dragon.benches)
    times_s = times_of('0' if arguments.times is None else arguments.times)
    _check_not_before_start(scene, times_s)
    rows: list[Row] = []
    with Progress('table', 'times', len(times_s)) as bar:
        for some in dr.compile(scene).batches(times_s):
            rows += _rows(some.t_s.tolist(), handles, some.handles_m, some.velocity_m_s)
            bar.update(some.t_s.size)
    return rows


def _check_not_before_start(scene: 'dr.Scene', times_s: list[float]) -> None:
    if min(times_s) < 0:
        turn = f'; the head enters the turn at {scene.track.before_m / scene.head.speed_m_s:g} s' if (
            isinstance(scene.track, dr.STurn) and hasattr(scene.head, 'speed_m_s')) else ''
        raise dr.InputError(f'--times {min(times_s):g}: times of a scene begin at 0 s{turn}; add the difference',
                            field='times')


def _rows(times_s: list[float], handles: list[int], handles_m: 'Floats', velocity_m_s: 'Floats') -> Iterator[Row]:
    """Yield the row of each time and handle; the arrays have the shape (times, N+1, 2)."""
    import numpy as np
    velocity = velocity_m_s[:, handles]
    speed = np.hypot(velocity[..., :1], velocity[..., 1:])
    values = np.concatenate((handles_m[:, handles], velocity, speed), axis=-1).tolist()
    for t_s, group in zip(times_s, values, strict=True):
        for handle, row in zip(handles, group, strict=True):
            yield t_s, handle, *row


def _bag_rows(arguments: Namespace) -> list[Row]:
    """Return the rows of a bag in the same form as the rows of a scene; missing velocities are nan."""
    import numpy as np
    out: list[Row] = []
    command_line.check_is_bag(arguments.bag)
    with dr.read_bag(arguments.bag, arguments.namespace) as bag:
        times_s = [bag.reader.start_ns / 1e9] if arguments.times is None else times_of(arguments.times)
        for tick in bag.at(times_s):
            handles = handles_of(arguments.handles, len(tick.handles_m) - 1)
            velocity = np.full_like(tick.handles_m, np.nan) if tick.velocity_m_s is None else tick.velocity_m_s
            out += _rows([tick.t_ns / 1e9], handles, tick.handles_m[None], velocity[None])
        if not out:
            raise dr.InputError(f'{arguments.bag}: it has no tick at or after the given --times; the bag ends at '
                                f'{bag.reader.end_ns / 1e9:.9f} s')
    return out


def _text(rows: list[Row]) -> str:
    head = f'{"t_s":>12} {"handle":>6}' + ''.join(f' {name:>15}' for name in COLUMNS[2:])
    return '\n'.join([head, *(f'{row[0]:12.6f} {row[1]:6d}' + ''.join(f' {value:15.9f}' for value in row[2:])
                              for row in rows)])


def _csv(rows: list[Row]) -> str:
    return command_line.csv_of(COLUMNS, rows).rstrip('\n')


def _json(rows: list[Row]) -> str:
    return json.dumps([dict(zip(COLUMNS, (None if value != value else value for value in row), strict=True))
                       for row in rows])


def _xlsx(rows: list[Row]) -> bytes:
    from dragon_ros.cli.workbook import xlsx_of  # openpyxl is an optional extra
    return xlsx_of(COLUMNS, rows)


_FORMATS: dict[str, Callable[[list[Row]], str | bytes]] = {'text': _text, 'csv': _csv, 'json': _json, 'xlsx': _xlsx}
