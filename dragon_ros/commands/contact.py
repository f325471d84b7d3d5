"""``contact``: find the first contact of a scene."""
import argparse
import json
import os
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.inputs import counted, number
from dragon_ros.cli.progress import Progress

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
        raise dr.InputError('--within: the proof for a family of dragons was removed in 0.4.0; use ./dragon study '
                         'tolerances, which answers by samples with a stated confidence')
    if arguments.verify is not None:
        if arguments.output is not None and arguments.format != 'text':
            raise dr.InputError(f'--output {arguments.output}: --verify writes only text; give a name that ends in '
                                '.txt')
        given = {f'--{name}': getattr(arguments, name.replace('-', '_')) is not None
                 for name in ('accuracy', 'namespace', 'near-misses', 'certificate')}
        given |= {'--scene': command_line.names_scene(arguments), '--set': bool(arguments.overrides),
                  '--trust': arguments.trust, '--format': arguments.format != 'text', 'BAG': arguments.bag is not None}
        command_line.check_taken('--verify', given, set())
    elif arguments.effort is not None:
        raise dr.InputError('--effort: it requires --verify; add --verify, or omit --effort')
    if arguments.near_misses is not None:
        number('--near-misses', arguments.near_misses, above=0.0)
    if None not in (arguments.certificate, arguments.output) and (
            os.path.realpath(arguments.certificate) == os.path.realpath(arguments.output)):
        raise dr.InputError(f'--output {arguments.output}: the certificate is written to this file; give another file')
    if arguments.near_misses is not None and arguments.format == 'csv':
        raise dr.InputError('--near-misses: --format csv contains only the contact; use text or json')


def _run(arguments: Namespace) -> int:
    _check(arguments)
    if arguments.verify is not None:
        return _verify(arguments.verify, arguments.effort, arguments.output)
    command_line.check_keeps('--certificate', arguments.certificate, arguments.bag, arguments.scene)
    scene, lack, touch = _scene_of(arguments)
    run, start = dr.compile(scene), time.perf_counter()
    with Progress('contact', 'states') as bar:
        found = run.contact(progress=bar.update)
    values = values_of(found)
    if values['t_s'] is None and lack:
        values |= {'certified': False, **lack}
    if touch is not None:
        values['recorded_obstacles'] = touch
    values['stats'] = {'elapsed_s': time.perf_counter() - start, 'states': found.states}
    if arguments.near_misses is not None:
        with Progress('near misses', 'states') as bar:
            near = run.near_misses(arguments.near_misses, contact=found, progress=bar.update)
        values['near_misses'] = [{'bench': miss.bench, 'benches': list(miss.benches), 'obstacle': miss.obstacle,
                                  't_s': miss.t_s, 'gap_m': miss.gap_m} for miss in near.nearest]
        values |= {'near_misses_count': near.count, 'near_misses_are': 'sampled and refined'}
    if arguments.certificate and 'unsearched' in values:
        command_line.note(f'contact: no certificate is written: {values["unsearched"]}')
    elif arguments.certificate:
        command_line.write_output(arguments.certificate, json.dumps(run.certificate(found)), '--certificate')
    command_line.write_output(arguments.output, _FORMATS[arguments.format](values, found))
    return command_line.INCOMPLETE if 'unsearched' in values else command_line.OK


def _scene_of(arguments: Namespace) -> 'tuple[dr.Scene, dict[str, Any], dict[str, Any] | None]':
    """Return the scene to search, what a bag lacks for a complete search, and a recorded contact with obstacles."""
    if not arguments.bag:
        if arguments.namespace is not None or arguments.trust:
            option = '--trust' if arguments.trust else '--namespace'
            raise dr.InputError(f'{option}: it requires a BAG; omit {option} for a scene')
        return command_line.scene_from(arguments), {}, None
    if command_line.gives_scene(arguments):
        raise dr.InputError('BAG: a bag contains its own scene; omit --scene, --set and --accuracy')
    command_line.check_is_bag(arguments.bag)
    with dr.read_bag(arguments.bag, arguments.namespace, arguments.trust) as bag:
        walk = bag.walk
        if walk is None:
            raise dr.InputError(f'{arguments.bag}: it does not contain its scene; record it with dragon_ros, or give '
                                '--scene')
        lack = {'examined_s': walk.examined_s, 'recorded_s': walk.recorded_s, 'unsearched': walk.lack}
        return walk.scene, lack if walk.lack else {}, _obstacle_touch(bag)


