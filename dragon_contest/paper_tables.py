"""The paper's three tables: the printed values, the values from the paper's recipe, the true values, and the errors."""
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any
from unicodedata import east_asian_width

import dragon_ros as dr
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.language import Words, say
from dragon_ros.cli.workbook import xlsx_of

_LABEL, _KIND, _CELL = 20, 11, 12       # number of terminal columns per value
WORDS: Words = {
    'table1': ('Table 1. Positions (m)', '表 1  位置 (m)'),
    'table2': ('Table 2. Speeds (m/s)', '表 2  速度 (m/s)'),
    'table3': ('Table 3. Position (m) and speed (m/s) at the "moment of collision" (412.20 s, see the errata)',
               '表 3  “碰撞时刻”的位置 (m) 与速度 (m/s)（412.20 s，见勘误）'),
    'head': ('head', '龙头'), 'section': ('section {n}', '第{n}节龙身'), 'tail': ('tail', '龙尾（后）'),
    'quantity': ('{quantity} of {name}', '{name}{quantity}'),
    'printed': ('printed', '论文值'), 'reproduced': ('reproduced', '复现值'), 'true': ('true', '真值'),
    'error': ('error', '误差'),
    'no_xlsx': ('table: XLSX files are not written, because openpyxl is not installed: pip install openpyxl',
                'table：未写出 XLSX，因为没有安装 openpyxl；请运行 pip install openpyxl'),
}


@dataclass(frozen=True)
class PrintedNumber:
    """A number as printed, with the digits that the paper's recipe gives and the true value."""

    table: int
    handle: int
    quantity: str
    t_s: float
    printed: str
    reproduced: str
    true: float

    @property
    def error(self) -> float:
        """The printed value minus the true value."""
        return float(self.printed) - self.true


def cells() -> list[PrintedNumber]:
    """Return every printed number of the three tables."""
    printed = json.loads(Path(__file__).with_name('paper_tables.json').read_text(encoding='utf-8'))
    late = printed['table3_reconstructed_time_s']
    out = [_cell(1, handle, quantity, t_s, row[t_s][quantity])
           for handle, row in printed['table1'].items() for quantity in 'xy' for t_s in row]
    out += [_cell(2, handle, 'v', t_s, row[t_s]) for handle, row in printed['table2'].items() for t_s in row]
    return out + [_cell(3, handle, quantity, late, row[quantity])
                  for handle, row in printed['table3'].items() for quantity in 'xyv']


def text(rows: list[PrintedNumber], lang: str = 'en') -> str:
    """Return the tables in the paper's layout, with four lines per row: printed, reproduced, true and error."""
    out = []
    for table, group in groupby(rows, lambda cell: cell.table):
        columns = list(group)
        out += ['', say(WORDS, f'table{table}', lang)]
        key = (lambda cell: (cell.handle, cell.quantity)) if table < 3 else (lambda cell: (cell.handle, ''))
        for number, (name, cells_) in enumerate(groupby(columns, key)):
            row = list(cells_)
            if not number:
                heads = [f'{cell.t_s:g} s' if table < 3 else cell.quantity for cell in row]
                out.append(' ' * (_LABEL + _KIND) + ''.join(f'{head:>{_CELL}}' for head in heads))
            out += _lines(_label(*name, lang), row, lang)
    return '\n'.join(out[1:])


def csv_text(rows: list[PrintedNumber]) -> str:
    """Return one CSV line for each printed number."""
    return csv_of(_values(rows[0]), [_values(cell).values() for cell in rows]).rstrip('\n')


def json_text(rows: list[PrintedNumber]) -> str:
    """Return a JSON list with one object for each printed number."""
    return json.dumps([_values(cell) for cell in rows])


def xlsx_bytes(rows: list[PrintedNumber]) -> bytes:
    """Return a workbook with a row for each printed number."""
    return xlsx_of(_values(rows[0]), [tuple(_values(cell).values()) for cell in rows])


def _values(cell: PrintedNumber) -> dict[str, Any]:
    return {'table': cell.table, 'handle': cell.handle, 'quantity': cell.quantity, 't_s': cell.t_s,
            'printed': cell.printed, 'reproduced': cell.reproduced, 'true': cell.true, 'error': cell.error}


def _lines(label: str, row: list[PrintedNumber], lang: str) -> list[str]:
    kinds = {'printed': [cell.printed for cell in row], 'reproduced': [cell.reproduced for cell in row],
             'true': [f'{cell.true:.6f}' for cell in row], 'error': [f'{cell.error:.6f}' for cell in row]}
    return [_padded(label if kind == 'printed' else '', _LABEL) + _padded(say(WORDS, kind, lang), _KIND)
            + ''.join(f'{value:>{_CELL}}' for value in values) for kind, values in kinds.items()]


def _padded(text_: str, width: int) -> str:
    """Pad a string to a number of terminal columns; a Chinese character takes two columns."""
    wide = sum(east_asian_width(letter) in 'WF' for letter in text_)
    return text_ + ' ' * (width - len(text_) - wide)


def _label(handle: int, quantity: str, lang: str) -> str:
    name = say(WORDS, {0: 'head', 223: 'tail'}.get(handle, 'section'), lang, n=handle)
    return say(WORDS, 'quantity', lang, quantity=quantity, name=name) if quantity else name


def _cell(table: int, handle: str, quantity: str, t_s: str | float, printed: str) -> PrintedNumber:
    at = float(t_s)
    paper, exact = (_value(accuracy, at, int(handle), quantity) for accuracy in ('paper', 'exact'))
    return PrintedNumber(table, int(handle), quantity, at, printed, six_decimals(paper), exact)


def six_decimals(value: float) -> str:
    """Return a number as the paper prints it: six decimals without trailing zeros, and no minus sign on zero."""
    shown = f'{value:.6f}'.rstrip('0').rstrip('.')
    return '0' if shown == '-0' else shown


def _value(tier: str, t_s: float, handle: int, quantity: str) -> float:
    motion = _state(tier, t_s)
    return float(motion.speed_m_s[handle] if quantity == 'v' else motion.handles_m[handle, 'xy'.index(quantity)])


@lru_cache(maxsize=32)
def _state(tier: str, t_s: float) -> dr.Motion:
    return dr.compile(dr.scene('winding', accuracy=tier)).state(t_s)


FORMATS: dict[str, Callable[[list[PrintedNumber]], str | bytes]] = {
    'csv': csv_text, 'json': json_text, 'xlsx': xlsx_bytes}
