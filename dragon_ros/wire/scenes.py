"""Scene files: YAML to a core Scene, with errors that name file, line and key."""
from collections.abc import Iterable
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from dragon_ros.core.dragon import Dragon
from dragon_ros.core.effects import effects_of
from dragon_ros.core.errors import FieldError, InputError, MissingError
from dragon_ros.core.head import Head, Profile
from dragon_ros.core.joined import KINDS as PIECES
from dragon_ros.core.joined import Joined
from dragon_ros.core.path import Spiral
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.settings import Noise, Trails
from dragon_ros.core.turn import Turn
from dragon_ros.wire import config
from dragon_ros.wire.documents import Document, parse_document, read_document

SECTIONS: dict[str, dict[str, type]] = {
    'dragon': {'': Dragon},
    'track': {'spiral': Spiral, 'turn': Turn, 'joined': Joined},
    'head': {'constant': Head, 'profile': Profile},
    'run': {'': Run},
    'noise': {'': Noise},
    'trails': {'': Trails},
}       # by kind; the first is the default
_WORDS = ('lead', 'ramps', 'side')
CHOICES = ('solver', 'markers')
SINGLES = ('accuracy', 'effects', *CHOICES)
ABOUT = 'about'     # what a scene says of itself: anything, and it changes nothing


def scene_names() -> list[str]:
    """Return the names of the scenes that come with the package."""
    return sorted(path.stem for path in (config.folder() / 'scenes').glob('*.yaml'))


def load_scene(name_or_file: str, overrides: Iterable[str] = ()) -> Scene:
    """Return the scene of a name or file, with ``key=value`` overrides (dotted keys) applied on top.

    What is left out has the classic value. Raises InputError with file, line and key.
    """
    document = read_document(_find(name_or_file))
    for override in overrides:
        _override(document, override)
    return scene_of(document)


def scene_of(document: Document) -> Scene:
    """Return the scene that a document describes."""
    document.check_keys('', document.values, (*SECTIONS, *SINGLES, ABOUT))
    try:
        parts = {name: _build(document, name, kinds) for name, kinds in SECTIONS.items()}
        values = document.values
        if 'effects' in values:
            parts['effects'] = effects_of(_names(document, 'effects', values['effects']))
        if 'accuracy' in values:
            parts['accuracy'] = _number(values['accuracy'])
        parts |= {name: values[name] for name in CHOICES if name in values}
        return Scene(**parts)
    except FieldError as error:
        raise InputError(f'{document.place(error.fields["field"])}: {error}', **error.fields) from None


def scene_values(scene: Scene) -> dict[str, Any]:
    """Return the scene as the mapping that a scene file would hold, complete."""
    values = {name: _values(getattr(scene, name), kinds) for name, kinds in SECTIONS.items()}
    return {**values, 'accuracy': scene.accuracy, 'effects': scene.effects.names,
            **{name: getattr(scene, name) for name in CHOICES}}


def _find(name_or_file: str) -> Path:
    """Return the file of a scene: a path if it looks like one, else a scene of the package."""
    if '/' in name_or_file or name_or_file.endswith(('.yaml', '.yml')):
        return Path(name_or_file)
    known = scene_names()
    if name_or_file not in known:
        raise MissingError(f'scene: {name_or_file!r} is not known; the scenes are {", ".join(known)}; '
                           'or give the path of a .yaml file')
    return config.folder() / 'scenes' / f'{name_or_file}.yaml'


def _values(part: Any, kinds: dict[str, type]) -> dict[str, Any]:
    """Return one section, or one piece of a track, as a mapping; what is None is left out of a piece."""
    kind = next(name for name, one in kinds.items() if isinstance(part, one))
    values = {f.name: getattr(part, f.name) for f in fields(part)}
    if isinstance(part, Joined):
        values['pieces'] = [{key: _plain(value) for key, value in _values(piece, PIECES).items() if value is not None}
                            for piece in part.pieces]
    return {**({'kind': kind} if kind else {}), **{key: _plain(value) for key, value in values.items()}}


def _plain(value: Any) -> Any:
    """Return tuples as lists, which YAML writes plainly."""
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


def _build(document: Document, name: str, kinds: dict[str, type]) -> Any:
    """Build one section's dataclass from its mapping; ``kind`` says which where there are several."""
    given = dict(document.section(name))
    if name == 'track' and isinstance(given.get('pieces'), list):
        given['pieces'] = tuple(_piece(document, f'track.pieces.{n + 1}', piece)
                                for n, piece in enumerate(given['pieces']))
    return _made(document, name, kinds, given)


def _made(document: Document, name: str, kinds: dict[str, type], given: dict[str, Any]) -> Any:
    """Return the dataclass of a kind, from a mapping whose keys and shape are checked here and values there."""
    chosen = given.pop('kind', next(iter(kinds))) if len(kinds) > 1 else ''
    if chosen not in kinds:
        document.refuse(f'{name}.kind', f'{chosen!r} is not known; the kinds are {", ".join(kinds)}')
    kind = kinds[chosen]
    known = [f.name for f in fields(kind)]
    document.check_keys(f'{name}.', given, (*known, 'kind') if len(kinds) > 1 else known)
    for f in fields(kind):
        if f.default is MISSING and f.name not in given:
            document.refuse(f'{name}.{f.name}', f'it is missing; a {chosen} needs it')
    return kind(**{key: _value(document, f'{name}.{key}', value) for key, value in given.items()})


def _piece(document: Document, name: str, given: Any) -> Any:
    """Return one piece of a joined track."""
    if not isinstance(given, dict) or 'kind' not in given:
        document.refuse(name, f'it holds {given!r}; write for example {{kind: line, length_m: 5}}')
    return _made(document, name, PIECES, dict(given))


def _value(document: Document, name: str, value: Any) -> Any:
    """Return numbers as numbers, and the lists that some keys hold as tuples."""
    key = name.rpartition('.')[2]
    if key == 'knots':
        if not isinstance(value, list) or not all(_is_pair(knot) for knot in value):
            document.refuse(name, f'{value!r} is not a list of pairs; write for example [[0, 1], [60, -1]]')
        return tuple((_number(t_s), _number(speed)) for t_s, speed in value)
    if key == 'at_m' and value is not None:
        if not _is_pair(value):
            document.refuse(name, f'{value!r} is not a place; write for example [1.5, 2]')
        return tuple(map(_number, value))
    if key == 'pieces' and not isinstance(value, tuple):
        document.refuse(name, f'{value!r} is not a list of pieces; write for example [{{kind: line, length_m: 5}}]')
    return value if isinstance(value, tuple) or key in _WORDS else _number(value)


def _is_pair(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2


def _number(value: Any) -> Any:
    """Return a number that YAML 1.1 takes for text, such as 1e-9; anything else as it is."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def _names(document: Document, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        document.refuse(key, f'{value!r} is not a list; write for example [velocity, benches]')
    return value


def _override(document: Document, text: str) -> None:
    """Apply one ``dotted.key=value``."""
    key, equals, value = text.partition('=')
    if not equals or not key:
        raise InputError(f'--set {text}: is not key=value; write for example --set track.pitch_m=0.5', field='set')
    place = f'--set {text}'
    parsed = parse_document(place, f'value: {value}').values.get('value')
    *sections, last = key.split('.')
    target = document.values
    for section in sections:
        target = target.setdefault(section, {})
        if not isinstance(target, dict):
            raise InputError(f'{place}: {section} is not a section', field=key)
    target[last] = parsed
    document.places[key] = place
