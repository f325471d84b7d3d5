"""Read untrusted workbooks and CSV files as rows of cells, within budgets (``core.limits``); no content is executed.

Only the parts with cells are unpacked, into a plain archive for the reader. Before it starts, everything that it would
allocate is bounded. The reader is python-calamine if it is installed, and otherwise openpyxl, which takes about six
times as long. Formats are not read, so dates are numbers of days.
"""
import csv
import re
import struct
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from io import BytesIO
from itertools import islice, pairwise
from lzma import LZMAError
from pathlib import Path
from typing import NamedTuple, cast
from xml.etree import ElementTree

import dragon_ros as dr
from dragon_contest.grade.words import sentence
from dragon_contest.limits import (
    BOOK_BYTES,
    BOOK_CELLS,
    BOOK_COLUMNS,
    BOOK_INDEX_BYTES,
    BOOK_PARTS,
    BOOK_ROWS,
    BOOK_SHEETS,
    BOOK_TEXT_BYTES,
    BOOK_TEXTS,
    BOOK_UNPACKED_BYTES,
)

Cell = float | str | None
CSV_SUFFIXES = '.csv', '.tsv'
_OLD = b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1'                # start of .xls files and of workbooks with a password
_ENCRYPTED = 'EncryptedPackage'.encode('utf-16-le')
_SHEET = re.compile(r'xl/worksheets/[^/]*\.xml')
_TEXTS = 'xl/sharedstrings.xml'
_INDEX = re.compile(r'\[content_types\]\.xml|_rels/\.rels|xl/workbook\.xml|xl/_rels/workbook\.xml\.rels',
                    re.IGNORECASE)
_NEEDED = re.compile(rf'{_INDEX.pattern}|{_TEXTS}|{_SHEET.pattern}', re.IGNORECASE)
_ROW = re.compile(rb'<(?:[\w.-]+:)?row(?![\w.-])')
_CELL = re.compile(rb'<(?:[\w.-]+:)?c(?![\w.-])')
_PLACE = re.compile(rb'(?<=[\s"\'])r\s*=\s*["\']([A-Za-z]*)(\d+)["\']')
_LINE = re.compile(rb"\s[^<>]*?\br\s*=\s*[\"'](\d{1,9})[\"']")
# Columns from AAA on, numbers with more digits, and positions in another notation.
_FAR = rb'\sr="(?:[A-Za-z]{3}|[A-Za-z]{0,2}\d{%d})|\sr=\'|\sr\s+=|\sr=\s'
# Positions that follow no space, and rows and cells with a prefix.
_UNUSUAL = b'"r', b"'r", b'\tr', b'\nr', b'\rr', b':row', b':c'
_TWO_LETTERS = 26 * 27                                   # number of columns up to ZZ
# Patterns exclude < inside a tag, so that they take linear time.
_MERGED = re.compile(rb'<(?:[\w.-]+:)?mergeCell\s[^<>]*?ref\s*=\s*["\']([A-Z]+)(\d+):([A-Z]+)(\d+)["\']')
_FORMULA = re.compile(rb'<(?:[\w.-]+:)?c(\s[^<>]*)?>\s*<(?:[\w.-]+:)?f[\s>/]')
_UNVALUED = re.compile(rb'<(?:[\w.-]+:)?c((?:\s[^<>]*)?)>\s*<(?:[\w.-]+:)?f(?:\s[^<>]*)?(?:/>|>[^<]*</(?:[\w.-]+:)?f>)'
                       rb'\s*(?:</(?:[\w.-]+:)?c>|<(?:[\w.-]+:)?v(?:\s[^<>]*)?(?:/>|>\s*</))')
_VALUE = re.compile(rb'<(?:[\w.-]+:)?v(?:\s[^<>]*)?>([^<]*)')
_TEXT_END = re.compile(rb'</(?:[\w.-]+:)?si\s*>|<(?:[\w.-]+:)?si\s*/>')
_SIZES = 64 * 1024
_DECIMAL_COMMA = re.compile(r'[+-]?\d+,\d+')


class Refused(dr.InputError):
    """A file that cannot be read: the key of the reason in ``words``, and the parameters of its sentence."""

    def __init__(self, path: Path, key: str, **parameters: object) -> None:
        """Create the error."""
        super().__init__(f'{path}: {sentence(key, parameters)}')
        self.key, self.parameters = key, parameters


class WorkbookSheet(NamedTuple):
    """A sheet: its name, its rows of cells, and merged ranges as (first row, first column, last row, last column).

    Rows and columns count from 0.
    """

    name: str
    rows: list[list[Cell]]
    merged: tuple[tuple[int, int, int, int], ...] = ()


