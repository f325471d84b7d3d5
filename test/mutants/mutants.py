"""Mutate a room of the package and run its tests: ``./dragon mutants ROOM --sample 40 --seed 1``.

Cosmic Ray makes the mutants: another operator, another number, another branch. One at a time is written into a copy of
the checkout, and the tests that reach its line run there, the quickest first, until one fails. A mutant that cannot be
imported is not counted, since any test finds it. Tests marked ``snapshot``, which compare with an earlier output, are
left out: only a property, a reference, a bound or an independent decoder counts.

Results are kept as they come, in ``.venv/mutants``: the same command goes on after Ctrl-C, and Ctrl-C loses one mutant.
"""
import argparse
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from xml.etree import ElementTree

import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names
from tqdm import tqdm

ROOT = Path(__file__).parents[2]
CORE, TEST = 'dragon_ros/core', 'test/core'
# What is mutated, and the tests that must find it.
ROOMS = {
    'geometry': ([f'{CORE}/geometry'], [f'{TEST}/geometry', f'{TEST}/effects', f'{TEST}/search/test_contact.py']),
    'enclosures': ([f'{CORE}/enclosures'], [f'{TEST}/enclosures', f'{TEST}/search']),
    'search': ([f'{CORE}/search'], [f'{TEST}/search', f'{TEST}/enclosures', 'test/verify/test_accepts.py']),
    'tracks': ([f'{CORE}/tracks'], [f'{TEST}/tracks', f'{TEST}/test_accuracy.py', f'{TEST}/chain']),
    'chain': ([f'{CORE}/chain'], [f'{TEST}/chain', f'{TEST}/test_accuracy.py', f'{TEST}/test_promises.py']),
    'shift_map': ([f'{CORE}/shift_map'], [f'{TEST}/shift_map', f'{TEST}/test_accuracy.py']),
    'verify': (['dragon_ros/verify'], ['test/verify']),
    'messages': (['dragon_ros/messages'], ['test/messages']),
    'monitor': (['dragon_ros/nodes/monitor.py', 'dragon_ros/nodes/contact_messages.py', f'{CORE}/geometry/tracker.py'],
                [f'{TEST}/geometry/test_tracker.py', 'test/nodes/test_monitor_topics.py']),
}
# Of the operators on two operands those that look like a slip: others, such as a shift for a sum, any test finds.
_SLIPS = {'Add_Sub', 'Sub_Add', 'Mul_Div', 'Div_Mul', 'FloorDiv_Mul', 'Mod_FloorDiv', 'Pow_Mul', 'BitAnd_BitOr',
          'BitOr_BitAnd'}
_IGNORED = ('core/VariableInserter', 'core/VariableReplacer', 'core/NoOp', 'core/RemoveDecorator', 'core/AddNot',
            'core/ExceptionReplacer', 'core/KeywordReplacer')
_BOTH_WAYS = (('min', 'max'), ('minimum', 'maximum'), ('floor', 'ceil'), ('any', 'all'), ('sin', 'cos'),
              ('AHEAD', 'BEHIND'), ('first', 'last'), ('low', 'high'))
_OTHER = {**dict(_BOTH_WAYS), **{b: a for a, b in _BOTH_WAYS}, 'inf': '0.0', 'abs': 'float'}
_SLACK = 4.0        # times what its tests take without a mutant, and
_START_S = 20.0     # s for Python and imports: then a mutant counts as found, for a loop that does not end
_MOST_S = 150.0     # s of tests for one mutant, the quickest first


class Swapped(Operator):
    """Exchange names that differ by a side, a sense or a sign."""

    def mutation_positions(self, node):
        if isinstance(node, parso.python.tree.Name) and node.value in _OTHER and not node.is_definition():
            yield node.start_pos, node.end_pos

    def mutate(self, node, index):
        return parso.python.tree.Name(node.prefix + _OTHER[node.value], node.start_pos)

    @classmethod
    def examples(cls):
        return ()


class Scaled(Operator):
    """Double a number, or halve it: a factor that was forgotten, or taken twice."""

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
    """One change: the file, the operator and which of its occurrences there, and the line."""

    path: str
    operator: str
    occurrence: int
    line: int


