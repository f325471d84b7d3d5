"""Find the meaning of a workbook's cells: the handle, the quantity and the time of each cell, from its labels.

A label may be in a row, in a column, in a heading over several columns, or in the name of a sheet, in Chinese or
English. Besides the contest's layout, transposed tables, long tables, tables without labels, and positions and speeds
side by side are supported. A sheet whose layout is not understood is not used; a note says what was seen.
"""
import re
import unicodedata
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dragon_contest.grade.reading import Cell, WorkbookSheet, number_of
from dragon_contest.limits import BOOK_TIMES
from dragon_ros.cli.inputs import Floats, Ints

HANDLES = 224
QUANTITIES = ('x', 'y', 'v')
_NONE = -9999
_TIME = re.compile(r't\s*=\s*(-?\d+(?:\.\d+)?)|(?:^|[^\d.\-])(-?\d+(?:\.\d+)?)\s*(?:s|秒|sec|seconds?)(?![a-z])|'
                   r'^(-?\d+(?:\.\d+)?)\s*(?:s|秒|sec|seconds?)$|^(?:t|time|时间|时刻)[\s_:]*(-?\d+(?:\.\d+)?)$')
_CLOCK = re.compile(r'(?:^|\s|t)(\d{1,3}):(\d\d):(\d\d(?:\.\d+)?)$')
_SECTION = re.compile(r'第\s*(\d+)\s*[节個个条]|(?:section|body|bench|handle|node|joint|point|把手|节点|板凳|龙身|节|p)'
                      r'[\s_#:]*(\d+)|^(\d+)\s*[节号]')
_INDEXED = re.compile(r'^([vxy])[\s_]*\(?(-?\d+(?:\.\d+)?)\)?$|^(-?\d+(?:\.\d+)?)[\s_]*\(?([vxy])\)?$')
_SPEED = re.compile(r'速|speed|velocity|vel\b|m/s|(?<![a-z])v(?![a-z])')
_X = re.compile(r'横坐标|横坐標|(?<![a-z])x(?![a-z])')
_Y = re.compile(r'纵坐标|縱坐標|(?<![a-z])y(?![a-z])')
_PLACE = re.compile(r'位置|坐标|position|coordinate|xy')
_TIME_NAME = re.compile(r'时间|时刻|^time|^t$|^t\s*[\(/]|^t_s$')
_HANDLE_NAME = re.compile(r'把手|编号|序号|节点|板凳|^handle|^index|^section|^bench|^node|^i$|^no\.?$')
_HUGE = 1e100           # larger numbers are read as this, so that sums of squares stay finite
_FEW = 4                # smallest number of values in a progression
_MOST_LABELS = 8        # largest number of rows or columns before the values
_DAY_S = 86400.0
_SHORT_STEP = 1e-3      # smaller steps of unlabelled times are days, as in a spreadsheet's times of day
_CONTEST_TIMES = {301: 0.0, 201: -100.0}        # number of times in a result: the first time (s)
_MOST_SPEED = 5.0       # a table of larger numbers without names contains no speeds (m/s)
_FIRST_DATE = 10_000.0  # larger numbers are dates
_HUGE_SECTION = 1e6
_MOST_SHOWN = 20        # maximum length of a label in an error


class Label(NamedTuple):
    """The meaning of a label; fields that the label does not specify are None."""

    handle: int | None = None
    quantity: str | None = None
    t_s: float | None = None
    number: float | None = None     # a bare number, which is a time or a handle, depending on the other labels
    section: int | None = None      # the number of a section or handle, which may be counted from 1

    def over(self, other: 'Label') -> 'Label':
        """Return this label, with missing fields filled in from another label."""
        return Label(other.handle if self.handle is None else self.handle, self.quantity or other.quantity,
                     other.t_s if self.t_s is None else self.t_s, other.number if self.number is None else self.number,
                     other.section if self.section is None else self.section)