def _obstacle_touch(bag: 'dr.Bag') -> dict[str, Any] | None:
    """Return the first recorded contact with the obstacles that a monitor read from a file or a map.

    These obstacles are not in the bag's scene. The result is None if there are none, and has the time None if none of
    them is touched before benches touch each other. A sentence about them goes to standard error.
    """
    topic = f'{bag.namespace}/collision/obstacles'
    if not any(row.name == topic and row.messages for row in bag.reader.topics):
        return None
    said = f"contact: the obstacles on {topic} are not in the bag's scene: "
    try:
        with Progress('obstacles', 'ticks') as bar:
            touch = bag.first_touch(bar.update)
    except dr.InputError as error:
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
    options = [] if effort is None else [f'--effort={effort}']
    done = subprocess.run([sys.executable, '-m', 'dragon_ros.verify', certificate_file, *options],
                          stdout=subprocess.PIPE, text=True, errors='surrogateescape',
                          check=False)      # the name of the file may not be UTF-8
    if done.stdout:
        command_line.write_output(output, done.stdout.rstrip('\n'))
    return done.returncode


def values_of(found: 'dr.Contact | dr.NoContact') -> dict[str, Any]:
    """Return the result as plain values."""
    if not found:
        end = found.end
        return {'t_s': None, 'end': end.reason, 't_end_s': end.t_s, 'link': end.link,
                'certified': found.certificate.complete}
    seen, obstacle = found.witness, None
    features: dict[str, Any] = {'bench': seen.owner, 'corner': seen.corner, 'other': seen.other, 'edge': seen.edge}
    if found.obstacle:
        features |= {key: None for key in ('bench', 'other') if features[key] not in found.benches}
        obstacle = {'name': found.obstacle.name, 'edge_m': [list(end) for end in found.obstacle.edge_m],
                    'corner_m': list(found.obstacle.corner_m) if found.obstacle.corner_m else None}
    return {'t_s': found.t_s, 'benches': list(found.benches), 'obstacle': obstacle, 'point_m': list(found.point_m),
            'features': features,
            'grazing_m': list(found.grazing_m) if found.grazing_m else None,
            'simultaneous': [list(pair) for pair in found.simultaneous], 'approach_m_s': found.approach_m_s,
            'uncertainty_s': found.uncertainty_s if isfinite(found.uncertainty_s) else None,
            'certified': found.certificate.complete}


def _text(values: dict[str, Any], found: 'dr.Contact | dr.NoContact') -> str:
    stats = f'{counted(values["stats"]["states"], "state")} in {values["stats"]["elapsed_s"]:.3f} s'
    stats += '' if values['certified'] else ', without a certificate'
    return f'{_found(values, found)} ({stats}){_misses(values)}'


def _found(values: dict[str, Any], found: 'dr.Contact | dr.NoContact') -> str:
    if not found:
        said = values.get('unsearched', f'{found.end.words} at {found.end.t_s:.9f} s')
        return f'no contact; {said}'
    x, y = values['point_m']
    kind = 'grazing, first' if values['grazing_m'] else 'first contact'
    return f'{kind} at {values["t_s"]:.12g} s: {found.between}, at ({x:.9f}, {y:.9f}) m'


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


def _csv(values: dict[str, Any], _: 'dr.Contact | dr.NoContact') -> str:
    inner, outer = (*values.get('benches', ('', '')), '')[:2]
    x, y = values.get('point_m', ('', ''))
    obstacle = (values.get('obstacle') or {}).get('name')
    cells = (values['t_s'], inner, outer, x, y, values.get('end'), values.get('t_end_s'), obstacle)
    return command_line.csv_of(_COLUMNS, [cells]).rstrip('\n')


_FORMATS: dict[str, Callable[[dict[str, Any], Any], str]] = {
    'text': _text, 'csv': _csv, 'json': lambda values, _: json.dumps(values)}
