"""``inspect``: what is in a bag and how far it can be trusted; checks it against the model, or repairs it."""
import json
from argparse import Namespace
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from dragon_ros.bags.check.compare import Comparison, compare_with_model
from dragon_ros.bags.check.examine import Contents, examine
from dragon_ros.bags.check.gaps import gaps_of
from dragon_ros.bags.check.repair import repair
from dragon_ros.bags.read.folder import files_of
from dragon_ros.bags.read.frames import namespace_of, scene_of_bag
from dragon_ros.bags.read.reader import LogReader
from dragon_ros.bags.read.records import BagError
from dragon_ros.cli import command_line
from dragon_ros.commands.contacts_in_bag import clearance_in, first_contact_in
from dragon_ros.commands.inspect_text import bag_text, check_text, repair_text
from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS
from dragon_ros.scenes.load import scene_values
from dragon_ros.scenes.provenance import RECORD


def main(argv: list[str]) -> int:
    """Inspect, check or repair; return the exit code (1 where something is wrong with the bag)."""
    options = command_line.parser('inspect', 'Tell what is in a bag: topics, rates, missing ticks, scene, first '
                                  'contact, clearance, integrity.', 'python -m dragon_ros inspect run.mcap --check')
    options.add_argument('bag', type=Path, metavar='BAG', help='an .mcap file or a rosbag2 folder')
    options.add_argument('--check', action='store_true', help='recompute every tick from the scene in the bag and '
                         'compare bit for bit, or where bits differ to the promise of its tier')
    options.add_argument('--repair', type=Path, metavar='OUT', help='write what can be read as a whole bag')
    options.add_argument('--looks', type=int, default=200, metavar='N',
                         help='look at so many ticks for the clearance, spread evenly; 0: at all (200)')
    command_line.add_namespace_option(options)
    command_line.add_output_options(options, ('text', 'json'))
    return command_line.guarded('inspect', partial(_run, options.parse_args(argv)))


def _run(arguments: Namespace) -> int:
    if arguments.looks < 0:
        raise InputError(f'--looks {arguments.looks}: give 0 (all ticks) or more', field='looks')
    body = _repair if arguments.repair else _check if arguments.check else _inspect
    values, code = body(arguments)
    text = json.dumps(values) if arguments.format == 'json' else _TEXT[body](values)
    command_line.write_output(arguments.output, text)
    return code


def _inspect(arguments: Namespace) -> tuple[dict[str, Any], int]:
    contents = _examined(arguments.bag)
    if arguments.namespace is not None:
        with LogReader(arguments.bag, bool(contents.problems.count)) as bag:
            namespace_of(bag, arguments.namespace)
    values: dict[str, Any] = {
        'bag': str(arguments.bag), 'files': [path.name for path in contents.files], 'bytes': contents.size,
        'written_by': contents.writers, 'chunks': contents.compressions, 'problems': contents.problems.lines,
        'problem_count': contents.problems.count, 'notes': contents.notes.lines, 'about': {}, 'scene': None}
    try:
        values.update(_dragon(arguments))
    except DragonError as error:
        values['unread'] = str(error)
        if isinstance(error, BagError):
            with suppress(DragonError):
                values.update(_dragon(arguments, damaged=True))
    values['topics'] = _topics(contents, values.pop('run', None))
    return values, command_line.FAILED if contents.problems.count else command_line.OK


def _examined(path: Path) -> Contents:
    total = sum(each.stat().st_size for each in files_of(path) if each.exists())
    with tqdm(desc='read', total=total, unit='B', unit_scale=True, disable=None, leave=False, delay=1) as bar:
        return examine(path, bar.update)


def _dragon(arguments: Namespace, damaged: bool = False) -> dict[str, Any]:
    """Return what the bag, or what still holds of a damaged one, tells of its dragon."""
    with LogReader(arguments.bag, damaged) as bag:
        return _told(bag, arguments)


def _told(bag: LogReader, arguments: Namespace) -> dict[str, Any]:
    scene = scene_of_bag(bag)
    about = {key: value for key, value in bag.metadata(RECORD).items() if key != 'scene'}
    out: dict[str, Any] = {'about': about, 'scene': scene_values(scene) if scene else None,
                           'run': scene.run if scene else None}
    if bag.empty:
        return out
    out |= {'start_s': bag.start_ns / NS, 'end_s': bag.end_ns / NS}
    try:
        namespace = namespace_of(bag, arguments.namespace)
    except InputError:
        return out
    return {**out, 'namespace': namespace, 'first_contact': first_contact_in(bag, namespace, scene),
            'clearance': asdict(clearance_in(bag, namespace, arguments.looks))}


def _topics(contents: Contents, run: Any) -> list[dict[str, Any]]:
    out = []
    for name, seen in contents.topics.items():
        gaps = gaps_of(seen.times_ns, run)
        out.append({'topic': name, 'type': seen.type, 'messages': seen.messages, 'bytes': seen.size,
                    'rate_hz': gaps.rate_hz, 'first_tick': gaps.first, 'last_tick': gaps.last,
                    'missing': gaps.missing, 'doubled': gaps.doubled, 'missing_ranges': gaps.ranges})
    return out


def _check(arguments: Namespace) -> tuple[dict[str, Any], int]:
    with LogReader(arguments.bag) as bag:
        scene = scene_of_bag(bag)
        if scene is None:
            raise BagError(f'{arguments.bag}: says of no scene what it holds (metadata record {RECORD}, key scene); '
                           'it cannot be recomputed')
        namespace = namespace_of(bag, arguments.namespace)
        frame_id = bag.metadata(RECORD).get('about.frame_id', 'dragon')
        with tqdm(desc='check', total=compile_scene(scene).last_tick + 1, unit=' ticks', disable=None, leave=False, delay=1) as bar:
            found = compare_with_model(bag, scene, namespace, lambda k: bar.update(k + 1 - bar.n), frame_id)
    code = command_line.FAILED if found.fault_count else command_line.OK
    return _verdict(arguments.bag, found, compile_scene(scene).tier.name), code


def _verdict(path: Path, found: Comparison, tier: str) -> dict[str, Any]:
    return {'bag': str(path), 'equal': found.equal, 'close': found.close, 'worst_m': found.worst_m, 'tier': tier,
            'fault_count': found.fault_count, 'faults': found.faults}


def _repair(arguments: Namespace) -> tuple[dict[str, Any], int]:
    total = sum(each.stat().st_size for each in files_of(arguments.bag) if each.exists())
    with tqdm(desc='repair', total=total, unit='B', unit_scale=True, disable=None, leave=False, delay=1) as bar:
        done = repair(arguments.bag, arguments.repair, bar.update)
    values = {'bag': str(arguments.bag), 'repaired': str(arguments.repair), 'messages': done.messages,
              'lost_count': done.lost.count, 'lost': done.lost.lines}
    return values, command_line.OK


_TEXT: dict[Callable[[Namespace], tuple[dict[str, Any], int]], Callable[[dict[str, Any]], str]] = {
    _inspect: bag_text, _check: check_text, _repair: repair_text}
