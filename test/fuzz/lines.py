"""Compare the output of commands about a bag with the messages that the mcap library's stream reader finds in it."""
import contextlib
import csv
import io
import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dragon_ros.__main__ import main
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.commands.view.data import ViewData
from dragon_ros.core.errors import DragonError
from dragon_ros.messages.decode import MessageError, read_pose_array
from dragon_ros.pictures.sources import dragon_in

Row = tuple[str, int, bytes]        # topic, log time in ns, data
HANDLES = '/dragon/handles'
_TOPIC = re.compile(r'  (/\S+) +(?:\S+/msg/\S+)? +(\d+) +\d+\.\d{3} .*')
_WHOLE = '  integrity: every length, index and CRC is correct'
_VERDICT = re.compile(r'.*: (\d+) messages? (?:is|are) bit-identical to the model'
                      r'(?:, (\d+) (?:is|are) within the promise but not bit-identical \(.*\))?, (\d+) (?:is|are) not'
                      r'(?:; (\d+) (?:is|are) missing)?')
_ONCE = re.compile(r'  scene and track: (\d+) message(?:s match| matches) the scene')
_UNCHECKED = re.compile(r'  unchecked: (\d+) of .* \(.*\)')
_SAVED = re.compile(r'.*: (\d+) messages? saved from .*')
_CUT_OFF = ('damaged', 'truncated')


@dataclass(frozen=True)
class Said:
    """The exit code of a command, its lines on stdout, and all of stderr."""

    code: int
    lines: list[str]
    errors: str


def said(*arguments: object) -> Said:
    """Run a command. Raises AssertionError for a traceback, an unknown exit code or a failure without a reason."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as errors:
        code = main([str(one) for one in arguments])
    found = Said(code, out.getvalue().splitlines(), errors.getvalue())
    assert code in (0, 1, 2, 3), code
    assert 'Traceback' not in found.errors
    assert code != 2 or (len(found.errors.splitlines()) == 1 and not found.lines)
    return found


def topics_in(lines: list[str]) -> Counter[str]:
    """Return the number of messages on each topic, as printed by ``inspect``."""
    return Counter({row[1]: int(row[2]) for line in lines if (row := _TOPIC.fullmatch(line))})


def hold_lines(path: Path, folder: Path, wanted: list[Row], ended: bool, model: dict[tuple[str, int], bytes]) -> Said:
    """Compare all commands' output with the messages ``wanted`` and with each other; return the output of ``inspect``.

    ``ended`` means that the stream reader reached the end of the file, so that the file contains nothing else.
    ``model`` contains the messages of the run by topic and log time. Raises AssertionError.
    """
    told = said('inspect', path, '--namespace', 'dragon')
    if not told.lines:
        told = said('inspect', path)
    assert (told.code in (0, 3)) == (_WHOLE in told.lines), 'the exit code contradicts the last line'
    if ended:
        assert topics_in(told.lines) == Counter(topic for topic, _, _ in wanted), 'inspect prints different counts'
    hold_saved(path, folder / 'printed.mcap', wanted)
    others = [hold_ticks(path, folder, wanted, ended, model), *hold_check(path, wanted, ended, model),
              said('contact', path, '--namespace', 'dragon')]
    if told.code in (0, 3):
        assert not any(word in one.errors for one in others for word in _CUT_OFF), 'only one command finds damage'
    return told


def hold_saved(path: Path, output: Path, wanted: list[Row]) -> None:
    """Check a repair: its bag has as many messages as reported, including all that the stream reader finds."""
    output.unlink(missing_ok=True)
    done = said('inspect', path, '--repair', output)
    if not done.lines:
        return
    saved = _SAVED.fullmatch(done.lines[0])
    assert saved, done.lines[0]
    with BagReader(output, damaged=True) as bag:
        kept = Counter((one.topic, one.t_ns, one.data) for one in bag.messages())
    assert kept.total() == int(saved[1]), 'a repair does not print the number of messages that it saves'
    assert not Counter(wanted) - kept, 'the stream reader finds messages that are not saved'
    assert not done.code or ' not saved' in '\n'.join(done.lines), 'a repair fails without a reason'


def hold_ticks(path: Path, folder: Path, wanted: list[Row], ended: bool, model: dict[tuple[str, int], bytes]) -> Said:
    """Compare the table, the export, and the data for pictures and the view with the bag's handles and each other."""
    output = folder / 'printed.csv'
    handles = [row for row in wanted if row[0] == HANDLES]
    exported = said('export', path, '--namespace', 'dragon', '--output', output, '--force')
    if exported.code:
        return exported
    rows = ticks_of(output.read_text())
    stamps = {stamp for stamp in map(stamp_of, handles) if stamp is not None}
    if ended:
        assert set(rows) == stamps, 'export and stream reader find different ticks'
    if ended and all(model.get((HANDLES, t_ns)) == data for _, t_ns, data in handles):
        for t_ns, places in rows.items():
            assert places == places_of(model[HANDLES, t_ns]), 'export and messages have different positions'
        times = ','.join(repr(t_ns / 1e9) for t_ns in sorted(stamps))
        shown = said('table', path, '--namespace', 'dragon', '--times', times, '--format', 'csv')
        assert ticks_of('\n'.join(shown.lines)) == rows, 'table and export differ'
    with suppress(DragonError), BagReader(path) as bag:
        view = ViewData(dragon_in(bag, 'dragon'), iter)
        assert [round(t_s * 1e9) for t_s in view.times_s.tolist()] == sorted(rows), 'view and export differ'
    return exported


