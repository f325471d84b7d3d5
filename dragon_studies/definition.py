"""A study: a base scene, its variations, the design, the samples and the questions. A study is loaded like a scene.

A study is self-contained: it includes its complete base scene, can be written as YAML text, and can be restored from
that text. Workers receive this text, and data sets contain it.
"""
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, ClassVar

import yaml

from dragon_ros import Scene
from dragon_ros.cli.inputs import (
    Document,
    FieldError,
    InputError,
    MissingError,
    changed_scene,
    choice,
    configuration_folder,
    number,
    parse_document,
    plain_number,
    read_document,
    scene_of,
    scene_values,
    settle,
    shown,
    whole,
)
from dragon_studies.questions import QUESTIONS, Question, name_of

DESIGNS = ('grid', 'random', 'sobol', 'saltelli')
MOST_ROWS = 10**9
MOST_DIMENSIONS = 10_000        # largest number of coordinates; saltelli needs twice as many, and scipy supports 21,201
_KEYS = ('scene', 'set', 'vary', 'design', 'samples', 'seed', 'ask', 'budget_s', 'about')
_MOST_STEPS = 100_000
_MOST_DIGITS = 6        # largest number of digits in a list index
_FAR = 1e300            # largest value, chosen so that differences stay finite
Values = dict[str, Any]


@dataclass(frozen=True)
class Listed:
    """A list of values; a random design draws each value with equal probability."""

    values: tuple[Any, ...]
    is_per_bench: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Reject an empty list, a mixture of numbers and words, and values of other types."""
        if not 1 <= len(self.values) <= _MOST_STEPS:
            raise FieldError('values', len(self.values), f'a list has 1 to {_MOST_STEPS} values', 'give at least one')
        for value in self.values:
            if not isinstance(value, (int, float, str)):
                raise FieldError('values', value, 'a list can contain only numbers and words', 'use only these')
        if len({isinstance(value, str) for value in self.values}) > 1:
            raise FieldError('values', self.values, 'a list contains either numbers or words', 'use only one kind')

    @property
    def as_value(self) -> Any:
        """The value as written in a study file."""
        return list(self.values)


@dataclass(frozen=True)
class Range:
    """``steps`` values from ``low`` to ``high``, inclusive; without ``steps``, random values in between."""

    low: float
    high: float
    steps: int | None = None
    is_per_bench: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Reject an invalid range."""
        settle(self, low=number('from', self.low, low=-_FAR), high=number('to', self.high, above=self.low, high=_FAR))
        if self.steps is not None:
            whole('steps', self.steps, low=2, high=_MOST_STEPS)

    @property
    def as_value(self) -> Any:
        """The value as written in a study file."""
        return {'from': self.low, 'to': self.high, **({} if self.steps is None else {'steps': self.steps})}


@dataclass(frozen=True)
class Uniform:
    """A uniform distribution; ``per: bench`` draws one value for each bench of a group."""

    low: float
    high: float
    is_per_bench: bool = False

    def __post_init__(self) -> None:
        """Reject invalid bounds."""
        settle(self, low=number('uniform', self.low, low=-_FAR),
               high=number('uniform', self.high, above=self.low, high=_FAR))

    @property
    def as_value(self) -> Any:
        """The value as written in a study file."""
        return {'uniform': [self.low, self.high], **_per(self.is_per_bench)}


@dataclass(frozen=True)
class Normal:
    """A normal distribution, truncated to ``within``; ``per: bench`` draws one value for each bench of a group."""

    mean: float
    deviation: float
    low: float
    high: float
    is_per_bench: bool = False

    def __post_init__(self) -> None:
        """Reject invalid values, and bounds that exclude almost all of the distribution."""
        settle(self, mean=number('normal', self.mean, low=-_FAR, high=_FAR),
               deviation=number('normal', self.deviation, above=0.0, high=_FAR),
               low=number('within', self.low, low=-_FAR), high=number('within', self.high, above=self.low, high=_FAR))
        if not (self.mean - self.high < 6 * self.deviation and self.low - self.mean < 6 * self.deviation):
            raise FieldError('within', [self.low, self.high], 'they are 6 standard deviations or more from the mean',
                             'give bounds closer to the mean')

    @property
    def as_value(self) -> Any:
        """The value as written in a study file."""
        return {'normal': [self.mean, self.deviation], 'within': [self.low, self.high], **_per(self.is_per_bench)}


