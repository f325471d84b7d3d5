"""``inspect``: summarise a bag, check it against the model, or repair it."""
import json
from argparse import Namespace
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dragon_ros.bags.check.examine import Contents, examine, gaps_of
from dragon_ros.bags.read.folder import files_of
from dragon_ros.bags.read.frames import (
    ends_in_contact,
    frame_of_bag,
    log_times_are_ticks,
    namespace_of,
    scene_of_bag,
    walk_in,
)
from dragon_ros.bags.read.mcap import BagError
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cli import command_line
from dragon_ros.cli.pool import Pool
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.contacts_in_bag import clearance_in, end_in_contact, first_contact_in
from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS
from dragon_ros.core.words import counted
from dragon_ros.messages.channels import channel_of
from dragon_ros.scenes.load import scene_values
from dragon_ros.scenes.provenance import RECORD

if TYPE_CHECKING:       # modules for checking and repairing are imported lazily
    from dragon_ros.bags.check.compare import Comparison

_SHOWN = 20     # largest number of faults shown
_STEPS = 8      # number of clearance values over time that are shown
_LOOKS = 200    # default number of ticks examined for the clearance
_TAKES: dict[str, set[str]] = {'--repair': set(), '--check': {'--check', '--trust', '--namespace', '--workers'},
                               'a summary': {'--trust', '--looks', '--namespace'}}


def run(arguments: Namespace) -> int:
    """Inspect, check or repair a bag; return the exit code."""
    what = '--repair' if arguments.repair is not None else '--check' if arguments.check else 'a summary'
    given = {'--check': arguments.check, '--trust': arguments.trust, '--looks': arguments.looks is not None,
             '--namespace': arguments.namespace is not None, '--workers': arguments.workers is not None}
    command_line.check_taken(what, given, _TAKES[what])
    if arguments.looks is None:
        arguments.looks = _LOOKS
    if arguments.looks < 0:
        raise InputError(f'--looks {arguments.looks}: give 0 (all ticks) or more', field='looks')
    body = {'--repair': _repair, '--check': _check, 'a summary': _inspect}[what]
    values, code = body(arguments)
    text = json.dumps(values) if arguments.format == 'json' else _TEXT[body](values)
    command_line.write_output(arguments.output, text)
    return code


def _inspect(arguments: Namespace) -> tuple[dict[str, Any], int]:
    contents = _examined(arguments.bag)
    if arguments.namespace is not None:
        with BagReader(arguments.bag, bool(contents.problems.count)) as bag:
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
    if contents.problems.count:
        return values, command_line.FAILED
    is_partial = 'unread' in values or 'unsearched' in values.get('first_contact', ())
    return values, command_line.INCOMPLETE if is_partial else command_line.OK


def _examined(path: Path) -> Contents:
    with _progress('read', path) as bar:
        return examine(path, bar.update)


def _progress(what: str, path: Path) -> Progress:
    """Return a progress bar that counts the bytes of a bag."""
    total = sum(each.stat().st_size for each in files_of(path) if each.exists())
    return Progress(what, 'B', total, unit_scale=True)


def _dragon(arguments: Namespace, damaged: bool = False) -> dict[str, Any]:
    """Return the data about the dragon in a bag, or in the intact part of a damaged bag."""
    with BagReader(arguments.bag, damaged) as bag:
        return _about_dragon(bag, arguments)


def _about_dragon(bag: BagReader, arguments: Namespace) -> dict[str, Any]:
    namespace = None
    with suppress(InputError):
        namespace = namespace_of(bag, arguments.namespace)
    scene = scene_of_bag(bag, namespace, arguments.trust)
    ticked = namespace is None or log_times_are_ticks(bag, namespace)
    about = {key: value for key, value in bag.metadata(RECORD).items() if key != 'scene'}
    out: dict[str, Any] = {'about': about, 'scene': scene_values(scene) if scene else None,
                           'run': scene.run if scene and ticked else None}
    if bag.empty:
        return out
    out |= {'start_s': bag.start_ns / NS, 'end_s': bag.end_ns / NS}
    if namespace is None:
        return out
    walk = walk_in(bag, scene, namespace) if scene else None
    return {**out, 'namespace': namespace, 'first_contact': first_contact_in(bag, namespace, walk, arguments.trust),
            'clearance': asdict(clearance_in(bag, namespace, arguments.looks))}


def _topics(contents: Contents, run: Any) -> list[dict[str, Any]]:
    out = []
    for name, seen in contents.topics.items():
        channel = channel_of(name)
        gaps = gaps_of(seen.times_ns, run, channel is not None and channel.each_tick)
        out.append({'topic': name, 'type': seen.type, 'messages': seen.messages, 'bytes': seen.size,
                    'rate_hz': gaps.rate_hz, 'first_tick': gaps.first, 'last_tick': gaps.last,
                    'missing': gaps.missing, 'doubled': gaps.doubled, 'missing_ranges': gaps.ranges,
                    'lengths_compared': seen.measured, 'lengths_not_compared_because': seen.unmeasured or None})
    return out


