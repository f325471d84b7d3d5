"""A long test of a live dragon, in which recorders are killed and stalled, monitors restarted and bags replayed.

Start this test by hand, as no other test starts it: ``./dragon python test/soak/soak.py --minutes 60 --controls 2``.
The test reports its progress every minute and, at the end, the losses, the differences from the model, the drift of
stamps against the clock, and the growth of memory; the exit code is 1 if a tick was lost or differs. With controls, the
dragon is paused, stepped and moved back by a few seconds, and its speed is changed: ticks repeat, but none is skipped.
"""
import argparse
import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dragon_ros.bags.check.repair import repair
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cli.dds_domain import free_domain, local_environment
from dragon_ros.core.step import tick
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.load import load_scene

RATE_HZ = 100
_EVERY_S = 5.0          # time between two actions; memory use is recorded before each action
_SETTLED_S = 120.0      # time from which the growth of memory is measured
_BEGUN_S = 60.0         # time by which a recorder must have data on the disk
_BEGUN_BYTES = 200_000  # size of that data in bytes
_NS = 10**9
Stamps = np.ndarray[tuple[int], np.dtype[np.int64]]


@dataclass
class Soak:
    """A run of the soak test, with its processes and observations."""

    folder: Path
    domain: int = field(default_factory=free_domain)
    began_s: float = field(default_factory=time.monotonic)
    memory_mb: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    started: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start(self, name: str, *arguments: object, domain: int | None = None) -> subprocess.Popen[bytes]:
        """Start an executable whose output is written to a file."""
        return self.run(name, ['-m', 'dragon_ros', name, *map(str, arguments)], domain)

    def run(self, name: str, arguments: list[str], domain: int | None = None) -> subprocess.Popen[bytes]:
        """Start Python with arguments; its output is written to a file."""
        environment = {**local_environment(domain or self.domain), 'PYTHONUNBUFFERED': '1'}
        with (self.folder / f'{name}.log').open('ab') as log:
            self.started.append(subprocess.Popen([sys.executable, *arguments], env=environment,
                                                 stdin=subprocess.DEVNULL, stdout=log, stderr=log))
        return self.started[-1]

    def end(self) -> None:
        """End all running processes."""
        for process in self.started:
            if process.poll() is None:
                process.kill()
                process.wait()

    def count(self, what: str, by: int = 1) -> None:
        """Count an action."""
        self.counts[what] = self.counts.get(what, 0) + by

    def look(self, **processes: subprocess.Popen[bytes]) -> None:
        """Record the memory use of the processes."""
        for name, process in processes.items():
            if process.poll() is not None:
                self.faults.append(f'{name} ended with {process.returncode}')
                continue
            pages = int(Path(f'/proc/{process.pid}/statm').read_text().split()[1])
            now_s = time.monotonic() - self.began_s
            self.memory_mb.setdefault(name, []).append((now_s, pages * os.sysconf('SC_PAGE_SIZE') / 1e6))


def ended(process: subprocess.Popen[bytes], number: int = signal.SIGINT) -> int:
    """Signal a process and return its exit code."""
    process.send_signal(number)
    return process.wait(timeout=60)