def read_book(path: Path) -> list[WorkbookSheet]:
    """Return the sheets of an XLSX workbook, or the only sheet of a CSV file.

    Raises Refused if the file is invalid or too large.
    """
    data = _bytes_of(path)
    if path.suffix.lower() in CSV_SUFFIXES and not data.startswith(b'PK'):
        return [WorkbookSheet(path.stem, _csv_rows(path, data))]
    _check_kind(path, data)
    try:
        parts = _parts(path, data)
        merged = {name: _checked(path, name, part) for name, part in parts.items() if _SHEET.fullmatch(name)}
        if not merged:
            raise Refused(path, 'no_sheets')
        files = _files_of_sheets(parts)
        _check_work(path, parts, files)
        named = dict(files)
        return [WorkbookSheet(name, rows, merged.get(named.get(name, ''), ()))
                for name, rows in _read(path, _plain(parts))]
    except dr.InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, LZMAError, struct.error, EOFError, LookupError, NotImplementedError,
            OSError, OverflowError, RuntimeError, ValueError, ElementTree.ParseError) as error:
        if isinstance(error, RuntimeError) and 'password' in str(error):
            raise Refused(path, 'password') from None
        raise Refused(path, 'damaged', said=_said(error)) from None


def number_of(cell: Cell) -> float:
    """Return a cell's number, or nan for any other cell; text is a number, too, also with a decimal comma."""
    if isinstance(cell, float):
        return cell
    text = unicodedata.normalize('NFKC', cell or '').replace('\u2212', '-').strip()
    try:
        return float(text.replace(',', '.') if _DECIMAL_COMMA.fullmatch(text) else text)
    except ValueError:
        return float('nan')


def _bytes_of(path: Path) -> bytes:
    """Return a file's bytes. Raises Refused."""
    try:
        if not path.is_file():      # opening a pipe would wait
            raise Refused(path, 'unreadable', said='not a regular file')
        with path.open('rb') as file:
            data = file.read(BOOK_BYTES + 1)
    except OSError as error:
        raise Refused(path, 'unreadable', said=error.strerror) from None
    except ValueError as error:
        raise Refused(path, 'unreadable', said=_said(error)) from None
    if len(data) > BOOK_BYTES:
        raise Refused(path, 'too_large', most=BOOK_BYTES)
    return data


def _check_kind(path: Path, data: bytes) -> None:
    """Raise Refused if a file is obviously not XLSX."""
    if data.startswith(_OLD):
        raise Refused(path, 'password' if _ENCRYPTED in data else 'excel97')
    if not data.startswith(b'PK'):
        raise Refused(path, 'not_xlsx' if data else 'empty_file')


def _parts(path: Path, data: bytes) -> dict[str, bytes]:
    """Return the required parts of the archive, unpacked within the budget. Raises Refused or zipfile's errors."""
    with zipfile.ZipFile(BytesIO(data)) as book:
        entries = book.infolist()
        if len(entries) > BOOK_PARTS:
            raise Refused(path, 'too_many', things='n_files', count=len(entries), most=BOOK_PARTS)
        lower = [entry.filename.lower() for entry in entries]
        if any('vbaproject' in name or 'macrosheets' in name for name in lower):
            raise Refused(path, 'macros')
        if any(name.startswith('xl/externallinks/') for name in lower):
            raise Refused(path, 'links_out')
        if any(name.endswith('.bin') and name.startswith('xl/work') for name in lower):
            raise Refused(path, 'xlsb')
        needed = [entry for entry in entries if _NEEDED.fullmatch(entry.filename)]
        if len({entry.filename.lower() for entry in needed}) < len(needed):
            raise Refused(path, 'part_twice')
        if any(entry.flag_bits & 1 for entry in needed):
            raise Refused(path, 'password')
        return dict(_unpacked(path, book, needed))


