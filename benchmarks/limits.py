"""``cost limits``: the time of each stage relative to this machine's limit, which shows the remaining headroom.

Each stage is compared with the machine's rates, measured in the same run on one thread: multiplications and additions
in a matrix product, bytes copied within the cache or through memory, bytes compressed by zstd alone, and bytes written
to a file. The limit for a stage is the longest of the times needed to process its amounts at these rates.
"""
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.rates import LARGE, NUMBER, compression_rate, copy_rate, file_rate, limit, tick_rates
from benchmarks.stages import needs_of, ticks_from
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import LINES, PAGE_IN, TEXT_PT
from dragon_ros.core.batches import batches, velocity_of
from dragon_ros.core.geometry.near_pairs import NearPairs
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders

_SCENE = Scene(run=Run(300, 303, 100))
_STATES = 20_000
_AT_S = 300.0
_NAMES = {'none': 'not compressed', 'zstd': 'zstd'}
_RATES = {'product': 'multiplications and additions in a product', 'cache': 'bytes copied within the cache',
          'memory': 'bytes copied through memory', 'zstd': "bytes of a tick's messages compressed by zstd alone",
          'file': 'bytes written to a file, which the system writes to disk later'}


@dataclass(frozen=True)
class Stage:
    """A stage: its time per call, and the amounts that it must process, by the rate that limits each."""

    name: str
    timing: Timing
    needs: dict[str, float]

    def limit(self, rates: dict[str, float]) -> tuple[float, str]:
        """Return the shortest possible time in seconds, and the rate that determines it."""
        return limit(self.needs, rates)


@dataclass(frozen=True)
class Measured:
    """The machine's rates (per second), and all stages."""

    rates: dict[str, float]
    stages: list[Stage]


def measure(budget_s: float = 0.3) -> Measured:
    """Measure the machine's rates, and every stage of the scene ``winding``."""
    encode = encoders(_SCENE)
    frames = [tick(_SCENE, k) for k in range(compile_scene(_SCENE).last_tick + 1)]
    messages = [(name, encode[name](frame), frame.t_ns, k) for k, frame in enumerate(frames) for name in encode]
    with tempfile.TemporaryDirectory() as folder:
        jobs: list[Callable[[], object]] = [partial(_rates, messages, Path(folder), budget_s)]
        jobs += [partial(stage, budget_s) for stage in (_place, _velocities, _many, _benches, _look, _messages)]
        jobs += [partial(_bag, kind, messages, Path(folder), budget_s) for kind in ('none', 'zstd')]
        rates, *stages = (job() for job in tqdm(jobs, desc='cost limits', unit='part', disable=None))
    return Measured(rates, stages)      # type: ignore[arg-type]


def _rates(messages: list[tuple[str, bytes, int, int]], folder: Path, budget_s: float) -> dict[str, float]:
    data = b''.join(data for _, data, _, _ in messages)
    return tick_rates(budget_s) | {'memory': copy_rate(LARGE, budget_s),
                                   'zstd': compression_rate('zstd', data, budget_s),
                                   'file': file_rate(folder, budget_s)}


def _place(budget_s: float) -> Stage:
    simulation = compile_scene(_SCENE)
    times = cycle((_SCENE.run.start_s + np.arange(100) / 100).tolist())
    return Stage('place all handles', timed(lambda: simulation.chain(next(times)), budget_s, most=2000),
                 needs_of(_SCENE, _AT_S)['chain'])


def _velocities(budget_s: float) -> Stage:
    chain = state(_SCENE, _AT_S)
    return Stage('their velocities', timed(lambda: velocity_of(_SCENE, chain, _AT_S), budget_s, most=2000),
                 needs_of(_SCENE, _AT_S)['velocities'])


def _many(budget_s: float) -> Stage:
    times_s = np.linspace(0.0, 400.0, _STATES).tolist()
    scene = replace(_SCENE, run=Run(0, 400))

    def all_of_them() -> None:
        for _ in batches(scene, times_s):
            pass
    numbers = 4.0 * (scene.dragon.benches + 1)
    return Stage(f'both, per instant of {_STATES:,} at once', timed(all_of_them, budget_s, 3).shared_by(_STATES),
                 {'product': 2.0 * needs_of(_SCENE, _AT_S)['chain']['product'], 'cache': NUMBER * numbers})