Variation = Listed | Range | Uniform | Normal


def _per(is_per_bench: bool) -> Values:
    return {'per': 'bench'} if is_per_bench else {}


@dataclass(frozen=True)
class Study:
    """A base scene, the varied keys, the design and the questions; together with an index, they determine a row.

    ``samples`` is the number of points of a random or Sobol design; for ``saltelli``, it is the number of base points,
    and each base point has two rows plus one row per key. ``samples`` is ignored for grids. ``budget_s`` is the CPU
    time per row.
    """

    scene: Scene = field(default_factory=Scene)
    vary: tuple[tuple[str, Variation], ...] = ()
    design: str = 'grid'
    samples: int = 0
    seed: int = 0
    ask: tuple[Question, ...] = ()
    budget_s: float = 600.0

    def __post_init__(self) -> None:
        """Reject a study that would have no rows."""
        choice('design', self.design, DESIGNS)
        whole('seed', self.seed, low=0, high=2**63 - 1)
        settle(self, budget_s=number('budget_s', self.budget_s, above=0.0, high=1e9))
        if not self.vary:
            raise FieldError('vary', {}, 'a study varies at least one key of its scene', 'give one, such as '
                             'track.pitch_m: {from: 0.5, to: 0.6, steps: 11}')
        if not self.ask:
            raise FieldError('ask', [], 'a study asks at least one question', f'name one of {", ".join(QUESTIONS)}')
        for key, variation in self.vary:
            self._check_key(key, variation)
        if self.design == 'grid':
            settle(self, samples=prod(len(_steps_of(one)) for _, one in self.vary))
        whole('samples', self.samples, low=1, high=MOST_ROWS)
        if self.design == 'saltelli' and len(self.vary) < 2:
            raise FieldError('vary', [key for key, _ in self.vary], 'the design saltelli compares the influence of '
                             'several keys', 'vary at least two')
        if self.design == 'saltelli' and self.samples & (self.samples - 1):
            raise FieldError('samples', self.samples, 'the number of samples of the design saltelli must be a power '
                             'of 2',
                             'give 64, 128, 256, ...')
        whole('rows', self.rows, low=1, high=MOST_ROWS)
        whole('vary', self.dimensions, low=1, high=MOST_DIMENSIONS)

    def _check_key(self, key: str, variation: Variation) -> None:
        """Reject an unknown key, and a variation that does not suit the key or the design."""
        at = f'vary.{key}'
        group, target = target_of(self.base, key)
        value = target.get(group)
        if isinstance(value, (list, dict)):
            raise FieldError(at, value, 'it is not a single value', 'give one of the keys inside it')
        if self.design == 'grid' and (isinstance(variation, (Uniform, Normal)) or
                                      (isinstance(variation, Range) and variation.steps is None)):
            raise FieldError(at, variation.as_value, 'a grid needs lists, or ranges with steps',
                             'give steps, or choose another design')
        if isinstance(value, str) and not isinstance(variation, Listed) and key != 'accuracy':
            raise FieldError(at, variation.as_value, f'its value is a word, {value}', 'list the words')
        if type(value) is int and isinstance(variation, Listed):
            for one in variation.values:
                if isinstance(one, float) and not one.is_integer():
                    raise FieldError(at, one, f'its value is a whole number, {value}', 'list whole numbers')
        if variation.is_per_bench and not (key.startswith('dragon.groups.') and key.endswith('.length_m')):
            raise FieldError(at, variation.as_value, 'only a group of mixed benches has a value for each bench',
                             'use dragon.groups.N.length_m in a scene with dragon.kind: mixed')

    @cached_property
    def base(self) -> Values:
        """The complete base scene, as a mapping laid out like a scene file."""
        return scene_values(self.scene)

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """The number of coordinates that each key uses: one, or one per bench."""
        return tuple(target_of(self.base, key)[1]['count'] if one.is_per_bench else 1 for key, one in self.vary)

    @property
    def dimensions(self) -> int:
        """The number of coordinates of a point."""
        return sum(self.widths)

    @property
    def rows(self) -> int:
        """The number of rows."""
        return self.samples * (len(self.vary) + 2 if self.design == 'saltelli' else 1)

    @cached_property
    def values(self) -> Values:
        """The study as a mapping laid out like a study file."""
        return {**self.identity, 'samples': self.samples}

    @cached_property
    def identity(self) -> Values:
        """All settings that determine the values of a row."""
        asked = {name_of(one): {f.name: getattr(one, f.name) for f in fields(one)} for one in self.ask}
        return {'scene': self.base, 'vary': {key: one.as_value for key, one in self.vary}, 'design': self.design,
                'seed': self.seed, 'ask': asked, 'budget_s': self.budget_s}

    @cached_property
    def text(self) -> str:
        """The study as the text of a study file."""
        return as_text(self.values)

    def with_samples(self, samples: int) -> 'Study':
        """Return the study with a different number of samples. Raises FieldError for a grid."""
        if self.design == 'grid':
            raise FieldError('samples', samples, f'the number of points of a grid is fixed at {self.samples}',
                             'change the steps in its file')
        return replace(self, samples=samples)


