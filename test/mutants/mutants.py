"""Mutate a room of the package and run its tests: ``./dragon mutants ROOM --sample 40 --seed 1``.

Cosmic Ray generates the mutants: another operator, another number, another branch. Each mutant is written into a copy
of the checkout. The tests that reach the changed line run in that copy, fastest first, until one fails. They run in a
fork of this process, which has loaded the libraries, so a mutant takes a second in addition to its tests. A mutant that
cannot be imported is not counted, since any test would find it. Tests marked ``snapshot``, which compare with earlier
output, are excluded: only properties, references, bounds and independent decoders count.

Results are stored immediately in ``.venv/mutants``: Ctrl-C loses one mutant, and the same command then resumes. After
a test has been added, ``--again`` retries the survivors.
"""
import argparse
import ast
import importlib
import importlib.util
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

import parso
import pytest
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names
from tqdm import tqdm

ROOT = Path(__file__).parents[2]
CORE, TEST = 'dragon_ros/core', 'test/core'
# The mutated code, and the tests that must detect mutants.
ROOMS = {
    'geometry': ([f'{CORE}/geometry'], [f'{TEST}/geometry', f'{TEST}/effects', f'{TEST}/search/test_contact.py']),
    'enclosures': ([f'{CORE}/enclosures'], [f'{TEST}/enclosures', f'{TEST}/search']),
    'search': ([f'{CORE}/search'], [f'{TEST}/search', f'{TEST}/enclosures', 'test/verify/test_accepts.py']),
    'tracks': ([f'{CORE}/tracks'], [f'{TEST}/tracks', f'{TEST}/test_accuracy.py', f'{TEST}/chain']),
    'chain': ([f'{CORE}/chain'], [f'{TEST}/chain', f'{TEST}/test_accuracy.py', f'{TEST}/test_promises.py']),
    'shift_map': ([f'{CORE}/shift_map'], [f'{TEST}/shift_map', f'{TEST}/test_accuracy.py']),
    'verify': (['dragon_ros/verify'], ['test/verify']),
    'messages': (['dragon_ros/messages'], ['test/messages', 'test/scenes/test_scene_files.py',
                                           'test/bags/test_recorded_obstacles.py']),
    'monitor': (['dragon_ros/nodes/monitor.py', 'dragon_ros/nodes/contact_messages.py', f'{CORE}/geometry/tracker.py'],
                [f'{TEST}/geometry/test_tracker.py', f'{TEST}/geometry/test_tracker_in_venues.py',
                 'test/nodes/test_contact_messages.py',
                 'test/nodes/test_monitor_topics.py', 'test/nodes/test_overload.py',
                 'test/messages/test_monitor_markers.py']),
}
# Operator replacements that resemble a programmer's slip. Any test would find other replacements, such as a shift
# instead of a sum.
_SLIPS = {'Add_Sub', 'Sub_Add', 'Mul_Div', 'Div_Mul', 'FloorDiv_Mul', 'Mod_FloorDiv', 'Pow_Mul', 'BitAnd_BitOr',
          'BitOr_BitAnd'}
_IGNORED = ('core/VariableInserter', 'core/VariableReplacer', 'core/NoOp', 'core/RemoveDecorator', 'core/AddNot',
            'core/ExceptionReplacer', 'core/KeywordReplacer')
_BOTH_WAYS = (('min', 'max'), ('minimum', 'maximum'), ('floor', 'ceil'), ('any', 'all'), ('sin', 'cos'),
              ('AHEAD', 'BEHIND'), ('first', 'last'), ('low', 'high'))
_OTHER = {**dict(_BOTH_WAYS), **{b: a for a, b in _BOTH_WAYS}, 'inf': '0.0', 'abs': 'float'}
# Libraries that are loaded before forking. None of them imports the package.
_LOADED = ('numpy', 'shapely', 'hypothesis.extra.numpy', 'mpmath', 'flint', 'scipy.optimize', 'scipy.integrate', 'yaml',
           'matplotlib.figure', 'coverage')
