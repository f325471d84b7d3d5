"""``cost``: where the pages of ``docs/cost`` are made."""
from functools import partial

from dragon_ros.cli import command_line
from dragon_ros.core.errors import InputError

PAGES = ('limits', 'accuracy', 'promises', 'contact', 'effects', 'tick', 'first', 'scale', 'bag', 'memory', 'startup',
         'study', 'all')


def main(argv: list[str]) -> int:
    """Say where a page is made; return the exit code."""
    options = command_line.parser('cost', 'Measure a page of docs/cost; that takes a checkout: ./dragon cost PAGE.',
                                  'cost accuracy')
    options.add_argument('page', choices=PAGES, metavar='PAGE', help=', '.join(PAGES))
    return command_line.guarded('cost', partial(_refuse, options.parse_args(argv).page))


def _refuse(page: str) -> int:
    raise InputError(f'PAGE {page}: is made from a checkout: ./dragon cost {page}')
