"""Variants of a scene for ``view --try``: values that the page's address changes, and answers about each variant.

An address such as ``/?dragon.benches=40&track.pitch_m=0.6`` contains the changed values in the form of ``--set``. The
address alone selects the variant; the server caches the last few variants, so that a page need not wait for them again.
"""
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import ceil, isfinite
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl

from dragon_ros.commands.view.data import ViewData
from dragon_ros.core.errors import DragonError, FieldError, InputError
from dragon_ros.core.limits import SEARCHED_BENCHES
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.pictures.sources import Check, Progress, SceneSource
from dragon_ros.scenes.load import load_scene, scene_values

if TYPE_CHECKING:       # imported lazily, by the first question
    from dragon_ros.core.search.certificate import Contact, NoContact

_KEPT = 8               # number of cached variants
_MOST_FIELDS = 60       # the page shows only the first fields of a route with hundreds of pieces
_CHARACTERS = 32        # maximum length of a value in an address, in characters
_FEW_PIECES = 8         # the radii of a track with more pieces are no fields
_SECTIONS = ('dragon', 'track', 'head', 'run', 'venue')
_OMITTED = 'rate_hz', 'stamp_offset_s'
_CIRCLE_M = 9.0         # default turning circle of ``design min-pitch``
# The range and the step of a slider, by the last part of a key. A value outside the range widens the range, and the
# field beside the slider accepts any value.
_RANGES = {'benches': (1, 400, 1), 'count': (1, 400, 1), 'head_length_m': (0.6, 6, 0.01),
           'body_length_m': (0.6, 6, 0.01), 'width_m': (0.05, 1, 0.005), 'hole_inset_m': (0, 0.6, 0.005),
           'pitch_m': (0.3, 3, 0.005), 'start_turns': (2, 40, 0.25), 'diameter_m': (4, 20, 0.05),
           'ratio': (0.25, 4, 0.05), 'before_m': (0, 300, 1), 'speed_m_s': (0.1, 5, 0.05), 'radius_m': (1, 30, 0.05),
           'length_m': (0.5, 200, 0.5), 'angle_deg': (-360, 360, 1), 'margin_m': (0, 3, 0.05),
           'start_s': (0, 600, 1), 'stop_s': (0, 600, 1)}


@dataclass(frozen=True)
class PageValue:
    """A value on the page: its key as in ``--set``, its current value (or None), and the range of its slider."""

    key: str
    value: float | None
    low: float
    high: float
    step: float


@dataclass(frozen=True)
class Answer:
    """An answer: the key of its sentence in words.js, the sentence's values, and the certainty of the answer.

    ``how`` is ``proved``, ``sampled``, or empty if there is no answer. If ``until_contact`` is true, times after the
    contact were not examined.
    """

    key: str
    values: dict[str, str] = field(default_factory=dict)
    how: str = ''
    until_contact: bool = False


@dataclass(frozen=True)
class _Searched(SceneSource):
    """A scene whose first contact is computed only once, for the picture and all answers."""

    _found: 'list[Contact | NoContact]' = field(default_factory=list)

    def searched(self, progress: Progress) -> 'Contact | NoContact':
        """Return the result of the search, which runs at the first call."""
        if not self._found:
            self._found.append(super().searched(progress))
        return self._found[0]


class Variant:
    """The scene that an address describes, and the page's data about this scene."""

    def __init__(self, name: str, scene: Scene) -> None:
        """Take a scene."""
        self.scene, self._source = scene, _Searched(name, scene)
        self.data = ViewData(self._source, iter)

    def found(self, check: Check) -> 'Contact | NoContact':
        """Return the result of the search for the first contact."""
        self.data.contact(check)
        return self._source.searched(iter)

    def until_contact(self, check: Check) -> Scene:
        """Return the scene with a run that ends at its first contact, beyond which no dragon can walk."""
        t_s = self.contact_s(check)
        return self.scene if t_s is None else replace(self.scene, run=replace(self.scene.run, stop_s=t_s))

    def contact_s(self, check: Check) -> float | None:
        """Return the time (s) of the first contact, or None if there is none."""
        touch = self.data.contact(check)
        return None if touch is None else float(touch['t_s'])


