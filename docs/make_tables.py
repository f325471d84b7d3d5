"""Write the tables of the documents from the code, between the marks <!-- table NAME --> and <!-- end -->.

``./dragon docs`` renews all tables; with ``--check`` it changes nothing and fails if a table is stale.
"""
import argparse
import dataclasses
import inspect
import re
import sys
from collections.abc import Callable, Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import dragon_ros as dr  # noqa: E402
from dragon_contest import limits as contest_budgets  # noqa: E402
from dragon_ros import configuration  # noqa: E402
from dragon_ros.__main__ import EXECUTABLES  # noqa: E402
from dragon_ros.configuration import scene_names  # noqa: E402
from dragon_ros.core import domain  # noqa: E402
from dragon_ros.core import limits as budgets  # noqa: E402
from dragon_ros.core.flags import MEANINGS, NEEDS  # noqa: E402
from dragon_ros.messages.channels import Channel, channels  # noqa: E402
from dragon_ros.nodes import params  # noqa: E402
from dragon_ros.scenes.load import PARTS  # noqa: E402
from dragon_ros.scenes.schema import scene_schema  # noqa: E402
from dragon_ros.verify import reading  # noqa: E402

DOCUMENTS = tuple(ROOT / 'docs' / f'{name}.md' for name in ('reference', 'limits', 'api'))
_MARKED = re.compile(r'(<!-- table (\w+) -->\n).*?(<!-- end -->)', re.DOTALL)
_GONE = '-'
# The notations of different numpy versions for the type of an array of floats.
_FLOATS = re.compile(r'ndarray\[(?:tuple\[Any, \.\.\.\]|Any), dtype\[float64\]\]')


def main(argv: list[str]) -> int:
    """Renew or check all documents; return the exit code."""
    options = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    options.add_argument('--check', action='store_true', help='change nothing; exit with code 1 if a table is stale')
    check = options.parse_args(argv).check
    stale = [path for path in DOCUMENTS if renewed(path) != path.read_text(encoding='utf-8')]
    for path in stale:
        print(f'{path.relative_to(ROOT)}: {"stale; run ./dragon docs" if check else "renewed"}')
        if not check:
            path.write_text(renewed(path), encoding='utf-8')
    return int(check and bool(stale))


def renewed(path: Path) -> str:
    """Return a document with its tables renewed. Raises KeyError for an unknown mark."""
    return _MARKED.sub(lambda found: f'{found[1]}{TABLES[found[2]]()}\n{found[3]}', path.read_text(encoding='utf-8'))


def names_of(path: Path) -> list[str]:
    """Return the names of the tables in a document."""
    return [found[1] for found in _MARKED.findall(path.read_text(encoding='utf-8'))]