def operators() -> dict[str, Operator]:
    """Return every operator by its name."""
    found = {name: get_operator(name) for name in operator_names()}
    made = {name: kind() for name, kind in found.items() if not name.startswith(_IGNORED) and not kind.arguments()}
    made = {name: one for name, one in made.items() if not name.endswith(('_Is', '_IsNot'))
            and ('ReplaceBinaryOperator' not in name or name.partition('Operator_')[2] in _SLIPS)}
    return {**made, 'dragon/Scaled': Scaled(), 'dragon/Swapped': Swapped()}


def mutants_of(path: str, source: str, known: dict[str, Operator]) -> Iterator[Mutant]:
    """Yield every mutant of a file but those of annotations, which nothing computes with."""
    nodes = list(ast_nodes(get_ast(source)))
    inside = [(node.start_pos, node.end_pos) for node in nodes if node.type in ('annassign', 'tfpdef')]
    inside += [(function.annotation.start_pos, function.annotation.end_pos) for function in nodes
               if function.type == 'funcdef' and function.annotation is not None]
    inside += [(a.start_pos, b.start_pos) for a, b in ((node.children[0], node.children[1]) for node in nodes
                                                      if node.type == 'decorated')]
    for name, operator in known.items():
        number = 0
        for node in nodes:
            for start, _ in operator.mutation_positions(node):
                if not any(a <= start < b for a, b in inside):
                    yield Mutant(path, name, number, start[0])
                number += 1