class Variants:
    """The variants of one scene."""

    def __init__(self, name: str, scene: str, overrides: list[str]) -> None:
        """Load the scene with this name or file, changed by overrides. Raises InputError."""
        self._name, self._scene, self._overrides = name, scene, overrides
        self._own = _within_limits(load_scene(scene, overrides))
        self._made, self._lock = OrderedDict[str, Variant](), threading.Lock()

    def form(self, query: str) -> dict[str, Any]:
        """Return the fields of an address as JSON values and, if a field is invalid, an error about this field.

        If a field is invalid, the fields are those of the original scene.
        """
        try:
            scene, error = self.variant(query).scene, None
        except DragonError as wrong:
            scene, error = self._own, {'key': str(wrong.fields.get('field', '')), 'text': _plainly(wrong)}
        own = {one.key: one.value for one in fields_of(self._own)}
        fields = fields_of(scene)
        return {'fields': [{**vars(one), 'own': own.get(one.key)} for one in fields[:_MOST_FIELDS]],
                'left_out': max(0, len(fields) - _MOST_FIELDS), 'error': error}

    def variant(self, query: str) -> Variant:
        """Return the variant that an address describes. Raises InputError."""
        with self._lock:
            if query in self._made:
                self._made.move_to_end(query)
                return self._made[query]
        made = Variant(self._name, self._of(query))
        with self._lock:
            self._made[query] = made
            while len(self._made) > _KEPT:
                self._made.popitem(last=False)
        return made

    def _of(self, query: str) -> Scene:
        known = {one.key for one in fields_of(self._own)}
        changes = []
        for key, text in parse_qsl(query, keep_blank_values=True):
            if key not in known:
                raise InputError(f'{key[:_CHARACTERS]}: it is not a value that can be changed in this scene', field=key)
            value = _number(key, text)
            if key.endswith(('.benches', '.count')):
                _check_benches(key, float(value) if value != 'null' else 0.0)       # before a track is built for them
            changes.append(f'{key}={value}')
        return _within_limits(load_scene(self._scene, [*self._overrides, *changes]))

    def scene_file(self, query: str) -> bytes:
        """Return the scene file of a variant."""
        from dragon_ros.scenes.provenance import scene_file
        return scene_file(self.variant(query).scene).encode()

    def answer(self, question: str, query: str, check: Check) -> dict[str, Any]:
        """Return the answer to one of QUESTIONS as JSON values; ``check`` raises an exception to end the work."""
        variant = self.variant(query)
        try:
            return vars(QUESTIONS[question](variant, check))
        except InputError as wrong:
            return vars(Answer('refused', {'text': _plainly(wrong)}))


def _within_limits(scene: Scene) -> Scene:
    _check_benches('dragon.benches', scene.dragon.benches)
    return scene


def _check_benches(key: str, benches: float) -> None:
    if benches > SEARCHED_BENCHES:
        raise FieldError(key, benches, f'a page supports at most {SEARCHED_BENCHES} benches', 'give fewer')


def fields_of(scene: Scene) -> list[PageValue]:
    """Return the fields of a scene, one for each single number of its dragon, track, head, run and venue."""
    values = scene_values(scene)
    return [one for section in _SECTIONS if section in values for one in _fields(section, values[section])]


def _fields(key: str, value: Any) -> list[PageValue]:
    name = key.rpartition('.')[2]
    if isinstance(value, dict):
        return [one for part, inner in value.items() for one in _fields(f'{key}.{part}', inner)]
    if isinstance(value, list):     # a list of pieces or groups; lists of numbers have no fields
        if name == 'pieces':        # a route has hundreds, and only radii can be changed without moving the whole way
            radii = [(n, inner['radius_m']) for n, inner in enumerate(value, 1) if inner.get('radius_m') is not None]
            return [one for n, radius_m in radii for one in _fields(f'{key}.{n}.radius_m', radius_m)
                    if len(value) <= _FEW_PIECES]
        return [one for n, inner in enumerate(value, 1) if isinstance(inner, dict)
                for one in _fields(f'{key}.{n}', inner)]
    if name in _OMITTED or isinstance(value, (bool, str)) or (value is None and name != 'stop_s'):
        return []
    low, high, step = _RANGES.get(name, (0.0, float(f'{2 * abs(value or 1.0):.3g}'), 0.01))
    if value is not None:
        low, high = min(low, value), max(high, value)
    return [PageValue(key, value, low, high, step)]


def _number(key: str, text: str) -> str:
    """Return a number's text in its usual form, or null for an empty string; only some keys accept null."""
    if text.strip() in ('', 'null'):
        return 'null'
    try:
        value = float(text) if len(text) <= _CHARACTERS else None
    except ValueError:
        value = None
    if value is None or not isfinite(value):
        raise FieldError(key, text[:_CHARACTERS], 'it is not a finite number', 'give a number such as 2.5')
    return repr(int(value)) if value.is_integer() and '.' not in text else repr(value)


