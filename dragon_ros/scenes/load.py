"""Load scene files: convert YAML to a core Scene, with errors that name the file, line and key."""
import json
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import MISSING, fields
from itertools import count
from pathlib import Path
from typing import Any

from dragon_ros.configuration import folder as configuration_folder
from dragon_ros.configuration import scene_names
from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import FieldError, InputError, MissingError, did_you_mean, shown
from dragon_ros.core.flags import Noise, Trails, effects_of
from dragon_ros.core.limits import SCENE_CHARACTERS, SCENE_TICKS, VENUE_BYTES
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import PIECES, Composite, Spiral, STurn
from dragon_ros.core.venue import OBSTACLES, Origin, Venue
from dragon_ros.scenes.head_laws import PLUGIN, plugged
from dragon_ros.scenes.yaml import Document, parse_document, plain_number, read_document

SECTIONS: dict[str, dict[str, type]] = {
    'dragon': {'equal': Dragon, 'mixed': Mixed},
    'track': {'spiral': Spiral, 'turn': STurn, 'joined': Composite},
    'head': {'constant': Head, 'profile': Profile, 'commanded': Commanded},
    'run': {'': Run},
    'noise': {'': Noise},
    'trails': {'': Trails},
    'venue': {'': Venue},
    'origin': {'': Origin},
}       # the kinds of each section; the first kind is the default
_ABSENT = ('venue', 'origin')        # sections without a default
# Keys whose values are lists of mappings.
PARTS: dict[str, dict[str, type]] = {'pieces': dict(PIECES), 'groups': {'': Group}, 'obstacles': dict(OBSTACLES)}
_EXAMPLES = {'pieces': '{kind: line, length_m: 5}', 'groups': '{count: 100, length_m: 2.2}',
             'obstacles': '{kind: line, name: wall, points_m: [[0, 0], [9, 0]]}'}
_PAIRS = {'at_m': 'a point; write for example [1.5, 2]',
          'lon_lat_deg': 'a position; write [longitude, latitude]', 'map_m': 'a position; write [east, north]'}
_WORDS = ('lead', 'ramps', 'side', 'name', 'crs')
CHOICES = ('solver', 'markers')
SINGLES = ('accuracy', 'effects', *CHOICES)
_MOST_SHOWN = 100       # maximum length of a --set in an error message, in characters
# Lines with the corners of a venue, as written by provenance.
_CORNERS = re.compile(r"^[ -]*(?:points_m|inside)?:? *'?[-+.e0-9, ]+'?\n", re.MULTILINE)
ABOUT = 'about'     # notes on a scene, which have no effect


def load_scene(name_or_file: str, overrides: Iterable[str] = (), notes: list[str] | None = None) -> Scene:
    """Return the scene with the given name or file, after applying ``key=value`` overrides with dotted keys.

    Omitted keys default to the classic values. ``notes`` receives what was left out of the venue's file. Raises an
    InputError that names the file, line and key.
    """
    document = _overridden(name_or_file, overrides)
    if notes is not None:
        notes += document.notes
    return _scene_with_plugin(document)


def load_drawn_scene(name_or_file: str, overrides: Iterable[str], origin: Origin | None, track: Mapping[str, Any],
                     venue: Mapping[str, Any]) -> Scene:
    """Return a scene with another origin, another track and more obstacles, all laid out as in a scene file.

    Obstacles whose names are taken are numbered. Raises InputError.
    """
    given = [] if origin is None else [f'origin={json.dumps(_values(origin, SECTIONS["origin"]))}']
    document = _overridden(name_or_file, [*overrides, *given])
    document.values['track'] = dict(track)
    if venue:
        document.values['venue'] = _merged(document, document.values.get('venue') or {}, venue)
    return _scene_with_plugin(document)


