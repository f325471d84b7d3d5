"""A crash oracle: kill a bag writer at any moment, and compare the recovered messages with those written.

A child process writes numbered messages through the recorder's writer thread and prints, after each flush, how many
messages are in the file. After SIGKILL, ``--repair`` must save every flushed message of the bag and every later message
that is complete in the files. It must save nothing else, nothing twice and nothing out of order. The mcap library's own
stream reader is an independent check: all messages that it finds in the files must also be saved.

To try any number of kills by hand, run ``./dragon python test/bags/crash.py --kills 1000``.
"""
import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader

from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.check.repair import repair
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write import COMPRESSIONS
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core.errors import InputError
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels

FORMS = ('file', 'folder', 'parts')
_TOPICS = ('/dragon/scene', '/other/scene')
_BEGINS, _FLUSH_EVERY, _SIZES = 'begins', 7, (40, 1200, 70_000)


class Kill(NamedTuple):
    """The counts of flushed, saved and found messages and of files after a kill, and whether the bag is complete."""

    flushed: int
    saved: int
    found: int
    files: int
    whole: bool


def payload(n: int) -> bytes:
    """Return message ``n``: a string that begins with the number and continues with text that compresses poorly."""
    return string_message(f'{n:08d}' + random.Random(n).randbytes(_SIZES[n % len(_SIZES)]).hex())


def write_until_killed(path: Path, compression: str, parts: bool) -> None:
    """Write messages, flush occasionally, and print the number of messages after each flush."""
    options = BagOptions(compression, split_size_mb=0.3 if parts else None)
    with BagWriter(path, options=options) as bag:
        for topic in _TOPICS:
            bag.add_channel(topic, channels()['scene'])
        print(_BEGINS, flush=True)
        for n in range(10**9):
            bag.write(_TOPICS[n % 2], payload(n), n, n + 1)
            if n % _FLUSH_EVERY == _FLUSH_EVERY - 1:
                bag.flush()
                os.write(1, f'{n + 1}\n'.encode())


def kill(folder: Path, form: str, compression: str, after_s: float) -> Kill:
    """Kill a writer ``after_s`` seconds after it starts, and compare the bag that remains with the writer's output."""
    bag = folder / ('run.mcap' if form == 'file' else 'run')
    child = subprocess.Popen([sys.executable, __file__, '--write', str(bag), compression, form],
                             stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline().strip() == _BEGINS
    time.sleep(after_s)
    child.send_signal(signal.SIGKILL)
    said = [line for line in child.stdout.read().split('\n')[:-1] if line]
    child.wait()
    child.stdout.close()
    return check(bag, int(said[-1]) if said else 0, folder / 'saved.mcap')


def check(bag: Path, flushed: int, saved: Path) -> Kill:
    """Compare the bag of a killed writer with the messages that the writer had flushed. Raises AssertionError."""
    files = [bag] if bag.suffix == '.mcap' else sorted(bag.glob('*.mcap'))
    whole = readable(bag)
    assert whole or examined(bag), 'no problem is reported in a bag that cannot be read'
    if not any(file.stat().st_size for file in files):
        assert flushed == 0
        return Kill(0, 0, 0, len(files), False)
    repair(bag, saved)
    numbers = numbers_in(saved)
    assert numbers == list(range(len(numbers))), 'the saved messages are not the first ones written'
    assert len(numbers) >= flushed, f'{flushed} messages were flushed, {len(numbers)} are saved'
    found = {n for file in files for n in streamed(file)}
    assert found <= set(numbers), 'the mcap library finds messages that were not saved'
    assert not examine(saved).problems.count
    return Kill(flushed, len(numbers), len(found), len(files), whole)


def readable(bag: Path) -> bool:
    """Return whether the package's reader accepts the bag as it is."""
    try:
        with BagReader(bag) as reader:
            return all(True for _ in reader.messages())
    except InputError:
        return False


def examined(bag: Path) -> int:
    """Return the number of problems that ``inspect`` reports."""
    try:
        return examine(bag).problems.count
    except InputError:
        return 1


def numbers_in(bag: Path) -> list[int]:
    """Check every byte of each message in a bag, and return the message numbers."""
    with BagReader(bag, damaged=True) as reader:
        rows = [(message.sequence, message.topic, message.data) for message in reader.messages()]
    for sequence, topic, data in rows:
        assert (topic, data) == (_TOPICS[(sequence - 1) % 2], payload(sequence - 1))
    return [sequence - 1 for sequence, _, _ in rows]


def streamed(file: Path) -> list[int]:
    """Return the numbers of the messages that the mcap library's stream reader finds in a truncated file."""
    out: list[int] = []
    with file.open('rb') as data, suppress(EndOfFile, McapError, ValueError, OSError, RuntimeError):
        out.extend(record.sequence - 1 for record in StreamReader(data).records if isinstance(record, Message))
    return out


def main(argv: list[str]) -> int:
    """Kill writers of all bag forms and compressions, cycling through them, and print a table of the results."""
    if argv[:1] == ['--write']:
        write_until_killed(Path(argv[1]), argv[2], argv[3] == 'parts')
        return 0
    options = argparse.ArgumentParser(description=(__doc__ or '').split('\n')[0])
    options.add_argument('--kills', type=int, default=1000, help='number of writers to kill (1000)')
    options.add_argument('--longest-s', type=float, default=0.5, help='latest time of a kill in s (0.5)')
    options.add_argument('--seed', type=int, default=1, help='seed for the times of the kills (1)')
    arguments = options.parse_args(argv)
    moments, left = random.Random(arguments.seed), Counter[tuple[str, str, str]]()
    kinds = [(form, compression) for form in FORMS for compression in COMPRESSIONS]
    for n in range(arguments.kills):
        form, compression = kinds[n % len(kinds)]
        folder = Path(tempfile.mkdtemp(prefix='crash'))
        after_s = moments.uniform(0.0, arguments.longest_s)
        try:
            one = kill(folder, form, compression, after_s)
        except AssertionError as error:
            print(f'kill {n} ({form}, {compression}, after {after_s:.6f} s): {error}; see {folder}')
            return 1
        shutil.rmtree(folder)
        counts = {'kills': 1, 'flushed': one.flushed, 'saved': one.saved, 'files': one.files, 'whole': one.whole}
        left.update({(form, compression, key): int(value) for key, value in counts.items()})
        if n % 50 == 49:
            print(f'{n + 1} of {arguments.kills} kills', file=sys.stderr, flush=True)
    keys = ('kills', 'whole', 'files', 'flushed', 'saved')
    print('| form | compression | kills | bags complete without repair | files | messages flushed | messages saved |')
    print('|---|---' + '|---:' * len(keys) + '|')
    for kind in kinds:
        print('| ' + ' | '.join((*kind, *(str(left[(*kind, key)]) for key in keys))) + ' |')
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