def copied() -> Path:
    """Return a fresh copy of the checkout's files."""
    tree = ROOT / '.venv' / 'mutants' / 'tree'
    shutil.rmtree(tree, ignore_errors=True)
    listed = subprocess.run(['git', 'ls-files', '--cached', '--others', '--exclude-standard'], cwd=ROOT, check=True,
                            capture_output=True, text=True).stdout.splitlines()
    for name in listed:
        if (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
    return tree


def pytest(tree: Path, *arguments: str, seconds: float | None = None, quiet: bool = True) -> int | None:
    """Return the exit code of the tests in a copy, None where they took too long."""
    command = [sys.executable, '-m', 'pytest', '-q', '-m', 'not snapshot', '-p', 'no:cacheprovider', *arguments]
    environment = os.environ | {'PYTHONPATH': str(tree), 'PYTHONDONTWRITEBYTECODE': '1'}
    environment.pop('PYTHONPYCACHEPREFIX', None)
    stream = subprocess.DEVNULL if quiet else None
    with subprocess.Popen(command, cwd=tree, env=environment, stdout=stream, stderr=stream,
                          start_new_session=True) as process:
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def reached(tree: Path, room: str, folder: Path) -> tuple[dict[str, dict[int, list[str]]], dict[str, float]]:
    """Return which tests run which lines, and how long each test takes, from one run without a mutant."""
    sources, tests = ROOMS[room]
    key = sha256(b''.join(path.read_bytes() for part in (*sources, *tests) for path in files(ROOT, part))).hexdigest()
    kept = folder / f'{room}-{key[:16]}.json'
    if not kept.exists():
        report, data = folder / 'times.xml', folder / 'coverage'
        for old in folder.glob('coverage*'):
            old.unlink()
        settings = folder / 'settings.ini'
        settings.write_text(f'[run]\ndata_file = {data}\nsource = dragon_ros\n')
        code = pytest(tree, '--numprocesses=logical', '--cov=dragon_ros', f'--cov-config={settings}', '--cov-report=',
                      '--cov-context=test', f'--junit-xml={report}', '-o', 'junit_family=xunit1', *tests, quiet=False)
        if code != 0:
            raise SystemExit(f'mutants: the tests of {room} fail without any mutant, see above')
        kept.write_text(json.dumps([lines_of(tree, data), times_of(report)]))
    lines, times = json.loads(kept.read_text())
    return {path: {int(line): names for line, names in rows.items()} for path, rows in lines.items()}, times


def lines_of(tree: Path, data: Path) -> dict[str, dict[int, list[str]]]:
    """Return the tests that run each line of each file, from the data of coverage."""
    from coverage import CoverageData
    found = CoverageData(str(data))
    found.read()
    out = dict[str, dict[int, list[str]]]()
    for path in found.measured_files():
        rows = {line: sorted({name.rpartition('|')[0] for name in names if name})
                for line, names in found.contexts_by_lineno(path).items()}
        out[str(Path(path).relative_to(tree))] = {line: names for line, names in rows.items() if names}
    return out


def times_of(report: Path) -> dict[str, float]:
    """Return how many seconds each test takes, by its name alone."""
    return {case.attrib['name']: float(case.attrib['time']) for case in ElementTree.parse(report).iter('testcase')}


def files(root: Path, part: str) -> list[Path]:
    """Return the Python files of a folder, or a file itself."""
    path = root / part
    return sorted(path.rglob('*.py')) if path.is_dir() else [path]


def chosen(mutant: Mutant, lines: dict[str, dict[int, list[str]]], times: dict[str, float]) -> tuple[list[str], float]:
    """Return the tests that reach a mutant, the quickest first, and how long they take without it."""
    rows = lines.get(mutant.path, {})
    at_import = mutant.line not in rows         # a constant: whatever runs in its file may use it
    names = {name for group in rows.values() for name in group} if at_import else rows[mutant.line]
    timed = sorted((times.get(name.partition('::')[2], 0.1), name) for name in names if '\n' not in name)
    out, total = [], 0.0
    for seconds, name in timed:
        if total + seconds <= _MOST_S or not out:
            out.append(name)
            total += seconds
    return out, total


def tried(tree: Path, mutant: Mutant, tests: list[str], seconds: float, known: dict[str, Operator]) -> str:
    """Return 'caught', 'survived', 'unreached' or 'incompetent' for a mutant."""
    path = tree / mutant.path
    source = path.read_text()
    try:
        path.write_text(mutate_code(source, known[mutant.operator], mutant.occurrence))
        module = mutant.path.removesuffix('.py').replace('/', '.')
        done = subprocess.run([sys.executable, '-c', f'import {module}'], cwd=tree, capture_output=True, check=False,
                              env=os.environ | {'PYTHONPATH': str(tree), 'PYTHONDONTWRITEBYTECODE': '1'})
        if done.returncode:
            return 'incompetent'
        if not tests:
            return 'unreached'
        listed = tree / 'tests.txt'
        listed.write_text('\n'.join(tests))
        code = pytest(tree, '-x', '-n0', f'@{listed}', seconds=_START_S + _SLACK * seconds)
        return 'survived' if code == 0 else 'caught'
    finally:
        path.write_text(source)


def difference(mutant: Mutant, known: dict[str, Operator]) -> str:
    """Return the line before and after."""
    source = (ROOT / mutant.path).read_text()
    before, after = source.splitlines(), mutate_code(source, known[mutant.operator], mutant.occurrence).splitlines()
    changed = [n for n, (a, b) in enumerate(zip(before, after, strict=False)) if a != b][:1]
    return ''.join(f'    - {before[n].strip()}\n    + {after[n].strip()}\n' for n in changed)


def main(argv: list[str]) -> int:
    """Try a sample of mutants; return 1 where any survived."""
    options = argparse.ArgumentParser('mutants', description=__doc__.partition('\n')[0])
    options.add_argument('room', choices=ROOMS, metavar='ROOM', help=', '.join(ROOMS))
    options.add_argument('--sample', type=int, default=40, metavar='N', help='how many mutants (%(default)s)')
    options.add_argument('--seed', type=int, default=1, metavar='S', help='which ones (%(default)s)')
    options.add_argument('--list', action='store_true', help='list the sample and try none')
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
    tree = copied()
    lines, times = reached(tree, arguments.room, folder)
    kept = folder / f'{arguments.room}-{arguments.seed}.jsonl'
    done = {}
    if kept.exists():
        rows = [json.loads(line) for line in kept.read_text().splitlines()]
        done = {Mutant(**row['mutant']): row['outcome'] for row in rows}
    with kept.open('a') as file:
        for mutant in tqdm([one for one in sample if one not in done], unit='mutants'):
            done[mutant] = tried(tree, mutant, *chosen(mutant, lines, times), known)
            print(json.dumps({'mutant': asdict(mutant), 'outcome': done[mutant]}), file=file, flush=True)
    return told(arguments.room, {one: done[one] for one in sample}, known)


def told(room: str, outcomes: dict[Mutant, str], known: dict[str, Operator]) -> int:
    """Print what became of the sample; return the exit code."""
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
        sys.exit(f'mutants: {error or "interrupted"}; the same command goes on')