def as_text(values: Values) -> str:
    """Return values as YAML text, written by libyaml if PyYAML includes it."""
    text: str = yaml.dump(values, Dumper=getattr(yaml, 'CSafeDumper', yaml.SafeDumper), sort_keys=False)
    return text


def target_of(scene: Values, key: str) -> tuple[str, Values]:
    """Return the last part of a dotted key and the mapping of a scene that contains it. Raises FieldError.

    List items are numbered from 1, as in error messages about scene files.
    """
    *sections, last = key.split('.')
    target: Any = scene
    for section in sections:
        if isinstance(target, list):
            number_of = int(section) if section.isdecimal() and len(section) <= _MOST_DIGITS else 0
            target = target[number_of - 1] if 1 <= number_of <= len(target) else None
        else:
            target = target.get(section) if isinstance(target, dict) else None
    if not isinstance(target, dict) or last not in target:
        raise FieldError(f'vary.{key}', key, 'the base scene has no such key', 'give one from docs/reference.md; list '
                         'items are counted from 1: dragon.groups.2.length_m')
    return last, target


def _steps_of(variation: Variation) -> Any:
    """Return a sequence with as many items as a variation has values in a grid."""
    return variation.values if isinstance(variation, Listed) else range(getattr(variation, 'steps', None) or 1)


def study_names() -> list[str]:
    """Return the names of the studies that the package includes."""
    return sorted(path.stem for path in (configuration_folder() / 'studies').glob('*.yaml'))


def load_study(name_or_file: str) -> Study:
    """Return the study with the given name or file. Raises an InputError that names the file, line and key."""
    if '/' in name_or_file or name_or_file.endswith(('.yaml', '.yml')):
        path = Path(name_or_file)
    elif name_or_file in study_names():
        path = configuration_folder() / 'studies' / f'{name_or_file}.yaml'
    else:
        raise MissingError(f'no study is called {name_or_file!r}; the studies are {", ".join(study_names())}; give '
                           'a name, the path of a .yaml file, or the path of the data set to be continued')
    return study_of(read_document(path), path.parent)


def study_from(name: str, text: str) -> Study:
    """Return the study described by a complete YAML text. Raises InputError."""
    return study_of(parse_document(name, text), None)


def study_of(document: Document, folder: Path | None) -> Study:
    """Return the study described by a document. Scene files are looked up in ``folder``, or rejected if it is None."""
    document.check_keys('', document.values, _KEYS)
    given = document.values
    try:
        scene = _scene(document, folder)
        vary = tuple((key, _variation(document, key, value)) for key, value in document.section('vary').items())
        single = {key: plain_number(given[key]) for key in ('design', 'samples', 'seed', 'budget_s') if key in given}
        if given.get('design', 'grid') == 'grid' and folder is not None and 'samples' in given:
            document.refuse('samples', 'the number of points of a grid is fixed; omit this key, or choose another '
                                       'design')
        return Study(scene, vary, ask=_questions(document), **single)
    except FieldError as error:
        raise InputError(f'{document.place(error.fields["field"])}: {error}', **error.fields) from None