Note = tuple[str, dict[str, object]]


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
    notes: list[Note] = []
    for sheet in sheets:
        block = _block_of(sheet, refuse)
        if block is None:
            labelled = sum(isinstance(_plain(cell), str) for row in sheet.rows for cell in row)
            notes.append(('template' if labelled > _FEW else 'sheet_empty', {'sheet': sheet.name}))
            continue
        part, said = _understood(sheet, block, parts)
        notes += said
        if part is not None:
            parts.append(part)
    return joined(parts, notes)


def joined(parts: list[tuple[Floats, Floats]], notes: list[Note]) -> GivenResult:
    """Return the cells of several tables, merged by time; cells that later tables repeat are ignored."""
    times = np.unique(np.concatenate([times for times, _ in parts])) if parts else np.empty(0)
    if times.size > BOOK_TIMES:
        kept = _thinned(times)
        notes = [*notes, ('times_ignored', {'count': kept.size, 'whole': times.size})]
        parts = [(own[there], values[there]) for own, values in parts for there in [np.isin(own, kept)]]
        times = kept
    cells = np.full((times.size, HANDLES, 3), np.nan)
    for own, values in parts:
        at = np.searchsorted(times, own) if not np.isnan(own).all() else np.full(own.size, times.size - 1)
        room = cells[at]
        cells[at] = np.where(np.isnan(room), values, room)
    return GivenResult(times, cells, notes)


def _thinned(times_s: Floats) -> Floats:
    """Return at most ``BOOK_TIMES`` times: those of the contest if there are any, or evenly chosen ones."""
    whole = times_s[times_s == np.round(times_s)]
    some = whole if whole.size > _FEW else times_s
    kept: Floats = some[np.unique(np.linspace(0, some.size - 1, min(some.size, BOOK_TIMES)).astype(int))]
    return kept


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


def _numbers(rows: list[list[Cell]]) -> tuple[Floats, bool]:
    """Return cells as numbers (nan for other cells), and whether numbers are stored as text."""
    as_text = any(isinstance(cell, str) and np.isfinite(number_of(cell)) for row in rows[:20] for cell in row[:20])
    try:
        values = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array([[number_of(cell) for cell in row] for row in rows], dtype=np.float64)
    values[~np.isfinite(values)] = np.nan
    return np.clip(values, -_HUGE, _HUGE), as_text and bool(np.isfinite(values[:20, :20]).mean() > 0.5)


def _label_rows(rows: list[list[Cell]]) -> int:
    """Return the number of label rows at the top."""
    for n, row in enumerate(rows[:_MOST_LABELS]):
        behind = [cell for cell in row[1:] if cell is not None]
        numbers = [value for cell in behind if (value := number_of(cell)) == value]
        if behind and len(numbers) > 0.5 * len(behind) and not _is_progression(numbers):
            return n
    return min(len(rows), _MOST_LABELS)


def _label_columns(rows: list[list[Cell]], top: int) -> int:
    """Return the number of label columns on the left."""
    width = len(rows[0])
    for n in range(min(width, _MOST_LABELS)):
        cells = [row[n] for row in rows[top:] if row[n] is not None]
        numbers = [value for cell in cells if (value := number_of(cell)) == value]
        name = _normal(*(rows[k][n] for k in range(top)))
        keyed = bool(_TIME_NAME.search(name) or _HANDLE_NAME.search(name)) and not _X.search(name)
        if len(numbers) > 0.5 * len(cells) and not (_is_progression(numbers) or keyed):
            return n
    return min(width, _MOST_LABELS)


def _is_progression(numbers: list[float]) -> bool:
    """Return whether numbers are like times and handles (perhaps in pairs): evenly spaced, or increasing integers.

    The integers may also be the seconds of a spreadsheet's times of day.
    """
    values = np.array(numbers)
    steps = np.diff(values[::2] if values.size > _FEW and values[0] == values[1] else values)
    if values.size < _FEW or np.any(steps <= 0):
        return False
    seconds = values * _DAY_S
    return bool(np.all(np.abs(steps - steps[0]) < 1e-6 * steps[0]) or np.all(values == np.round(values))
                or np.all(np.abs(seconds - np.round(seconds)) < _SHORT_STEP))


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
        value = number_of(cell)
        label = label.over(Label(number=value) if value == value else _parsed(_normal(cell)))
    return label


