"""Pictures of a study: maps with contours and first contacts, curves, distributions with bands, and Sobol indices.

The pictures depend on the design. For a grid, the pictures show the main answers over one key or the first two keys.
For random and Sobol designs, the pictures show the distributions of the answers. For Saltelli designs, the pictures
show the Sobol indices of the inputs.
"""
from collections.abc import Iterator
from string import ascii_lowercase

import numpy as np
import pyarrow as pa
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from dragon_ros.cli.figures import BODY, HEAD, LINES, QUIET, TEXT_PT, legend_below, style
from dragon_ros.cli.inputs import FieldError, Floats, Ints, counted
from dragon_studies.answers import SAFE, main_answers, numbers
from dragon_studies.dataset import DataSet
from dragon_studies.definition import Listed
from dragon_studies.sampling import levels_of
from dragon_studies.statistics import (
    FEWEST_POINTS,
    distribution,
    indices,
    may_be_normal,
    normal_upper_bound,
    quantile,
    safe_rows,
    upper_bound,
)

_UNITS = {'_m': 'm', '_s': 's', '_m_s': 'm/s', '_m_s2': 'm/s²', '_rad': 'rad', '_deg': '°'}
_FEW = 8            # smallest number of rows for a distribution
NEEDED = (f'a grid needs a key with several values and a row with an answer, a distribution {_FEW} such rows, and '
          f'Sobol indices all rows of {FEWEST_POINTS} or more samples')
_CONTOURS = 12
_MOST_PAIRS = 12    # largest number of pairs of benches that colours can distinguish
_EDGE = '#444444'   # outlines white lines and letters, which would be invisible on the light colours of a map
_MOST_LETTERS = 20  # largest number of letters in a row or a column of a map
_PAIRS = {'contact_t_s': ('contact_inner', 'contact_outer'), 'min_pitch_m': ('min_pitch_inner', 'min_pitch_outer')}


def pictures(data: DataSet) -> Iterator[tuple[str, Figure]]:
    """Yield (name, figure) for each picture; titles of incomplete data sets state their number of rows."""
    table = data.table()
    varied = [key for key, one in data.study.vary if not isinstance(one, Listed) or len(one.values) > 1]
    for name in main_answers(data.study):
        values = numbers(table, name)
        if np.all(np.isnan(values)):
            continue
        with style():
            if data.study.design == 'grid':
                if len(varied) == 1:
                    yield name, _curve(data, table, varied[0], name)
                elif len(varied) > 1:
                    yield name, _map(data, table, (varied[0], varied[1]), name)
            elif data.study.design == 'saltelli':
                yield from _what_matters(data, values, name)
            elif np.sum(~np.isnan(values)) >= _FEW:
                yield name, _spread(data, values[~np.isnan(values)], name)


def _label(name: str) -> str:
    """Return the name of a key or column with its unit: 'track.pitch_m' is 'track pitch (m)'."""
    suffix = max((one for one in _UNITS if name.endswith(one)), key=len, default='')
    words = name.removesuffix(suffix).replace('.', ' ').replace('_', ' ')
    return f'{words} ({_UNITS[suffix]})' if suffix else words


def _rows_text(data: DataSet, count: int) -> str:
    total = data.study.rows
    rows = counted(total, 'row', form=',')
    return rows if count == total else f'{count:,} of {rows}'


def _curve(data: DataSet, table: pa.Table, key: str, name: str) -> Figure:
    """Return a figure of an answer over the only varied key; rows without an answer are marked below the curve."""
    figure = Figure(figsize=(8.4, 5))
    axes = figure.subplots()
    at, values = table.column(key).to_numpy(zero_copy_only=False), numbers(table, name)
    order = np.argsort(at, kind='stable') if at.dtype.kind in 'if' else np.arange(at.size)
    axes.plot(at[order], values[order], 'o-', color=LINES[0], markersize=3)
    axes.set(xlabel=_label(key), ylabel=_label(name))
    axes.set_title(f'{data.folder.name}: {_label(name)}, {_rows_text(data, len(table))}')
    _note_missing(axes, values)
    return figure


def _note_missing(axes: Axes, values: Floats) -> None:
    missing = int(np.sum(np.isnan(values)))
    if missing:
        axes.text(0.01, 0.01, f'{counted(missing, "row", "has", form=",")} no answer', transform=axes.transAxes,
                  color=QUIET, fontsize=TEXT_PT)