def _scene(document: Document, folder: Path | None) -> Scene:
    """Return the base scene, given as a name or file with the changes of ``set``, or as a mapping like a scene file."""
    given = document.values.get('scene', 'winding')
    changes = document.section('set')
    if isinstance(given, dict):
        if changes:
            document.refuse('set', 'a scene that is given in full cannot be changed by set; edit the scene itself')
        places = {key.removeprefix('scene.'): place for key, place in document.places.items()}
        return scene_of(Document(document.name, given, places))
    if not isinstance(given, str) or folder is None:
        document.refuse('scene', f'its value is {shown(given)}; write the name or file of a scene, or its keys')
    if '/' in given or given.endswith(('.yaml', '.yml')):
        given = str(folder / given)
    try:
        return changed_scene(given, changes)
    except InputError as error:
        raise InputError(f'{document.place("scene")}: {error}', **error.fields) from None


def _variation(document: Document, key: str, given: Any) -> Variation:
    """Return the variation of a key; errors name the key."""
    at = f'vary.{key}'
    if not isinstance(key, str):
        document.refuse(at, 'it is not a key of a scene; write for example track.pitch_m')
    try:
        if isinstance(given, list):
            return Listed(tuple(plain_number(one) for one in given))
        if not isinstance(given, dict):
            document.refuse(at, f'{shown(given)} is not a list, range or distribution; write for example '
                            '[0.5, 0.55], {from: 0.5, to: 0.6, steps: 11} or {uniform: [0.5, 0.6]}')
        known = next((names for names in _FORMS if names[0] in given), None)
        if known is None:
            document.refuse(at, 'it contains none of from, uniform and normal; write one of them')
        document.check_keys(f'{at}.', given, known)
        per = given.get('per')
        if per is not None and per != 'bench':
            document.refuse(f'{at}.per', f'{shown(per)} is unknown; write per: bench, or omit it')
        return _made(document, at, given, per == 'bench')
    except FieldError as error:
        raise FieldError(f'{at}.{error.fields["field"]}', error.fields['value'], error.fields['limit'],
                         error.fields['cure']) from None


_FORMS = (('from', 'to', 'steps'), ('uniform', 'per'), ('normal', 'within', 'per'))


def _made(document: Document, at: str, given: Values, is_per_bench: bool) -> Variation:
    if 'from' in given:
        if 'to' not in given:
            document.refuse(f'{at}.to', 'it is missing; write from and to')
        return Range(plain_number(given['from']), plain_number(given['to']), given.get('steps'))
    if 'uniform' in given:
        return Uniform(*_pair(document, f'{at}.uniform', given['uniform']), is_per_bench)
    if 'within' not in given:
        document.refuse(f'{at}.within', 'it is missing, but normal distributions must be truncated; write within: '
                                        '[low, high]')
    return Normal(*_pair(document, f'{at}.normal', given['normal']), *_pair(document, f'{at}.within', given['within']),
                  is_per_bench)


def _pair(document: Document, at: str, given: Any) -> tuple[float, float]:
    if not isinstance(given, list) or len(given) != 2:
        document.refuse(at, f'{shown(given)} is not a pair; write for example [2.19, 2.21]')
    return plain_number(given[0]), plain_number(given[1])


def _questions(document: Document) -> tuple[Question, ...]:
    """Return the questions, given as a list of names or as a mapping from names to options."""
    given = document.values.get('ask', [])
    if isinstance(given, list) and all(isinstance(name, str) for name in given):
        given = dict.fromkeys(given)
    if not isinstance(given, Mapping):
        document.refuse('ask', f'{shown(given)} is not a list; write for example [contact, lock]')
    document.check_keys('ask.', given, QUESTIONS)
    return tuple(_question(document, name, options) for name, options in given.items())


def _question(document: Document, name: str, options: Any) -> Question:
    options = {} if options is None else options
    if not isinstance(options, dict):
        document.refuse(f'ask.{name}', f'{shown(options)} is not a mapping of options; write for example '
                                       '{below_m: 0.1}')
    kind = QUESTIONS[name]
    document.check_keys(f'ask.{name}.', options, [f.name for f in fields(kind)])
    return kind(**{key: plain_number(value) for key, value in options.items()})
