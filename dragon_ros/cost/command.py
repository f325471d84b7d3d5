"""``cost``: measures the pages that show what accuracy and effects cost."""
from argparse import Namespace
from functools import partial
from importlib import import_module
from pathlib import Path

from dragon_ros.cli import command_line, figures
from dragon_ros.core.checks import number
from dragon_ros.core.errors import MissingError

PAGES = {'accuracy': 'dragon_ros.cost.workprec', 'promises': 'dragon_ros.cost.promises',
         'contact': 'dragon_ros.cost.contacts', 'tick': 'dragon_ros.cost.ticks', 'scale': 'dragon_ros.cost.scale',
         'bag': 'dragon_ros.cost.bags', 'effects': 'dragon_ros.cost.effects', 'memory': 'dragon_ros.cost.memory',
         'study': 'dragon_ros.cost.study'}


def main(argv: list[str]) -> int:
    """Measure one page; return the exit code."""
    options = command_line.parser('cost', 'Measure a page in one run: a table, CSV, and a picture as PNG and SVG.',
                                  'python -m dragon_ros cost accuracy --output docs/cost')
    options.add_argument('page', choices=PAGES, help='accuracy: error against time, for every tier and other solvers; '
                         'promises: error over promise on random chains (a part of the page accuracy too); '
                         'contact: the first contact against sampling at fixed steps, and growth with benches; '
                         'tick: where the time of one tick goes; scale: growth of each stage, and rates held over DDS; '
                         'bag: throughput and size of bags by compression; effects: what each effect adds to a tick; '
                         'memory: that of a recorder during a long run; study: rows a second of studies on Dask')
    options.add_argument('--output', type=Path, default=Path('cost'), metavar='FOLDER',
                         help='folder for the results (cost)')
    options.add_argument('--budget', type=float, default=0.3, metavar='S', help='seconds per timing (0.3)')
    options.add_argument('--minutes', type=float, default=10.0, metavar='MIN',
                         help='length of the run of the page memory (10)')
    options.add_argument('--chains', type=float, default=1000, metavar='N',
                         help='how many chains the page promises draws (1000); Ctrl-C ends it early with what is done')
    options.add_argument('--readme', type=Path, metavar='FILE', help='also renew the table between the marks in FILE')
    return command_line.guarded('cost', partial(_run, options.parse_args(argv)))


def _run(arguments: Namespace) -> int:
    try:
        page = import_module(PAGES[arguments.page])
    except ImportError as error:
        raise MissingError(f'{error.name}: is not installed; the cost pages compare with it: pip install {error.name}'
                           ) from None
    effort = {'memory': 60 * number('--minutes', arguments.minutes, low=0.05, high=1e4),
              'promises': number('--chains', arguments.chains, low=1, high=1e9)}
    rows = page.measure(effort.get(arguments.page, arguments.budget))
    try:
        paths = page.write(rows, arguments.output, figures.save)
    except OSError as error:
        raise MissingError(f'--output {arguments.output}: cannot be written: {error.strerror}') from None
    print(page.table(rows))
    if arguments.readme:
        renew(arguments.readme, arguments.page, page.summary(rows))
        paths.append(arguments.readme)
    print('\n' + '\n'.join(map(str, paths)))
    return command_line.OK


def renew(path: Path, page: str, text: str) -> None:
    """Put ``text`` between the marks <!-- cost PAGE --> and <!-- end --> of a file."""
    start, end = f'<!-- cost {page} -->', '<!-- end -->'
    try:
        old = path.read_text(encoding='utf-8')
        head, rest = old.split(start, 1)
        tail = rest.split(end, 1)[1]
        path.write_text(f'{head}{start}\n{text}\n{end}{tail}', encoding='utf-8')
    except (OSError, ValueError, IndexError):
        raise MissingError(f'--readme {path}: cannot be renewed; it needs the marks {start} and {end}') from None