def soak(run: Soak, minutes: float, seed: int, controls_s: float) -> None:
    """Run a soak; without controls it ends with the run, which lags behind the clock on a busy machine."""
    folder, rng = run.folder, random.Random(seed)
    whole = run.start('record', '--output', folder / 'whole', '--split-duration-s', 300)
    monitor, extra = run.start('monitor'), run.start('record', '--output', folder / 'extra_0.mcap')
    stop_s = 60 * minutes
    sim = run.start('sim', *set_of(minutes, controls_s), '--ros-args', '-p',
                    'wait_subscribers:=[handles=3,benches=3,scene=2]')
    if controls_s and not waited_for(folder / 'extra_0.mcap'):     # subscribers would miss an earlier step
        run.faults.append('the run did not start')
    controls = controls_s and run.run('controls', [str(Path(__file__).parents[1] / 'nodes/controls.py'), '--harmless',
                                                   '--each-s', str(controls_s), '--seed', str(seed)])
    until = time.monotonic() + stop_s
    acts = 0
    while time.monotonic() < until - 2 * _EVERY_S and sim.poll() is None:
        time.sleep(_EVERY_S)
        run.look(sim=sim, recorder=whole)
        act = ('kill', 'stall', 'monitor', 'join', 'look')[acts % 5]
        acts += 1
        if act == 'kill':       # kill a recorder; its bag is repaired and replayed in another domain
            bag = folder / f'extra_{run.counts.get("recorders killed", 0)}.mcap'
            begun = waited_for(bag)
            ended(extra, signal.SIGKILL)
            if begun:
                killed(run, bag)
            else:
                run.faults.append(f'{bag.name} held nothing after {_BEGUN_S:g} s')
            run.count('recorders killed')
            extra = run.start('record', '--output', folder / f'extra_{run.counts["recorders killed"]}.mcap')
        elif act == 'stall':    # stall the recorder that must not lose any message
            whole.send_signal(signal.SIGSTOP)
            time.sleep(rng.uniform(0.1, 1.0))
            whole.send_signal(signal.SIGCONT)
            run.count('stalls of the recorder')
        elif act == 'monitor':
            if ended(monitor):
                run.faults.append(f'monitor ended with {monitor.returncode}')
            monitor = run.start('monitor')
            run.count('monitors restarted')
        elif act == 'join':     # a recorder joins late and leaves again
            (folder / 'late.mcap').unlink(missing_ok=True)
            late = run.start('record', '--output', folder / 'late.mcap')
            if not waited_for(folder / 'late.mcap'):
                run.faults.append(f'late.mcap held nothing after {_BEGUN_S:g} s')
            if ended(late) not in (0, 3):       # 3: the beginning is missing
                run.faults.append(f'a late recorder ended with {late.returncode}')
            with BagReader(folder / 'late.mcap') as reader:
                mind_holes(run, 'a late recorder', stamps_in(reader))
            run.count('late recorders')
        if acts % 12 == 0:
            print(f'{(time.monotonic() - run.began_s) / 60:.0f} of {minutes:g} minutes: {run.counts}, '
                  f'{len(run.faults)} faults, {({name: seen[-1][1] for name, seen in run.memory_mb.items()})} MB',
                  file=sys.stderr, flush=True)
    if controls:
        if ended(controls):
            run.faults.append('answers to controls were wrong: controls.log')
        said = json.loads((folder / 'controls.log').read_text().splitlines()[-1])
        run.count('controls', said['controls'])
        run.count('calls of services and parameters', said['calls'])
        sim.send_signal(signal.SIGINT)
    sim.wait(timeout=stop_s + 120)
    for process in extra, monitor:
        ended(process)
    run.count('exit code of the recorder', whole.wait(timeout=120))


def set_of(minutes: float, controls_s: float) -> list[str]:
    """Return the scene as options; with controls, the run is long enough that only a signal ends it."""
    return ['--scene', 'unwinding', '--set', f'run.stop_s={60 * minutes * (2 if controls_s else 1)}',
            '--set', f'run.rate_hz={RATE_HZ}']


def waited_for(bag: Path) -> bool:
    """Wait until a chunk of a bag is on the disk; a recorder killed before that leaves nothing to compare."""
    until = time.monotonic() + _BEGUN_S
    while time.monotonic() < until:
        if bag.exists() and bag.stat().st_size >= _BEGUN_BYTES:
            return True
        time.sleep(0.1)
    return False


def killed(run: Soak, bag: Path) -> None:
    """Repair a killed recorder's bag, check its ticks for gaps, and replay it to another recorder without loss."""
    saved, again = bag.with_name('saved.mcap'), bag.with_name('again.mcap')
    saved.unlink(missing_ok=True)
    repair(bag, saved)
    bag.unlink()
    with BagReader(saved) as reader:
        before = [(m.topic, m.data) for m in reader.messages(['/dragon/handles', '/dragon/benches'])]
        stamps = stamps_in(reader)
    mind_holes(run, 'a recorder that was killed', stamps)
    run.count('ticks in killed bags', int(stamps.size))
    domain = free_domain()
    record = run.start('record', '--output', again, '--force', domain=domain)
    replay = run.start('replay', saved, '--rate', 0, '--wait-subscribers', '/dragon/handles=1,/dragon/benches=1',
                       domain=domain)
    if replay.wait(timeout=120) or record.wait(timeout=120) not in (0, 3):
        run.faults.append(f'a replay ended with {replay.returncode}, its recorder with {record.returncode}')
    with BagReader(again) as reader:
        after = [(m.topic, m.data) for m in reader.messages(['/dragon/handles', '/dragon/benches'])]
    if sorted(before) != sorted(after):
        run.faults.append(f'a replay of {len(before)} messages was recorded as {len(after)}')
    run.count('replays')
    run.count('messages replayed', len(after))