_UNUSED = ('xdist', 'cov', 'cacheprovider', 'stepwise', 'launch_testing', 'launch_pytest', 'ament_copyright')
# A test may take _SLACK times its processor time without a mutant, plus _EXTRA_S. Beyond that, the mutant is considered
# to loop forever, and counts as found. _WAITED is the multiple of the wall time of all tests after which a mutant is
# considered to wait forever.
_SLACK = 4.0
_EXTRA_S = 3.0
_WAITED = 20.0
_NODES = ('dragon_ros/nodes/', 'test/nodes/')
_ALIVE = ('survived', 'unreached')


class Swapped(Operator):
    """Replace a name with its counterpart, such as the other side, sense or end."""

    def mutation_positions(self, node):
        if isinstance(node, parso.python.tree.Name) and node.value in _OTHER and not node.is_definition():
            yield node.start_pos, node.end_pos

    def mutate(self, node, index):
        return parso.python.tree.Name(node.prefix + _OTHER[node.value], node.start_pos)

    @classmethod
    def examples(cls):
        return ()


class Scaled(Operator):
    """Double or halve a number, as if a factor of two had been forgotten or applied twice."""

    def mutation_positions(self, node):
        if isinstance(node, parso.python.tree.Number) and node.value not in ('0', '0.0'):
            yield from [(node.start_pos, node.end_pos)] * 2

    def mutate(self, node, index):
        value = eval(node.value)
        whole = isinstance(value, int)
        scaled = 2 * value if index == 0 else value // 2 if whole else value / 2
        return parso.python.tree.Number(node.prefix + repr(scaled), node.start_pos)

    @classmethod
    def examples(cls):
        return ()


@dataclass(frozen=True, order=True)
class Mutant:
    """A change to the code: the file, the operator, the number of its occurrence in the file, and the line."""

    path: str
    operator: str
    occurrence: int
    line: int


def operators() -> dict[str, Operator]:
    """Return every operator by name."""
    found = {name: get_operator(name) for name in operator_names()}
    made = {name: kind() for name, kind in found.items() if not name.startswith(_IGNORED) and not kind.arguments()}
    made = {name: one for name, one in made.items() if not name.endswith(('_Is', '_IsNot'))
            and ('ReplaceBinaryOperator' not in name or name.partition('Operator_')[2] in _SLIPS)}
    return {**made, 'dragon/Scaled': Scaled(), 'dragon/Swapped': Swapped()}


def mutants_of(path: str, source: str, known: dict[str, Operator]) -> Iterator[Mutant]:
    """Yield every mutant of a file, except those in code that computes nothing (see ``_unused``)."""
    nodes = list(ast_nodes(get_ast(source)))
    inside = [(part.start_pos, part.end_pos) for node in nodes for part in _unused(node)]
    for name, operator in known.items():
        number = 0
        for node in nodes:
            for start, _ in operator.mutation_positions(node):
                if not any(a <= start < b for a, b in inside):
                    yield Mutant(path, name, number, start[0])
                number += 1


def _unused(node: parso.tree.NodeOrLeaf) -> Iterator[parso.tree.NodeOrLeaf]:
    """Yield the parts of a node that compute nothing: annotations, decorators, error messages, ``strict`` of zip."""
    if node.type == 'annassign':
        yield node.children[1]
    elif node.type == 'tfpdef':
        yield node
    elif node.type == 'funcdef' and node.annotation is not None:
        yield node.annotation
    elif node.type == 'decorated':
        yield node.children[0]
    elif node.type == 'raise_stmt':
        yield from (part for part in ast_nodes(node) if part.type == 'fstring')
    elif node.type == 'argument' and node.children[0].type == 'name' and node.children[0].value == 'strict':
        yield node


