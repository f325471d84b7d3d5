"""Find the meaning of a workbook's cells: the handle, the quantity and the time of each cell, from its labels.

A label may be in a row, in a column, in a heading over several columns, or in the name of a sheet, in Chinese or
English. Besides the contest's layout, transposed tables, long tables, and positions and speeds side by side are
supported.
"""
import re
import unicodedata
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dragon_ros.commands.grade.reading import Cell, WorkbookSheet
from dragon_ros.core.numerics.types import Floats, Ints

HANDLES = 224
QUANTITIES = ('x', 'y', 'v')
_NONE = -9999
_TIME = re.compile(r't\s*=\s*(-?\d+(?:\.\d+)?)|(?:^|[^\d.\-])(-?\d+(?:\.\d+)?)\s*(?:s|秒|sec|seconds?)(?![a-z])|'
                   r'^(-?\d+(?:\.\d+)?)\s*(?:s|秒|sec|seconds?)$')
_SECTION = re.compile(r'第\s*(\d+)\s*[节個个条]|(?:section|body|bench|handle|node|joint|point|把手|节点|板凳|龙身|节|p)'
                      r'[\s_#:]*(\d+)|^(\d+)\s*[节号]')
_INDEXED = re.compile(r'^(?:v|x|y)[\s_]*\(?(\d+)\)?$')
_DECIMAL_COMMA = re.compile(r'[+-]?\d+,\d+')
_SPEED = re.compile(r'速|speed|velocity|vel\b|m/s|(?<![a-z])v(?![a-z])')
_X = re.compile(r'横坐标|横坐標|(?<![a-z])x(?![a-z])')
_Y = re.compile(r'纵坐标|縱坐標|(?<![a-z])y(?![a-z])')
_PLACE = re.compile(r'位置|坐标|position|coordinate|xy')
_TIME_NAME = re.compile(r'时间|时刻|^time|^t$|^t\s*[\(/]|^t_s$')
_HANDLE_NAME = re.compile(r'把手|编号|序号|节点|板凳|^handle|^index|^section|^bench|^node|^i$|^no\.?$')
_HUGE = 1e100           # larger numbers are read as this, so that sums of squares stay finite
_FEW = 4                # smallest number of values in a progression
_MOST_LABELS = 8        # largest number of rows or columns before the values


class Label(NamedTuple):
    """The meaning of a label; fields that the label does not specify are None."""

    handle: int | None = None
    quantity: str | None = None
    t_s: float | None = None
    number: float | None = None     # a bare number, which is a time or a handle, depending on the other labels

    def over(self, other: 'Label') -> 'Label':
        """Return this label, with missing fields filled in from another label."""
        return Label(other.handle if self.handle is None else self.handle, self.quantity or other.quantity,
                     other.t_s if self.t_s is None else self.t_s, other.number if self.number is None else self.number)


@dataclass
class GivenResult:
    """One result from workbooks: times (s, shape (T,)), nan if unlabelled, and cells (T, 224, 3) of x, y and speed.

    ``notes`` contains keys of ``words`` with the parameters of their sentences.
    """

    times_s: Floats
    cells: Floats
    notes: list[tuple[str, dict[str, object]]] = field(default_factory=list)

    def has(self, quantity: str) -> bool:
        """Return whether any cell of a quantity is given."""
        return bool(np.isfinite(self.cells[..., QUANTITIES.index(quantity)]).any())


def given_by(sheets: Iterable[WorkbookSheet], refuse: Callable[[str, dict[str, object]], Exception]) -> GivenResult:
    """Return the combined result of sheets. Raises the exception that ``refuse`` creates from a key of ``words``."""
    parts: list[tuple[Floats, Floats]] = []
    notes: list[tuple[str, dict[str, object]]] = []
    for sheet in sheets:
        block = _block_of(sheet, refuse)
        if block is None:
            notes.append(('sheet_empty', {'sheet': sheet.name}))
            continue
        part, said = _understood(sheet, block, parts)
        notes += said
        if part is not None:
            parts.append(part)
    return _joined(parts, notes)