def _check(arguments: Namespace) -> tuple[dict[str, Any], int]:
    from dragon_ros.bags.check.compare import compare_with_model
    pool = Pool(arguments.workers)
    with BagReader(arguments.bag) as bag:
        namespace = namespace_of(bag, arguments.namespace)
        scene, frame_id = scene_of_bag(bag, namespace, arguments.trust), frame_of_bag(bag, namespace)
        if scene is None:
            raise BagError(f'{arguments.bag}: it cannot be recomputed without its scene (metadata record {RECORD}, key '
                           'scene, or the topic scene); record the topic scene')
        contact_s, proof = None, None
        if ends_in_contact(bag, namespace) and not scene.is_led:
            contact_s, proof = end_in_contact(bag, namespace, scene, arguments.trust)
        with Progress('check', 'ticks', compile_scene(scene).last_tick + 1) as bar:
            found = compare_with_model(bag, scene, namespace, lambda k: bar.reach(k + 1), frame_id, contact_s,
                                       pool.in_order)
    code = command_line.OK if found.passed else command_line.FAILED
    return {**_verdict(arguments.bag, found, scene.solver), 'end_proved': proof}, code


def _verdict(path: Path, found: 'Comparison', solver: str) -> dict[str, Any]:
    return {'bag': str(path), 'equal': found.equal, 'close': found.close, 'worst_m': found.worst_m, 'tier': solver,
            'other_version': found.other_version, 'other_kernel': found.other_kernel, 'fault_count': found.fault_count,
            'missing_count': found.missing_count, 'faults': found.faults, 'once': found.once, 'notes': found.notes,
            'unchecked': {name: {'messages': count, 'reason': why} for name, (count, why) in found.unchecked.items()}}


def _repair(arguments: Namespace) -> tuple[dict[str, Any], int]:
    from dragon_ros.bags.check.repair import repair
    with _progress('repair', arguments.bag) as bar:
        done = repair(arguments.bag, arguments.repair, bar.update)
    values = {'bag': str(arguments.bag), 'repaired': str(arguments.repair), 'messages': done.messages,
              'unsaved': done.unsaved, 'lost_count': done.lost.count, 'lost': done.lost.lines}
    return values, command_line.FAILED if done.unsaved else command_line.OK


def _bag_text(values: dict[str, Any]) -> str:
    """Return the result of an inspection as text."""
    chunks = ', '.join(f'{counted(count, "chunk")} in {name}' for name, count in values['chunks'].items())
    lines = [f'{values["bag"]}: {counted(len(values["files"]), "file")}, '
             f'{values["bytes"] / 1e6:.3f} MB, {chunks or "no chunks"}; '
             f'written by {", ".join(sorted(set(values["written_by"])))}']
    lines += _about_lines(values['about'])
    lines += _scene_lines(values['scene']) + _topic_lines(values['topics'])
    if 'start_s' in values:
        lines.append(f'  from {values["start_s"]:.9f} to {values["end_s"]:.9f} s')
    if 'namespace' in values:
        lines += [_contact_line(values['first_contact']), *_clearance_lines(values['clearance'])]
    return '\n'.join([*lines, *_integrity_lines(values)])


def _check_text(values: dict[str, Any]) -> str:
    """Return the result of a check as text."""
    line = f'{values["bag"]}: {counted(values["equal"], "message", "is")} bit-identical to the model'
    if values['close']:
        why = (f'version {values["other_version"]} made the bag, so the limit is twice the promise for all topics'
               if values['other_version'] else f'made with another kernel: {values["other_kernel"]}'
               if values['other_kernel'] else 'the bag does not name the version and kernel that made it')
        line += (f', {counted(values["close"], "", "is")} within the promise but not '
                 f'bit-identical (the largest difference is {values["worst_m"]:.3g} m: {why})')
    missing = values['missing_count']
    line += f', {counted(values["fault_count"] - missing, "", "is")} not' + (
        f'; {counted(missing, "", "is")} missing' if missing else '')
    lines = [line] + [f'  {note}' for note in values['notes']] + [f'  {fault}' for fault in values['faults'][:_SHOWN]]
    lines += _more(len(values['faults'][:_SHOWN]), len(values['faults']))
    if values['end_proved']:
        lines.append(f'  the certificate in the bag proves the end of the run: {values["end_proved"]}')
    if values['once']:
        lines.append(f'  scene and track: {counted(values["once"], "message", "matches")} the scene')
    return '\n'.join([*lines, *(f'  unchecked: {row["messages"]} of {name} ({row["reason"]})'
                                for name, row in values['unchecked'].items())])


def _repair_text(values: dict[str, Any]) -> str:
    """Return the result of a repair as text."""
    lines = [f'{values["repaired"]}: {counted(values["messages"], "message")} saved from {values["bag"]}']
    lines += [f'  {line}' for line in values['lost'][:_SHOWN]]
    return '\n'.join(lines + _more(len(values['lost'][:_SHOWN]), values['lost_count']))


def _more(shown: int, count: int) -> list[str]:
    return [f'  and {count - shown} more'] if count > shown else []