def _parsed(text: str) -> Label:
    """Return the meaning of a label's text."""
    if found := _INDEXED.match(text):       # the number is a handle or a time
        return Label(quantity=found[1] or found[4], number=float(found[2] or found[3]))
    quantity = ('v' if _SPEED.search(text) else 'x' if _X.search(text) else 'y' if _Y.search(text) else None)
    if clock := _CLOCK.search(text):
        return Label(quantity=quantity, t_s=3600 * float(clock[1]) + 60 * float(clock[2]) + float(clock[3]))
    time = _TIME.search(text)
    t_s = next((float(one) for one in time.groups() if one is not None), None) if time else None
    section = _SECTION.search(text)
    handle = _handle_of(text)
    number = int(next(one for one in section.groups() if one is not None)[:9]) if section and handle is None else None
    return Label(handle, quantity, None if section and 't' not in text else t_s, section=number)


def _handle_of(text: str) -> int | None:
    """Return the handle that a label names without a number."""
    rear = '后' in text or 'rear' in text or 'back' in text or 'end' in text
    if '龙尾' in text or 'tail' in text:
        return HANDLES - 1 if rear else HANDLES - 2
    if '龙头' in text or 'head' in text:
        return 1 if rear else 0
    return None


class _AxisLabels(NamedTuple):
    """Codes of the labels of rows or columns: handles and quantities (``_NONE`` if unknown), and times."""

    handle: Ints
    quantity: Ints
    t_s: Floats


def _understood(sheet: WorkbookSheet, block: _SheetBlock, before: list[tuple[Floats, Floats]],
                ) -> tuple[tuple[Floats, Floats] | None, list[Note]]:
    """Return the times and cells of a block, and notes about the block."""
    notes: list[Note] = []
    if block.as_text:
        notes.append(('numbers_as_text', {'sheet': sheet.name}))
    keys = [_normal(*cells) for cells in block.corner]
    rows = [_row_label(cells, keys) for cells in block.rows]
    columns = [label_of(cells) for cells in block.columns]
    if _handles_on(columns) > _handles_on(rows):
        notes.append(('transposed', {'sheet': sheet.name}))
    rows, columns = _numbers_told(rows, columns, keys)
    rows, columns, said = _sections_told(sheet.name, block, rows, columns)
    notes += said
    rows, columns, said = _by_shape(sheet.name, block, rows, columns)
    notes += said
    context = _context(sheet, block, before, rows, columns)
    one, other = _axis(rows), _axis(columns)
    handle = _both(one.handle, other.handle, _NONE)
    quantity = _both(one.quantity, other.quantity, context)
    t_s = np.where(np.isnan(one.t_s)[:, None], other.t_s[None], one.t_s[:, None])
    known = (handle >= 0) & (handle < HANDLES) & (quantity != _NONE) & np.isfinite(block.values)
    if not known.any():
        return None, [*notes, ('not_understood', {
            'sheet': sheet.name, 'rows': block.values.shape[0], 'columns': block.values.shape[1],
            'label': _shown_label(block)})]
    times, at = np.unique(t_s[known], return_inverse=True)
    at, handles, quantities = at.ravel(), handle[known], quantity[known]
    place: Ints = (at * HANDLES + handles) * len(QUANTITIES) + quantities
    if again := _contradictions(place, block.values[known]):
        return None, [*notes, ('contradictory', {'sheet': sheet.name, 'count': again})]
    kept = np.isin(times, _thinned(times)) if times.size > BOOK_TIMES else np.ones(times.size, dtype=bool)
    cells = np.full((int(kept.sum()), HANDLES, 3), np.nan)
    there = kept[at]
    cells[(np.cumsum(kept) - 1)[at[there]], handles[there], quantities[there]] = block.values[known][there]
    if not kept.all():
        notes.append(('times_ignored', {'count': int(kept.sum()), 'whole': times.size}))
    return (times[kept], cells), notes


