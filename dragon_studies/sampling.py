"""Draw the values of a study's rows; the values of a row depend only on the study and on the row's index.

Each random point has its own generator, seeded by (seed, index); a Sobol point is reached by advancing one scrambled
sequence. Rows can therefore be drawn in any order, batch or process.
"""
from copy import deepcopy
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

import numpy as np

from dragon_ros.cli.inputs import Floats, MissingError
from dragon_studies.definition import Listed, Normal, Range, Study, Uniform, Variation, target_of

Values = dict[str, Any]


def check_libraries(study: Study) -> None:
    """Reject a study that needs scipy (for a Sobol sequence or a normal distribution) if scipy is not installed."""
    needs = study.design in ('sobol', 'saltelli') or any(isinstance(one, Normal) for _, one in study.vary)
    if needs and not find_spec('scipy'):
        raise MissingError("scipy: it is not installed, but Sobol sequences and normal distributions need it; "
                           "pip install 'dragon_ros[study]'")


def values_of(study: Study, index: int) -> Values:
    """Return the values of the varied keys for the row with the given index; per-bench values are lists."""
    if study.design == 'grid':
        return _in_grid(study, index)
    point, at, out = _point(study, index), 0, {}
    for (key, variation), width in zip(study.vary, study.widths, strict=True):
        drawn = [_typed(study, key, one) for one in _drawn(variation, point[at:at + width])]
        out[key] = drawn if variation.is_per_bench else drawn[0]
        at += width
    return out


def scene_values_of(study: Study, values: Values) -> Values:
    """Return the base scene with the given values substituted, as a mapping laid out like a scene file."""
    scene = deepcopy(study.base)
    for key, value in values.items():       # groups are split afterwards, so that all groups keep their numbers
        if not isinstance(value, list):
            last, target = target_of(scene, key)
            target[last] = value
    per_bench = {int(key.split('.')[2]): value for key, value in values.items() if isinstance(value, list)}
    for n in sorted(per_bench, reverse=True):
        scene['dragon']['groups'][n - 1:n] = [{'length_m': length_m, 'count': 1} for length_m in per_bench[n]]
    return scene


def _in_grid(study: Study, index: int) -> Values:
    """Return the values at a point of a grid; the last key varies fastest."""
    out: Values = {}
    for key, variation in reversed(study.vary):
        steps = levels_of(variation)
        index, step = divmod(index, len(steps))
        out[key] = _typed(study, key, steps[step])
    return {key: out[key] for key, _ in study.vary}


def levels_of(variation: Variation) -> list[Any]:
    """Return the values of a key in a grid."""
    if isinstance(variation, Listed):
        return list(variation.values)
    assert isinstance(variation, Range)
    assert variation.steps
    return [float(one) for one in np.linspace(variation.low, variation.high, variation.steps)]


def _typed(study: Study, key: str, value: Any) -> Any:
    """Return a value, rounded to an integer if the key has an integer value in the scene."""
    last, target = target_of(study.base, key)
    return round(value) if isinstance(target[last], int) and isinstance(value, float) else value


def _point(study: Study, index: int) -> Floats:
    """Return the point of the unit cube for the row with the given index."""
    if study.design == 'random':
        return np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(index,))).random(study.dimensions)
    if study.design == 'sobol':
        return _sequence(study.dimensions, study.seed).point(index)
    return _of_two(study, *divmod(index, len(study.vary) + 2))


def _of_two(study: Study, base: int, which: int) -> Floats:
    """Return base point A (0) or B (1), or A with one key's values from B (2 and up), as in Saltelli 2010, table 2."""
    both = _sequence(2 * study.dimensions, study.seed).point(base)
    a, b = both[:study.dimensions], both[study.dimensions:]
    if which < 2:
        return b if which else a
    ends = np.cumsum((0, *study.widths))
    mixed: Floats = a.copy()
    key = slice(ends[which - 2], ends[which - 1])
    mixed[key] = b[key]
    return mixed


class _Sequence:
    """A scrambled Sobol sequence and a position in it. Advancing is fast; moving backwards restarts the sequence."""

    def __init__(self, dimensions: int, seed: int) -> None:
        from scipy.stats import qmc  # imported lazily, because other designs do not need it
        self._engine, self._next = qmc.Sobol(dimensions, scramble=True, seed=np.random.default_rng(seed)), 0
        self._last: Floats = np.empty(0)

    def point(self, index: int) -> Floats:
        """Return the point with the given index."""
        if index == self._next - 1:
            return self._last
        if index < self._next:
            self._engine.reset()
            self._next = 0
        if index > self._next:
            self._engine.fast_forward(index - self._next)
        self._last, self._next = np.asarray(self._engine.random(1)[0], dtype=np.float64), index + 1
        return self._last


@lru_cache(maxsize=4)
def _sequence(dimensions: int, seed: int) -> _Sequence:
    return _Sequence(dimensions, seed)


def _drawn(variation: Variation, point: Floats) -> list[Any]:
    """Return the values of a variation for coordinates in [0, 1)."""
    if isinstance(variation, Listed):
        return [variation.values[int(one * len(variation.values))] for one in point]
    if isinstance(variation, Range) and variation.steps:
        return [levels_of(variation)[int(one * variation.steps)] for one in point]
    low, high = variation.low, variation.high
    if isinstance(variation, Normal):
        from scipy.special import ndtr, ndtri
        ends = ndtr((np.array([low, high]) - variation.mean) / variation.deviation)
        drawn = variation.mean + variation.deviation * ndtri(ends[0] + point * (ends[1] - ends[0]))
    else:
        assert isinstance(variation, (Range, Uniform))
        drawn = low + point * (high - low)
    out: list[Any] = np.clip(drawn, low, high).tolist()
    return out
