"""Read untrusted workbooks as rows of cells, within budgets (``core.limits``); no content is executed.

Only the parts with cells are unpacked, into a plain archive for the reader. The reader is python-calamine if it is
installed, and otherwise openpyxl, which takes about six times as long. No other part of a workbook is opened.
"""
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, cast
from xml.etree import ElementTree

from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.limits import (
    BOOK_BYTES,
    BOOK_CELLS,
    BOOK_COLUMNS,
    BOOK_PARTS,
    BOOK_ROWS,
    BOOK_SHEETS,
    BOOK_UNPACKED_BYTES,
)

Cell = float | str | None
_OLD = b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1'                # start of .xls files and of workbooks with a password
_ENCRYPTED = 'EncryptedPackage'.encode('utf-16-le')
_SHEET = re.compile(r'xl/worksheets/[^/]*\.xml')
_NEEDED = re.compile(r'\[content_types\]\.xml|_rels/\.rels|xl/workbook\.xml|xl/_rels/workbook\.xml\.rels|'
                     r'xl/sharedstrings\.xml|xl/styles\.xml|xl/worksheets/[^/]*\.xml', re.IGNORECASE)
_ROW = re.compile(rb'<(?:[\w.-]+:)?row(?![\w.-])')
_CELL = re.compile(rb'<(?:[\w.-]+:)?c(?![\w.-])')
_PLACE = re.compile(rb'(?<=[\s"\'])r\s*=\s*["\']([A-Za-z]*)(\d+)["\']')
_LINE = re.compile(rb"\s[^>]*?\br\s*=\s*[\"'](\d{1,9})[\"']")
# Columns from AAA on, numbers with more digits, and positions in another notation.
_FAR = rb'\sr="(?:[A-Za-z]{3}|[A-Za-z]{0,2}\d{%d})|\sr=\'|\sr\s+=|\sr=\s'
# Positions that follow no space, and rows and cells with a prefix.
_UNUSUAL = b'"r', b"'r", b'\tr', b'\nr', b'\rr', b':row', b':c'
_TWO_LETTERS = 26 * 27                                   # number of columns up to ZZ
_MERGED = re.compile(rb'<(?:[\w.-]+:)?mergeCell\s[^>]*ref\s*=\s*["\']([A-Z]+)(\d+):([A-Z]+)(\d+)["\']')
_FORMULA = re.compile(rb'<(?:[\w.-]+:)?c(\s[^>]*)?>\s*<(?:[\w.-]+:)?f[\s>/]')
_UNVALUED = re.compile(rb'<(?:[\w.-]+:)?c((?:\s[^>]*)?)>\s*<(?:[\w.-]+:)?f(?:\s[^>]*)?(?:/>|>[^<]*</(?:[\w.-]+:)?f>)\s*'
                       rb'(?:</(?:[\w.-]+:)?c>|<(?:[\w.-]+:)?v(?:\s[^>]*)?(?:/>|>\s*</))')
_SIZES = 64 * 1024


class WorkbookSheet(NamedTuple):
    """A sheet: its name, its rows of cells, and merged ranges as (first row, first column, last row, last column).

    Rows and columns count from 0.
    """

    name: str
    rows: list[list[Cell]]
    merged: tuple[tuple[int, int, int, int], ...]


def read_book(path: Path) -> list[WorkbookSheet]:
    """Return the sheets of an XLSX workbook. Raises InputError if the workbook is invalid or too large."""
    data = _bytes_of(path)
    try:
        parts = _parts(path, data)
        merged = {name: _checked(path, name, part) for name, part in parts.items() if _SHEET.fullmatch(name)}
        if not merged:
            raise InputError(f'{path}: it contains no sheets; save it again as an Excel workbook (.xlsx)')
        if len(merged) > BOOK_SHEETS:
            raise InputError(f'{path}: it has {len(merged)} sheets; the limit is {BOOK_SHEETS}')
        files = _files_of_sheets(parts)
        return [WorkbookSheet(name, rows, merged.get(files.get(name, ''), ()))
                for name, rows in _read(path, _plain(parts))]
    except InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, struct.error, EOFError, LookupError, NotImplementedError, OSError,
            OverflowError, RuntimeError, ValueError, ElementTree.ParseError) as error:
        if isinstance(error, RuntimeError) and 'password' in str(error):
            raise InputError(f'{path}: it is protected by a password; save it without a password') from None
        raise InputError(f'{path}: it is damaged or truncated ({_said(error)}); save it again as .xlsx') from None