def _unpacked(path: Path, book: zipfile.ZipFile, needed: list[zipfile.ZipInfo]) -> Iterator[tuple[str, bytes]]:
    """Yield parts with their bytes, within budgets that do not rely on the sizes stated in the archive."""
    room = BOOK_UNPACKED_BYTES
    for entry in needed:
        most = BOOK_INDEX_BYTES if _INDEX.fullmatch(entry.filename) else BOOK_UNPACKED_BYTES
        pieces = []
        with book.open(entry) as file:
            while min(room, most) >= 0 and (piece := file.read(min(_SIZES * 16, room + 1, most + 1))):
                room, most = room - len(piece), most - len(piece)
                pieces.append(piece)
        if room < 0:
            raise Refused(path, 'unpacks', most=BOOK_UNPACKED_BYTES)
        if most < 0:
            raise Refused(path, 'index_unpacks', part=entry.filename, most=BOOK_INDEX_BYTES)
        part = b''.join(pieces)
        pieces.clear()
        plain = b'<!' not in part if entry.filename.lower() == _TEXTS or _SHEET.fullmatch(entry.filename) else (
            b'<!DOCTYPE' not in part and b'<!ENTITY' not in part)
        if not plain or b'\0' in part:
            raise Refused(path, 'not_plain_xml', part=entry.filename)
        yield entry.filename, part


def _checked(path: Path, name: str, part: bytes) -> tuple[tuple[int, int, int, int], ...]:
    """Return the merged ranges of a sheet. Raises Refused if a sheet is too large or a formula has no value.

    A reader allocates a full rectangle of rows and columns, so a budget limits their product.
    """
    _check_size(path, name, *_extent(part))
    if b'f>' in part and _FORMULA.search(part) and (empty := _UNVALUED.search(part)):
        place = re.search(rb'r\s*=\s*["\'](\w+)["\']', empty[1])
        raise Refused(path, 'formula', sheet=name, place=place[1].decode() if place else '?')
    return tuple((int(top) - 1, _column(left) - 1, int(bottom) - 1, _column(right) - 1)
                 for left, top, right, bottom in _MERGED.findall(part, max(part.rfind(b'</sheetData'), 0)))


def _check_size(path: Path, name: str, rows: int, columns: int) -> None:
    for things, size, most in (('n_rows', rows, BOOK_ROWS), ('n_columns', columns, BOOK_COLUMNS),
                               ('n_cells', rows * columns, BOOK_CELLS)):
        if size > most:
            raise Refused(path, 'sheet_too_large', sheet=name, things=things, count=size, most=most)


def _check_work(path: Path, parts: dict[str, bytes], files: list[tuple[str, str]]) -> None:
    """Raise Refused if a reader would make too much of a workbook: of the cells of all its sheets, or of its texts.

    A sheet may be listed several times, and a text may be shared by any number of cells.
    """
    if len(files) > BOOK_SHEETS:
        raise Refused(path, 'too_many', things='n_sheets', count=len(files), most=BOOK_SHEETS)
    pages = {name: part for name, part in parts.items() if _SHEET.fullmatch(name)}
    listed = [target for _, target in files if not target.startswith('xl/chartsheets/')]
    times = {name: max(1, sum(target == name or target not in pages for target in listed)) for name in pages}
    for bound in (_extent, _exact_extent):
        cells = sum(times[name] * rows * columns for name, (rows, columns) in (
            (name, bound(part)) for name, part in pages.items()))
        if cells <= BOOK_CELLS:
            break
    else:
        raise Refused(path, 'too_many', things='n_cells', count=cells, most=BOOK_CELLS)
    texts = next((part for name, part in parts.items() if name.lower() == _TEXTS), b'')
    ends = [0, *(found.end() for found in islice(_TEXT_END.finditer(texts), BOOK_TEXTS + 1))]
    if len(ends) > BOOK_TEXTS + 1:
        raise Refused(path, 'too_many', things='n_texts', count=len(ends) - 1, most=BOOK_TEXTS)
    sizes = [after - before for before, after in pairwise(ends)]
    room = BOOK_TEXT_BYTES // sum(times.values())
    if any(_text_bytes(page, sizes, room) > room for page in pages.values()):
        raise Refused(path, 'texts_unpack', most=BOOK_TEXT_BYTES)


def _text_bytes(page: bytes, sizes: Sequence[int], room: int) -> int:
    """Return a bound on the bytes of shared texts that a reader copies into the cells of a sheet."""
    longest, work = max(sizes, default=0), 0
    if page.count(b'</') * longest <= room:     # even if every element were such a cell
        return 0
    for found in _VALUE.finditer(page):
        try:
            work += sizes[int(found[1])]
        except ValueError:      # no number, or an entity that may be one
            work += longest if b'&' in found[1] else 0
        except IndexError:
            continue
        if work > room:
            break
    return work


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
    return _exact_extent(part)