def _map(data: DataSet, table: pa.Table, keys: tuple[str, str], name: str) -> Figure:
    """Return a figure of an answer over two keys, with contours and, if known, the pair that touches first.

    If more than two keys vary, the title states the values of the other keys, which are the first that have answers.
    """
    held = _held(data, table, keys, name)
    grid = _on_grid(data, table, held, name)
    pairs = _PAIRS.get(name)
    figure = Figure(figsize=(7.4, 10.4 if pairs else 5.4))
    panels = figure.subplots(2 if pairs else 1, 1, squeeze=False)[:, 0]
    x, y = (_levels(data, key)[0] for key in keys)
    shown = panels[0].pcolormesh(x, y, grid.T, shading='nearest', cmap='viridis')
    if min(grid.shape) > 1 and np.nanmax(grid) > np.nanmin(grid):
        lines = panels[0].contour(x, y, grid.T, levels=_CONTOURS, colors='white', linewidths=0.8)
        lines.set_path_effects([withStroke(linewidth=1.6, foreground=_EDGE)])
        for label in panels[0].clabel(lines, fontsize=TEXT_PT):
            label.set_path_effects([withStroke(linewidth=2, foreground=_EDGE)])
    figure.colorbar(shown, ax=panels[0], label=_label(name))
    panels[0].set_title('\n'.join((f'{data.folder.name}: {_label(name)}, {_rows_text(data, len(table))}',
                                   *_held_text(data, held))))
    if pairs:
        inner, outer = (_on_grid(data, table, held, one) for one in pairs)
        _pairs_panel(figure, panels[1], (x, y), inner, outer)
    for axes in panels:
        axes.grid(False)
        axes.set(xlabel=_label(keys[0]), ylabel=_label(keys[1]))
        for axis, key in ((axes.xaxis, keys[0]), (axes.yaxis, keys[1])):
            words = levels_of(dict(data.study.vary)[key])
            if isinstance(words[0], str):
                axis.set_ticks(range(len(words)), labels=words)
    return figure


def _levels(data: DataSet, key: str) -> tuple[list[float], Ints]:
    """Return the different values of a key in increasing order, and their places in the grid.

    Words keep their order, and are drawn at 0, 1, ...
    """
    levels = levels_of(dict(data.study.vary)[key])
    values, places = np.unique(range(len(levels)) if isinstance(levels[0], str) else levels, return_index=True)
    return [float(value) for value in values], places


def _sizes(data: DataSet) -> list[int]:
    return [len(levels_of(variation)) for _, variation in data.study.vary]


def _held(data: DataSet, table: pa.Table, keys: tuple[str, str], name: str) -> dict[str, int]:
    """Return the place in the grid of each key except two: that of the first values with an answer."""
    answered = table.column('index').to_numpy()[~np.isnan(numbers(table, name))]
    other = {key: at for (key, _), at in zip(data.study.vary, np.unravel_index(answered, _sizes(data)), strict=True)
             if key not in keys}
    first = np.lexsort([*reversed(other.values())])[0] if other else 0
    return {key: int(at[first]) for key, at in other.items()}


def _held_text(data: DataSet, held: dict[str, int]) -> list[str]:
    """Return the values of the keys that a map does not show, as at most one line of text."""
    vary = dict(data.study.vary)
    values = [f'{key} = {levels_of(vary[key])[at]}' for key, at in held.items()
              if len(levels_of(vary[key])) > 1]
    return [', '.join(values)] if values else []


def _on_grid(data: DataSet, table: pa.Table, held: dict[str, int], name: str) -> Floats:
    """Return a column as a function of the two keys that are not held; missing rows are nan."""
    sizes = _sizes(data)
    whole = np.full(int(np.prod(sizes)), np.nan)
    whole[table.column('index').to_numpy()] = numbers(table, name)
    x, y = (_levels(data, key)[1] for key, _ in data.study.vary if key not in held)
    out: Floats = whole.reshape(sizes)[tuple(held.get(key, slice(None)) for key, _ in data.study.vary)][np.ix_(x, y)]
    return out