def _bytes_of(path: Path) -> bytes:
    """Return a file's bytes. Raises MissingError, and InputError if the file is obviously not XLSX."""
    try:
        with path.open('rb') as file:
            data = file.read(BOOK_BYTES + 1)
    except OSError as error:
        raise MissingError(f'{path}: cannot be read: {error.strerror}') from None
    except ValueError as error:
        raise MissingError(f'a file cannot be read: {error}') from None
    if len(data) > BOOK_BYTES:
        raise InputError(f'{path}: it has more than {BOOK_BYTES} bytes, the limit for a workbook; keep only the '
                         'result sheets')
    if data.startswith(_OLD):
        raise InputError(f'{path}: it is protected by a password; save it without a password' if _ENCRYPTED in data else
                         f'{path}: it is a workbook of Excel 97 (.xls); save it as .xlsx')
    if not data.startswith(b'PK'):
        what = 'is empty' if not data else 'is not an XLSX workbook'
        raise InputError(f'{path}: {what}; save it as an Excel workbook (.xlsx)')
    return data


def _parts(path: Path, data: bytes) -> dict[str, bytes]:
    """Return the required parts of the archive, unpacked within the budget. Raises InputError or zipfile's errors."""
    with zipfile.ZipFile(BytesIO(data)) as book:
        entries = book.infolist()
        if len(entries) > BOOK_PARTS:
            raise InputError(f'{path}: it contains {len(entries)} files; the limit for a workbook is {BOOK_PARTS}')
        names = [entry.filename for entry in entries]
        lower = [name.lower() for name in names]
        if any('vbaproject' in name or 'macrosheets' in name for name in lower):
            raise InputError(f'{path}: it contains macros; save it as .xlsx without macros')
        if any(name.startswith('xl/externallinks/') for name in lower):
            raise InputError(f'{path}: it contains links to other workbooks; replace them with values and '
                             'save it again')
        if any(name.endswith('.bin') and name.startswith('xl/work') for name in lower):
            raise InputError(f'{path}: it is a binary workbook (.xlsb); save it as .xlsx')
        needed = [entry for entry in entries if _NEEDED.fullmatch(entry.filename)]
        if len({entry.filename.lower() for entry in needed}) < len(needed):
            raise InputError(f'{path}: it contains a part twice; save it again as .xlsx')
        if any(entry.flag_bits & 1 for entry in needed):
            raise InputError(f'{path}: it is protected by a password; save it without a password')
        return dict(_unpacked(path, book, needed))


def _unpacked(path: Path, book: zipfile.ZipFile, needed: list[zipfile.ZipInfo]) -> Iterator[tuple[str, bytes]]:
    """Yield parts with their bytes, within a budget that does not rely on the sizes stated in the archive."""
    room = BOOK_UNPACKED_BYTES
    for entry in needed:
        pieces = []
        with book.open(entry) as file:
            while room >= 0 and (piece := file.read(min(_SIZES * 16, room + 1))):
                room -= len(piece)
                pieces.append(piece)
        if room < 0:
            raise InputError(f'{path}: unpacks to more than {BOOK_UNPACKED_BYTES} bytes, the limit for a workbook')
        part = b''.join(pieces)
        if b'<!DOCTYPE' in part or b'<!ENTITY' in part or b'\0' in part:
            raise InputError(f'{path}: {entry.filename} is not plain XML in UTF-8; save it again as .xlsx')
        yield entry.filename, part


def _checked(path: Path, name: str, part: bytes) -> tuple[tuple[int, int, int, int], ...]:
    """Return the merged ranges of a sheet. Raises InputError if a sheet is too large or a formula has no value.

    A reader allocates a full rectangle of rows and columns, so a budget limits their product.
    """
    rows, columns = _extent(part)
    for what, size, most in (('rows', rows, BOOK_ROWS), ('columns', columns, BOOK_COLUMNS),
                             ('cells', rows * columns, BOOK_CELLS)):
        if size > most:
            raise InputError(f'{path}: {name} has {size} {what}; the limit for a sheet is {most}; delete everything '
                             'that is not part of the result')
    if b'f>' in part and _FORMULA.search(part) and (empty := _UNVALUED.search(part)):
        place = re.search(rb'r\s*=\s*["\'](\w+)["\']', empty[1])
        raise InputError(f'{path}: {name} has a formula without a value{f" in {place[1].decode()}" if place else ""}; '
                         'open the workbook in a spreadsheet program, recalculate it, and save it')
    return tuple((int(top) - 1, _column(left) - 1, int(bottom) - 1, _column(right) - 1)
                 for left, top, right, bottom in _MERGED.findall(part, max(part.rfind(b'</sheetData'), 0)))


