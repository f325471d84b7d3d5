"""Options, exit codes and one-line errors shared by all command lines."""
import argparse
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.core.errors import DragonError, InputError, MissingError, ModelEnd, did_you_mean, shown

if TYPE_CHECKING:       # --help must not import numpy
    from dragon_ros.core.scene import Scene

OK, FAILED, BAD_INPUT, INCOMPLETE = 0, 1, 2, 3
# Control characters except tabs and line feeds, separators of lines, and marks that reverse the direction of text.
_CONTROLS = re.compile('[\0-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]')
_INVALID_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)")
_NEGATIVE = re.compile(r'-\.?\d')
_WITH_UNIT = re.compile(r'(\d+\.?\d*(?:e-?\d+)?|\.\d+)\s*(m|cm|mm|um|µm|nm)')
_UNITS_M = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6, 'µm': 1e-6, 'nm': 1e-9}
_MOST_SHOWN = 400       # maximum length of argparse's error messages, in characters


class _Default(str):
    """A default value that can be distinguished from an equal value given by the user."""

    __slots__ = ()


_SUFFIXES = {'.csv': 'csv', '.htm': 'html', '.html': 'html', '.json': 'json', '.npz': 'npz', '.parquet': 'parquet',
             '.txt': 'text', '.xlsx': 'xlsx'}
_OTHERS = frozenset(('.docx', '.jpg', '.mat', '.ods', '.pdf', '.png', '.svg', '.tex', '.xls'))   # no tables
DEFAULT_SCENE = _Default('winding')


class _StoreIfGiven(argparse.Action):
    """Store a positional argument if it is given; otherwise, keep the value of the option with the same name."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any,
                 option_string: str | None = None) -> None:
        """Store the value."""
        if values is not None:
            setattr(namespace, self.dest, values)


class Parser(argparse.ArgumentParser):
    """A parser that accepts only finite numbers, reports each error on one line, and supports shell completion."""

    def __init__(self, **options: Any) -> None:
        """Create a parser from the arguments of ``ArgumentParser``."""
        super().__init__(**options)
        self.register('type', float, _finite)
        self.register('type', int, _whole)
        self.register('type', Path, _path)

    def parse_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> Any:
        """Parse the arguments; if the shell requests completions, print them and exit."""
        if '_ARGCOMPLETE' in os.environ:
            from dragon_ros.cli import completion
            completion.answer(self)
        words = sys.argv[1:] if args is None else args
        arguments = super().parse_args(_with_negative_values(words), namespace)
        try:
            _check_output(arguments)
        except InputError as error:
            self.error(str(error))
        if 'formats' in arguments:
            _settle_format(self, arguments)
        return arguments

    def parse_known_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse the arguments; reject unknown options here, where the error can name the command or subcommand."""
        arguments, unknown = super().parse_known_args(args, namespace)
        if unknown and '_ARGCOMPLETE' not in os.environ:
            known = [name for action in self._actions for name in action.option_strings]
            hint = self._scene_hint(unknown[0], known) or did_you_mean(unknown[0], known, '')
            self.error(f'unrecognized arguments: {" ".join(unknown)}' + (f'; {hint}' if hint else ''))
        return arguments, unknown

    @staticmethod
    def _scene_hint(word: str, known: Sequence[str]) -> str:
        """Return a hint if a scene is given without --scene."""
        from dragon_ros.configuration import scene_names
        scene = '--scene' in known and (word in scene_names() or word.endswith(('.yaml', '.yml')))
        return f'write --scene {word}' if scene else ''

    def error(self, message: str) -> NoReturn:
        """Print the error with a reference to --help, and exit with code 2."""
        line = ' '.join(message.split())
        if wrong := _INVALID_CHOICE.search(line):
            hint = did_you_mean(wrong[1], re.findall(r"[^\s,']+", wrong[2]), '')
            line += f'; {hint}' if hint else ''
        line = line if len(line) <= _MOST_SHOWN else f'{line[:_MOST_SHOWN]}...'
        name = self.prog.removeprefix(program()).strip()
        self.exit(BAD_INPUT, printable(f'{name}: {line}; see {self.prog} --help') + '\n')


def _finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{shown(text)} is not a number; write a number such as 0.5') from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f'{shown(text)} is not a finite number')
    return value


def _whole(text: str) -> int:
    value = int(text)
    if abs(value) >= 2**63:
        raise argparse.ArgumentTypeError(f'{shown(text)} is too large')
    return value


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError('the path is empty; write the name of a file or folder')
    return Path(text)       # an empty one would be the working folder


def _assignment(text: str) -> str:
    key, colon, value = text.partition(':')
    if '=' not in text and colon and value:
        raise argparse.ArgumentTypeError(f'{shown(text)} is not KEY=VALUE; write --set {key}={value.strip()}')
    if '=' not in text:
        raise argparse.ArgumentTypeError(f'{shown(text)} is not KEY=VALUE; write --set {text}=VALUE, without a space')
    return text


def _accuracy(text: str) -> str:
    if found := _WITH_UNIT.fullmatch(text):
        metres = float(found[1]) * _UNITS_M[found[2]]
        raise argparse.ArgumentTypeError(f'{shown(text)} has a unit; write metres alone: --accuracy {metres:g}')
    return text


