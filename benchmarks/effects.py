"""``cost effects``: the time and bytes that each effect adds to a tick, alone and in each named scene."""
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.passes import PASSES
from benchmarks.rates import times
from benchmarks.wholes import Whole, wholes
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT, legend_below
from dragon_ros.configuration import scene_names
from dragon_ros.core.flags import known
from dragon_ros.cost.effects import Price, price
from dragon_ros.cost.measure import TIMES, circumstances
from dragon_ros.scenes.load import load_scene

ALONE = 'alone'     # the classic scene with only the effects that an effect needs


@dataclass(frozen=True)
class Measured:
    """All rows of the page; ``prices`` maps scenes to the same effects in the same order."""

    prices: dict[str, list[Price]]
    wholes: list[Whole]


def measure(budget_s: float = 0.3) -> Measured:
    """Measure everything; progress goes to standard error."""
    named = {name: load_scene(name) for name in scene_names()}
    scenes = {ALONE: load_scene('minimal'), **{name: scene for name, scene in named.items() if not scene.is_led}}
    jobs = [(effect, name) for name in scenes for effect in known().values()]
    rows = [price(effect, scenes[name], budget_s / PASSES)
            for effect, name in tqdm(PASSES * jobs, desc='cost effects', unit='price', disable=None)]
    best = iter([_fastest(rows[n::len(jobs)]) for n in range(len(jobs))])
    return Measured({name: [next(best) for _ in known()] for name in scenes}, wholes(4 * budget_s))


def _fastest(rows: list[Price]) -> Price:
    """Return the row of the fastest of several passes over an effect in a scene."""
    return min(rows, key=lambda row: row.timing.median_s if row.timing else 0.0)


def table(rows: Measured) -> str:
    """Return both tables as Markdown, after a line that states the machine, the versions and the date."""
    lines = [f'{circumstances()}. Each time is the median of the fastest of {PASSES} passes.', '',
             '| µs per tick | bytes | ' + ' | '.join(rows.prices) + ' |',
             '|---|---:|' + '---:|' * len(rows.prices)]
    for alone, *mine in zip(rows.prices[ALONE], *rows.prices.values(), strict=True):
        lines.append(f'| {alone.effect} | {alone.size:,} | ' + ' | '.join(map(_cell, mine)) + ' |')
    lines += ['', '| a whole tick of the classic scene | µs | quartiles | times | of | limit (µs) | times the limit |',
              '|---|---:|---|---:|---|---:|---:|']
    lines += [f'| {row.name} | {row.timing.median_s * 1e6:.0f} | {row.timing.low_s * 1e6:.0f} to '
              f'{row.timing.high_s * 1e6:.0f} | {row.ratio:.3f} | {row.over} | {row.limit_s * 1e6:.3g} '
              f'| {times(row.timing.median_s, row.limit_s)} |' for row in rows.wholes]
    return '\n'.join(lines)


def _cell(row: Price) -> str:
    return '-' if row.timing is None else f'{row.timing.median_s * 1e6:.3g}'


def csv_text(rows: Measured) -> str:
    """Return the rows as CSV, with times in seconds."""
    prices = [(row.effect, scene, row.size, *(row.timing.cells if row.timing else [''] * 4), '', '')
              for scene, mine in rows.prices.items() for row in mine]
    wholes = [(whole.name, f'over {whole.over}', '', *whole.timing.cells, whole.ratio, whole.limit_s)
              for whole in rows.wholes]
    return csv_of(['what', 'scene', 'bytes', *TIMES, 'ratio', 'limit_s'], [*prices, *wholes])


def picture(rows: Measured) -> Figure:
    """Return a figure of two panels: the cost of each effect, and whole ticks."""
    figure = Figure(figsize=(PAGE_IN, 9), layout='constrained')
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    _price_panel(above, rows.prices)
    _whole_panel(below, rows.wholes)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure


def _price_panel(axes: Axes, prices: dict[str, list[Price]]) -> None:
    names = [row.effect for row in prices[ALONE] if row.timing]
    for shift, scene, colour in ((-0.2, ALONE, '#0072B2'), (0.2, 'first_contact', '#E69F00')):
        mine = {row.effect: row for row in prices[scene] if row.timing}
        for n, name in enumerate(names):
            if name not in mine:
                continue
            row = mine[name]
            assert row.timing is not None
            us = row.timing.median_s * 1e6
            axes.barh(n + shift, us, 0.36, color=colour, label=scene if n == 0 else None)
            size = f', {row.size:,} bytes' if scene == ALONE else ''
            axes.annotate(f'{us:.3g} µs{size}', (max(us, 0.0), n + shift), xytext=(4, 0), textcoords='offset points',
                          va='center', fontsize=TEXT_PT)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set(xlabel='added to a tick, computed and encoded (µs)', title='What each effect adds')
    axes.set_xlim(right=1.25 * axes.get_xlim()[1])
    legend_below(axes, fontsize=TEXT_PT)


def _whole_panel(axes: Axes, rows: list[Whole]) -> None:
    shown = {row.name: row for row in rows}
    for n, row in enumerate(shown.values()):
        us = row.timing.median_s * 1e6
        axes.barh(n, us, 0.6, color='#009E73')
        axes.annotate(f'{us:.0f} µs', (us, n), xytext=(4, 0), textcoords='offset points', va='center', fontsize=TEXT_PT)
    axes.set_yticks(range(len(shown)), list(shown))
    axes.invert_yaxis()
    axes.set(xlabel='a whole tick, computed and encoded (µs)', title='Whole ticks of the classic dragon')
    axes.set_xlim(right=1.2 * axes.get_xlim()[1])
