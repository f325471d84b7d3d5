"""Numerical summary of a data set: the number of rows with each status, and statistics of the answers."""
from collections.abc import Iterator
from dataclasses import asdict
from importlib.util import find_spec
from typing import Any

import numpy as np
import pyarrow as pa

from dragon_ros.cli.inputs import Floats, counted
from dragon_studies.dataset import DataSet
from dragon_studies.definition import Study
from dragon_studies.questions import MAIN, name_of
from dragon_studies.rows import STATUSES
from dragon_studies.statistics import (
    CONFIDENCE,
    distribution,
    may_be_normal,
    normal_upper_bound,
    proportion,
    quantile,
    safe_rows,
    upper_bound,
)

SAFE = 0.999            # the share of dragons that a bound must cover
_RANDOM = ('random', 'sobol')
_FEW = 8                # smallest number of rows for which a distribution is estimated
_MOST_SHOWN = 5         # largest number of reasons in a summary


def main_answers(study: Study) -> list[str]:
    """Return, for each question, the column that summaries and figures show."""
    return [MAIN[name_of(one)] for one in study.ask]


def numbers(table: pa.Table, name: str) -> Floats:
    """Return a column as an array of floats (rows,), with nan for empty cells."""
    return np.asarray(table.column(name).cast(pa.float64()).fill_null(float('nan')).to_numpy(), dtype=np.float64)


def summary(data: DataSet) -> dict[str, Any]:
    """Return a summary of a data set as plain values: counts, reasons, and statistics of each main answer."""
    table = data.table()
    statuses = table.column('status').to_pylist()
    reasons = [reason for reason in table.column('reason').to_pylist() if reason]
    often = sorted(set(reasons), key=lambda one: -reasons.count(one))[:_MOST_SHOWN]
    return {'folder': str(data.folder), 'rows': len(table), 'total': data.study.rows, 'design': data.study.design,
            'statuses': {status: statuses.count(status) for status in STATUSES},
            'reasons': {reason: reasons.count(reason) for reason in often},
            'cpu_s': float(np.sum(numbers(table, 'cpu_s'))),
            'answers': {name: found for name in main_answers(data.study)
                        if (found := _figures(data.study, table, name))}}


def _figures(study: Study, table: pa.Table, name: str) -> dict[str, Any]:
    """Return the minimum, median and maximum of an answer and, for random designs, bounds for all dragons."""
    values = numbers(table, name)
    known = values[~np.isnan(values)]
    if not known.size:
        return {}
    out: dict[str, Any] = {'count': int(known.size), 'least': float(known.min()), 'median': float(np.median(known)),
                           'greatest': float(known.max())}
    if study.design not in _RANDOM or known.size < _FEW or not find_spec('scipy'):
        return out
    out |= {'median_interval': _interval(asdict(quantile(known, 0.5))), 'confidence': CONFIDENCE, 'share': SAFE,
            'half_width': distribution(known)[2], 'rows_for_bound': safe_rows(SAFE)}
    if known.size < len(table):
        out['answered'] = asdict(proportion(int(known.size), len(table)))
    bound = upper_bound(known, SAFE)
    out['bound'] = bound if np.isfinite(bound) else None
    if may_be_normal(known):
        out['bound_if_normal'] = normal_upper_bound(known, SAFE)
    return out


def _interval(values: dict[str, float]) -> list[float | None]:
    return [one if np.isfinite(one) else None for one in (values['low'], values['high'])]


def text(found: dict[str, Any]) -> str:
    """Return a summary as text."""
    return '\n'.join(_lines(found))


def _lines(found: dict[str, Any]) -> Iterator[str]:
    counts = ', '.join(f'{count} {status.replace("_", " ")}' for status, count in found['statuses'].items() if count)
    yield (f'{found["folder"]}: {found["rows"]:,} of {counted(found["total"], "row", form=",")} ({counts or "none"}), '
           f'{found["cpu_s"]:.1f} s of CPU')
    for reason, count in found['reasons'].items():
        yield f'  {counted(count, "row")}: {reason}'
    for name, one in found['answers'].items():
        yield f'{name}: {one["least"]:.9g} to {one["greatest"]:.9g}, median {one["median"]:.9g}{_between(one)}'
        yield from _bounds(name, one)


def _between(one: dict[str, Any]) -> str:
    if 'median_interval' not in one:
        return f' ({counted(one["count"], "row", form=",")})'
    low, high = ('?' if end is None else f'{end:.9g}' for end in one['median_interval'])
    return f' (95 %: {low} to {high}; {counted(one["count"], "row", form=",")})'


def _bounds(name: str, one: dict[str, Any]) -> Iterator[str]:
    """Yield a bound that covers all but one dragon in a thousand or, if there are too few rows, the number required."""
    if 'share' not in one:
        return
    if one['bound'] is not None:
        yield f'{name}: {one["share"]:.1%} of dragons are below {one["bound"]:.9g} (with 95 % confidence)'
        return
    normal = ('; if the values are normally distributed (these rows are consistent with that), it is '
              f'{one["bound_if_normal"]:.9g}'
              if 'bound_if_normal' in one else '')
    yield (f'{name}: a bound for {one["share"]:.1%} of dragons (95 % confidence) needs {one["rows_for_bound"]:,} rows'
           f'{normal}')
