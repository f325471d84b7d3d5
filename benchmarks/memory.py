"""``cost memory``: the resident memory of a recorder during a long run, and its growth.

The limit for the growth is the growth of the data that the recorder must keep for the final index.
"""
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import psutil
from matplotlib.figure import Figure
from mcap.reader import make_reader
from tqdm import tqdm

from benchmarks.live import Start, alive, ended, processes
from benchmarks.rates import times
from dragon_ros.bags.write.mcap import packed_bytes
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT, legend_below
from dragon_ros.cost.measure import circumstances

_BENCHES, _RATE_HZ, _TOPICS = 223, 100, ('handles', 'benches', 'velocities')
_WAY_M = 400.0          # total distance of the head, fixed so that the size of a tick does not depend on the duration
_EACH_S = 5.0
_SETTLED_S = 60.0       # growth is fitted from this time on or, in shorter runs, after a tenth of the run
_STEP_MB = 0.1          # smallest change between samples that counts as a step (a backlog)


@dataclass(frozen=True)
class Recorded:
    """A recording: samples of the recorder's resident memory (s, MB), the number of missed messages, and the bag."""

    seconds: float
    samples: tuple[tuple[float, float], ...]
    ticks: int
    missing: int
    chunks: int
    index_bytes: int
    bag_bytes: int

    @property
    def settled(self) -> list[tuple[float, float]]:
        """The samples to which growth is fitted."""
        return [sample for sample in self.samples if sample[0] >= min(_SETTLED_S, 0.1 * self.seconds)]

    @property
    def fit(self) -> tuple[float, float]:
        """The growth in MB per second, and the memory in MB at time 0."""
        times_s, resident_mb = np.array(self.settled).T
        slope, start = np.polyfit(times_s, resident_mb, 1)
        return float(slope), float(start)

    @property
    def grows_kb_min(self) -> float:
        """The growth in kB per minute."""
        return 6e4 * self.fit[0]

    @property
    def steps_mb(self) -> float:
        """The growth (MB) in steps, which occur when the recorder is delayed and messages are queued."""
        changes = np.diff([mb for _, mb in self.settled])
        return float(np.sum(changes[np.abs(changes) >= _STEP_MB]))

    @property
    def creeps_kb_min(self) -> float:
        """The growth in kB per minute, excluding steps."""
        (first_s, first), (last_s, last) = self.settled[0], self.settled[-1]
        return 6e4 * (last - first - self.steps_mb) / (last_s - first_s)

    @property
    def index_kb_min(self) -> float:
        """The growth, in kB per minute, of the data kept for the final index."""
        return 0.06 * self.index_bytes / self.seconds


def measure(run_s: float = 600.0) -> Recorded:
    """Record a run of this many seconds; progress goes to standard error."""
    ticks = round(run_s * _RATE_HZ)
    with TemporaryDirectory() as name, processes(Path(name)) as start:
        bag = Path(name) / 'run.mcap'
        record = start('record', '--output', str(bag))
        start('sim', '--set', f'dragon.benches={_BENCHES}', '--set', f'head.speed_m_s={_WAY_M / run_s!r}', '--set',
              f'run.stop_s={(ticks - 1) / _RATE_HZ!r}', '--ros-args', '-p', f'rate_hz:={float(_RATE_HZ)}', '-p',
              f'wait_subscribers:=[{",".join(f"{topic}=1" for topic in _TOPICS)}]')
        samples = _watched(start, psutil.Process(record.pid), run_s)
        ended(record)
        return _recorded(bag, run_s, ticks, samples)


def _recorded(bag: Path, run_s: float, ticks: int, samples: list[tuple[float, float]]) -> Recorded:
    with bag.open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = {channel.topic: summary.statistics.channel_message_counts.get(number, 0)
              for number, channel in summary.channels.items()}
    missing = sum(ticks - counts.get(f'/dragon/{topic}', 0) for topic in _TOPICS)
    kept = sum(packed_bytes(len(chunk.message_index_offsets)) for chunk in summary.chunk_indexes)
    return Recorded(run_s, tuple(samples), ticks, missing, len(summary.chunk_indexes), kept, bag.stat().st_size)


def _watched(start: Start, process: psutil.Process, run_s: float) -> list[tuple[float, float]]:
    """Return samples (seconds since the first tick, resident MB) taken until the sim ends."""
    deadline, out = time.monotonic() + 2 * run_s + 60.0, []
    while 'starting ' not in start.text():
        alive(start, deadline)
        time.sleep(0.05)
    began = time.monotonic()
    with tqdm(desc='cost memory', total=round(run_s), unit=' s', disable=None) as bar:
        while 'published: ' not in start.text():
            alive(start, deadline)
            out.append((time.monotonic() - began, process.memory_info().rss / 1e6))
            bar.update(round(out[-1][0]) - bar.n)
            time.sleep(min(_EACH_S, 0.05 * run_s))
    return out


def table(row: Recorded) -> str:
    """Return the run as Markdown, after a line that states the machine, the versions and the date."""
    (first_s, first), (_, last), most = row.settled[0], row.settled[-1], max(mb for _, mb in row.samples)
    return '\n'.join([
        f'{circumstances()}. {row.ticks:,} ticks of {_BENCHES} benches at {_RATE_HZ} Hz over DDS, zstd.', '',
        '| recorded (min) | missing | resident (MB) after | at the end | peak | growth (kB/min) | in steps (MB) '
        '| without steps (kB/min) | of the index (kB/min) | growth / index | without steps / index | chunks '
        '| bag (MB) |', '|' + '---:|' * 13,
        f'| {row.seconds / 60:.3g} | {row.missing} | {first_s:.0f} s: {first:.2f} | {last:.2f} | {most:.2f} '
        f'| {row.grows_kb_min:.0f} | {row.steps_mb:.2f} | {row.creeps_kb_min:.0f} | {row.index_kb_min:.0f} '
        f'| {times(row.grows_kb_min, row.index_kb_min)} | {times(row.creeps_kb_min, row.index_kb_min)} '
        f'| {row.chunks:,} | {row.bag_bytes / 1e6:.0f} |', '',
        'A step is a change of 0.1 MB or more within 5 s. Steps occur after a delay of the recorder, because the '
        'middleware keeps the memory of its largest backlog.'])


def csv_text(row: Recorded) -> str:
    """Return the samples as CSV."""
    return csv_of(('seconds', 'resident_mb'), [(f'{t_s:.2f}', f'{mb:.3f}') for t_s, mb in row.samples])


def picture(row: Recorded) -> Figure:
    """Return a figure of resident memory against time, with the fitted growth."""
    figure = Figure(figsize=(PAGE_IN, 4.4), layout='constrained')
    axes = figure.subplots()
    axes.plot(*zip(*row.samples, strict=True), '.', color='#0072B2', label='resident')
    slope, start = row.fit
    ends = np.array([row.settled[0][0], row.settled[-1][0]])
    axes.plot(ends, start + slope * ends, '-', color='#D55E00', label=f'grows by {row.grows_kb_min:.0f} kB/min')
    axes.set(xlabel='time (s)', ylabel='memory of the recorder (MB)',
             title=f'Recording {_BENCHES} benches at {_RATE_HZ} Hz')
    axes.set_ylim(0, 1.15 * max(mb for _, mb in row.samples))
    axes.grid(True, linewidth=0.4)
    legend_below(axes)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
