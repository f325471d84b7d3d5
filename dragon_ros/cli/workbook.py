"""Convert tables to XLSX workbooks with openpyxl."""
from collections.abc import Iterable, Sized
from contextlib import suppress
from io import BytesIO
from typing import Any, Protocol

from dragon_ros.core.errors import InputError, MissingError

_MOST_ROWS = 2**20 - 1      # largest number of rows on a sheet below the column names


class _NumberedRows(Sized, Iterable[Iterable[Any]], Protocol):
    """An iterable of rows with a known length."""


def xlsx_of(head: Iterable[str], rows: _NumberedRows) -> bytes:
    """Return rows under their column names as a workbook with one sheet.

    Raises MissingError if openpyxl is not installed or its temporary file cannot be written, and InputError if there
    are more rows than fit on a sheet.
    """
    try:
        from openpyxl import Workbook
    except ImportError:
        raise MissingError("xlsx: openpyxl is not installed: pip install 'dragon_ros[xlsx]'") from None
    if len(rows) > _MOST_ROWS:
        raise InputError(f'xlsx: {len(rows)} rows do not fit on a sheet of {_MOST_ROWS} rows; request fewer times or '
                         'handles, or write CSV')
    book, out = Workbook(write_only=True), BytesIO()
    sheet = book.create_sheet('dragon_ros')
    try:
        sheet.append(list(head))
        for row in rows:
            sheet.append([None if value != value else value for value in row])
        book.save(out)
    except OSError as error:
        with suppress(OSError, StopIteration):      # a sheet that is not closed fails again when it is collected
            sheet.close()
        raise MissingError(f'xlsx: the temporary file of the sheet cannot be written: {error.strerror}; free some '
                           'space, or set TMPDIR') from None
    return out.getvalue()