def _extent(part: bytes) -> tuple[int, int]:
    """Return a bound on a sheet's rows and columns; a rough bound is enough if it is within the budgets."""
    part = part[max(part.find(b'sheetData'), 0):]
    lines = part.split(b'<row')
    counts = [line.count(b'<c') for line in lines]      # cells and other elements with the same initial letter
    numbers = [int(found[1]) for line in lines if (found := _LINE.match(line))]
    rows = max(numbers, default=0) + len(lines) - len(numbers)
    named, digits = part.count(b' r="') - len(numbers), len(str(rows))     # ``named`` cells state their positions
    if not any(one in part for one in _UNUSUAL) and not re.search(_FAR % (digits + 1), part) and (
            named <= 0 or named >= sum(counts)):
        columns = max(counts) if named <= 0 else max(_TWO_LETTERS, *counts)
        rows = rows if named <= 0 else 10**digits - 1       # a cell may state another row than its own
        if rows * columns <= BOOK_CELLS:
            return rows, columns
    lines = _ROW.split(part)
    counts = [len(_CELL.findall(line)) for line in lines]
    places = set(_PLACE.findall(part))
    rows = max((int(row) for _, row in places), default=0)
    columns = max(map(_column, {letters for letters, _ in places if letters}), default=0)
    if sum(1 for letters, _ in places if letters) < sum(counts):    # some positions follow only from the cells' order
        rows, columns = rows + len(lines) - 1, columns + max(counts)
    return rows, columns


def _column(letters: bytes) -> int:
    """Return the number of a column, counted from 1, from its letters."""
    number = 0
    for letter in letters.upper():
        number = 26 * number + letter - 64
    return number


def _plain(parts: dict[str, bytes]) -> BytesIO:
    """Return an uncompressed archive of these parts."""
    out = BytesIO()
    with zipfile.ZipFile(out, 'w') as plain:
        for name, part in parts.items():
            plain.writestr(zipfile.ZipInfo(name), part)
    out.seek(0)
    return out


def _files_of_sheets(parts: dict[str, bytes]) -> dict[str, str]:
    """Return a dict from sheet names to the paths of the sheets' parts in the file. Raises ParseError."""
    targets = {one.get('Id'): one.get('Target', '').removeprefix('/').removeprefix('xl/')
               for one in ElementTree.fromstring(parts.get('xl/_rels/workbook.xml.rels', b'<none/>'))}
    found = {}
    for one in ElementTree.fromstring(parts.get('xl/workbook.xml', b'<none/>')).iter():
        if one.tag.rpartition('}')[2] == 'sheet':
            target = next((value for key, value in one.attrib.items() if key.endswith('}id')), None)
            found[one.get('name', '')] = f'xl/{targets.get(target, "")}'
    return found


def _read(path: Path, plain: BytesIO) -> list[tuple[str, list[list[Cell]]]]:
    """Return the names and rows of the sheets, as read by the fastest reader. Raises InputError if the reader fails."""
    try:
        return _by_calamine(plain) if find_spec('python_calamine') else _by_openpyxl(path, plain)
    except (InputError, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # noqa: BLE001 - a reader raises whatever its XML library does; Rust panics, too
        raise InputError(f'{path}: cannot be read as a workbook ({_said(error)}); save it again as .xlsx') from None


def _by_calamine(plain: BytesIO) -> list[tuple[str, list[list[Cell]]]]:
    from python_calamine import CalamineWorkbook
    book = CalamineWorkbook.from_filelike(plain)
    return [(name, cast('list[list[Cell]]', book.get_sheet_by_name(name).to_python(skip_empty_area=False)))
            for name in book.sheet_names]


def _by_openpyxl(path: Path, plain: BytesIO) -> list[tuple[str, list[list[Cell]]]]:
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise InputError("xlsx: no reader is installed: pip install 'dragon_ros[xlsx]'") from None
    book = load_workbook(plain, read_only=True, data_only=True, keep_links=False)
    try:
        out = []
        for sheet in book.worksheets:
            sheet.reset_dimensions()
            rows: list[list[Cell]] = []
            for row in sheet.iter_rows(values_only=True):
                rows.append(list(row))
                if len(rows) > BOOK_ROWS or len(row) > BOOK_COLUMNS:
                    raise InputError(f'{path}: {sheet.title} exceeds the limits for a sheet')
            out.append((sheet.title, rows))
        return out
    finally:
        book.close()


def _said(error: BaseException) -> str:
    """Return an error's message as one short line."""
    text = ' '.join(str(error).split())
    return text[:100] or type(error).__name__