def hold_check(path: Path, wanted: list[Row], ended: bool, model: dict[tuple[str, int], bytes]) -> list[Said]:
    """Check ``--check``: accepted messages equal the model's, and every other message is accounted for."""
    told = said('inspect', path, '--namespace', 'dragon', '--check')
    if not told.lines:
        return [told]
    counts = _VERDICT.fullmatch(told.lines[0])
    assert counts, told.lines[0]
    equal, close, others, missing = (int(count or 0) for count in counts.groups())
    once = sum(int(row[1]) for line in told.lines if (row := _ONCE.fullmatch(line)))
    unchecked = sum(int(row[1]) for line in told.lines if (row := _UNCHECKED.fullmatch(line)))
    assert (told.code == 0) == (not others and not missing and equal + close > 0), 'exit code and first line disagree'
    assert not ended or equal + close + others + once + unchecked == len(wanted), 'a message is not accounted for'
    of_run = Counter(row for row in wanted if row[:2] in model)
    if told.code == 0 and ended and of_run:
        recorded = span_of(model, [row[:2] for row in of_run])
        assert recorded == {row[:2] for row in of_run}, 'a check passes ticks that lack messages'
        assert sum(of_run.values()) == len(recorded), 'a check passes a message that occurs twice'
        assert sum(model[row[:2]] == row[2] for row in of_run) == equal, 'a check counts different messages as equal'
    return [told]


def span_of(model: dict[tuple[str, int], bytes], found: list[tuple[str, int]]) -> set[tuple[str, int]]:
    """Return what a recording of these topics contains from the first to the last of these messages."""
    topics, times_ns = {topic for topic, _ in found}, [t_ns for _, t_ns in found]
    return {place for place in model if place[0] in topics and min(times_ns) <= place[1] <= max(times_ns)}


def ticks_of(text: str) -> dict[int, list[tuple[float, float]]]:
    """Return the handle positions (m) in a CSV table, by time (ns)."""
    out: dict[int, list[tuple[float, float]]] = {}
    for row in csv.DictReader(io.StringIO(text)):
        places = out.setdefault(round(float(row['t_s']) * 1e9), [])
        if int(row['handle']) < len(places):        # the tick is repeated, and only its last rows count
            places.clear()
        places.append((float(row['x_m']), float(row['y_m'])))
    return out


def stamp_of(row: Row) -> int | None:
    """Return the stamp (ns) of a message with handles, or None if the message is invalid."""
    with suppress(MessageError):
        return read_pose_array(row[2]).t_ns
    return None


def places_of(data: bytes) -> list[tuple[float, float]]:
    """Return the handle positions (m) in a message."""
    return [(x, y) for x, y in np.asarray(read_pose_array(data).poses)[:, :2].tolist()]
