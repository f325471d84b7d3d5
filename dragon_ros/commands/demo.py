"""``demo``: run everything once: nodes in separate processes, a bag, its replay, a check and a picture."""
import re
import signal
import subprocess
import sys
import threading
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, NoReturn

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.signals import ending

SCENE = 'first_contact'
_READERS = 'handles=2,benches=2,velocities=1'
_COMPARED = ('handles', 'benches', 'velocities', 'collision')
_PROGRESS = re.compile(r'at ([\d.]+) s, tick')
_LONGEST_S = 120.0


def _end(*_: object) -> NoReturn:
    """Raise the same exception as Ctrl-C, so that all processes are ended."""
    raise KeyboardInterrupt


@contextmanager
def _later() -> Iterator[None]:
    """Defer signals until the end of this block, so that every started process is also registered."""
    came: list[int] = []
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in ending()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            _end()


def main(argv: list[str]) -> int:
    """Run the demonstration; return the exit code."""
    options = command_line.parser('demo', 'Run sim, monitor and recorder over DDS on this host until the first '
                                  'contact; replay the bag, check it against the model, and draw the contact.',
                                  'demo --pace 4')
    options.add_argument('--output', type=Path, default=Path('dragon_demo'), metavar='FOLDER',
                         help='folder for the bag and the picture; replaces an earlier demo (%(default)s)')
    options.add_argument('--pace', type=float, default=2.0, help='simulated seconds per real second (%(default)g)')
    arguments = options.parse_args(argv)
    return command_line.guarded('demo', partial(_run, arguments))