def _shown_label(block: _SheetBlock) -> str:
    """Return some label of a block for an error."""
    labels = [str(cell) for cells in (*block.rows[:3], *block.columns[:3]) for cell in cells if cell is not None]
    return ', '.join(label if len(label) <= _MOST_SHOWN else f'{label[:_MOST_SHOWN]}...' for label in labels[:3]) or '-'


def _contradictions(place: Ints, values: Floats) -> int:
    """Return how many values differ from the first value with the same handle, quantity and time."""
    _, first, of = np.unique(place, return_index=True, return_inverse=True)
    return int(np.sum(values != values[first][of.ravel()]))


def _handles_on(labels: list[Label]) -> int:
    return sum(label.handle is not None or label.section is not None for label in labels)


def _row_label(cells: list[Cell], keys: list[str]) -> Label:
    """Return the meaning of a row's label cells; the heading above a number shows whether it is a time or a handle."""
    label = Label()
    for cell, key in zip(cells, keys, strict=True):
        value = number_of(cell)
        if value == value and _TIME_NAME.search(key):
            label = label.over(Label(t_s=value))
        elif value == value and _HANDLE_NAME.search(key):
            label = label.over(Label(section=_whole(value)))
        else:
            label = label.over(label_of([cell]))
    return label


def _whole(value: float) -> int:
    return int(np.clip(value, -_HUGE_SECTION, _HUGE_SECTION))


def _context(sheet: WorkbookSheet, block: _SheetBlock, before: list[tuple[Floats, Floats]], rows: list[Label],
             columns: list[Label]) -> int:
    """Return the code of the quantity that a whole sheet contains.

    The quantity follows from the sheet's name or its titles. Otherwise, small values are speeds if the sheet comes
    after positions, or if it names each handle once.
    """
    text = f'{_normal(sheet.name)} {_normal(block.text)}'
    if _SPEED.search(text) and not _PLACE.search(text):
        return 2
    if any(label.quantity for label in (*rows, *columns)) or not np.isfinite(block.values).any():
        return _NONE
    handles = [label.handle for label in (*rows, *columns) if label.handle is not None]
    once = len(handles) == len(set(handles))
    return 2 if (before or once) and float(np.nanmax(np.abs(block.values))) < _MOST_SPEED else _NONE


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
        distinct = np.unique(numbers)
        times = bool(_TIME_NAME.search(key)) or (has_handles and not has_times) or (
            not has_times and (distinct.size not in (HANDLES - 1, HANDLES, HANDLES + 1)))
        first, factor = _clock(distinct) if times else (0.0, 1.0)
        out.append([_told(label, times, first, factor) for label in labels])
        has_times, has_handles = has_times or times, has_handles or not times
    return out[0], out[1]


def _clock(numbers: Floats) -> tuple[float, float]:
    """Return the number at 0 s and the seconds per unit of unlabelled times.

    A spreadsheet counts in days: times of day are small fractions, and dates are large numbers.
    """
    if numbers.size < 2 or not 0 < float(np.min(np.diff(numbers))) < _SHORT_STEP:
        dates = numbers.size > 1 and numbers[0] > _FIRST_DATE
        return (float(numbers[0]), 1.0) if dates else (0.0, 1.0)
    return float(np.floor(numbers[0])), _DAY_S


def _told(label: Label, is_time: bool, first: float, factor: float) -> Label:
    if label.number is None:
        return label
    if not is_time:
        return label.over(Label(section=_whole(label.number)))
    t_s = (label.number - first) * factor
    return label.over(Label(t_s=t_s if factor == 1.0 else round(t_s, 3)))


