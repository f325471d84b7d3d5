"""What ``inspect`` found, as text for people."""
from typing import Any

_SHOWN = 20     # lines of faults
_STEPS = 8      # of the clearance over time


def bag_text(values: dict[str, Any]) -> str:
    """Return the text of an inspection."""
    chunks = ', '.join(f'{count} chunks in {name}' for name, count in values['chunks'].items()) or 'no chunks'
    lines = [f'{values["bag"]}: {len(values["files"])} file{"s"[:len(values["files"]) != 1]}, '
             f'{values["bytes"] / 1e6:.3f} MB, {chunks}; written by {", ".join(sorted(set(values["written_by"])))}']
    lines += _about(values['about'])
    lines += _scene(values['scene']) + _topics(values['topics'])
    if 'start_s' in values:
        lines.append(f'  from {values["start_s"]:.9f} to {values["end_s"]:.9f} s')
    if 'namespace' in values:
        lines += [_contact(values['first_contact']), *_clearance(values['clearance'])]
    return '\n'.join([*lines, *_integrity(values)])


def check_text(values: dict[str, Any]) -> str:
    """Return the text of a check."""
    line = f'{values["bag"]}: {values["equal"]} messages are bit for bit what the model says'
    if values['close']:
        line += (f', {values["close"]} keep the promise of tier {values["tier"]} with other bits (the largest '
                 f'difference is {values["worst_m"]:.3g} m: another machine\'s mathematics library)')
    lines = [f'{line}, {values["fault_count"]} are not'] + [f'  {fault}' for fault in values['faults'][:_SHOWN]]
    return '\n'.join(lines + _more(len(values['faults'][:_SHOWN]), len(values['faults'])))


def repair_text(values: dict[str, Any]) -> str:
    """Return the text of a repair."""
    lines = [f'{values["repaired"]}: {values["messages"]} messages saved from {values["bag"]}']
    lines += [f'  {line}' for line in values['lost'][:_SHOWN]]
    return '\n'.join(lines + _more(len(values['lost'][:_SHOWN]), values['lost_count']))


def _more(shown: int, count: int) -> list[str]:
    return [f'  and {count - shown} more'] if count > shown else []


def _about(about: dict[str, str]) -> list[str]:
    made = [f'{key.removeprefix("about.")} {value}' for key, value in about.items() if key.startswith('about.')]
    return [f'  made with {", ".join(made)}'] if made else []


def _scene(scene: dict[str, Any] | None) -> list[str]:
    if scene is None:
        return ['  no scene is recorded in it']
    dragon, track, run = scene['dragon'], scene['track'], scene['run']
    benches = dragon.get('benches') or sum(group['count'] for group in dragon['groups'])
    on = f'pitch {track["pitch_m"]:g} m' if 'pitch_m' in track else f'{len(track["pieces"])} pieces of track'
    return [f'  scene: {benches}{" mixed" if "groups" in dragon else ""} benches, {on}, {run["rate_hz"]:g} Hz from '
            f'{run["start_s"]:g} s, accuracy {scene["accuracy"]}, effects {", ".join(scene["effects"]) or "none"}']


def _topics(topics: list[dict[str, Any]]) -> list[str]:
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


def _contact(found: dict[str, Any]) -> str:
    source = {'collision': 'as the monitor reported it', 'scene': 'recomputed from the scene'}.get(found['source'])
    if source is None:
        return '  first contact: unknown, there is neither a scene nor a report in it'
    if found['t_s'] is None:
        return f'  no contact ({source})'
    where = '' if found['in_bag'] else ', which is not in this bag'
    return (f'  first contact: benches {found["benches"][0]} and {found["benches"][1]} at {found["t_s"]:.9f} s{where} '
            f'({source})')


def _clearance(found: dict[str, Any]) -> list[str]:
    rows = list(zip(found['t_s'], found['gap_m'], strict=True))
    looked = f'{found["looks"]} of {found["ticks"]} ticks'
    if not rows:
        return [f'  smallest clearance: none ({looked} looked at)']
    t_s, gap = min(rows, key=lambda row: row[1])
    where = 'from the topic clearance' if found['source'] == 'clearance' else f'{looked} looked at'
    size = max(1, -(-len(rows) // _STEPS))
    parts = [min(rows[n:n + size], key=lambda row: row[1]) for n in range(0, len(rows), size)]
    over_time = ', '.join(f'{gap * 1e3:.3f} at {t:g} s' for t, gap in parts)
    return [f'  smallest clearance: {gap * 1e3:.6f} mm at {t_s:.9f} s ({where}); over time, in mm: {over_time}']


def _integrity(values: dict[str, Any]) -> list[str]:
    lines = [f'  NOT READ: {values["unread"]}'] if 'unread' in values else []
    lines += [f'  {line}' for line in values['notes']]
    count = values['problem_count']
    lines.append(f'  integrity: {count} problems' if count else '  integrity: every length, index and CRC holds')
    return lines + [f'    {line}' for line in values['problems'][:_SHOWN]] + _more(
        len(values['problems'][:_SHOWN]), count)