def _pairs_panel(figure: Figure, axes: Axes, at: tuple[list[float], list[float]], inner: Floats, outer: Floats) -> None:
    """Draw which pair of benches touches first; for more than a dozen pairs, show only the outer bench's number."""
    code = inner * 1e6 + outer
    kinds = np.unique(code[~np.isnan(code)])
    place = np.where(np.isnan(code), np.nan, np.searchsorted(kinds, code).astype(float))
    axes.set_title('which benches touch first')
    if kinds.size > _MOST_PAIRS:
        shown = axes.pcolormesh(*at, outer.T, shading='nearest', cmap='cividis')
        figure.colorbar(shown, ax=axes, label='outer bench')
        return
    shown = axes.pcolormesh(*at, place.T, shading='nearest', vmin=-0.5, vmax=kinds.size - 0.5,
                            cmap=colormaps['viridis'].resampled(kinds.size))
    bar = figure.colorbar(shown, ax=axes, ticks=range(kinds.size))
    bar.ax.set_yticklabels([f'{letter}: {int(one // 1e6)} and {int(one % 1e6)}'
                            for letter, one in zip(ascii_lowercase, kinds, strict=False)])
    _letters(axes, at, place)


def _letters(axes: Axes, at: tuple[list[float], list[float]], place: Floats) -> None:
    """Write a letter for the pair on each cell of a map, or on some cells if there are many, in addition to colours."""
    steps = [-(-count // _MOST_LETTERS) for count in place.shape]
    for n, k in ((n, k) for n in range(steps[0] // 2, place.shape[0], steps[0])
                 for k in range(steps[1] // 2, place.shape[1], steps[1])):
        if not np.isnan(place[n, k]):
            axes.text(at[0][n], at[1][k], ascii_lowercase[int(place[n, k])], ha='center', va='center', color='white',
                      fontsize=TEXT_PT, path_effects=[withStroke(linewidth=2, foreground=_EDGE)])


def _spread(data: DataSet, values: Floats, name: str) -> Figure:
    """Return a figure of an answer's histogram, its distribution with a band, and its 1-in-1000 quantile."""
    figure = Figure(figsize=(8.4, 10))
    above, below = figure.subplots(2, 1)
    above.hist(values, bins=max(8, min(60, int(2 * values.size ** 0.5))), color=BODY, edgecolor='white', linewidth=0.4)
    above.set(xlabel=_label(name), ylabel='rows')
    above.set_title(f'{data.folder.name}: {_label(name)}, {_rows_text(data, values.size)}')
    ordered, steps, half = distribution(values)
    below.step(ordered, steps, where='post', color=LINES[0], label='share of dragons below')
    below.fill_between(ordered, np.clip(steps - half, 0, 1), np.clip(steps + half, 0, 1), step='post', color=LINES[0],
                       alpha=0.18, linewidth=0, label='95 % band')
    middle = quantile(values, 0.5)
    below.axvline(middle.value, color=QUIET, linewidth=0.8, linestyle=':', label=f'median {middle.value:.6g}')
    bound = upper_bound(values, SAFE)
    if np.isfinite(bound):
        below.axvline(bound, color=HEAD, label=f'{SAFE:.1%} are below {bound:.6g} (95 % sure)')
    elif may_be_normal(values):
        normal = normal_upper_bound(values, SAFE)
        below.axvline(normal, color=HEAD, linestyle='--', label=f'{SAFE:.1%} are below {normal:.6g} if they are\n'
                      f'normally distributed; a bound needs {safe_rows(SAFE):,} rows')
    below.set(xlabel=_label(name), ylabel='share of dragons', ylim=(0, 1.02))
    legend_below(below)
    below.set_title('distribution')
    return figure


def _what_matters(data: DataSet, values: Floats, name: str) -> Iterator[tuple[str, Figure]]:
    """Yield a figure of the Sobol indices of each input if all rows have the answer."""
    try:
        found = indices(data.study, values)
    except FieldError:      # rows are missing, rejected or too few, and the summary counts them
        return
    figure = Figure(figsize=(8.4, 1.6 + 0.7 * len(found)))
    axes = figure.subplots()
    at = np.arange(len(found))[::-1]
    for n, (label, ends) in enumerate((('alone (first order)', [one.first for one in found]),
                                       ('with others (total)', [one.total for one in found]))):
        middle = np.array([one.value for one in ends])
        reach = np.abs(np.array([[one.value - one.low, one.high - one.value] for one in ends])).T
        axes.barh(at + 0.2 - 0.4 * n, middle, height=0.38, color=LINES[n], xerr=reach, label=label,
                  error_kw={'elinewidth': 1, 'ecolor': QUIET})
    axes.set_yticks(at, [_label(one.key) for one in found])
    axes.set(xlabel='share of the variance (Sobol index, 95 % interval)', xlim=(min(0.0, axes.get_xlim()[0]), None))
    figure.legend(loc='outside lower center', ncols=2)      # below the axis label, however few bars there are
    axes.set_title(f'{data.folder.name}: what {_label(name)} depends on, {_rows_text(data, values.size)}')
    yield name, figure