def _merged(document: Document, venue: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    if venue.get('inside') and more.get('inside'):
        document.refuse('venue.inside', 'the scene and the drawing both have one; remove one of them')
    taken = {one.get('name') for one in venue.get('obstacles') or []}
    added = []
    for one in more['obstacles']:
        names = (f'{one["name"]}{f" {n}" if n > 1 else ""}' for n in count(1))
        added.append({**one, 'name': next(name for name in names if name not in taken)})
        taken.add(added[-1]['name'])
    return {**venue, **more, 'obstacles': [*(venue.get('obstacles') or []), *added]}


def _overridden(name_or_file: str, overrides: Iterable[str]) -> Document:
    """Return the document of a scene, with its venue file and its overrides."""
    path, listed = _find(name_or_file), list(overrides)
    document = read_document(path)
    early = [one for one in listed if _is_early(one)]
    for override in early:
        _override(document, override)
    takes_other = any(override.partition('=')[0].strip() in ('venue', 'venue.file') for override in early)
    _take_file(document, Path() if takes_other else path.parent)
    for override in listed:
        if override not in early:
            _override(document, override)
    return document


def _is_early(override: str) -> bool:
    """Return whether an override takes effect before the venue file is read: an origin, or another venue."""
    key, _, value = override.partition('=')
    is_origin = key.partition('.')[0] == 'origin' or key == 'venue.origin_deg'
    return key in ('venue', 'venue.file') or (is_origin and value.strip() not in ('', 'null', '~'))


def load_venue(name_or_file: str) -> Venue:
    """Return the venue of a scene (a name or a file), or of a map. Raises InputError."""
    from dragon_ros.scenes.maps import READERS
    if Path(name_or_file).suffix.lower() in READERS:
        document = parse_document(name_or_file, '{}')
        document.values['venue'] = {'file': str(Path(name_or_file).absolute())}
        _take_file(document, Path())
    else:
        document = _read(name_or_file)
    if not document.values.get('venue'):
        document.refuse('venue', 'the scene has none; give one with a section venue, or a GeoJSON or WKT file')
    try:
        venue: Venue = _build(document, 'venue', SECTIONS['venue'])
    except FieldError as error:
        raise _placed(document, error) from None
    return venue


def venue_file(name_or_file: str, overrides: Iterable[str] = ()) -> tuple[Path | None, Origin | None, bool]:
    """Return the path of the venue file of a scene, its origin, and whether it has obstacles of its own.

    The path and the origin are None if the scene has none. Raises InputError.
    """
    path = _find(name_or_file)
    document, folder = read_document(path), path.parent
    for override in overrides:
        key = override.partition('=')[0].strip()
        if key.partition('.')[0] in ('origin', 'venue'):
            _override(document, override)
            folder = Path() if key in ('venue', 'venue.file') else folder
    venue = document.values.get('venue')
    listed = venue if isinstance(venue, dict) else {}
    name = listed.get('file')
    return (folder / name if isinstance(name, str) else None, _origin_of(document),
            bool(listed.get('obstacles') or listed.get('inside')))


def _read(name_or_file: str) -> Document:
    """Return the document of a scene, given its name or file, including the contents of its venue file."""
    path = _find(name_or_file)
    document = read_document(path)
    _take_file(document, path.parent)
    return document


def _take_file(document: Document, folder: Path) -> None:
    """Replace the key venue.file, if given, with the contents of that file. Raises InputError."""
    origin = _origin_of(document)
    section = document.values.get('venue')
    if not isinstance(section, dict) or 'file' not in section:
        return
    from dragon_ros.scenes.georeference import own_origin
    from dragon_ros.scenes.maps import read_drawing
    from dragon_ros.scenes.venue_files import venue_of
    name = section.pop('file')
    if not isinstance(name, str):
        document.refuse('venue.file', f'{shown(name)} is not a file name; write for example street.geojson')
    drawing = read_drawing(folder / name)
    if origin is None:
        own = own_origin(str(drawing.path), [one.geometry for one in drawing.features], drawing.crs)
        if own is not None:
            document.refuse('venue.file', f'{name} lies on a map, and the scene does not say where its track is; give '
                                          f'the place of (0, 0), for example the middle of the file: {_yaml(own)}')
    found = venue_of(drawing, origin)
    drawn = found.values
    document.notes.extend(found.notes)
    for key in drawn.keys() & section.keys():
        if drawn[key]:
            document.refuse(f'venue.{key}', f'{name} defines it too; remove one of them')
    document.values['venue'] = {**drawn, **section}


def _yaml(origin: Origin) -> str:
    """Return an origin as a line of a scene file."""
    given = {'lon_lat_deg': origin.lon_lat_deg, 'map_m': origin.map_m, 'crs': origin.crs}
    return 'origin: {' + ', '.join(f'{key}: {_plain(value)}' for key, value in given.items() if value is not None) + '}'


def _origin_of(document: Document) -> Origin | None:
    """Return the origin of a document; the older key ``venue.origin_deg`` is moved to the section ``origin``."""
    venue = document.values.get('venue')
    if isinstance(venue, dict) and 'origin_deg' in venue:
        old = venue.pop('origin_deg')
        if old is not None:
            _check_same(document, 'venue.origin_deg', {'lon_lat_deg': old})
            document.values['origin'] = {'lon_lat_deg': old}
            document.places['origin'] = document.places.get('venue.origin_deg', document.name)
        elif not document.place('venue.origin_deg').startswith(f'{document.name}:'):
            document.values['origin'] = None
    if document.values.get('origin') is None:
        return None
    try:
        origin: Origin = _build(document, 'origin', SECTIONS['origin'])
    except FieldError as error:
        raise _placed(document, error) from None
    return origin


def _check_same(document: Document, key: str, other: Any) -> None:
    """Raise InputError if a scene with an origin is given another one."""
    before = document.values.get('origin')
    if before is not None and _given(before) != _given(other):
        document.refuse(key, f'{shown(other)} differs from the origin of the scene, {shown(before)}, about which its '
                             'track and its venue were made; a scene has one origin')


def _given(section: Any) -> Any:
    """Return a section without the keys that are None."""
    return {key: one for key, one in section.items() if one is not None} if isinstance(section, dict) else section


def _scene_with_plugin(document: Document) -> Scene:
    """Return the scene of a user's document, which may name a custom head law.

    The path of a venue file in a change is relative to the working directory.
    """
    _take_file(document, Path())
    if document.section('head').get('kind') == PLUGIN:
        document.values['head'] = _values(plugged(document), SECTIONS['head'])
    return scene_of(document)


def changed_scene(name_or_file: str, changes: Mapping[str, Any]) -> Scene:
    """Return a scene, given its name or file, changed by a mapping that is laid out like a scene file.

    Keys of a section are changed one by one; if the kind changes, the section's other keys are dropped. Raises an
    InputError that names the key.
    """
    path = _find(name_or_file)
    document = read_document(path)
    _change(document, {key: value for key, value in changes.items() if key == 'origin' and value is not None})
    venue = changes.get('venue', {})
    if venue is not None and not (isinstance(venue, Mapping) and 'file' in venue):
        _take_file(document, path.parent)
    elif isinstance(document.values.get('venue'), dict):
        document.values['venue'].pop('file', None)
    _change(document, changes)
    return _scene_with_plugin(document)


def _change(document: Document, changes: Mapping[str, Any]) -> None:
    for key, value in changes.items():
        old = document.values.get(key, {})
        if key == 'origin' and isinstance(value, Mapping):
            _origin_of(document)
            _check_same(document, 'origin', _as_lists(value))
        if isinstance(value, Mapping) and isinstance(old, dict):
            kinds = [section.get('kind', next(iter(SECTIONS.get(key, {'': None})))) for section in (old, value)]
            kept = old if 'kind' not in value or kinds[0] == kinds[1] else {}
            document.places |= {f'{key}.{name}': 'changes' for name in value}
            value = {**kept, **value}
        document.values[key], document.places[key] = _as_lists(value), 'changes'


def _as_lists(value: Any) -> Any:
    """Return a value with its tuples converted to lists, as in YAML."""
    if isinstance(value, Mapping):
        return {key: _as_lists(one) for key, one in value.items()}
    return [_as_lists(one) for one in value] if isinstance(value, (tuple, list)) else value


def strangers_scene(name: str, text: str, trust: bool = False) -> Scene:
    """Return the scene described by text from a bag or a topic.

    Unless ``trust`` is set, the budgets of ``core.limits`` apply. Raises InputError.
    """
    if not trust:
        _within(name, 'characters', len(text), SCENE_CHARACTERS + VENUE_BYTES)
        _within(name, 'characters', len(text) - _characters_of_corners(text), SCENE_CHARACTERS)
    document = parse_document(name, text)
    scene = _settings(document)
    _check_compiled(document, scene)
    if not trust:
        with suppress(FieldError):      # an endless run is rejected later, when its ticks are iterated
            _within(name, 'ticks', compile_scene(scene).last_tick + 1, SCENE_TICKS)
    return scene


def _characters_of_corners(text: str) -> int:
    """Return the number of characters in the lines of a scene's text that contain only corners of a venue."""
    return sum(map(len, _CORNERS.findall(text)))


def _within(name: str, what: str, value: int, most: int) -> None:
    if value > most:
        raise InputError(f'{name}: it has {value} {what}; the limit for untrusted scenes is {most}; give --trust if '
                         'you know where it comes from', field=what, value=value, limit=most)


def scene_of(document: Document) -> Scene:
    """Return the scene described by a document. Raises InputError."""
    scene = _settings(document)
    _check_compiled(document, scene)
    return scene


def _check_compiled(document: Document, scene: Scene) -> None:
    """Raise InputError for errors that appear only when the track is laid out in the plane."""
    try:
        compile_scene(scene)
        if scene.venue is not None:
            from dragon_ros.core.search.venue import check_start
            check_start(scene)
    except FieldError as error:
        raise _placed(document, error) from None


def _settings(document: Document) -> Scene:
    """Return a document's scene without compiling it or loading a custom head law."""
    if document.section('head').get('kind') == PLUGIN:
        document.refuse('head.kind', 'custom head laws are loaded only from scene files, not from bags or topics')
    if isinstance(document.values.get('venue'), dict) and 'file' in document.values['venue']:
        document.refuse('venue.file', 'venue files are read only for scene files, not for bags or topics')
    _origin_of(document)
    document.check_keys('', document.values, (*SECTIONS, *SINGLES, ABOUT))
    try:
        values = document.values
        parts = {name: _build(document, name, kinds) for name, kinds in SECTIONS.items()
                 if name not in _ABSENT or values.get(name) is not None}
        if 'effects' in values:
            parts['effects'] = effects_of(_names(document, 'effects', values['effects']))
        if 'accuracy' in values:
            parts['accuracy'] = plain_number(values['accuracy'])
        parts |= {name: values[name] for name in CHOICES if name in values}
        return Scene(**parts)
    except FieldError as error:
        raise _placed(document, error) from None


def _placed(document: Document, error: FieldError) -> InputError:
    """Return a field's error with the field's position in the document."""
    return InputError(f'{document.place(error.fields["field"])}: {error}', **error.fields)


def scene_values(scene: Scene) -> dict[str, Any]:
    """Return the complete scene as a mapping laid out like a scene file."""
    values = {name: _values(part, kinds) for name, kinds in SECTIONS.items()
              if (part := getattr(scene, name)) is not None}
    return {**values, 'accuracy': scene.accuracy, 'effects': scene.effects.names,
            **{name: getattr(scene, name) for name in CHOICES}}


def _find(name_or_file: str) -> Path:
    """Return the file of a scene, given its path or the name of a scene in the package."""
    if '/' in name_or_file or name_or_file.endswith(('.yaml', '.yml')):
        return Path(name_or_file)
    known = scene_names()
    if name_or_file not in known and os.path.isfile(name_or_file):
        return Path(name_or_file)
    if name_or_file not in known:
        hint = did_you_mean(name_or_file, known, 'give one of these or the path of a .yaml file')
        raise MissingError(f'scene: {shown(name_or_file)} is not known; the scenes are {", ".join(known)}; {hint}')
    return configuration_folder() / 'scenes' / f'{name_or_file}.yaml'


def _values(part: Any, kinds: dict[str, type]) -> dict[str, Any]:
    """Return a section, or an item of a list in it, as a mapping; items omit keys that are None."""
    kind = next(name for name, one in kinds.items() if isinstance(part, one))
    values = {f.name: getattr(part, f.name) for f in fields(part)}
    for key in PARTS.keys() & values.keys():
        values[key] = [{name: _plain(value) for name, value in _values(one, PARTS[key]).items() if value is not None}
                       for one in values[key]]
    return {**({'kind': kind} if kind else {}), **{key: _plain(value) for key, value in values.items()}}


def _plain(value: Any) -> Any:
    """Return tuples as lists, which YAML writes without tags."""
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


def _build(document: Document, name: str, kinds: dict[str, type]) -> Any:
    """Build the dataclass of a section from its mapping; the key ``kind`` selects a dataclass if there are several."""
    return _made(document, name, kinds, dict(document.section(name)))


def _made(document: Document, name: str, kinds: dict[str, type], given: dict[str, Any]) -> Any:
    """Return an instance of the chosen kind. Keys and shapes are checked here; the dataclass checks the values."""
    chosen = given.pop('kind', next(iter(kinds))) if len(kinds) > 1 else ''
    if not isinstance(chosen, str) or chosen not in kinds:
        document.refuse(f'{name}.kind', f'{shown(chosen)} is not known; '
                        + did_you_mean(chosen, kinds, f'the kinds are {", ".join(kinds)}'))
    kind = kinds[chosen]
    known = [f.name for f in fields(kind)]
    for key, other in ((f.name, other) for other, one in kinds.items() for f in fields(one)):
        if key in given and key not in known:
            document.refuse(f'{name}.{key}', f'unknown key for kind {chosen}; it belongs to kind: {other}')
    document.check_keys(f'{name}.', given, (*known, 'kind') if len(kinds) > 1 else known)
    for f in fields(kind):
        if f.default is MISSING and f.name not in given:
            whose = f'kind {chosen}' if chosen else 'each part'
            document.refuse(f'{name}.{f.name}', f'it is missing; {whose} requires it')
    return kind(**{key: _value(document, f'{name}.{key}', value) for key, value in given.items()})


def _part(document: Document, name: str, key: str, given: Any) -> Any:
    """Return an item of a list of mappings: a piece of a joined track, a group of benches or an obstacle."""
    if not isinstance(given, dict) or (len(PARTS[key]) > 1 and 'kind' not in given):
        document.refuse(name, f'its value is {shown(given)}; write for example {_EXAMPLES[key]}')
    return _made(document, name, PARTS[key], dict(given))


def _value(document: Document, name: str, value: Any) -> Any:
    """Return the value of a key; text such as 1e-9 becomes a number, and the lists of certain keys become tuples."""
    key = name.rpartition('.')[2]
    if key == 'knots':
        if not isinstance(value, list) or not all(_is_pair(knot) for knot in value):
            document.refuse(name, f'{shown(value)} is not a list of pairs; write for example [[0, 1], [60, -1]]')
        return tuple((plain_number(t_s), plain_number(speed)) for t_s, speed in value)
    if key in _PAIRS and value is not None:
        if not _is_pair(value):
            document.refuse(name, f'{shown(value)} is not {_PAIRS[key]}')
        return tuple(map(plain_number, value))
    if key in ('points_m', 'inside') and value is not None:
        return _points(document, name, value)
    if key == 'holes_m':
        if not isinstance(value, list):
            document.refuse(name, f'{shown(value)} is not a list of rings; write for example [[[1, 1], [2, 1], [2, '
                                  '2]]]')
        return tuple(_points(document, f'{name}.{n}', one) for n, one in enumerate(value, 1))
    if key in PARTS:
        if not isinstance(value, list):
            document.refuse(name, f'{shown(value)} is not a list of {key}; write for example [{_EXAMPLES[key]}]')
        return tuple(_part(document, f'{name}.{n}', key, one) for n, one in enumerate(value, 1))
    return value if key in _WORDS else plain_number(value)


def _points(document: Document, name: str, value: Any) -> tuple[tuple[Any, ...], ...]:
    """Return points, given as a list of pairs or in the shorter notation of WKT (``0 0, 4 0, 4 3``)."""
    if isinstance(value, str):
        pairs = [one.split() for one in value.split(',')]
        try:
            return tuple(tuple(map(float, pair)) for pair in pairs)
        except ValueError:
            document.refuse(name, f"{shown(value)} contains no points; write for example '0 0, 4 0, 4 3'")
    if not isinstance(value, list) or not all(_is_pair(one) for one in value):
        document.refuse(name, f'{shown(value)} is not a list of points; write for example [[0, 0], [4, 0], [4, 3]]')
    return tuple(tuple(map(plain_number, pair)) for pair in value)


def _is_pair(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2


def _names(document: Document, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        document.refuse(key, f'{shown(value)} is not a list; write for example [velocity, benches]')
    return value


def _override(document: Document, text: str) -> None:
    """Apply one ``dotted.key=value``."""
    key, equals, value = text.partition('=')
    place = f'--set {text if len(text) <= _MOST_SHOWN else text[:_MOST_SHOWN] + "..."}'
    if not equals or not key:
        raise InputError(f'{place}: it is not key=value; write for example --set track.pitch_m=0.5', field='set')
    parsed = parse_document(place, f'value: {value}').values.get('value')
    *sections, last = key.split('.')
    target: Any = document.values
    origin = deepcopy(document.values.get('origin')) if key.partition('.')[0] == 'origin' else None
    for section in sections:
        target = _below(target, section, place, key)
    if isinstance(target, list):
        target[_item(target, last, place, key)] = parsed
    else:
        target[last] = parsed
    document.places[key] = place
    if origin is not None and document.values['origin'] is not None:
        now, document.values['origin'] = document.values['origin'], origin
        _check_same(document, key, now)
        document.values['origin'] = now


def _below(target: Any, section: str, place: str, key: str) -> Any:
    """Return the section or list item (numbered from 1) that a part of a dotted key selects."""
    below = target[_item(target, section, place, key)] if isinstance(target, list) else target.setdefault(section, {})
    if not isinstance(below, (dict, list)):
        raise InputError(f'{place}: {section} is not a section', field=key)
    return below


def _item(items: list[Any], number: str, place: str, key: str) -> int:
    """Return the index of a list item; dotted keys number the items from 1."""
    if not (number.isdecimal() and 1 <= int(number) <= len(items)):
        raise InputError(f'{place}: {shown(number)} is not the number of a list item; count from 1 to {len(items)}',
                         field=key)
    return int(number) - 1
