"""``./dragon cost PAGE``: measure the pages of ``docs/cost``."""
import subprocess
import sys
from argparse import Namespace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from dragon_ros.cli import command_line, figures
from dragon_ros.core.checks import number
from dragon_ros.core.errors import DragonError, InputError, MissingError
from dragon_ros.cost.measure import circumstances

PAGES = {'limits': 'benchmarks.limits', 'accuracy': 'benchmarks.workprec',
         'promises': 'benchmarks.promises', 'contact': 'benchmarks.contacts',
         'effects': 'benchmarks.effects', 'tick': 'benchmarks.ticks',
         'first': 'benchmarks.first_ticks', 'scale': 'benchmarks.scale',
         'bag': 'benchmarks.bags', 'simulate': 'benchmarks.simulate', 'memory': 'benchmarks.memory',
         'startup': 'benchmarks.startup', 'study': 'benchmarks.study',
         'venue': 'benchmarks.venues'}
ALL = 'all'
_CHECKOUT = Path(__file__).parents[1]
_CHAINS = 1000
_BUDGET_S, _MINUTES = 0.3, 10.0
_EFFORTS = {'memory': 'minutes', 'promises': 'chains'}      # these pages have other options than --budget
_RANGES = {'budget': (_BUDGET_S, 1e-6, 1e6), 'minutes': (_MINUTES, 0.05, 1e4), 'chains': (_CHAINS, 1, 1e9)}
_END = '<!-- end -->'


def main(argv: list[str]) -> int:
    """Measure one page or all; return the exit code."""
    options = command_line.parser('cost', 'Measure a page in one run: a table, CSV, and a picture as PNG and SVG.',
                                  'cost accuracy --output docs/cost')
    options.add_argument('page', choices=(*PAGES, ALL), help="limits: each stage compared with the machine's limit; "
                                                             'accuracy: error against time, for table and march '
                                                             'and other solvers; '
                         'promises: errors relative to promises on random chains; '
                         'contact: the first contact compared with sampling at fixed steps, and growth with benches; '
                         'effects: what each effect adds to a tick; tick: where the time of one tick goes; '
                         'first: time of the first tick of a track; '
                         'scale: growth of each stage, and rates sustained over DDS; '
                         'bag: throughput and size of bags by compression; simulate: speed by the number of workers; '
                         'memory: memory of a recorder in a long run; startup: start-up time of every executable; '
                         'study: rows per second of studies; venue: design fit and contact in a town; all: '
                         'all pages one after another, but promises only with --chains')
    options.add_argument('--resume', action='store_true', help='with all: omit the pages that were already '
                         'measured today with this version')
    options.add_argument('--output', type=Path, metavar='FOLDER',
                         help='folder for the results (cost; for all: docs/cost of the checkout). An '
                         'existing page keeps its text; only its table is renewed')
    options.add_argument('--budget', type=float, metavar='S', help=f'seconds per timing ({_BUDGET_S:g}); not for '
                         'the pages memory and promises')
    options.add_argument('--minutes', type=float, metavar='MIN',
                         help=f'length of the run of the page memory ({_MINUTES:g})')
    options.add_argument('--chains', type=float, metavar='N',
                         help=f'number of chains for the page promises ({_CHAINS:g}; 20,000 take 10 minutes); after '
                         'Ctrl-C, the page shows the chains computed so far')
    return command_line.guarded('cost', partial(_run, options.parse_args(argv)))


def _run(arguments: Namespace) -> int:
    if arguments.page == ALL:
        return _all(arguments)
    if arguments.resume:
        raise InputError('--resume: it applies only to the page all; omit it')
    _page(arguments.page, arguments, arguments.output or Path('cost'))
    return command_line.OK


def _all(arguments: Namespace) -> int:
    """Measure every page in its own process; report failed pages and continue with the others."""
    pages = _CHECKOUT / 'docs' / 'cost'
    folder = arguments.output or (pages if pages.is_dir() else Path('cost'))
    failed = list[str]()
    names = [name for name in PAGES if name != 'promises' or arguments.chains is not None]      # it measures no times
    if arguments.resume:
        names = [name for name in names if not _is_new(folder / f'{name}.md')]
    for n, name in enumerate(names, 1):
        print(f'cost: page {n} of {len(names)}: {name}', file=sys.stderr)
        option = _EFFORTS.get(name, 'budget')
        effort = getattr(arguments, option)
        options = ['--output', folder, *([] if effort is None else [f'--{option}', effort])]
        measured = [sys.executable, '-m', 'benchmarks', name, *map(str, options)]
        if subprocess.run(measured, check=False).returncode:
            print(f'cost: page {name} failed, see above', file=sys.stderr)
            failed.append(name)
    if failed:
        raise DragonError(f'{len(failed)} of {len(names)} pages failed: {", ".join(failed)}')
    return command_line.OK


def _is_new(page: Path) -> bool:
    """Return whether a page was measured today on this machine with this version."""
    return page.is_file() and circumstances() in page.read_text(encoding='utf-8')


def _page(name: str, arguments: Namespace, folder: Path) -> None:
    """Measure one page, write it, and print its table and the paths of the written files."""
    effort = _effort(name, arguments)
    try:
        page = import_module(PAGES[name])
    except ImportError as error:
        raise MissingError(f'{error.name}: it is not installed; the cost pages need it: pip install {error.name}'
                           ) from None
    rows = page.measure(effort)
    try:
        paths = write(name, rows, folder)
    except OSError as error:
        raise MissingError(f'--output {folder}: it cannot be written: {error.strerror}') from None
    print(page.table(rows))
    print('\n' + '\n'.join(map(str, paths)))


def _effort(name: str, arguments: Namespace) -> float:
    """Return the effort for a page: seconds per timing or run, or a number of chains."""
    option = _EFFORTS.get(name, 'budget')
    command_line.check_taken(f'page {name}', {f'--{each}': getattr(arguments, each) is not None
                                              for each in ('budget', *_EFFORTS.values())}, {f'--{option}'})
    given, (usual, low, high) = getattr(arguments, option), _RANGES[option]
    value = number(f'--{option}', usual if given is None else given, low=low, high=high)
    return 60 * value if option == 'minutes' else value


def write(name: str, rows: Any, folder: Path) -> list[Path]:
    """Write a page, its CSV and its pictures into a folder; return their paths. An existing page's text is kept."""
    page, text, data = import_module(PAGES[name]), folder / f'{name}.md', folder / f'{name}.csv'
    folder.mkdir(parents=True, exist_ok=True)
    if not (text.is_file() and _mark(name) in text.read_text(encoding='utf-8')):
        text.write_text(f'{_mark(name)}\n{_END}\n', encoding='utf-8')
    renew(text, name, page.table(rows))
    data.write_text(page.csv_text(rows), encoding='utf-8')
    return [text, data, *figures.save(page.picture(rows), folder / name)]


def _mark(name: str) -> str:
    return f'<!-- cost {name} -->'


def renew(path: Path, page: str, text: str) -> None:
    """Put ``text`` between the marks <!-- cost PAGE --> and <!-- end --> of a file."""
    try:
        old = path.read_text(encoding='utf-8')
        head, rest = old.split(_mark(page), 1)
        tail = rest.split(_END, 1)[1]
        path.write_text(f'{head}{_mark(page)}\n{text}\n{_END}{tail}', encoding='utf-8')
    except (OSError, ValueError, IndexError):
        raise MissingError(f'{path}: it cannot be renewed; add the marks {_mark(page)} and {_END}') from None