def _exact_extent(part: bytes) -> tuple[int, int]:
    """Return a sheet's rows and columns, or a bound if some positions follow only from the cells' order."""
    part = part[max(part.find(b'sheetData'), 0):]
    lines = _ROW.split(part)
    counts = [len(_CELL.findall(line)) for line in lines]
    places = set(_PLACE.findall(part))
    rows = max((int(row) for _, row in places), default=0)
    columns = max(map(_column, {letters for letters, _ in places if letters}), default=0)
    if sum(1 for letters, _ in places if letters) < sum(counts):
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


def _files_of_sheets(parts: dict[str, bytes]) -> list[tuple[str, str]]:
    """Return the names of the sheets with the paths of their parts in the file. Raises ParseError."""
    targets = {one.get('Id'): one.get('Target', '').removeprefix('/').removeprefix('xl/')
               for one in ElementTree.fromstring(parts.get('xl/_rels/workbook.xml.rels', b'<none/>'))}
    found = []
    for one in ElementTree.fromstring(parts.get('xl/workbook.xml', b'<none/>')).iter():
        if one.tag.rpartition('}')[2] == 'sheet':
            target = next((value for key, value in one.attrib.items() if key.endswith('}id')), None)
            found.append((one.get('name', ''), f'xl/{targets.get(target, "")}'))
    return found


def _read(path: Path, plain: BytesIO) -> list[tuple[str, list[list[Cell]]]]:
    """Return the names and rows of the sheets, as read by the fastest reader. Raises Refused if the reader fails."""
    try:
        return _by_calamine(plain) if find_spec('python_calamine') else _by_openpyxl(path, plain)
    except (dr.InputError, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # noqa: BLE001 - a reader raises whatever its XML library does; Rust panics, too
        raise Refused(path, 'not_a_book', said=_said(error)) from None


def _by_calamine(plain: BytesIO) -> list[tuple[str, list[list[Cell]]]]:
    from python_calamine import CalamineWorkbook, SheetTypeEnum
    book = CalamineWorkbook.from_filelike(plain)
    return [(one.name, cast('list[list[Cell]]', book.get_sheet_by_name(one.name).to_python(skip_empty_area=False)))
            for one in book.sheets_metadata if one.typ == SheetTypeEnum.WorkSheet]


def _by_openpyxl(path: Path, plain: BytesIO) -> list[tuple[str, list[list[Cell]]]]:
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise dr.InputError("xlsx: no reader is installed: pip install 'dragon_ros[xlsx]'") from None
    book = load_workbook(plain, read_only=True, data_only=True, keep_links=False)
    try:
        out = []
        for sheet in book.worksheets:
            sheet.reset_dimensions()
            rows: list[list[Cell]] = []
            for row in sheet.iter_rows(values_only=True):
                rows.append(list(row))
                _check_size(path, sheet.title, len(rows), len(row))
            out.append((sheet.title, rows))
        return out
    finally:
        book.close()


def _csv_rows(path: Path, data: bytes) -> list[list[Cell]]:
    """Return the rows of a CSV file in UTF-8, UTF-16 or GBK, separated by commas, semicolons or tabs."""
    if not data:
        raise Refused(path, 'empty_file')
    text = _decoded(path, data)
    start = text[:_SIZES]
    separator = ';' if 3 * start.count(';') > start.count(',') else ',' if ',' in start else '\t'   # 1,5;2,5 or 1.5,2.5
    _check_size(path, path.name, max(text.count('\n'), text.count('\r')), 1)
    lines = text.splitlines()
    _check_size(path, path.name, 1, max(line.count(separator) for line in lines))
    rows: list[list[Cell]] = []
    cells = 0
    try:
        for row in csv.reader(lines, delimiter=separator):
            cells += len(row)
            if cells > BOOK_CELLS:
                raise Refused(path, 'too_many', things='n_cells', count=cells, most=BOOK_CELLS)
            rows.append(list(map(_plain_cell, row)))
    except csv.Error as error:
        raise Refused(path, 'not_csv', said=_said(error)) from None
    return rows


def _plain_cell(text: str) -> Cell:
    if not text or text.isspace():
        return None
    try:
        return float(text)
    except ValueError:
        value = number_of(text)
        return text if value != value else value


def _decoded(path: Path, data: bytes) -> str:
    """Return the text of a CSV file. Raises Refused if it has an unknown encoding."""
    tried = ('utf-16',) if data[:2] in (b'\xff\xfe', b'\xfe\xff') else ('utf-8-sig', 'gb18030')
    for encoding in tried:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if '\0' not in text:
            return text
    raise Refused(path, 'not_csv', said='neither UTF-8 nor GBK')


def _said(error: BaseException) -> str:
    """Return an error's message as one short line."""
    text = ' '.join(str(error).split())
    return text[:100] or type(error).__name__