def copied(room: str) -> Path:
    """Copy the files of the checkout, and return the folder that contains the copy."""
    tree = (ROOT / '.venv').resolve() / 'mutants' / f'tree-{room}'
    listed = subprocess.run(['git', 'ls-files', '--cached', '--others', '--exclude-standard'], cwd=ROOT, check=True,
                            capture_output=True, text=True).stdout.splitlines()
    shutil.rmtree(tree, ignore_errors=True)
    for name in listed:
        if (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
    return tree


@dataclass(eq=False)
class Order:
    """A pytest plugin that runs some tests in a given order and records the one that failed.

    A test that takes too much processor time, compared with its entry in ``times`` (in s), ends the process.
    """

    tests: list[str]
    times: dict[str, float]
    extra_s: float
    failed: str = ''

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        place = {name: number for number, name in enumerate(self.tests)}
        items[:] = sorted((one for one in items if one.nodeid in place), key=lambda one: place[one.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, self.extra_s + _SLACK * self.times[item.nodeid])
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)

    def pytest_runtest_logreport(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if report.failed:
            self.failed = self.failed or report.nodeid

    pytest_collectreport = pytest_runtest_logreport


class Lines:
    """A pytest plugin that records the processor time of each test and the lines that the test runs."""

    def __init__(self, sources: list[Path]) -> None:
        from coverage import Coverage
        self.times = dict[str, float]()
        self._coverage = Coverage(data_file=None, include=[str(path) for path in sources], config_file=False)
        self._coverage.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._coverage.switch_context(item.nodeid)
        started = time.process_time()
        out = yield
        self.times[item.nodeid] = time.process_time() - started
        self._coverage.switch_context('')
        return out

    def lines(self, tree: Path) -> dict[str, dict[int, list[str]]]:
        """Return the tests that run each line of each file."""
        self._coverage.stop()
        found, out = self._coverage.get_data(), dict[str, dict[int, list[str]]]()
        for path in found.measured_files():
            rows = {line: sorted(filter(None, names)) for line, names in found.contexts_by_lineno(path).items()}
            out[str(Path(path).relative_to(tree))] = {line: names for line, names in rows.items() if names}
        return out


def forked(tree: Path, work: Callable[[], object], seconds: float = 1000.0) -> tuple[bool, object]:
    """Do work in a fork of this process that uses a tree's package; return whether the fork ended, and its answer."""
    answer = tree / 'answer.json'
    answer.unlink(missing_ok=True)
    child = os.fork()
    if not child:
        try:
            os.setsid()
            sys.path[:] = [str(tree), *(path for path in sys.path if path not in ('', str(ROOT)))]
            os.environ['PYTHONPATH'] = str(tree)
            os.chdir(tree)
            quiet = os.open(tree / 'output.txt', os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            answer.write_text(json.dumps(work()))
        except Exception:   # noqa: BLE001 - a fork must not continue as its parent
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(0)
    ended_s = time.monotonic() + _WAITED * seconds
    try:
        while not os.waitpid(child, os.WNOHANG)[0]:
            if time.monotonic() > ended_s:
                break
            time.sleep(0.02)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    return answer.exists(), json.loads(answer.read_text()) if answer.exists() else None


def run(arguments: list[str], plugin: object) -> int:
    """Run pytest in this process without the plugins that are not needed here."""
    unused = [part for name in _UNUSED for part in ('-p', f'no:{name}')]
    # Hypothesis was loaded before pytest could rewrite it.
    loaded = ('-W', 'ignore::pytest.PytestAssertRewriteWarning')
    chosen = '--long', '-m', 'not snapshot'
    return int(pytest.main(['-q', '--tb=short', *chosen, *loaded, *unused, *arguments], [plugin]))


def reached(tree: Path, room: str, folder: Path) -> tuple[dict[str, dict[int, list[str]]], dict[str, float]]:
    """Return the tests that run each line, and the time that each test takes, measured in one run without a mutant.

    The data of a test file is cached until the file or the room changes.
    """
    parts, tests = ROOMS[room]
    sources = [path for part in parts for path in files(ROOT, part)]
    key = sha256(b''.join(path.read_bytes() for path in sources))
    lines, times = defaultdict[str, dict[int, list[str]]](lambda: defaultdict(list)), dict[str, float]()
    for file in tqdm([path for test in tests for path in files(ROOT, test) if path.name.startswith('test_')],
                     unit='files', desc='lines'):
        known = key.copy()
        known.update(file.read_bytes())
        kept = folder / f'{file.stem}-{known.hexdigest()[:16]}.json'
        if not kept.exists():
            kept.write_text(json.dumps(lines_of(tree, str(file.relative_to(ROOT)), [tree / path.relative_to(ROOT)
                                                                                   for path in sources])))
        rows, taken = json.loads(kept.read_text())
        times |= taken
        for path, by_line in rows.items():
            inside = in_functions((ROOT / path).read_text())
            for line, names in by_line.items():
                if int(line) in inside:
                    lines[path][int(line)] += names
    return {path: dict(rows) for path, rows in lines.items()}, times


def in_functions(source: str) -> set[int]:
    """Return the lines inside functions; other lines run at import, and any test may use their results.

    If a module is imported on first use, these other lines run in the first test that uses it.
    """
    kinds = ast.FunctionDef, ast.AsyncFunctionDef
    return {line for node in ast.walk(ast.parse(source)) if isinstance(node, kinds)
            for line in range(node.body[0].lineno, node.body[-1].end_lineno + 1)}


def lines_of(tree: Path, file: str, sources: list[Path]) -> tuple[dict[str, dict[int, list[str]]], dict[str, float]]:
    """Return a file's tests by the source lines that they run, and each test's processor time."""
    def work() -> object:
        plugin = Lines(sources)
        code = run([file], plugin)
        return code, plugin.lines(tree), plugin.times

    _, (code, lines, times) = forked(tree, work)
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        raise SystemExit(f'mutants: {file} fails without any mutant, see {tree / "output.txt"}')
    return lines, times


def files(root: Path, part: str) -> list[Path]:
    """Return the Python files in a folder; for a file, return the file itself."""
    path = root / part
    return sorted(path.rglob('*.py')) if path.is_dir() else [path]


def chosen(mutant: Mutant, lines: dict[str, dict[int, list[str]]], times: dict[str, float],
           found: dict[str, int], most_s: float) -> dict[str, float]:
    """Return the tests that reach a mutant, with their times in s without it, which total at most ``most_s``.

    Tests that have already found mutants in this file come first, then the fastest ones, and then all other tests of
    the same test files, which may share results with them.
    """
    rows = lines.get(mutant.path, {})
    at_import = mutant.line not in rows         # any code in the file may use it
    names = {name for group in rows.values() for name in group} if at_import else {*rows[mutant.line]}
    if mutant.path.startswith(_NODES[0]):       # nodes run in other processes, whose lines are not recorded
        names |= {name for name in times if name.startswith(_NODES[1])}
    shared = {name.partition('::')[0] for name in names}
    others = {name for name in times if name.partition('::')[0] in shared} - names
    out = dict[str, float]()
    for name in sorted(names | others, key=lambda one: (one in others, times[one] / (1 + 10 * found.get(one, 0)), one)):
        if sum(out.values()) + times[name] <= most_s or not out:
            out[name] = times[name]
    return out


@contextmanager
def written(tree: Path, mutant: Mutant, known: dict[str, Operator]) -> Iterator[None]:
    """Apply a mutant to the copy for the duration of the block."""
    path = tree / mutant.path
    source = path.read_text()
    cached = Path(importlib.util.cache_from_source(str(path)))
    try:
        cached.unlink(missing_ok=True)
        path.write_text(mutate_code(source, known[mutant.operator], mutant.occurrence))
        yield
    finally:
        path.write_text(source)


def tried(tree: Path, mutant: Mutant, times: dict[str, float], known: dict[str, Operator],
          extra_s: float = _EXTRA_S) -> tuple[str, str]:
    """Return 'caught', 'survived', 'unreached' or 'incompetent' for a mutant, and the test that found it.

    ``times`` contains the tests in the order in which they run, and their times in s without a mutant.
    """
    def work() -> object:
        sys.dont_write_bytecode = True
        importlib.import_module(mutant.path.removesuffix('.py').replace('/', '.'))
        (tree / 'imported').touch()
        plugin = Order(list(times), times, extra_s)
        code = run(['-x', '--hypothesis-profile=first', *{name.partition('::')[0]: None for name in times}], plugin)
        return code, plugin.failed

    (tree / 'imported').unlink(missing_ok=True)
    with written(tree, mutant, known):
        ended, answer = forked(tree, work, extra_s + sum(times.values()))
    if not (tree / 'imported').exists():
        return 'incompetent', ''
    if not times:
        return 'unreached', ''
    if not ended:
        return 'caught', 'no end'
    code, failed = answer
    if code == pytest.ExitCode.OK:
        return 'survived', ''
    if not failed:
        raise SystemExit(f'mutants: the tests of {mutant} could not be run, see {tree / "output.txt"}')
    return 'caught', failed


def difference(mutant: Mutant, known: dict[str, Operator]) -> str:
    """Return the first line that a mutant changes, before and after the change."""
    source = (ROOT / mutant.path).read_text()
    before, after = source.splitlines(), mutate_code(source, known[mutant.operator], mutant.occurrence).splitlines()
    changed = [n for n, (a, b) in enumerate(zip(before, after, strict=False)) if a != b][:1]
    return ''.join(f'    - {before[n].strip()}\n    + {after[n].strip()}\n' for n in changed)


def main(argv: list[str]) -> int:
    """Try a sample of mutants, and return 1 if any survived."""
    options = argparse.ArgumentParser('mutants', description=__doc__.partition('\n')[0])
    options.add_argument('room', choices=ROOMS, metavar='ROOM', help=', '.join(ROOMS))
    options.add_argument('--sample', type=int, default=40, metavar='N', help='number of mutants (%(default)s)')
    options.add_argument('--seed', type=int, default=1, metavar='S', help='seed of the sample (%(default)s)')
    options.add_argument('--list', action='store_true', help='list the sample without trying it')
    options.add_argument('--most', type=float, default=60.0, metavar='SECONDS',
                         help='maximum time in s for all tests of a mutant, measured without it (%(default)s)')
    options.add_argument('--again', action='store_true', help='try the survivors again')
    arguments = options.parse_args(argv)
    known, folder = operators(), ROOT / '.venv' / 'mutants'
    folder.mkdir(parents=True, exist_ok=True)
    every = sorted(one for part in ROOMS[arguments.room][0] for path in files(ROOT, part)
                   for one in mutants_of(str(path.relative_to(ROOT)), path.read_text(), known))
    sample = random.Random(arguments.seed).sample(every, min(arguments.sample, len(every)))
    if arguments.list:
        for mutant in sample:
            print(f'{mutant.path}:{mutant.line} {mutant.operator}\n{difference(mutant, known)}', end='')
        return 0
    for name in _LOADED:
        importlib.import_module(name)
    tree = copied(arguments.room)
    lines, times = reached(tree, arguments.room, folder)
    kept = folder / f'{arguments.room}-{arguments.seed}.jsonl'
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {Mutant(**row['mutant']): (row['outcome'], row['by']) for row in rows}
    left = [one for one in sample if one not in done or (arguments.again and done[one][0] in _ALIVE)]
    with kept.open('a') as file:
        for mutant in tqdm(left, unit='mutants'):
            found = Counter(by for one, (_, by) in done.items() if one.path == mutant.path)
            tests = chosen(mutant, lines, times, found, arguments.most)
            done[mutant] = outcome, by = tried(tree, mutant, tests, known)
            print(json.dumps({'mutant': asdict(mutant), 'outcome': outcome, 'by': by}), file=file, flush=True)
    return told(arguments.room, {one: done[one][0] for one in sample}, known)


def told(room: str, outcomes: dict[Mutant, str], known: dict[str, Operator]) -> int:
    """Print the results of the sample, and return the exit code."""
    groups = defaultdict(list)
    for mutant, outcome in sorted(outcomes.items()):
        groups[outcome].append(mutant)
    alive = groups['survived'] + groups['unreached']
    counted = len(outcomes) - len(groups['incompetent'])
    print(f'{room}: {len(groups["caught"])} of {counted} mutants caught, {len(alive)} alive; '
          f'{len(groups["incompetent"])} could not be imported and do not count')
    for mutant in alive:
        print(f'  {mutant.path}:{mutant.line} {outcomes[mutant]} ({mutant.operator})\n{difference(mutant, known)}',
              end='')
    return 1 if alive else 0


if __name__ == '__main__':
    try:
        sys.exit(main(sys.argv[1:]))
    except (KeyboardInterrupt, sqlite3.Error) as error:
        sys.exit(f'mutants: {error or "interrupted"}; the same command resumes')