def _joined(parts: list[tuple[Floats, Floats]], notes: list[tuple[str, dict[str, object]]]) -> GivenResult:
    """Return the cells of all sheets, merged by time; cells that later sheets repeat are ignored."""
    times = np.unique(np.concatenate([times for times, _ in parts])) if parts else np.empty(0)
    cells = np.full((times.size, HANDLES, 3), np.nan)
    for own, values in parts:
        at = np.searchsorted(times, own) if not np.isnan(own).all() else np.full(own.size, times.size - 1)
        room = cells[at]
        cells[at] = np.where(np.isnan(room), values, room)
    return GivenResult(times, cells, notes)


class _SheetBlock(NamedTuple):
    """The values of a sheet (rows, columns), the labels of its rows and columns, and its titles."""

    values: Floats
    rows: list[list[Cell]]          # the label cells of each row
    columns: list[list[Cell]]       # the label cells of each column, from the top
    corner: list[list[Cell]]        # the cells above each column of labels
    text: str                       # titles
    as_text: bool                   # whether numbers are stored as text


def _block_of(sheet: WorkbookSheet, refuse: Callable[[str, dict[str, object]], Exception]) -> _SheetBlock | None:
    """Return the values and the labels of a sheet, or None if the sheet has no values."""
    rows = _trimmed(sheet.rows)
    if not rows:
        return None
    width = max(map(len, rows))
    rows = [[*row, *[None] * (width - len(row))] for row in rows]
    top = _label_rows(rows)
    left = _label_columns(rows, top)
    if top >= len(rows) or left >= width:
        return None
    _check_merged(sheet, top, left, refuse)
    titles: list[list[Cell]] = []
    heads: list[list[Cell]] = []
    for row in rows[:top]:
        filled = [cell for cell in row if cell is not None]
        (titles if len(filled) <= 1 and width > 2 else heads).append(row)
    values, as_text = _numbers([row[left:] for row in rows[top:]])
    columns = [list(each) for each in zip(*_carried([row[left:] for row in heads]), strict=True)] or [
        [] for _ in range(width - left)]
    labels = _transposed(_carried(_transposed([row[:left] for row in rows[top:]])))
    return _SheetBlock(values, labels or [[] for _ in rows[top:]], columns,
                       [[row[n] for row in heads] for n in range(left)],
                       ' '.join(str(cell) for row in titles for cell in row if cell is not None), as_text)


def _transposed(rows: list[list[Cell]]) -> list[list[Cell]]:
    return [list(each) for each in zip(*rows, strict=True)]


def _carried(lines: list[list[Cell]]) -> list[list[Cell]]:
    """Copy each heading that spans several cells to all these cells; the last line has no such headings."""
    out = []
    for n, line in enumerate(lines):
        if n < len(lines) - 1:
            last, line = None, list(line)
            for place, cell in enumerate(line):
                last = line[place] = last if cell is None else cell
        out.append(line)
    return out


def _trimmed(rows: list[list[Cell]]) -> list[list[Cell]]:
    """Return rows of plain cells, without empty rows at the start and the end."""
    plain = [[cell if type(cell) is float else _plain(cell) for cell in row] for row in rows]
    full = [n for n, row in enumerate(plain) if any(cell is not None for cell in row)]
    if not full:
        return []
    plain = plain[full[0]:full[-1] + 1]
    first = min(next(n for n, cell in enumerate(row) if cell is not None) for row in plain
                if any(cell is not None for cell in row))
    last = max(max(n for n, cell in enumerate(row) if cell is not None) for row in plain
               if any(cell is not None for cell in row))
    return [row[first:last + 1] for row in plain]


def _plain(cell: object) -> Cell:
    """Return a cell as a number or a string, or None if the cell is empty."""
    if isinstance(cell, str):
        return cell if cell and not cell.isspace() else None
    if cell is None:
        return None
    return float(cell) if isinstance(cell, (int, float)) and not isinstance(cell, bool) else str(cell)