def _with_negative_values(words: Iterable[str]) -> list[str]:
    """Join each option with a value that begins with a negative number; argparse takes -100,-50 for an option."""
    out: list[str] = []
    for word in words:
        if out and _NEGATIVE.match(word) and out[-1].startswith('--') and '=' not in out[-1] and out[-1] != '--':
            out[-1] += f'={word}'
        else:
            out.append(word)
    return out


def program() -> str:
    """Return the words that the user typed before the command's name, such as ``ros2 run dragon_ros``."""
    if 'DRAGON_PROGRAM' in os.environ:      # set by the script ./dragon
        return os.environ['DRAGON_PROGRAM']
    started = Path(sys.argv[0])
    if started.parent.name == 'dragon_ros' and started.parent.parent.name == 'lib':
        return 'ros2 run dragon_ros'
    return 'dragon' if started.name == 'dragon' else 'python -m dragon_ros'


def parser(name: str, text: str, example: str) -> argparse.ArgumentParser:
    """Return a parser that shows the executable's name, its purpose and an example that begins with its name."""
    return Parser(prog=f'{program()} {name}', description=text, epilog=f'example: {program()} {example}',
                  allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter)


def add_scene_options(options: argparse.ArgumentParser, scene: str | None = DEFAULT_SCENE) -> None:
    """Add --scene, --set and --accuracy.

    A node passes None for ``scene``, because its scene is also a ROS parameter.
    """
    options.add_argument('--scene', default=scene, metavar='NAME|FILE',
                         help='name or file of the scene' + (' (%(default)s)' if scene else ''))
    options.add_argument('--set', action='append', default=[], metavar='KEY=VALUE', dest='overrides',
                         type=_assignment, help='override a scene key, such as track.pitch_m=0.5; repeatable')
    options.add_argument('--accuracy', metavar='METRES', type=_accuracy,
                         help='largest position error allowed, in metres')


def add_source_options(options: argparse.ArgumentParser) -> None:
    """Add the scene options, and the alternative options --bag and --namespace."""
    add_scene_options(options)
    add_bag(options, 'recording to show instead of a scene')
    add_namespace_option(options)


def add_namespace_option(options: argparse.ArgumentParser) -> None:
    """Add --namespace, which selects a dragon in a bag (``bags.read.frames.namespace_of``)."""
    options.add_argument('--namespace', metavar='NAME', help='namespace of the dragon, if the bag has several')


def add_bag(options: argparse.ArgumentParser, text: str, required: bool = False) -> None:
    """Add the positional BAG and the equivalent option --bag; both specify a recording."""
    given = options.add_mutually_exclusive_group(required=required)
    given.add_argument('bag', nargs='?', type=Path, metavar='BAG', action=_StoreIfGiven, help=text)
    given.add_argument('--bag', type=Path, metavar='BAG', dest='bag', help='the same as BAG')


def add_times_option(options: argparse.ArgumentParser, text: str) -> None:
    """Add --times and its alias --time, which take numbers and ranges (``cli.ranges``)."""
    options.add_argument('--times', '--time', metavar='T,...|FIRST-LAST|START:STOP:STEP', help=text)


def add_workers_option(options: argparse.ArgumentParser, what: str, of: str = '') -> None:
    """Add --workers (``cli.pool``); its help states that ``what`` does not depend on the number of workers."""
    options.add_argument('--workers', type=int, metavar='N', help=f'number of processes{of} (one per core for long '
                         f'work); the {what} does not depend on it')


def add_handles_option(options: argparse.ArgumentParser) -> None:
    """Add --handles, which takes numbers and ranges (``cli.ranges``)."""
    options.add_argument('--handles', metavar='I,...|FIRST-LAST|START:STOP:STEP', help='handles (all)')


def add_output_options(options: argparse.ArgumentParser, formats: tuple[str, ...] = ('text', 'csv', 'json')) -> None:
    """Add --format and --output."""
    add_format_option(options, formats)
    options.add_argument('--output', type=Path, metavar='FILE', help='write to a file instead of standard output')


def add_format_option(options: argparse.ArgumentParser, formats: tuple[str, ...], pictures: Collection[str] = (),
                      ) -> None:
    """Add --format, whose default follows from --output; ``pictures`` lists further suffixes of --output."""
    options.add_argument('--format', choices=formats, default=_Default(formats[0]),
                         help='output format (%(default)s, unless the suffix of --output determines it)')
    options.set_defaults(formats=formats, pictures=pictures)


