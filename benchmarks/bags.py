"""``cost bag``: throughput and size of bags for each compression, compared with the MCAP library's writer.

The limit for a bag is the longest of three times, at rates measured in the same run: the times to copy its messages
through memory, to compress them, and to write the bytes of the bag to a file.
"""
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure
from mcap.writer import CompressionType, Writer
from tqdm import tqdm

from benchmarks.rates import LARGE, Amounts, compression_rate, copy_rate, file_rate, limit, times
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders

_SCENE = Scene(run=Run(300, 303, 100))
_OWN, _LIBRARY = 'dragon_ros', 'mcap.writer'
_RAW = {'zstd': CompressionType.ZSTD, 'lz4': CompressionType.LZ4, 'none': CompressionType.NONE}
_Row = tuple[str, bytes, int, int]


@dataclass(frozen=True)
class Written:
    """One writer with one compression: the time for all ticks, and the bytes before and after compression.

    ``rates`` holds the machine's rates (per second).
    """

    writer: str
    compression: str
    timing: Timing
    ticks: int
    messages: int
    raw_bytes: int
    bag_bytes: int
    rates: Amounts

    @property
    def limit_s(self) -> float:
        """The shortest possible time in seconds, if copying, compressing and writing run in parallel."""
        needs = {'memory': self.raw_bytes, 'file': self.bag_bytes}
        return limit(needs | ({} if self.compression == 'none' else {self.compression: self.raw_bytes}), self.rates)[0]

    @property
    def mb_s(self) -> float:
        """The throughput in megabytes of messages per second."""
        return self.raw_bytes / 1e6 / self.timing.median_s

    @property
    def ticks_s(self) -> float:
        """Ticks per second."""
        return self.ticks / self.timing.median_s

    @property
    def message_us(self) -> float:
        """Microseconds per message."""
        return 1e6 * self.timing.median_s / self.messages

    @property
    def share(self) -> float:
        """The size of the bag relative to the size of its messages."""
        return self.bag_bytes / self.raw_bytes


def measure(budget_s: float = 0.3) -> list[Written]:
    """Write the same ticks with each writer and compression; progress goes to standard error."""
    rows = _rows()
    raw = sum(len(data) for _, data, _, _ in rows)
    jobs = [(writer, compression) for compression in _RAW for writer in (_OWN, _LIBRARY)]
    out = []
    with tempfile.TemporaryDirectory() as folder:
        path, rates = Path(folder) / 'bag.mcap', _rates(rows, Path(folder), budget_s)
        for writer, compression in tqdm(jobs, desc='cost bag', unit='bag', disable=None):
            timing = timed(partial(_WRITERS[writer], path, compression, rows), budget_s)
            out.append(Written(writer, compression, timing, compile_scene(_SCENE).last_tick + 1, len(rows), raw,
                               path.stat().st_size, rates))
    return out


def _rates(rows: list[_Row], folder: Path, budget_s: float) -> Amounts:
    data = b''.join(data for _, data, _, _ in rows)
    alone = {name: compression_rate(name, data, budget_s) for name in _RAW if name != 'none'}
    return {**alone, 'memory': copy_rate(LARGE, budget_s), 'file': file_rate(folder, budget_s)}


def _rows() -> list[_Row]:
    encode = encoders(_SCENE)
    frames = [tick(_SCENE, k) for k in range(compile_scene(_SCENE).last_tick + 1)]
    return [(name, encode[name](frame), frame.t_ns, k) for k, frame in enumerate(frames) for name in encode]


def _own(path: Path, compression: str, rows: list[_Row]) -> None:
    with BagWriter(path, overwrite=True, options=BagOptions(compression)) as bag:
        for name in {name for name, *_ in rows}:
            bag.add_channel(name, channels()[name])
        for row in rows:
            bag.write(*row)


def _library(path: Path, compression: str, rows: list[_Row]) -> None:
    with path.open('wb') as file:
        writer = Writer(file, compression=_RAW[compression])
        writer.start('ros2')
        schema = writer.register_schema('x', 'ros2msg', b'')
        ids = {name: writer.register_channel(name, 'cdr', schema) for name in {name for name, *_ in rows}}
        for name, data, t_ns, k in rows:
            writer.add_message(ids[name], t_ns, data, t_ns, k)
        writer.finish()  # type: ignore[no-untyped-call]


_WRITERS: dict[str, Callable[[Path, str, list[_Row]], None]] = {_OWN: _own, _LIBRARY: _library}


def table(rows: list[Written]) -> str:
    """Return the rows as Markdown, after a line that states the machine, the versions and the date."""
    lines = [f'{circumstances()}. {rows[0].ticks} ticks of {_SCENE.dragon.benches} benches: {rows[0].messages} '
             f'messages, {rows[0].raw_bytes / 1e6:.1f} MB.', '',
             '| writer | compression | MB/s | limit (MB/s) | times the limit | µs per message | ticks/s | times 100 Hz '
             '| size | kB per tick |', '|---|---|' + '---:|' * 8]
    lines += [f'| {row.writer} | {row.compression} | {row.mb_s:.0f} | {row.raw_bytes / 1e6 / row.limit_s:.0f} '
              f'| {times(row.timing.median_s, row.limit_s)} | {row.message_us:.1f} | {row.ticks_s:.0f} '
              f'| {row.ticks_s / 100:.0f} | {row.share:.1%} | {row.bag_bytes / row.ticks / 1000:.1f} |' for row in rows]
    return '\n'.join(lines)


def csv_text(rows: list[Written]) -> str:
    """Return the rows as CSV."""
    return csv_of(['writer', 'compression', 'ticks', 'messages', 'raw_bytes', 'bag_bytes', 'limit_s', *TIMES],
                  [(row.writer, row.compression, row.ticks, row.messages, row.raw_bytes, row.bag_bytes,
                    row.limit_s, *row.timing.cells) for row in rows])


def picture(rows: list[Written]) -> Figure:
    """Return a figure of throughput against size, with one point per writer and compression."""
    figure = Figure(figsize=(PAGE_IN, 5.4), layout='constrained')
    axes = figure.subplots()
    for row in rows:
        own = row.writer == _OWN
        axes.plot(100 * row.share, row.mb_s, 'o' if own else 's', color='#0072B2' if own else '#E69F00', markersize=9)
        on_left = own and row.compression == 'zstd'         # since lz4 is to the right, at nearly the same height
        axes.annotate(f'{row.writer}, {row.compression}', (100 * row.share, row.mb_s), textcoords='offset points',
                      xytext=(-8 if on_left else 8, 4 if own else -12), ha='right' if on_left else 'left',
                      fontsize=TEXT_PT)
    axes.set(xlabel='size of the bag (% of its messages)', ylabel='throughput (MB/s of messages)', xlim=(0, 140),
             title=f'Writing bags of {_SCENE.dragon.benches} benches')
    axes.set_ylim(0, 1.1 * max(row.mb_s for row in rows))
    axes.grid(True, linewidth=0.4)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
