"""``contact``: find the first contact of a scene."""
import argparse
import json
import os
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dragon_ros.cli import command_line
from dragon_ros.cli.progress import Progress
from dragon_ros.core.checks import number
from dragon_ros.core.errors import InputError
from dragon_ros.core.words import counted

if TYPE_CHECKING:       # --verify must not import the solver
    from dragon_ros.bags.read.frames import Walk
    from dragon_ros.core.scene import Scene
    from dragon_ros.core.search.certificate import Contact, NoContact

_COLUMNS = ('t_s', 'inner', 'outer', 'x_m', 'y_m', 'end', 't_end_s', 'obstacle')


def main(argv: list[str]) -> int:
    """Print the first contact; return the exit code."""
    options = command_line.parser('contact', 'Find the first contact between two benches that are not neighbours '
                                  'in the chain, or between a bench and an obstacle of the venue.',
                                  'contact --scene winding --format json')
    command_line.add_bag(options, 'bag whose scene is searched, including the recorded walk of a led dragon '
                         '(incompatible with scene options)')
    command_line.add_scene_options(options)
    command_line.add_namespace_option(options)
    options.add_argument('--trust', action='store_true', help='search the scene in the bag even if it exceeds '
                         'the budgets (docs/limits.md)')
    options.add_argument('--near-misses', type=float, metavar='METRES',
                         help='also report near misses: gaps below this value between two benches, or between a bench '
                         'and an obstacle')
    options.add_argument('--within', help=argparse.SUPPRESS)       # removed in 0.4.0
    options.add_argument('--certificate', type=Path, metavar='FILE',
                         help='write the proof that no benches touch earlier, as JSON')
    options.add_argument('--verify', type=Path, metavar='FILE',
                         help="check a certificate without using the solver's code (incompatible with scene options)")
    options.add_argument('--effort', metavar='TIMES', help='with --verify: multiple of the usual budget (1); if it is '
                         'too small, the error names a sufficient multiple')
    command_line.add_output_options(options)
    return command_line.guarded('contact', partial(_run, options.parse_args(argv)))


def _check(arguments: Namespace) -> None:
    """Reject options that would be ignored."""
    if arguments.within is not None:
        raise InputError('--within: the proof for a family of dragons was removed in 0.4.0; use ./dragon study '
                         'tolerances, which answers by samples with a stated confidence')
    if arguments.verify is not None:
        if arguments.output is not None and arguments.format != 'text':
            raise InputError(f'--output {arguments.output}: --verify writes only text; give a name that ends in .txt')
        given = {f'--{name}': getattr(arguments, name.replace('-', '_')) is not None
                 for name in ('accuracy', 'namespace', 'near-misses', 'certificate')}
        given |= {'--scene': command_line.names_scene(arguments), '--set': bool(arguments.overrides),
                  '--trust': arguments.trust, '--format': arguments.format != 'text', 'BAG': arguments.bag is not None}
        command_line.check_taken('--verify', given, set())
    elif arguments.effort is not None:
        raise InputError('--effort: it requires --verify; add --verify, or omit --effort')
    if arguments.near_misses is not None:
        number('--near-misses', arguments.near_misses, above=0.0)
    if None not in (arguments.certificate, arguments.output) and (
            os.path.realpath(arguments.certificate) == os.path.realpath(arguments.output)):
        raise InputError(f'--output {arguments.output}: the certificate is written to this file; give another file')
    if arguments.near_misses is not None and arguments.format == 'csv':
        raise InputError('--near-misses: --format csv contains only the contact; use text or json')