def _number(cell: Cell) -> float:
    """Return a cell's number, or nan for any other cell; text is a number, too, also with a decimal comma."""
    if isinstance(cell, float):
        return cell
    text = unicodedata.normalize('NFKC', cell or '').replace('\u2212', '-').strip()
    try:
        return float(text.replace(',', '.') if _DECIMAL_COMMA.fullmatch(text) else text)
    except ValueError:
        return np.nan


def _numbers(rows: list[list[Cell]]) -> tuple[Floats, bool]:
    """Return cells as numbers (nan for other cells), and whether numbers are stored as text."""
    as_text = any(isinstance(cell, str) and np.isfinite(_number(cell)) for row in rows[:20] for cell in row[:20])
    try:
        values = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array([[_number(cell) for cell in row] for row in rows], dtype=np.float64)
    values[~np.isfinite(values)] = np.nan
    return np.clip(values, -_HUGE, _HUGE), as_text and bool(np.isfinite(values[:20, :20]).mean() > 0.5)


def _label_rows(rows: list[list[Cell]]) -> int:
    """Return the number of label rows at the top."""
    for n, row in enumerate(rows[:_MOST_LABELS]):
        behind = [cell for cell in row[1:] if cell is not None]
        numbers = [value for cell in behind if (value := _number(cell)) == value]
        if behind and len(numbers) > 0.5 * len(behind) and not _is_progression(numbers):
            return n
    return min(len(rows), _MOST_LABELS)


def _label_columns(rows: list[list[Cell]], top: int) -> int:
    """Return the number of label columns on the left."""
    width = len(rows[0])
    for n in range(min(width, _MOST_LABELS)):
        cells = [row[n] for row in rows[top:] if row[n] is not None]
        numbers = [value for cell in cells if (value := _number(cell)) == value]
        name = _normal(*(rows[k][n] for k in range(top)))
        keyed = bool(_TIME_NAME.search(name) or _HANDLE_NAME.search(name)) and not _X.search(name)
        if len(numbers) > 0.5 * len(cells) and not (_is_progression(numbers) or keyed):
            return n
    return min(width, _MOST_LABELS)


def _is_progression(numbers: list[float]) -> bool:
    """Return whether numbers are evenly spaced or increasing integers, like times and handles (perhaps in pairs)."""
    values = np.array(numbers)
    steps = np.diff(values[::2] if values.size > _FEW and values[0] == values[1] else values)
    if values.size < _FEW or np.any(steps <= 0):
        return False
    return bool(np.all(np.abs(steps - steps[0]) < 1e-6 * steps[0]) or np.all(values == np.round(values)))


def _check_merged(sheet: WorkbookSheet, top: int, left: int,
                  refuse: Callable[[str, dict[str, object]], Exception]) -> None:
    """Reject merged cells among the values; headings may be merged."""
    if not sheet.merged:
        return
    first_row = next((n for n, row in enumerate(sheet.rows) if any(_plain(cell) is not None for cell in row)), 0)
    first_column = min((n for row in sheet.rows for n, cell in enumerate(row) if _plain(cell) is not None), default=0)
    for one in sheet.merged:
        if one[2] >= first_row + top and one[3] >= first_column + left:
            raise refuse('merged', {'sheet': sheet.name, 'place': f'{_letters(one[1])}{one[0] + 1}:'
                                    f'{_letters(one[3])}{one[2] + 1}'})


def _letters(column: int) -> str:
    """Return the letters that name a column; column numbers start at 0."""
    text, column = '', column + 1
    while column:
        column, rest = divmod(column - 1, 26)
        text = chr(65 + rest) + text
    return text


def _normal(*cells: Cell) -> str:
    """Join labels into one string, with full-width forms and capitals normalised."""
    return ' '.join(unicodedata.normalize('NFKC', str(cell)).strip().lower() for cell in cells if cell is not None)