def _settle_format(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """Choose the format by the suffix of --output; reject a --format that contradicts the suffix."""
    output, formats = arguments.output, arguments.formats
    suffix = output.suffix.lower() if output is not None else ''
    if not suffix or suffix in arguments.pictures:
        return
    chosen = _SUFFIXES.get(suffix)
    if suffix in _OTHERS or (chosen is None and isinstance(arguments.format, _Default)):
        others = f', or a picture, {", ".join(arguments.pictures)}' if arguments.pictures else ''
        parser.error(f'argument --output: {output}: {suffix[1:]} is not supported here; the formats are '
                     f'{", ".join(formats)}'
                     f'{others}')
    if chosen is None or chosen == arguments.format:
        return
    if chosen not in formats:
        parser.error(f'argument --output: {output}: {chosen} is not supported here; the formats are '
                     f'{", ".join(formats)}')
    if not isinstance(arguments.format, _Default):
        parser.error(f'argument --format: {arguments.format} conflicts with --output {output}; give only one of them')
    arguments.format = chosen


def names_scene(arguments: argparse.Namespace) -> bool:
    """Return whether the user gave --scene, even with the default value."""
    return not isinstance(arguments.scene, _Default)


def gives_scene(arguments: argparse.Namespace) -> bool:
    """Return whether the user gave any scene option."""
    return bool(arguments.overrides) or arguments.accuracy is not None or names_scene(arguments)


def check_taken(what: str, given: dict[str, bool], takes: set[str]) -> None:
    """Raise InputError if a given option would be ignored."""
    unused = sorted(name for name, is_given in given.items() if is_given and name not in takes)
    if unused:
        raise InputError(f'{unused[0]}: {what} does not accept it; omit it')


def scene_from(arguments: argparse.Namespace) -> 'Scene':
    """Return the scene that the options describe; what is left out of its venue's file is said on standard error."""
    from dragon_ros.scenes.load import load_scene
    notes = list[str]()
    scene = load_scene(arguments.scene, overrides_from(arguments), notes)
    for text in notes:
        note(text)
    return scene


def overrides_from(arguments: argparse.Namespace) -> list[str]:
    """Return the scene changes that the options specify, as ``key=value`` strings."""
    accuracy = [f'accuracy={arguments.accuracy}'] if arguments.accuracy is not None else []
    return [*arguments.overrides, *accuracy]


def check_is_bag(path: Path) -> None:
    """Raise InputError if the name or file of a scene is given instead of a recording."""
    from dragon_ros.configuration import scene_names
    if path.suffix in ('.yaml', '.yml') or (str(path) in scene_names() and not path.exists()):
        raise InputError(f'BAG {path}: it is a scene, not a recording; write --scene {path}')


def csv_of(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """Return column names and rows as CSV; every line ends with a line feed."""
    import csv
    import io
    out = io.StringIO()
    csv.writer(out, lineterminator='\n').writerows([head, *rows])
    return out.getvalue()


def check_keeps(option: str, path: Path | None, *sources: str | Path | None) -> None:
    """Raise InputError if the file to write is one of the files that are read."""
    for source in sources:
        if path is not None and source is not None and os.path.exists(source) and os.path.exists(path) and (
                path.samefile(source)):
            raise InputError(f'{option} {path}: this is the file that is read; give another file')


def _check_output(arguments: argparse.Namespace) -> None:
    """Raise InputError if --output names the bag or the scene file that the command reads."""
    given, scene = getattr(arguments, 'output', None), getattr(arguments, 'scene', None)
    is_file = scene is not None and Path(scene).suffix in ('.yaml', '.yml')
    for path in given if isinstance(given, list) else [given]:
        check_keeps('--output', path, getattr(arguments, 'bag', None), scene if is_file else None)


def write_output(path: Path | None, content: str | bytes, option: str = '--output') -> None:
    """Write the content to a file or, if it is text and ``path`` is None, to standard output.

    In text, bytes of file names that are not UTF-8 are escaped.

    Raises InputError or MissingError.
    """
    if path is None:
        if isinstance(content, bytes):
            raise InputError('--format: this format can only be written to a file; give --output FILE', field='output')
        try:
            print(printable(content), flush=True)
        except BrokenPipeError:
            raise
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())      # at exit, Python writes the rest
            raise MissingError(f'standard output cannot be written: {error.strerror}') from None
        return
    try:
        with whole_or_none(path, overwrite=True) as file:
            file.write(content if isinstance(content, bytes) else f'{content}\n'.encode(errors='backslashreplace'))
    except OSError as error:
        raise MissingError(f'{option} {path}: cannot be written: {error.strerror}') from None


def printable(text: str) -> str:
    """Return text with escaped control characters except line feeds and tabs, so that names cannot drive a terminal."""
    return _CONTROLS.sub(lambda found: found[0].encode('unicode_escape').decode(), text)


def note(text: str) -> None:
    """Print a line to standard error, with escaped control characters."""
    print(printable(text), file=sys.stderr)


def guarded(name: str, body: Callable[[], int]) -> int:
    """Run a command and return its exit code; report a DragonError as one line on standard error."""
    try:
        return body()
    except BrokenPipeError:
        sys.stderr.close()
        return FAILED
    except KeyboardInterrupt:
        return FAILED
    except DragonError as error:
        note(f'{name}: {" ".join((error.naming_options or str(error)).split())}')
        return BAD_INPUT if isinstance(error, (InputError, ModelEnd)) else FAILED
    except OSError as error:        # a name that the system rejects, for example because it is too long
        if error.filename is None:
            raise
        note(f'{name}: {error.filename}: {error.strerror}')
        return BAD_INPUT