def _benches(budget_s: float) -> Stage:
    chain, dragon = state(_SCENE, _AT_S), _SCENE.dragon
    return Stage('bench rectangles', timed(lambda: benches_of(chain, dragon, axes_of(chain)), budget_s, most=2000),
                 needs_of(_SCENE, _AT_S)['benches'])


def _look(budget_s: float) -> Stage:
    near, ticks = NearPairs(), ticks_from(_SCENE, _AT_S)
    return Stage("the monitor's check", timed(lambda: near.look(*next(ticks)), budget_s, most=2000),
                 needs_of(_SCENE, _AT_S)['look'])


def _messages(budget_s: float) -> Stage:
    encode, frame = [*encoders(_SCENE).values()], tick(_SCENE, 0)
    return Stage('messages of a tick', timed(lambda: [one(frame) for one in encode], budget_s, most=2000),
                 needs_of(_SCENE, _AT_S)['encode'])


def _bag(compression: str, messages: list[tuple[str, bytes, int, int]], folder: Path, budget_s: float) -> Stage:
    path, ticks = folder / 'bag.mcap', messages[-1][-1] + 1

    def write() -> None:
        with BagWriter(path, overwrite=True, options=BagOptions(compression)) as bag:
            for name in {name for name, *_ in messages}:
                bag.add_channel(name, channels()[name])
            for row in messages:
                bag.write(*row)
    timing = timed(write, budget_s, 3).shared_by(ticks)
    size = sum(len(data) for _, data, _, _ in messages) / ticks
    needs = {'memory': size, 'file': path.stat().st_size / ticks}
    return Stage(f'a tick into a bag, {_NAMES[compression]}', timing,
                 needs | ({'zstd': size} if compression == 'zstd' else {}))


def table(rows: Measured) -> str:
    """Return rates and stages as Markdown, after a line that states the machine, the versions and the date."""
    lines = [f'{circumstances()}. Rates are those of one thread; times are medians.', '', '| rate | per second |',
             '|---|---:|']
    lines += [f'| {text} | {_amount(rows.rates[name])} |' for name, text in _RATES.items()]
    lines += ['', '| stage | time (µs) | limit of the machine (µs) | ratio | limited by |',
              '|---|---:|---:|---:|---|']
    for stage in rows.stages:
        limit_s, rate = stage.limit(rows.rates)
        lines.append(f'| {stage.name} | {1e6 * stage.timing.median_s:.3g} | {1e6 * limit_s:.3g} '
                     f'| {stage.timing.median_s / limit_s:.1f} | {rate} |')
    return '\n'.join(lines)


def _amount(value: float) -> str:
    return f'{value / 1e9:.3g} billion'


def csv_text(rows: Measured) -> str:
    """Return the stages as CSV, with times in seconds."""
    return csv_of(['stage', 'limit_s', 'bound_by', *TIMES],
                  [(stage.name, *stage.limit(rows.rates), *stage.timing.cells) for stage in rows.stages])


def picture(rows: Measured) -> Figure:
    """Return a figure with a bar for each stage: its time relative to the machine's limit."""
    figure = Figure(figsize=(PAGE_IN, 0.5 * len(rows.stages) + 1.8), layout='constrained')
    axes = figure.subplots()
    kinds = [*_RATES]
    for y, stage in enumerate(reversed(rows.stages)):
        limit_s, rate = stage.limit(rows.rates)
        times = stage.timing.median_s / limit_s
        axes.barh(y, times, color=LINES[kinds.index(rate)], label=rate, height=0.6)
        axes.annotate(f' {times:.1f} times {1e6 * limit_s:.3g} µs', (max(times, 1.0), y), va='center', fontsize=TEXT_PT)
    axes.set_yticks(range(len(rows.stages)), [stage.name for stage in reversed(rows.stages)])
    axes.axvline(1.0, color='black', linewidth=1.0)
    axes.set(xscale='log', xlabel="time relative to the machine's shortest time (1: no headroom)",
             title="How far each stage is from the machine's limit")
    longest = max(stage.timing.median_s / stage.limit(rows.rates)[0] for stage in rows.stages)
    axes.set_xlim(0.5, 6 * max(longest, 1.0))
    axes.grid(visible=False, axis='y')
    seen = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(seen.values(), seen.keys(), title='limited by', loc='lower right')
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