def _run(arguments: Namespace) -> int:
    """Run the demonstration; return the exit code. A signal ends the demonstration and all its processes."""
    missing = [name for name in ('resource', 'termios', 'rclpy') if find_spec(name) is None]
    if missing:
        raise dr.MissingError(f'the nodes of the demo need Linux and ROS 2, but {missing[0]} is missing; `view --scene '
                           f'{SCENE}` shows the same run without them')
    for number in ending():
        signal.signal(number, _end)
    folder: Path = arguments.output
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise dr.MissingError(f'--output {folder}: it cannot be created: {error.strerror}') from None
    with _alone(folder):
        return _demonstrate(folder, arguments.pace)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Reserve the folder for this demonstration."""
    from dragon_ros.cli.inputs import lock
    with (folder / 'lock').open('w') as file:
        try:
            lock(file)
        except BlockingIOError:
            raise dr.MissingError(f'{folder}: another demo is using this folder; wait, or give another --output'
                                  ) from None
        yield


def _demonstrate(folder: Path, pace: float) -> int:
    live, again = folder / 'first_contact.mcap', folder / 'replayed.mcap'
    say(f'1. sim, monitor and recorder run as three processes over DDS at {pace:g} times real time')
    with ExitStack() as stack:
        with _processes(folder / 'live.log') as start:
            _bystanders(start, live)
            sim = start('sim', '--json', '--scene', SCENE, '--ros-args', '-p', f'time_scale:={pace}',
                        '-p', f'wait_subscribers:=[{_READERS}]')
            for reader in start.readers:
                threading.Thread(target=_interrupt_if_it_fails, args=(reader, sim), daemon=True).start()
            lines = _progress_of(sim)
            next(lines, None)
            # During the run, the monitor and recorder of the replay start in another domain and discover each other.
            then = stack.enter_context(_processes(folder / 'replay.log'))
            _bystanders(then, again)
            for _ in lines:
                pass
            start.wait_for_contact()
        say('2. the bag is replayed into another monitor and recorder, as fast as they can keep up')
        readers = [f'/dragon/{reader}' for reader in _READERS.split(',')]
        replay = then('replay', str(live), '--rate', '0', '--wait-subscribers', ','.join(readers),
                      '--topics', ','.join(reader.partition('=')[0] for reader in readers))
        compared, pictures = _compared(folder, live)
        _finished(replay)
        then.wait_for_contact()
    return _told(compared, live, again, pictures)


def _compared(folder: Path, live: Path) -> 'tuple[dr.Comparison, list[Path]]':
    """Compare the bag with the model, and draw the contact in the bag."""
    with dr.read_bag(live) as bag:
        comparison, value = bag.check(), _event(bag).values
    pair, point = (int(value['inner']), int(value['outer'])), (float(value['x_m']), float(value['y_m']))
    step_s = float(value['t_after_s']) - float(value['t_before_s'])
    return comparison, _drawn(dr.scene(SCENE), float(value['t_contact_s']), pair, point, step_s, folder)


def _told(comparison: 'dr.Comparison', live: Path, again: Path, pictures: list[Path]) -> int:
    """Compare the live bag with the replayed bag, and print all results."""
    with dr.read_bag(live) as bag, dr.read_bag(again) as replayed:
        event, second = _event(bag), _event(replayed)
        same = _by_topic(bag) == _by_topic(replayed)
    value = event.values
    say(f'3. {event.message}; seen between {value["t_before_s"]} and {value["t_after_s"]} s')
    say(f'   {comparison.equal} messages are bit-identical to the model, {len(comparison.faults)} are not')
    say(f'   replayed: {"the same bytes" if same else "OTHER BYTES"}, '
        f'{"the same event" if second == event else "ANOTHER EVENT"}')
    for path in (live, again, *pictures):
        say(f'   {path}')
    return command_line.OK if same and second == event and not comparison.faults else command_line.FAILED


def _drawn(scene: 'dr.Scene', t_s: float, pair: tuple[int, int], point_m: tuple[float, float],
           step_s: float, folder: Path) -> list[Path]:
    """Draw the contact that the monitor reported."""
    from dragon_ros.cli.figures import save, style
    from dragon_ros.pictures.dragon import contact_picture
    from dragon_ros.pictures.sources import SceneSource, Touch, decimals_of, moment, witness_at
    source = SceneSource(SCENE, scene)
    with style():
        seen = witness_at(moment(source, t_s), pair)
        picture = contact_picture(source, Touch(t_s, pair, point_m, seen, decimals_of(step_s)))
        return save(picture, folder / 'contact', f'{SCENE}, {t_s:.6f} s')


def say(line: str) -> None:
    """Print a line immediately."""
    print(line, flush=True)


@contextmanager
def _processes(log: Path) -> Iterator['_Processes']:
    """Start executables in a separate ROS domain; at the end, interrupt the remaining ones, and wait for them."""
    with log.open('w') as file:
        start = _Processes(file)
        try:
            yield start
            # The recorder ends once the monitor, which is still running, has reported everything.
            for process in start.readers:
                process.send_signal(signal.SIGINT)
                _finished(process)
        finally:
            for process in start.all:
                process.send_signal(signal.SIGINT)
            for process in start.all:
                try:
                    process.wait(timeout=20)
                except subprocess.TimeoutExpired:
                    process.kill()


class _Processes:
    """Starts processes ``python -m dragon_ros NAME ...``, whose output goes to a log file."""

    def __init__(self, log: IO[str]) -> None:
        from dragon_ros.cli.dds_domain import free_domain, local_environment
        self.log, self.environment = log, local_environment(free_domain())
        self.environment['PYTHONUNBUFFERED'] = '1'
        self.all: list[subprocess.Popen[str]] = []
        self.monitors: list[subprocess.Popen[str]] = []
        self.recorders: list[subprocess.Popen[str]] = []

    def __call__(self, name: str, *arguments: str) -> subprocess.Popen[str]:
        with _later():
            process = subprocess.Popen([sys.executable, '-m', 'dragon_ros', name, *arguments], env=self.environment,
                                       stdin=subprocess.DEVNULL, stdout=subprocess.PIPE if name == 'sim' else self.log,
                                       stderr=subprocess.STDOUT, text=True)
            self.all.append(process)
        return process

    @property
    def readers(self) -> 'list[subprocess.Popen[str]]':
        """The recorders and the monitors."""
        return [*self.recorders, *self.monitors]

    def wait_for_contact(self) -> None:
        """Wait until the monitor, which may lag behind, has reported a contact. Raises DragonError if a node fails."""
        end = time.monotonic() + _LONGEST_S
        while 'contact of benches' not in Path(self.log.name).read_text(encoding='utf-8'):
            for process in self.readers:
                if process.poll():
                    _finished(process)
            if time.monotonic() > end:
                raise dr.DragonError(f'the monitor reported no contact; see {self.log.name}')
            time.sleep(0.05)


def _bystanders(start: _Processes, bag: Path) -> None:
    """Start a monitor, and a recorder that waits for it and keeps recording until it has reported."""
    start.monitors.append(start('monitor'))
    start.recorders.append(start('record', '--output', str(bag), '--force', '--keep-going', '--wait-monitor'))


def _interrupt_if_it_fails(reader: 'subprocess.Popen[str]', sim: 'subprocess.Popen[str]') -> None:
    """Stop the simulator if a process that it waits for fails."""
    if reader.wait():
        sim.send_signal(signal.SIGINT)


def _progress_of(sim: 'subprocess.Popen[str]') -> Iterator[float]:
    """Read the simulator's log, show the progress, and yield the time that each line reports."""
    from tqdm import tqdm
    run = dr.scene(SCENE).run
    stop_s = run.stop_s or run.start_s
    assert sim.stdout is not None
    with tqdm(total=stop_s - run.start_s, unit='s', disable=None, leave=False, bar_format='{l_bar}{bar}| {n:.1f} of '
              '{total:.0f} s [{elapsed}<{remaining}]') as bar:
        for line in sim.stdout:
            if found := _PROGRESS.search(line):
                bar.update(float(found[1]) - run.start_s - bar.n)
                if bar.disable:
                    say(f'   at {float(found[1]):.2f} s of {stop_s:g} s')
                yield float(found[1])
    _finished(sim)


def _finished(process: 'subprocess.Popen[str]') -> None:
    """Wait for a process. Raises DragonError if the process fails or hangs."""
    name = process.args[3] if isinstance(process.args, list) else '?'
    try:
        code = process.wait(timeout=_LONGEST_S)
    except subprocess.TimeoutExpired:
        raise dr.DragonError(f'{name} did not end within {_LONGEST_S:g} s; see the .log files beside the bag') from None
    if code:
        raise dr.DragonError(f'{name} ended with exit code {code}; see the .log files beside the bag')


def _by_topic(bag: 'dr.Bag') -> dict[str, list[tuple[int, bytes]]]:
    """Return the stamped messages of each topic, in order; the order of messages of different topics is undefined."""
    out: dict[str, list[tuple[int, bytes]]] = {}
    for message in bag.reader.messages([f'/dragon/{name}' for name in _COMPARED]):
        out.setdefault(message.topic, []).append((message.t_ns, message.data))
    return out


def _event(bag: 'dr.Bag') -> Any:
    """Return the only contact in a bag. Raises DragonError if there are no contacts or several."""
    events = bag.contact_events()
    if len(events) != 1:
        raise dr.DragonError(f'{bag.reader.path}: {len(events)} contacts were reported; expected one')
    return events[0]