def _about_lines(about: dict[str, str]) -> list[str]:
    made = [f'{key.removeprefix("about.")} {value}' for key, value in about.items() if key.startswith('about.')]
    return [f'  made with {", ".join(made)}'] if made else []


def _scene_lines(scene: dict[str, Any] | None) -> list[str]:
    if scene is None:
        return ['  it contains no scene']
    dragon, track, run = scene['dragon'], scene['track'], scene['run']
    benches = dragon.get('benches') or sum(group['count'] for group in dragon['groups'])
    on = f'pitch {track["pitch_m"]:g} m' if 'pitch_m' in track else f'{counted(len(track["pieces"]), "piece")} of track'
    offset_s = run.get('stamp_offset_s', 0)
    later = f'; stamps are {offset_s!r} s later than the time of the simulation' if offset_s else ''
    of = counted(benches, 'mixed bench' if 'groups' in dragon else 'bench')
    return [f'  scene: {of}, {on}, {run["rate_hz"]:g} Hz from {run["start_s"]:g} s, accuracy {scene["accuracy"]}, '
            f'effects {", ".join(scene["effects"]) or "none"}'
            f'{later}']


def _topic_lines(topics: list[dict[str, Any]]) -> list[str]:
    head = f'  {"topic":<30} {"type":<36} {"messages":>9} {"MB":>9} {"Hz":>9}  ticks'
    return [head, *(f'  {row["topic"]:<30} {row["type"]:<36} {row["messages"]:>9} {row["bytes"] / 1e6:>9.3f} '
                    f'{_number(row["rate_hz"])}  {_ticks(row)}' for row in topics)]


def _number(value: float | None) -> str:
    return f'{"-":>9}' if value is None else f'{value:>9.3f}'


def _ticks(row: dict[str, Any]) -> str:
    if row['missing'] is None:
        return '-'
    line = f'{row["first_tick"]} to {row["last_tick"]}'
    if row['missing']:
        ranges = ', '.join(f'{a}' if a == b else f'{a} to {b}' for a, b in row['missing_ranges'])
        line += f', {row["missing"]} MISSING: {ranges}{", ..." if len(row["missing_ranges"]) == _SHOWN else ""}'
    return line + (f', {row["doubled"]} DOUBLED' if row['doubled'] else '')


def _contact_line(found: dict[str, Any]) -> str:
    source = {'collision': 'reported by the monitor', 'scene': 'recomputed from the scene'}.get(found['source'])
    if source is None:
        return '  first contact: unknown; the bag contains neither a scene nor a report'
    if 'unsearched' in found:
        return f'  first contact: unknown; {found["unsearched"]}'
    if found['t_s'] is None:
        return f'  no contact ({source})'
    where = '' if found['in_bag'] else ', which is not in this bag'
    what = (f'bench {found["benches"][0]} and obstacle {found["obstacle"]!r}' if found.get('obstacle') else
            f'benches {found["benches"][0]} and {found["benches"][1]}')
    return f'  first contact: {what} at {found["t_s"]:.9f} s{where} ({source})'


def _clearance_lines(found: dict[str, Any]) -> list[str]:
    rows = list(zip(found['t_s'], found['gap_m'], strict=True))
    examined = f'{found["looks"]} of {counted(found["ticks"], "tick")}'
    if not rows:
        return [f'  smallest clearance: none ({examined} examined)']
    t_s, gap = min(rows, key=lambda row: row[1])
    where = f'from the topic {found["source"]}' if found['source'] != 'benches' else f'{examined} examined'
    size = max(1, -(-len(rows) // _STEPS))
    parts = [min(rows[n:n + size], key=lambda row: row[1]) for n in range(0, len(rows), size)]
    over_time = ', '.join(f'{gap * 1e3:.3f} at {t:g} s' for t, gap in parts)
    return [f'  smallest clearance: {gap * 1e3:.6f} mm at {t_s:.9f} s ({where}); over time, in mm: {over_time}']


def _integrity_lines(values: dict[str, Any]) -> list[str]:
    lines = [f'  NOT READ: {values["unread"]}'] if 'unread' in values else []
    lines += [f'  {line}' for line in values['notes']] + _length_lines(values['topics'])
    count = values['problem_count']
    found = f'{counted(count, "problem")}' if count else 'every length, index and CRC is correct'
    lines.append(f'  integrity: {found}')
    return lines + [f'    {line}' for line in values['problems'][:_SHOWN]] + _more(
        len(values['problems'][:_SHOWN]), count)


def _length_lines(topics: list[dict[str, Any]]) -> list[str]:
    """Return lines that state how many messages' lengths were compared with their types, and why others were not."""
    compared = sum(row['lengths_compared'] for row in topics)
    return [f'  lengths: {counted(compared, "message", "was")} compared with their types',
            *(f'  lengths not compared: {row["messages"] - row["lengths_compared"]} of {row["topic"]} '
              f'({row["lengths_not_compared_because"]})' for row in topics if row['lengths_not_compared_because'])]


_TEXT: dict[Callable[[Namespace], tuple[dict[str, Any], int]], Callable[[dict[str, Any]], str]] = {
    _inspect: _bag_text, _check: _check_text, _repair: _repair_text}
