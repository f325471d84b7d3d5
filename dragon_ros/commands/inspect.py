"""``inspect``: summarise a bag, check it against the model, or repair it."""
import json
from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.inputs import counted
from dragon_ros.cli.progress import Progress

_SHOWN = 20     # largest number of faults shown
_STEPS = 8      # number of clearance values over time that are shown
_LOOKS = 200    # default number of ticks examined for the clearance
_TAKES: dict[str, set[str]] = {'--repair': set(), '--check': {'--check', '--trust', '--namespace', '--workers'},
                               'a summary': {'--trust', '--looks', '--namespace'}}


def main(argv: list[str]) -> int:
    """Inspect, check or repair a bag; return the exit code (1 if the bag has faults)."""
    options = command_line.parser('inspect', 'Summarise a bag: topics, rates, missing ticks, scene, first contact, '
                                  'clearance, integrity.', 'inspect run.mcap --check')
    command_line.add_bag(options, 'an .mcap file or a rosbag2 folder', required=True)
    options.add_argument('--check', action='store_true', help='recompute every tick from the scene in the bag, and '
                         'compare it bit for bit or, if bits differ, within the promise')
    options.add_argument('--trust', action='store_true', help='recompute the scene in the bag even if it '
                         'exceeds the budgets (docs/limits.md)')
    options.add_argument('--repair', type=Path, metavar='OUT', help='write all readable messages to a complete bag')
    options.add_argument('--looks', type=int, metavar='N', help='number of evenly spaced ticks at which the clearance '
                         'is computed; 0 means all ticks (200)')
    command_line.add_namespace_option(options)
    command_line.add_workers_option(options, 'result', ' of --check')
    command_line.add_output_options(options, ('text', 'json'))
    arguments = options.parse_args(argv)
    return command_line.guarded('inspect', partial(_run, arguments))


def _run(arguments: Namespace) -> int:
    """Inspect, check or repair a bag; return the exit code."""
    what = '--repair' if arguments.repair is not None else '--check' if arguments.check else 'a summary'
    given = {'--check': arguments.check, '--trust': arguments.trust, '--looks': arguments.looks is not None,
             '--namespace': arguments.namespace is not None, '--workers': arguments.workers is not None}
    command_line.check_taken(what, given, _TAKES[what])
    if arguments.looks is None:
        arguments.looks = _LOOKS
    if arguments.looks < 0:
        raise dr.InputError(f'--looks {arguments.looks}: give 0 (all ticks) or more', field='looks')
    body = {'--repair': _repair, '--check': _check, 'a summary': _inspect}[what]
    values, code = body(arguments)
    text = json.dumps(values) if arguments.format == 'json' else _TEXT[body](values)
    command_line.write_output(arguments.output, text)
    return code


def _inspect(arguments: Namespace) -> tuple[dict[str, Any], int]:
    from dataclasses import asdict
    with ExitStack() as stack:
        bars = {'bytes': _progress('read', arguments.bag), 'states': Progress('contact', 'states'),
                'ticks': Progress('clearance', 'ticks', arguments.looks or None)}
        for bar in bars.values():
            stack.enter_context(bar)
        found = dr.inspect_bag(arguments.bag, arguments.namespace, arguments.trust, looks=arguments.looks,
                               progress=lambda what, more: bars[what].update(more))
    contact = None if found.first_contact is None else {
        key: value for key, value in asdict(found.first_contact).items()
        if key in ('source', 't_s') or value not in (None, ())}
    contents = found.contents
    values: dict[str, Any] = {
        'bag': str(arguments.bag), 'files': [path.name for path in contents.files], 'bytes': contents.size,
        'written_by': contents.writers, 'chunks': contents.compressions, 'problems': contents.problems.lines,
        'problem_count': contents.problems.count, 'notes': contents.notes.lines, 'about': found.about,
        'scene': dr.scene_values(found.scene) if found.scene else None}
    values |= {key: value for key, value in (
        ('start_s', found.start_s), ('end_s', found.end_s), ('namespace', found.namespace), ('first_contact', contact),
        ('clearance', found.clearance and asdict(found.clearance)), ('unread', found.unread)) if value is not None}
    values['topics'] = [_topic(found, name) for name in contents.topics]
    is_partial = 'unread' in values or 'unsearched' in (contact or ())
    return values, (command_line.FAILED if contents.problems.count else
                    command_line.INCOMPLETE if is_partial else command_line.OK)


def _progress(what: str, path: Path) -> Progress:
    """Return a progress bar that counts the bytes of a bag."""
    files = path.rglob('*.mcap') if path.is_dir() else [path]
    return Progress(what, 'B', sum(one.stat().st_size for one in files if one.exists()), unit_scale=True)


def _topic(found: 'dr.BagSummary', name: str) -> dict[str, Any]:
    seen, gaps = found.contents.topics[name], found.gaps(name)
    return {'topic': name, 'type': seen.type, 'messages': seen.messages, 'bytes': seen.size, 'rate_hz': gaps.rate_hz,
            'first_tick': gaps.first, 'last_tick': gaps.last, 'missing': gaps.missing, 'doubled': gaps.doubled,
            'missing_ranges': gaps.ranges, 'lengths_compared': seen.measured,
            'lengths_not_compared_because': seen.unmeasured or None}


def _check(arguments: Namespace) -> tuple[dict[str, Any], int]:
    with dr.read_bag(arguments.bag, arguments.namespace, arguments.trust) as bag:
        with Progress('check', 'ticks', dr.compile(bag.scene).ticks if bag.scene else None) as bar:
            found = bag.check(workers=arguments.workers, progress=bar.reach)
        tier = bag.scene.solver if bag.scene else None
    return _verdict(arguments.bag, found, tier), command_line.OK if found.passed else command_line.FAILED


def _verdict(path: Path, found: 'dr.Comparison', tier: str | None) -> dict[str, Any]:
    return {'bag': str(path), 'equal': found.equal, 'close': found.close, 'worst_m': found.worst_m, 'tier': tier,
            'other_version': found.other_version, 'other_kernel': found.other_kernel, 'fault_count': found.fault_count,
            'missing_count': found.missing_count, 'faults': found.faults, 'once': found.once, 'notes': found.notes,
            'unchecked': {name: {'messages': count, 'reason': why} for name, (count, why) in found.unchecked.items()},
            'end_proved': found.end_proved}


def _repair(arguments: Namespace) -> tuple[dict[str, Any], int]:
    with _progress('repair', arguments.bag) as bar:
        done = dr.repair_bag(arguments.bag, arguments.repair, progress=bar.update)
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