def table(head: str, rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table; ``head`` lists the columns, separated by bars."""
    lines = [f'| {head} |', '|' + '---|' * (head.count('|') + 1)]
    return '\n'.join([*lines, *(f'| {" | ".join(cell.replace("|", chr(92) + "|") for cell in row)} |' for row in rows)])


def executables() -> str:
    """Return the executables and their purposes."""
    return table('name | purpose', ((f'`{name}`', one.help) for name, one in EXECUTABLES.items()))


def topics() -> str:
    """Return the topics with their type, publisher, effect and meaning."""
    return table('topic | type | from | effect | meaning', (
        (f'`{name}`', one.type.replace('/msg/', '/'), one.publisher,
         f'`{one.effect.names[0]}`' if one.effect else '', one.meaning + (', latched' if _says_late(one) else ''))
        for name, one in channels().items()))


def _says_late(channel: Channel) -> bool:
    return channel.latched and 'latched' not in channel.meaning


def qualities() -> str:
    """Return the topics of each quality of service."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for name, one in channels().items():
        found.setdefault((one.reliability, one.durability, str(one.depth)), []).append(f'`{name}`')
    return table('reliability | durability | depth | topics', ((*of, ', '.join(names)) for of, names in found.items()))


def parameters(rows: tuple[params.Parameter, ...]) -> str:
    """Return the parameters of a node."""
    return table('parameter | default | allowed | live | meaning', (
        (f'`{one.name}`', f'`{one.default!r}`', _limits(one), 'yes' if one.live else '', one.text) for one in rows))


def _limits(one: params.Parameter) -> str:
    if one.choices:
        return ', '.join(f'`{choice}`' for choice in one.choices)
    return f'{one.low:g} to {one.high:g}' if one.low is not None and one.high is not None else ''


def scenes() -> str:
    """Return the scenes of the package with the first sentence of each file."""
    return table('scene | contents', ((f'`{name}`', _first_sentence(name)) for name in scene_names()))


def _first_sentence(name: str) -> str:
    """Return the first sentence of a scene file's initial comment."""
    lines = (configuration.folder() / 'scenes' / f'{name}.yaml').read_text(encoding='utf-8').splitlines()
    end = next((number for number, line in enumerate(lines) if not line.startswith('#')), len(lines))
    return re.split(r'(?<=\.)\s', ' '.join(line.lstrip('# ') for line in lines[:end]))[0]


def keys() -> str:
    """Return the keys of a scene file with their defaults."""
    return table('section | kind | keys and defaults | meaning', _key_rows(scene_schema()['properties']))


def _key_rows(parts: dict[str, Any]) -> Iterable[tuple[str, str, str, str]]:
    for name, part in parts.items():
        for one in part.get('oneOf', [part]):
            yield (f'`{name}`', *_kind_row(one))
        for key, items in [part for one in part.get('oneOf', [part]) for part in _parts(one)]:
            yield from ((f'`{name}.{key}`', *_kind_row(row)) for row in items.get('oneOf', [items]))


def _parts(one: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Return the keys that contain lists of mappings, each with the schema of its mappings."""
    return [(key, row['items']) for key, row in one.get('properties', {}).items() if key in PARTS]


def _kind_row(one: dict[str, Any]) -> tuple[str, str, str]:
    """Return (kind, keys with defaults, meaning) of a section or of a single key."""
    what = one['description'].replace('``', '`')
    if 'properties' not in one:
        return '', _default(one), what
    fields = dict(one['properties'])
    kind = fields.pop('kind', {}).get('const', '')
    return f'`{kind}`' if kind else '', ', '.join(f'`{key}`{_default(row, ": ")}' for key, row in fields.items()), what


def _default(row: dict[str, Any], before: str = '') -> str:
    if 'default' not in row:
        return ' (must be given)' if before else ''
    value = row['default']
    text = f'[{", ".join(value)}]' if isinstance(value, list) else _GONE if value is None else str(value)
    return f'{before}{text}'


def effects() -> str:
    """Return the effects with their topics and needs."""
    named = {effect: [name for name, one in channels().items() if one.effect == effect] for effect in MEANINGS}
    return table('effect | topic | needs | meaning', (
        (f'`{effect.names[0]}`', ', '.join(f'`{name}`' for name in named[effect] or ['/clock']),
         f'`{NEEDS[effect].names[0]}`' if effect in NEEDS else '', text) for effect, text in MEANINGS.items()))


def world() -> str:
    """Return the limits of the world."""
    return table('quantity | from | to', ((one.what, f'{one.low:,g}', f'{one.high:,g} {one.unit}'.strip())
                                          for one in domain.WORLD))


def limits() -> str:
    """Return the budgets for untrusted input."""
    rows = [(one.bounds, _amount(getattr(module, one.name), one.unit), one.beyond)
            for module in (budgets, contest_budgets) for one in module.LIMITS]
    checked = [('a certificate', _amount(reading.MOST_BYTES, 'bytes'), 'rejected')]
    return table('quantity | at most | beyond it', [*rows, *checked])


def _amount(value: float, unit: str) -> str:
    """Return a number with its unit; bytes are given in MiB or KiB if they are whole multiples of that unit."""
    if unit == 'bytes':
        power, name = next((power, name) for power, name in ((2**20, 'MiB'), (2**10, 'KiB'), (1, 'bytes'))
                           if not value % power)
        return f'{int(value // power)} {name}'
    return f'{value:,g} {unit}' if isinstance(value, float) else f'{value:,} {unit}'


def api() -> str:
    """Return the public names of ``import dragon_ros as dr``: functions, then classes, each from its docstring."""
    public = {name: getattr(dr, name) for name in dr.__all__}
    of_functions = [_function(f'dr.{name}', one) for name, one in public.items() if inspect.isfunction(one)]
    instances = [_class(f'dr.{name}', type(one)) for name, one in public.items()
                 if not inspect.isclass(one) and not inspect.isfunction(one)]
    of_classes = [_class(f'dr.{name}', one) for name, one in public.items() if inspect.isclass(one)]
    return '\n\n'.join([*of_functions, *instances, *of_classes])


def _function(name: str, function: Callable[..., Any], level: str = '##') -> str:
    signature = inspect.signature(function)
    kept = [_shown(one) for key, one in signature.parameters.items() if key != 'self']
    text = str(signature.replace(parameters=kept, return_annotation=_bare(signature.return_annotation)))
    return f'{level} `{name}`\n\n```text\n{name}{_wrapped(text)}\n```\n\n{_prose(function)}'


def _shown(one: inspect.Parameter) -> inspect.Parameter:
    """Return a parameter with abbreviated types; a default that is a function is shown as three dots."""
    default = _Text('...') if inspect.isfunction(one.default) else one.default
    return one.replace(annotation=_bare(one.annotation), default=default)


def _bare(annotation: Any) -> Any:
    """Return an annotation without the quotes of a forward reference and without the modules of its types."""
    if annotation is inspect.Parameter.empty:
        return annotation
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    return _Text(_FLOATS.sub('ndarray', re.sub(r"[\w.]+\.(?=[A-Za-z_])|'", '', text)))


class _Text(str):
    """A string whose repr has no quotes."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def _wrapped(text: str, width: int = 100) -> str:
    """Break a long signature after the comma that ends each parameter."""
    if len(text) <= width:
        return text
    return re.sub(r', (?=\*?\*?\w+[:=,]|\*,)', ',\n    ', text).replace('(', '(\n    ', 1)


def _class(name: str, one: type) -> str:
    """Return a class: its description, public base, fields, properties and methods."""
    bases = [base.__name__ for base in one.__bases__ if base.__name__ in dr.__all__]
    lines = [f'## `{name}`', _prose(one)]
    if bases:
        lines.append(f'Subclass of {", ".join(f"`dr.{base}`" for base in bases)}.')
    if dataclasses.is_dataclass(one):
        fields = (f'`{field.name}` ({_bare(field.type)})' for field in dataclasses.fields(one)
                  if not field.name.startswith('_') and field.name != 'simulation')
        if listed := ', '.join(fields):
            lines.append(f'Fields: {listed}.')
    members = {key: value for key, value in vars(one).items() if not key.startswith('_')}
    properties = [f'- `{key}`: {_prose(value)}' for key, value in members.items()
                  if isinstance(value, (property, cached_property))]
    if properties:
        lines.append('\n'.join(properties))
    lines += [_function(f'{name}.{key}', value.__func__ if isinstance(value, staticmethod) else value, '###')
              for key, value in members.items() if inspect.isfunction(getattr(value, '__func__', value))]
    return '\n\n'.join(lines)


def _prose(one: Any) -> str:
    """Return the docstring of an object as Markdown."""
    return (inspect.getdoc(one) or '').replace('``', '`')


TABLES: dict[str, Callable[[], str]] = {
    'executables': executables, 'topics': topics, 'qualities': qualities,
    'scenes': scenes, 'keys': keys, 'effects': effects, 'world': world, 'limits': limits, 'api': api,
    'sim': lambda: parameters(params.SIM), 'monitor': lambda: parameters(params.MONITOR),
    'replay': lambda: parameters(params.REPLAY)}

if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
