"""Rows and batches of rows. A row is a scene of a study with its answers; it depends only on the study and its index.

If a scene is rejected or exceeds its budget, its row states the reason. Only ``cpu_s``, and therefore whether a row
exceeds its budget, depends on the machine.
"""
import hashlib
import json
import time
from collections.abc import Callable, Iterable
from functools import lru_cache, partial
from typing import Any, NamedTuple

from dragon_ros import Scene
from dragon_ros.cli.inputs import Document, DragonError, __version__, scene_of
from dragon_studies.definition import Listed, Study, study_from, target_of
from dragon_studies.questions import Asked, name_of
from dragon_studies.sampling import scene_values_of, values_of

OK, REFUSED, OVER_BUDGET, FAILED = 'ok', 'refused', 'over_budget', 'failed'
STATUSES = (OK, REFUSED, OVER_BUDGET, FAILED)       # from best to worst; a row has the worst status of its answers
_ABOUT: dict[str, type] = {'status': str, 'reason': str, 'cpu_s': float, 'version': str, 'scene_sha256': str}
_MOST_SHOWN = 500       # largest number of characters in a reason
Row = dict[str, Any]


class _OverBudget(Exception):
    """A row has used up its time budget."""


class Column(NamedTuple):
    """A column of a data set: its type, and whether each value is a list with one entry per bench."""

    type: type
    is_list: bool = False


def columns_of(study: Study) -> dict[str, Column]:
    """Return the columns of a study's rows: index, inputs by key, answers, status and cost."""
    inputs = {key: Column(_type_of(study, key, one), one.is_per_bench) for key, one in study.vary}
    answers = {name: Column(kind) for question in study.ask for name, kind in question.columns.items()}
    about = {name: Column(kind) for name, kind in _ABOUT.items()}
    return {'index': Column(int), **inputs, **answers, **about}


def _type_of(study: Study, key: str, variation: object) -> type:
    """Return the type of a key's values."""
    if isinstance(variation, Listed) and isinstance(variation.values[0], str):
        return str
    last, target = target_of(study.base, key)
    listed = isinstance(variation, Listed) and any(isinstance(one, float) for one in variation.values)
    return int if isinstance(target[last], int) and not listed else float


def row_of(study: Study, index: int) -> Row:
    """Return the row with the given index; missing answers are None."""
    return _computed(study, _DrawnRow.of(study, index))


def rows_of(study: Study, indices: Iterable[int]) -> list[Row]:
    """Return rows in index order. Rows with equal dragons and tracks are computed consecutively.

    Such rows share a compiled model, which does not affect their values.
    """
    drawn = sorted((_DrawnRow.of(study, index) for index in indices), key=lambda one: one.shares)
    return sorted((_computed(study, one) for one in drawn), key=lambda row: row['index'])


@lru_cache(maxsize=8)
def parsed(text: str) -> Study:
    """Return the study described by a complete YAML text, which is the form in which workers receive it."""
    return study_from('study', text)


class _DrawnRow(NamedTuple):
    """The inputs of a row, the mapping of its scene, and the key under which rows share a compiled model."""

    number: int
    inputs: Row
    scene: dict[str, Any]
    shares: str

    @classmethod
    def of(cls, study: Study, index: int) -> '_DrawnRow':
        inputs = values_of(study, index)
        scene = scene_values_of(study, inputs)
        return cls(index, inputs, scene, json.dumps([scene['dragon'], scene['track']]))


def _computed(study: Study, drawn: _DrawnRow) -> Row:
    """Return a row with its answers, status and cost."""
    began, row = time.thread_time(), dict.fromkeys(columns_of(study))
    row |= {'index': drawn.number, **drawn.inputs, 'version': __version__, 'scene_sha256': _hash_of(drawn.scene)}
    reasons: list[tuple[str, str]] = []

    def tell(_: int) -> None:
        if time.thread_time() - began > study.budget_s:
            raise _OverBudget

    scene = _tried('scene', partial(scene_of, Document('scene', drawn.scene)), reasons, study)
    if isinstance(scene, Scene):
        asked = Asked(scene, tell)
        for question in study.ask:
            found = _tried(name_of(question), partial(question.answer, asked), reasons, study)
            row |= found if isinstance(found, dict) else {}
            if reasons and reasons[-1][0] == OVER_BUDGET:
                break
    status = max((one for one, _ in reasons), key=STATUSES.index, default=OK)
    return row | {'status': status, 'reason': '; '.join(why for _, why in reasons)[:_MOST_SHOWN] or None,
                  'cpu_s': time.thread_time() - began}


def _tried(what: str, answer: Callable[[], object], reasons: list[tuple[str, str]], study: Study) -> object:
    """Return an answer, or record why there is none: one scene's error must not end a study of a million rows."""
    try:
        return answer()
    except _OverBudget:
        reasons.append((OVER_BUDGET, f'{what}: it took more than its budget of {study.budget_s:g} s'))
    except DragonError as error:
        reasons.append((REFUSED, f'{what}: {" ".join(str(error).split())}'))
    except Exception as error:  # noqa: BLE001 - a failing scene is reported in its row
        reasons.append((FAILED, f'{what}: {type(error).__name__}: {" ".join(str(error).split())}'))
    return None


def _hash_of(scene: dict[str, Any]) -> str:
    """Return the SHA-256 digest of a complete scene, written as JSON with sorted keys."""
    return hashlib.sha256(json.dumps(scene, sort_keys=True).encode()).hexdigest()
