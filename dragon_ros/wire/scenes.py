"""Scene files: YAML to a core Scene, with errors that name file, line and key."""
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from dragon_ros.core.dragon import Dragon
from dragon_ros.core.effects import effects_of
from dragon_ros.core.errors import FieldError, InputError, MissingError
from dragon_ros.core.head import Head
from dragon_ros.core.path import Spiral
from dragon_ros.core.scene import Run, Scene
from dragon_ros.wire import config
from dragon_ros.wire.documents import Document, parse_document, read_document

SECTIONS: dict[str, type] = {'dragon': Dragon, 'track': Spiral, 'head': Head, 'run': Run}
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
        parts = {name: _build(document, name, kind) for name, kind in SECTIONS.items()}
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
    values: dict[str, Any] = {name: {f.name: getattr(getattr(scene, name), f.name) for f in fields(kind)}
                              for name, kind in SECTIONS.items()}
    values['track'] = {'kind': 'spiral', **values['track']}
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


def _build(document: Document, name: str, kind: type) -> Any:
    """Build one section's dataclass from its mapping."""
    given = dict(document.section(name))
    known = [f.name for f in fields(kind)]
    if kind is Spiral:
        track = given.pop('kind', 'spiral')
        if track != 'spiral':
            document.refuse('track.kind', f'{track!r} is not known; the only kind is spiral')
    document.check_keys(f'{name}.', given, (*known, 'kind') if kind is Spiral else known)
    return kind(**{key: _number(value) for key, value in given.items()})


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


def scene_text(scene: Scene) -> str:
    """Return the scene as a complete scene file."""
    return yaml.safe_dump(scene_values(scene), sort_keys=False)