def _sections_told(sheet: str, block: _SheetBlock, rows: list[Label], columns: list[Label],
                   ) -> tuple[list[Label], list[Label], list[Note]]:
    """Return the labels with the handles of numbered sections, which may be counted from 1 and be one too many."""
    labels = rows if _handles_on(rows) >= _handles_on(columns) else columns
    numbers = {label.section for label in labels if label.handle is None and label.section is not None}
    named = {label.handle for label in labels if label.handle is not None}
    if not numbers:
        return rows, columns, []
    notes: list[Note] = []
    head, tail = 0 in named, bool(named & {HANDLES - 2, HANDLES - 1})
    from_one = not head and min(numbers) == 1 and (max(numbers) >= HANDLES or (tail and max(numbers) == HANDLES - 1))
    if from_one:
        notes.append(('from_one', {'sheet': sheet}))
    base = int(from_one)
    later = 0
    if head and {HANDLES - 2} <= numbers & named:       # 222 sections between the head and the tail
        later = int(not _repeats(block, labels, rows is labels))
        notes += [('row_too_many', {'sheet': sheet, 'count': HANDLES + 1})]
    elif max(numbers) - base == HANDLES:
        notes.append(('row_too_many', {'sheet': sheet, 'count': HANDLES + 1}))

    def told(label: Label) -> Label:
        if label.handle is not None:
            return label._replace(handle=label.handle + later) if label.handle >= HANDLES - 2 else label
        return label if label.section is None else label._replace(handle=label.section - base)
    return list(map(told, rows)), list(map(told, columns)), notes


def _repeats(block: _SheetBlock, labels: list[Label], on_rows: bool) -> bool:
    """Return whether the row of a section too many repeats the values of the tail."""
    values = block.values if on_rows else block.values.T
    section = [n for n, label in enumerate(labels) if label.handle is None and label.section == HANDLES - 2]
    tail = [n for n, label in enumerate(labels) if label.handle == HANDLES - 2]
    return len(section) == len(tail) and bool(np.array_equal(values[section], values[tail], equal_nan=True))


def _by_shape(sheet: str, block: _SheetBlock, rows: list[Label], columns: list[Label],
              ) -> tuple[list[Label], list[Label], list[Note]]:
    """Label unnamed rows or columns by position.

    224, 448 or 672 rows contain the speed, x and y, or all three of each handle, and 301 or 201 columns are the times
    of result 1 or 4. With 2 or 3 columns of 224 rows, the columns are x, y and speed.
    """
    notes: list[Note] = []
    if any(label.handle is not None for label in (*rows, *columns)):
        rows, columns = _twice(rows), _twice(columns)
    else:
        sizes = [len(rows), len(columns)]
        axis = next((n for n, size in enumerate(sizes) if size in (HANDLES, 2 * HANDLES, 3 * HANDLES)), None)
        if axis is None:
            return rows, columns, notes
        labels = [rows, columns]
        each = sizes[axis] // HANDLES
        quantities = '' if any(label.quantity for label in (*rows, *columns)) else ('', 'xy', 'xyv')[each - 1]
        labels[axis] = [Label(k // each, quantities[k % each] if quantities else None).over(label)
                        for k, label in enumerate(labels[axis])]
        if each == 1 and sizes[1 - axis] in (2, 3) and _unlabelled(labels[1 - axis]):
            labels[1 - axis] = [Label(quantity=name) for name in 'xyv'[:sizes[1 - axis]]]
        rows, columns = labels
        notes.append(('without_labels', {'sheet': sheet}))
    for axis, (ours, others) in enumerate(((rows, columns), (columns, rows))):
        if len(ours) in _CONTEST_TIMES and _unlabelled(ours) and not any(one.t_s is not None for one in others):
            first = _CONTEST_TIMES[len(ours)]
            told = [label._replace(t_s=first + n) for n, label in enumerate(ours)]
            rows, columns = (told, columns) if axis == 0 else (rows, told)
            notes.append(('without_times', {'sheet': sheet, 'count': len(ours), 'first': first,
                                            'last': first + len(ours) - 1}))
    return rows, columns, notes


def _unlabelled(labels: list[Label]) -> bool:
    """Return whether no label has a meaning."""
    return all(label == Label() for label in labels)


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
