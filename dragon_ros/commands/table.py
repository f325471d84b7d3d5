"""``table``: print positions and velocities of handles at given times."""
import json
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from dragon_ros.cli import command_line
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import handles_of, times_of
from dragon_ros.core.batches import batches
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.tracks.spec import STurn
from dragon_ros.guests import installed

if TYPE_CHECKING:       # imported lazily, because a table of a scene needs no bag reader
    from dragon_ros.bags.read.frames import BagFrame
    from dragon_ros.bags.read.reader import BagReader

COLUMNS = ('t_s', 'handle', 'x_m', 'y_m', 'vx_m_s', 'vy_m_s', 'speed_m_s')
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


def run(arguments: Namespace) -> int:
    """Print the requested tables; return the exit code."""
    _check(arguments)
    if arguments.paper or arguments.contest:
        from importlib import import_module
        guest = installed()['table --paper' if arguments.paper else 'table --contest']
        code: int = import_module(guest.module).run(arguments)
        return code
    if arguments.bag:
        rows = _bag_rows(arguments)
    else:
        scene = command_line.scene_from(arguments)
        handles = handles_of(arguments.handles, scene.dragon.benches)
        times_s = times_of('0' if arguments.times is None else arguments.times)
        _check_not_before_start(scene, times_s)
        with Progress('table', 'times', len(times_s)) as bar:
            rows = table(scene, times_s, handles, bar.update)
    command_line.write_output(arguments.output, _FORMATS[arguments.format](rows))
    return command_line.OK


def _check_not_before_start(scene: Scene, times_s: list[float]) -> None:
    if min(times_s) < 0:
        turn = f'; the head enters the turn at {scene.track.before_m / scene.head.speed_m_s:g} s' if (
            isinstance(scene.track, STurn) and isinstance(scene.head, Head)) else ''
        raise InputError(f'--times {min(times_s):g}: times of a scene begin at 0 s{turn}; add the difference',
                         field='times')


def table(scene: Scene, times_s: list[float], handles: list[int],
          progress: Callable[[int], object] = lambda times: None) -> list[Row]:
    """Return a row of COLUMNS for each time and handle.

    ``progress`` is called with the number of newly completed times.
    """
    rows: list[Row] = []
    for some in batches(scene, times_s):
        p, velocity = some.handles_m[:, handles], some.velocity_m_s[:, handles]
        block = np.concatenate((p, velocity, np.hypot(velocity[..., :1], velocity[..., 1:])), axis=-1).tolist()
        rows += [(t_s, handle, *values) for t_s, group in zip(some.t_s.tolist(), block, strict=True)
                 for handle, values in zip(handles, group, strict=True)]
        progress(len(block))
    return rows


def _bag_rows(arguments: Namespace) -> list[Row]:
    """Return the rows of a bag in the same form as the rows of a scene; missing velocities are nan."""
    from dragon_ros.bags.read.frames import namespace_of
    from dragon_ros.bags.read.reader import BagReader
    out: list[Row] = []
    command_line.check_is_bag(arguments.bag)
    with BagReader(arguments.bag) as bag:
        times_s = [bag.start_ns / NS] if arguments.times is None else times_of(arguments.times)
        for frame in at_times(bag, namespace_of(bag, arguments.namespace), times_s):
            handles = handles_of(arguments.handles, len(frame.handles_m) - 1)
            values = values_of(frame, handles).tolist()
            out += [(frame.t_ns / NS, handle, *row) for handle, row in zip(handles, values, strict=True)]
    if not out:
        raise InputError(f'{arguments.bag}: it has no tick at or after the given --times; the bag ends at '
                         f'{bag.end_ns / NS:.9f} s')
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


def values_of(frame: 'BagFrame', handles: list[int]) -> Floats:
    """Return an array (handles, 5) of x and y (m) and vx, vy and speed (m/s); missing velocities are nan."""
    out = np.full((len(handles), 5), np.nan)
    out[:, :2] = frame.handles_m[handles]
    if frame.velocity_m_s is not None:
        out[:, 2:4] = frame.velocity_m_s[handles]
        out[:, 4] = np.hypot(out[:, 2], out[:, 3])
    return out


def at_times(bag: 'BagReader', namespace: str, times_s: Iterable[float]) -> Iterator['BagFrame']:
    """For each time up to the last tick, yield the first tick in the bag at or after that time."""
    from dragon_ros.bags.read.frames import frames
    for t_s in times_s:
        frame = next(frames(bag, namespace, max(0, round(t_s * NS))), None)
        if frame is not None:
            yield frame