def stamps_in(bag: BagReader) -> Stamps:
    """Return the log times (ns) of a bag's handles in order of publication; they decrease if the dragon goes back."""
    rows = sorted((message.publish_ns, message.t_ns) for message in bag.messages(['/dragon/handles']))
    return np.array([t_ns for _, t_ns in rows], dtype=np.int64)


def holes(stamps: Stamps) -> int:
    """Return how many ticks are missing between successive messages."""
    steps = np.round(np.diff(stamps) * RATE_HZ / _NS)
    return int(np.sum(np.maximum(steps - 1, 0)))


def mind_holes(run: Soak, whose: str, stamps: Stamps) -> None:
    """Record the ticks that are missing from a bag."""
    if missing := holes(stamps):
        run.faults.append(f'{whose} lacks {missing} ticks in between')


def differing(run: Soak, options: list[str]) -> int:
    """Return the number of messages of handles and benches in the whole run's bag that differ from the model."""
    scene = load_scene(options[1], options[3::2])
    encode, last_k, frame, different = encoders(scene), -1, None, 0
    with BagReader(run.folder / 'whole') as reader:
        for message in reader.messages(['/dragon/handles', '/dragon/benches']):
            k = scene.run.tick_at(message.t_ns)
            frame = tick(scene, k) if frame is None or k != last_k else frame
            last_k = k
            different += bytes(encode[message.topic.rpartition('/')[2]](frame)) != message.data
    return different


def results(run: Soak, options: list[str]) -> dict[str, object]:
    """Return the losses, the differences from the model, the drift of stamps, and the growth of memory."""
    with BagReader(run.folder / 'whole') as reader:
        rows = np.array(sorted(((m.t_ns, m.publish_ns) for m in reader.messages(['/dragon/handles'])),
                               key=lambda row: row[1]), dtype=np.int64)
        account = reader.metadata('dragon_ros.received')
    missing = holes(rows[:, 0])
    off_ms = (rows[:, 1] - rows[:, 0] - (rows[0, 1] - rows[0, 0])) / 1e6
    tenth = max(1, len(off_ms) // 10)
    growth = {}
    for name, seen in run.memory_mb.items():
        t_s, mb = np.array([row for row in seen if row[0] >= min(_SETTLED_S, seen[-1][0] / 2)]).T
        growth[name] = {'at_first_mb': round(float(mb[0]), 1), 'at_last_mb': round(float(mb[-1]), 1),
                        'kb_a_minute': round(float(np.polyfit(t_s / 60, mb * 1000, 1)[0]), 1)}
    return {'ticks': len(np.unique(rows[:, 0])), 'messages of handles': len(rows), 'missing_ticks': missing,
            'messages unlike the model': differing(run, options), 'account': account.get('complete'),
            'drift_ms': round(float(np.median(off_ms[-tenth:]) - np.median(off_ms[:tenth])), 3),
            'late_ms_99th_percentile': round(float(np.quantile(off_ms - np.min(off_ms), 0.99)), 3),
            'late_ms_worst': round(float(np.max(off_ms) - np.min(off_ms)), 3), 'memory': growth, **run.counts,
            'faults': run.faults}


def main(argv: list[str]) -> int:
    """Run the soak test and print the results as JSON."""
    options = argparse.ArgumentParser(description=(__doc__ or '').split('\n')[0])
    options.add_argument('--minutes', type=float, default=60.0, help='how long (60)')
    options.add_argument('--folder', type=Path, default=Path('soak'), help='new folder for bags and logs')
    options.add_argument('--seed', type=int, default=1, help='seed for the stalls and the controls (1)')
    options.add_argument('--controls', type=float, default=0.0, metavar='S',
                         help='seconds between two controls of the sim (0: none)')
    arguments = options.parse_args(argv)
    arguments.folder.mkdir(parents=True)
    run = Soak(arguments.folder)
    try:
        soak(run, arguments.minutes, arguments.seed, arguments.controls)
    finally:
        run.end()
    found = results(run, set_of(arguments.minutes, arguments.controls))
    print(json.dumps(found, indent=1))
    return int(bool(found['missing_ticks'] or found['messages unlike the model'] or found['faults']))


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