def _run(arguments: Namespace) -> int:
    _check(arguments)
    if arguments.verify is not None:
        return _verify(arguments.verify, arguments.effort, arguments.output)
    command_line.check_keeps('--certificate', arguments.certificate, arguments.bag, arguments.scene)
    scene, walk = _scene_of(arguments)
    touch = _obstacle_touch(arguments)
    from dragon_ros.core.search.first_contact import first_contact
    start = time.perf_counter()
    with Progress('contact', 'states') as bar:
        found = first_contact(scene, bar.update)
    values = values_of(found)
    lack = walk.lack if walk and values['t_s'] is None else ''
    if walk and lack:
        values |= {'certified': False, 'examined_s': walk.examined_s, 'recorded_s': walk.recorded_s,
                   'unsearched': lack}
    if touch is not None:
        values['recorded_obstacles'] = touch
    values['stats'] = {'elapsed_s': time.perf_counter() - start, 'states': found.states}
    if arguments.near_misses is not None:
        from dragon_ros.core.search.near_misses import near_misses
        with Progress('near misses', 'states') as bar:
            near = near_misses(scene, found, arguments.near_misses, bar.update)
        values['near_misses'] = [{'bench': miss.bench, 'benches': list(miss.benches), 'obstacle': miss.obstacle,
                                  't_s': miss.t_s, 'gap_m': miss.gap_m} for miss in near.nearest]
        values |= {'near_misses_count': near.count, 'near_misses_are': 'sampled and refined'}
    if arguments.certificate and lack:
        command_line.note(f'contact: no certificate is written: {lack}')
    elif arguments.certificate:
        from dragon_ros.scenes import certificate
        command_line.write_output(arguments.certificate, json.dumps(certificate.as_values(scene, found)),
                                  '--certificate')
    command_line.write_output(arguments.output, _FORMATS[arguments.format](values))
    return command_line.INCOMPLETE if lack else command_line.OK


def _scene_of(arguments: Namespace) -> 'tuple[Scene, Walk | None]':
    """Return the scene to search, from the options or from a bag, and the walk in the bag."""
    if not arguments.bag:
        if arguments.namespace is not None or arguments.trust:
            option = '--trust' if arguments.trust else '--namespace'
            raise InputError(f'{option}: it requires a BAG; omit {option} for a scene')
        return command_line.scene_from(arguments), None
    if command_line.gives_scene(arguments):
        raise InputError('BAG: a bag contains its own scene; omit --scene, --set and --accuracy')
    from dragon_ros.bags.read.frames import namespace_of, scene_of_bag, walk_in
    from dragon_ros.bags.read.reader import BagReader
    command_line.check_is_bag(arguments.bag)
    with BagReader(arguments.bag) as bag:
        namespace = namespace_of(bag, arguments.namespace)
        scene = scene_of_bag(bag, namespace, arguments.trust)
        if scene is None:
            raise InputError(f'{arguments.bag}: it does not contain its scene; record it with dragon_ros, or give '
                             '--scene')
        walk = walk_in(bag, scene, namespace)
        return walk.scene, walk


def _obstacle_touch(arguments: Namespace) -> dict[str, Any] | None:
    """Return the first recorded contact with the obstacles that a monitor read from a file or a map.

    These obstacles are not in the bag's scene. The result is None if there are none, and has the time None if none of
    them is touched before benches touch each other. A sentence about them goes to standard error.
    """
    if not arguments.bag:
        return None
    from dragon_ros.bags.read.frames import namespace_of
    from dragon_ros.bags.read.reader import BagReader
    from dragon_ros.commands.sources import dragon_in
    with BagReader(arguments.bag) as bag:
        namespace = namespace_of(bag, arguments.namespace)
        topic = f'{namespace}/collision/obstacles'
        if not any(row.name == topic and row.messages for row in bag.topics):
            return None
        said = f"contact: the obstacles on {topic} are not in the bag's scene: "
        try:
            touch = dragon_in(bag, namespace).first_touch(Progress('obstacles', 'ticks'))
        except InputError as error:
            command_line.note(f'{said}not examined, because {error}')
            return None
    if touch is None or touch.obstacle is None:
        command_line.note(f'{said}in the recorded ticks, no bench touches an obstacle'
                          f'{"" if touch is None else f" before benches touch each other at {touch.t_s:.9f} s"}')
        return {'t_s': None}
    command_line.note(f'{said}in the recorded ticks, {touch.words} at {touch.t_s:.9f} s')
    return {'t_s': touch.t_s, 'bench': touch.benches[0], 'obstacle': touch.obstacle, 'point_m': list(touch.point_m)}