def label_of(cells: Iterable[Cell]) -> Label:
    """Return the combined meaning of the label cells of a row or a column."""
    label = Label()
    for cell in cells:
        value = _number(cell)
        label = label.over(Label(number=value) if value == value else _parsed(_normal(cell)))
    return label


def _parsed(text: str) -> Label:
    """Return the meaning of a label's text."""
    quantity = ('v' if _SPEED.search(text) else 'x' if _X.search(text) else 'y' if _Y.search(text) else None)
    time = _TIME.search(text)
    t_s = next((float(one) for one in time.groups() if one is not None), None) if time else None
    return Label(_handle_of(text), quantity, None if _SECTION.search(text) and 't' not in text else t_s)


def _handle_of(text: str) -> int | None:
    """Return the handle that a label names."""
    if found := _INDEXED.match(text):
        return int(found[1])
    rear = '后' in text or 'rear' in text or 'back' in text or 'end' in text
    if '龙尾' in text or 'tail' in text:
        return HANDLES - 1 if rear else HANDLES - 2
    if '龙头' in text or 'head' in text:
        return 1 if rear else 0
    found = _SECTION.search(text)
    return int(next(one for one in found.groups() if one is not None)) if found else None


class _AxisLabels(NamedTuple):
    """Codes of the labels of rows or columns: handles and quantities (``_NONE`` if unknown), and times."""

    handle: Ints
    quantity: Ints
    t_s: Floats


def _understood(sheet: WorkbookSheet, block: _SheetBlock, before: list[tuple[Floats, Floats]],
                ) -> tuple[tuple[Floats, Floats] | None, list[tuple[str, dict[str, object]]]]:
    """Return the times and cells of a block, and notes about the block."""
    notes: list[tuple[str, dict[str, object]]] = []
    if block.as_text:
        notes.append(('numbers_as_text', {'sheet': sheet.name}))
    keys = [_normal(*cells) for cells in block.corner]
    rows = [_row_label(cells, keys) for cells in block.rows]
    columns = [label_of(cells) for cells in block.columns]
    if _handles_on(columns) > _handles_on(rows):
        notes.append(('transposed', {'sheet': sheet.name}))
    context = _context(sheet, block, before, rows, columns)
    rows, columns = _numbers_told(rows, columns, keys)
    rows, columns, guessed = _by_shape(block, rows, columns)
    if guessed:
        notes.append(('without_labels', {'sheet': sheet.name}))
    one, other = _axis(rows), _axis(columns)
    handle = _both(one.handle, other.handle, _NONE)
    quantity = _both(one.quantity, other.quantity, context)
    t_s = np.where(np.isnan(one.t_s)[:, None], other.t_s[None], one.t_s[:, None])
    known = (handle >= 0) & (handle < HANDLES) & (quantity != _NONE) & np.isfinite(block.values)
    if not known.any():
        return None, [*notes, ('not_understood', {'sheet': sheet.name})]
    times = np.unique(t_s[known])
    cells = np.full((times.size, HANDLES, 3), np.nan)
    at = np.searchsorted(times, t_s[known])
    cells[np.minimum(at, times.size - 1), handle[known], quantity[known]] = block.values[known]
    return (times, cells), notes


def _handles_on(labels: list[Label]) -> int:
    return sum(label.handle is not None for label in labels)


def _row_label(cells: list[Cell], keys: list[str]) -> Label:
    """Return the meaning of a row's label cells; the heading above a number shows whether it is a time or a handle."""
    label = Label()
    for cell, key in zip(cells, keys, strict=True):
        value = _number(cell)
        if value == value and _TIME_NAME.search(key):
            label = label.over(Label(t_s=value))
        elif value == value and _HANDLE_NAME.search(key):
            label = label.over(Label(handle=int(value)))
        else:
            label = label.over(label_of([cell]))
    return label


