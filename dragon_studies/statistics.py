"""Statistics of a data set: quantiles and distributions with confidence bands, proportions, and Sobol indices.

Bands have 95 % confidence and, unless stated otherwise, assume nothing about the distribution. The bands are valid for
rows of a random design; for a Sobol design, they are usually too wide, but this is not proved.
"""
from dataclasses import dataclass
from math import ceil, inf, log, sqrt

import numpy as np

from dragon_ros.cli.inputs import FieldError, Floats
from dragon_studies.definition import Study

CONFIDENCE = 0.95
FEWEST_POINTS = 16      # smallest number of base points for Sobol indices; fewer points vary too little by bootstrap
_RESAMPLES = 999
_NORMAL_FROM = 20       # smallest number of rows for which a standard deviation is estimated
_MOST_TESTED = 5000     # largest number of tested values: for more values, the test's p-values are inaccurate


@dataclass(frozen=True)
class Estimate:
    """A value with its confidence interval; an end is infinite if there are too few rows to estimate it."""

    value: float
    low: float
    high: float


def quantile(values: Floats, share: float, confidence: float = CONFIDENCE) -> Estimate:
    """Return a quantile of samples (N,) and the order statistics that bracket it, using the binomial distribution."""
    return Estimate(float(np.quantile(values, share)), *_order_statistics(values, share, confidence, 'two-sided'))


def _order_statistics(values: Floats, share: float, confidence: float, side: str) -> tuple[float, float]:
    """Return the order statistics that bound a quantile with the given confidence, infinite if there are too few."""
    from scipy.stats import quantile_test  # slow to import
    low, high = quantile_test(values, p=share, alternative=side).confidence_interval(confidence)
    return -inf if np.isnan(low) else float(low), inf if np.isnan(high) else float(high)


def safe_rows(share: float, confidence: float = CONFIDENCE) -> int:
    """Return the number of rows whose maximum bounds a quantile: the smallest N with 1 - share^N >= confidence."""
    return ceil(log(1 - confidence) / log(share))


def upper_bound(values: Floats, share: float, confidence: float = CONFIDENCE) -> float:
    """Return an upper bound for a share of all values, with the given confidence, or inf if there are too few rows."""
    return _order_statistics(values, share, confidence, 'less')[1]


def normal_upper_bound(values: Floats, share: float, confidence: float = CONFIDENCE) -> float:
    """Return a bound like ``upper_bound``, valid only **if** the values are normally distributed (tolerance factor)."""
    from scipy.stats import nct, norm
    count = values.size
    factor = float(nct.ppf(confidence, count - 1, norm.ppf(share) * sqrt(count))) / sqrt(count)
    return float(np.mean(values) + factor * np.std(values, ddof=1))


def may_be_normal(values: Floats) -> bool:
    """Return whether a sample is continuous and consistent with a normal distribution (Shapiro and Wilk 1965)."""
    from scipy.stats import shapiro
    if values.size < _NORMAL_FROM or np.unique(values).size < values.size:
        return False
    return bool(shapiro(values[:_MOST_TESTED]).pvalue > 1 - CONFIDENCE)


def proportion(hits: int, count: int, confidence: float = CONFIDENCE) -> Estimate:
    """Return a proportion with its confidence interval (Clopper and Pearson 1934)."""
    from scipy.stats import binomtest
    low, high = binomtest(hits, count).proportion_ci(confidence, method='exact')
    return Estimate(hits / count, float(low), float(high))


def distribution(values: Floats, confidence: float = CONFIDENCE) -> tuple[Floats, Floats, float]:
    """Return sorted values (N,), their empirical distribution, and the half width of its band (DKW, Massart 1990)."""
    ordered = np.sort(values)
    steps: Floats = np.arange(1, ordered.size + 1) / ordered.size
    return ordered, steps, sqrt(log(2 / (1 - confidence)) / (2 * ordered.size))


@dataclass(frozen=True)
class Indices:
    """Sobol indices of one input: its effect alone (first order), and including all interactions (total)."""

    key: str
    first: Estimate
    total: Estimate


def indices(study: Study, values: Floats) -> list[Indices]:
    """Return the Sobol indices of an answer (rows,) in a study of design ``saltelli``, with bootstrapped intervals.

    The estimators are those of Saltelli 2010. Raises FieldError for any other design, or if an answer is missing,
    because the indices need every row.
    """
    if study.design != 'saltelli':
        raise FieldError('design', study.design, 'Sobol indices need paired rows', 'write design: saltelli')
    if study.samples < FEWEST_POINTS:
        raise FieldError('samples', study.samples, f'Sobol indices and their intervals need at least {FEWEST_POINTS} '
                         'base points', 'give more --samples')
    missing = int(np.sum(np.isnan(values)))
    if missing or values.size < study.rows:
        raise FieldError('rows', missing or values.size, 'each row must have the answer',
                         'narrow the variations until no row is rejected, or finish the study')
    keys = [key for key, _ in study.vary]
    if np.ptp(values) == 0:
        nothing = Estimate(0.0, 0.0, 0.0)
        return [Indices(key, nothing, nothing) for key in keys]
    table = values.reshape(study.samples, len(keys) + 2).T
    draw = np.random.default_rng(study.seed)
    again = np.array([_both_of(table[:, draw.integers(study.samples, size=study.samples)]) for _ in range(_RESAMPLES)])
    low, high = np.percentile(again, (50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)), axis=0)
    first, total = (map(Estimate, *(part[n].tolist() for part in (_both_of(table), low, high))) for n in (0, 1))
    return [Indices(*row) for row in zip(keys, first, total, strict=True)]


def _both_of(table: Floats) -> Floats:
    """Return the first-order and total indices (2, keys) of answers (2 + keys, samples)."""
    from scipy.stats import sobol_indices
    functions = {'f_A': table[:1], 'f_B': table[1:2], 'f_AB': table[2:, None, :]}
    found = sobol_indices(func=functions, n=table.shape[1])
    return np.stack((np.ravel(found.first_order), np.ravel(found.total_order)))
