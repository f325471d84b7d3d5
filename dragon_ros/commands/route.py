"""``route``: make a scene whose track follows a drawing, with a table of its pieces and of all changes."""
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from dragon_ros.cli import command_line
from dragon_ros.commands.drawn_scene import DrawnScene, drawn_scene
from dragon_ros.core.errors import TrackEndError
from dragon_ros.core.words import counted

if TYPE_CHECKING:
    from dragon_ros.core.tracks.drawn import Change

_SHOWN_PIECES, _SHOWN_CHANGES = 12, 8      # on the terminal; --table has all


def run(arguments: Namespace) -> int:
    """Make a scene from a drawing; return the exit code."""
    for option in ('output', 'table'):
        command_line.check_keeps(f'--{option}', getattr(arguments, option), arguments.drawing, arguments.obstacles)
    drawn = drawn_scene(arguments)
    command_line.write_output(None, '\n'.join(summary(drawn)))
    if arguments.table is not None:
        lines = [*_rows(drawn), '', *_notes(drawn, len(drawn.route.changes))]
        command_line.write_output(arguments.table, '\n'.join(lines), '--table')
        command_line.write_output(None, f'written: {arguments.table}')
    if arguments.output is not None:
        write_scene(arguments, drawn, arguments.output)
        command_line.write_output(None, f'written: {arguments.output}')
    return command_line.OK


def write_scene(arguments: Namespace, drawn: DrawnScene, path: Path) -> None:
    """Write the scene as a YAML file that lists the drawing and the options under ``about``."""
    from dragon_ros.scenes.provenance import differing_scene_file
    about = {'drawing': str(arguments.drawing or arguments.topic), 'path': drawn.line.name,
             'tolerance': drawn.tolerance_m, **{key: str(value) if isinstance(value, Path) else value
                for key in ('obstacles', 'scale', 'unit', 'reverse', 'frame_pose')
                if (value := getattr(arguments, key, None))}, 'radius': drawn.radius_m}
    command_line.write_output(path, differing_scene_file(drawn.scene, about).rstrip('\n'))


def summary(drawn: DrawnScene) -> list[str]:
    """Return the table of pieces, if it is short, and the notes with the largest changes, in about a screenful."""
    rows = _rows(drawn)
    shown = [*rows, ''] if len(rows) <= _SHOWN_PIECES + 1 else []
    notes = _notes(drawn, _SHOWN_CHANGES)
    return [*shown, *notes, *([] if shown else ['the table of all pieces and changes: --table FILE'])]


def _rows(drawn: DrawnScene) -> list[str]:
    """Return the table of pieces."""
    rows = [f'{"piece":<10} {"length m":>10} {"radius m":>10} {"turn":>14}   begins at m']
    for number, (segment, piece) in enumerate(zip(drawn.track.segments, drawn.route.pieces, strict=True), 1):
        first = segment.after(0.0)
        at = complex(segment.at(first))
        length_m = float(segment.metres_between(first, segment.last))
        radius_m, angle = getattr(piece, 'radius_m', None), getattr(piece, 'angle_deg', 0.0)
        turn = f'{abs(angle):.2f}° {"left" if angle > 0 else "right"}' if radius_m else ''
        rows.append(f'{number:<4} {"arc" if radius_m else "line":<5} {length_m:10.3f} '
                    f'{"" if radius_m is None else f"{radius_m:.3f}":>10} {turn:>14}   ({at.real:.3f}, {at.imag:.3f})')
    return rows


def _notes(laid: DrawnScene, most: int) -> list[str]:
    """Return the notes on the track, with at most so many changes, the largest first."""
    route, track = laid.route, laid.track
    arcs = sum(hasattr(piece, 'radius_m') for piece in route.pieces)
    changes = sorted(route.changes, key=lambda change: -change.off_m) if len(route.changes) > most else route.changes
    notes = [*laid.notes, f'{laid.line.name}: {track.end_m - route.lead_in_m:.3f} m, '
             f'{counted(len(route.pieces), "piece")} ({counted(arcs, "arc")})',
             laid.deviation, _tightest(laid), *map(_changed, changes[:most])]
    if len(changes) > most:
        notes.append(f'changed: {counted(len(changes) - most, "more place")}, by up to {changes[most].off_m:.3g} m')
    if route.lead_in_m:
        notes.append(f'changed: the drawing starts with a bend, so a line of {route.lead_in_m:g} m was added before '
                     'the bend')
    return [*notes, _start(laid)]


def _tightest(laid: DrawnScene) -> str:
    if not laid.track.bend:
        return 'the track has no bends'
    k = max(range(len(laid.track.segments)), key=lambda k: laid.track.segments[k].bend)
    at = complex(laid.track.segments[k].at(laid.track.segments[k].after(0.0)))
    return (f'the tightest bend has a radius of {1 / laid.track.bend:.4g} m: piece {k + 1} at ({at.real:.3f}, '
            f'{at.imag:.3f}) m; the smallest radius that these benches can walk is {laid.least_m:.4g} m')


def _changed(change: 'Change') -> str:
    x, y = change.place_m
    what = 'the corner' if change.is_corner else 'the bend'
    return (f'changed: {what} at ({x:.3f}, {y:.3f}) m now has a radius of {change.radius_m:.4g} m and deviates by up '
            f'to {change.off_m:.3g} m from the drawing')


def _start(laid: DrawnScene) -> str:
    from dragon_ros.core.chain.leader import head_in_front_m
    start_m = laid.scene.track.start_m - laid.route.lead_in_m
    walked_m = laid.track.end_m - laid.route.lead_in_m - start_m
    text = f'the head starts {start_m:.3f} m along the drawing and walks {walked_m:.3f} m'
    try:
        whole_m = head_in_front_m(laid.track, laid.scene.dragon.link_lengths_m, laid.route.lead_in_m)
    except TrackEndError:
        whole_m = float('inf')
    if start_m + laid.route.lead_in_m >= whole_m - 1e-6:
        return f'{text}; the whole dragon is on the drawing'
    return f'{text}; the rest of the dragon is on a straight line before the drawing'