def _context(sheet: WorkbookSheet, block: _SheetBlock, before: list[tuple[Floats, Floats]], rows: list[Label],
             columns: list[Label]) -> int:
    """Return the code of the quantity that a whole sheet contains.

    The quantity follows from the sheet's name, its titles or, if the sheet comes after positions, its values.
    """
    text = f'{_normal(sheet.name)} {_normal(block.text)}'
    if _SPEED.search(text) and not _PLACE.search(text):
        return 2
    if any(label.quantity for label in (*rows, *columns)):
        return _NONE
    if before and np.isfinite(block.values).any() and float(np.nanmax(np.abs(block.values))) < 5:
        return 2
    return _NONE


def _numbers_told(rows: list[Label], columns: list[Label], keys: list[str]) -> tuple[list[Label], list[Label]]:
    """Interpret bare numbers as times or handles, based on a heading, the other labels, or their count."""
    has_handles = _handles_on(rows) + _handles_on(columns) > 0
    has_times = any(label.t_s is not None for label in (*rows, *columns))
    out = []
    for labels, key in ((rows, ' '.join(keys)), (columns, '')):
        numbers = [label.number for label in labels if label.number is not None]
        if not numbers:
            out.append(labels)
            continue
        distinct = sorted(set(numbers))
        times = bool(_TIME_NAME.search(key)) or (has_handles and not has_times) or (
            not has_times and (len(distinct) not in (HANDLES, HANDLES - 1)))
        base = 1.0 if not times and distinct[0] == 1 and distinct[-1] == HANDLES else 0.0
        out.append([_told(label, times, base) for label in labels])
        has_times, has_handles = has_times or times, has_handles or not times
    return out[0], out[1]


def _told(label: Label, is_time: bool, base: float) -> Label:
    if label.number is None:
        return label
    return label.over(Label(t_s=label.number) if is_time else Label(handle=int(label.number - base)))


def _by_shape(block: _SheetBlock, rows: list[Label], columns: list[Label]) -> tuple[list[Label], list[Label], bool]:
    """Label unnamed rows or columns by position: 448 contain x and y of each handle, and 672 also contain the speed."""
    if _handles_on(rows) + _handles_on(columns) == 0:
        for number, labels in enumerate((rows, columns)):
            each = {HANDLES: '', 2 * HANDLES: 'xy', 3 * HANDLES: 'xyv'}.get(len(labels))
            if each is None:
                continue
            size = max(1, len(each))
            named = [Label(k // size, each[k % size] if each else None).over(label) for k, label in enumerate(labels)]
            return (named, columns, True) if number == 0 else (rows, named, True)
    return _twice(rows), _twice(columns), False


def _twice(labels: list[Label]) -> list[Label]:
    """If every handle appears twice without a quantity, label the first occurrence as x and the second as y."""
    handles = [label.handle for label in labels if label.handle is not None]
    if any(label.quantity for label in labels) or len(handles) < 2 or len(handles) != 2 * len(set(handles)):
        return labels
    seen: set[int] = set()
    out = []
    for label in labels:
        if label.handle is not None:
            label = label.over(Label(quantity='y' if label.handle in seen else 'x'))
            seen.add(label.handle if label.handle is not None else _NONE)
        out.append(label)
    return out


def _axis(labels: list[Label]) -> _AxisLabels:
    return _AxisLabels(np.array([_NONE if one.handle is None else one.handle for one in labels], dtype=np.int64),
                       np.array([_NONE if one.quantity is None else QUANTITIES.index(one.quantity) for one in labels]),
                       np.array([np.nan if one.t_s is None else one.t_s for one in labels], dtype=np.float64))


def _both(rows: Ints, columns: Ints, otherwise: int) -> Ints:
    """Return the codes of cells (rows, columns), given the codes of their rows and columns."""
    code: Ints = np.where(rows[:, None] != _NONE, rows[:, None], columns[None])
    return np.where(code == _NONE, otherwise, code)