def _verify(certificate_file: Path, effort: str | None, output: Path | None) -> int:
    """Check a certificate in a process without the solver; progress and errors go to standard error."""
    import subprocess

    from dragon_ros.commands.checker import command
    done = subprocess.run(command(str(certificate_file), effort), stdout=subprocess.PIPE, text=True,
                          errors='surrogateescape', check=False)        # the name of the file may not be UTF-8
    if done.stdout:
        command_line.write_output(output, done.stdout.rstrip('\n'))
    return done.returncode


def values_of(found: 'Contact | NoContact') -> dict[str, Any]:
    """Return the result as plain values."""
    from dragon_ros.core.geometry.contacts import OBSTACLE
    from dragon_ros.core.search.certificate import NoContact
    if isinstance(found, NoContact):
        end = found.end
        return {'t_s': None, 'end': end.reason, 't_end_s': end.t_s, 'link': end.link,
                'certified': found.certificate.complete}
    seen = found.witness
    features: dict[str, Any] = {'bench': seen.owner, 'corner': seen.corner, 'other': seen.other, 'edge': seen.edge}
    obstacle = None
    if found.obstacle:
        features |= {key: None for key in ('bench', 'other') if features[key] == OBSTACLE}
        obstacle = {'name': found.obstacle.name, 'edge_m': [list(end) for end in found.obstacle.edge_m],
                    'corner_m': list(found.obstacle.corner_m) if found.obstacle.corner_m else None}
    return {'t_s': found.t_s, 'benches': list(found.benches), 'obstacle': obstacle, 'point_m': list(found.point_m),
            'features': features,
            'grazing_m': list(found.grazing_m) if found.grazing_m else None,
            'simultaneous': [list(pair) for pair in found.simultaneous], 'approach_m_s': found.approach_m_s,
            'uncertainty_s': found.uncertainty_s if isfinite(found.uncertainty_s) else None,
            'certified': found.certificate.complete}


def _text(values: dict[str, Any]) -> str:
    stats = f'{counted(values["stats"]["states"], "state")} in {values["stats"]["elapsed_s"]:.3f} s'
    stats += '' if values['certified'] else ', without a certificate'
    return f'{_found(values)} ({stats}){_misses(values)}'


def _found(values: dict[str, Any]) -> str:
    if values['t_s'] is None:
        from dragon_ros.core.model import End
        end = End(values['t_end_s'], values['end'], values['link'])
        said = values.get('unsearched', f'{end.words} at {end.t_s:.9f} s')
        return f'no contact; {said}'
    x, y = values['point_m']
    what = (f'bench {values["benches"][0]} and obstacle {values["obstacle"]["name"]!r}' if values['obstacle'] else
            f'benches {values["benches"][0]} and {values["benches"][1]}')
    kind = 'grazing, first' if values['grazing_m'] else 'first contact'
    return f'{kind} at {values["t_s"]:.12g} s: {what}, at ({x:.9f}, {y:.9f}) m'


def _misses(values: dict[str, Any]) -> str:
    """Return a line for each near miss; if they were requested and there are none, a line that says so."""
    if 'near_misses' not in values:
        return ''
    shown = values['near_misses']
    lines = [f'near miss (sampled) of bench {miss["benches"][0]} and {_other(miss)}: {miss["gap_m"] * 1e3:.6f} mm '
             f'at {miss["t_s"]:.5f} s' for miss in shown]
    if (count := values['near_misses_count']) > len(shown):
        lines.append(f'and {count - len(shown)} more near misses with larger gaps')
    return ''.join(f'\n  {line}' for line in lines or ['no near misses (sampled)'])


def _other(miss: dict[str, Any]) -> str:
    """Return the name of the bench or obstacle that a bench nearly touches."""
    return str(miss['bench']) if miss['obstacle'] is None else f'obstacle {miss["obstacle"]!r}'


def _csv(values: dict[str, Any]) -> str:
    inner, outer = (*values.get('benches', ('', '')), '')[:2]
    x, y = values.get('point_m', ('', ''))
    obstacle = (values.get('obstacle') or {}).get('name')
    cells = (values['t_s'], inner, outer, x, y, values.get('end'), values.get('t_end_s'), obstacle)
    return command_line.csv_of(_COLUMNS, [cells]).rstrip('\n')


_FORMATS: dict[str, Callable[[dict[str, Any]], str]] = {'text': _text, 'csv': _csv, 'json': json.dumps}