def _plainly(error: DragonError) -> str:
    """Return an error's message on one line, without the position of an override, which the user never typed."""
    text = ' '.join(str(error).split())
    key = error.fields.get('field')
    return text[text.index(f'{key}: '):] if key and f'{key}: ' in text else text


def _contact(variant: Variant, check: Check) -> Answer:
    """Return the first contact."""
    from dragon_ros.core.search.certificate import NoContact
    found = variant.found(check)
    sure = 'proved' if found.certificate.complete else ''
    if isinstance(found, NoContact):
        return Answer('no_contact', {'end': f'{variant.data.times_s[-1]:.6g}'}, sure)
    values = {'t': f'{found.t_s:.9f}', 'first': str(found.benches[0]), 'second': str(found.benches[-1]),
              'obstacle': found.obstacle.name if found.obstacle else ''}
    kind = 'graze' if found.grazing_m else 'meet'
    return Answer(f'{kind}_obstacle' if found.obstacle else kind, values, sure)


def _clearance(variant: Variant, check: Check) -> Answer:
    """Return the smallest gap before the contact."""
    contact_s, curve = variant.contact_s(check), variant.data.clearance(check)
    rows = [(gap, t_s) for gap, t_s in zip(curve['gap_mm'], curve['t_s'], strict=True)
            if gap is not None and (contact_s is None or t_s <= contact_s)]
    if not rows:
        return Answer('no_gap')
    gap, t_s = min(rows)
    return Answer('least_gap', {'gap': f'{gap:.3f}', 't': f'{t_s:.6g}', 'times': str(len(rows))}, 'sampled',
                  contact_s is not None)


def _speed(variant: Variant, check: Check) -> Answer:
    """Return the largest speed of any handle up to the contact."""
    from dragon_ros.core.search.max_speed import max_speed
    most = max_speed(variant.until_contact(check), lambda looks: check())
    ratio, until = f'{most.ratio:.9g}', variant.contact_s(check) is not None
    sure = 'proved' if f'{most.bound:.9g}' == ratio else ''
    if most.ratio == 1:
        return Answer('none_faster', {}, sure, until)
    return Answer('fastest', {'handle': str(most.handle), 'ratio': ratio, 'along': f'{most.along_m:.6g}'}, sure, until)


def _pitch(variant: Variant, check: Check) -> Answer:
    """Return the smallest pitch at which this dragon winds in to a turning circle."""
    from dragon_ros.core.search.min_pitch import min_pitch
    if not isinstance(variant.scene.track, Spiral):
        return Answer('no_spiral')
    found = min_pitch(variant.scene.dragon, _CIRCLE_M, variant.scene.track.start_turns, within_m=1e-9,
                      progress=lambda states: check())
    return Answer('least_pitch', {'pitch': f'{_up(found.high_m, 9):.9f}', 'circle': f'{_CIRCLE_M:g}'}, 'proved')


def _room(variant: Variant, check: Check) -> Answer:
    """Return the space that the run requires: the gaps to the obstacles in its venue, or a square."""
    scene, until = variant.until_contact(check), variant.contact_s(check) is not None
    if scene.venue is not None:
        from dragon_ros.core.search.venue_fit import venue_fit
        worst = min(venue_fit(scene, progress=lambda looks: check()).gaps, key=lambda gap: gap.low_m)
        if worst.high_m <= 0:
            return Answer('touches', {'name': worst.name}, 'proved', until)
        gap_m = max(0.0, -_up(-worst.low_m, 4))     # rounded down
        return Answer('gap_to', {'gap': f'{gap_m:.4f}', 'name': worst.name, 'wanted': f'{scene.venue.margin_m:g}'},
                      'proved' if worst.low_m >= gap_m else '', until)
    from dragon_ros.core.search.bounding_box import bounding_box
    box = bounding_box(scene, progress=lambda looks: check())
    (_, centred), (_, free) = box.centred_m, box.free_m
    return Answer('square', {'free': f'{_up(free, 4):.4f}', 'centred': f'{_up(centred, 4):.4f}'}, 'proved', until)


def _up(value: float, decimals: int) -> float:
    """Return a proved upper bound, rounded up, so that the shown number is proved, too."""
    scale = float(10 ** decimals)
    return ceil(value * scale) / scale


QUESTIONS: dict[str, Callable[[Variant, Check], Answer]] = {
    'contact': _contact, 'speed': _speed, 'room': _room, 'pitch': _pitch, 'clearance': _clearance}
