"""Budgets for workbooks and CSV files that are graded, which are untrusted; a file that exceeds one is rejected."""
from dragon_ros.cli.inputs import Limit

MB = 2**20
BOOK_BYTES = 16 * MB
BOOK_UNPACKED_BYTES = 48 * MB
BOOK_INDEX_BYTES = MB
BOOK_PARTS = 1000
BOOK_SHEETS = 50
BOOK_ROWS = 100_000
BOOK_COLUMNS = 2000
BOOK_CELLS = 2_000_000
BOOK_TEXTS = 500_000
BOOK_TEXT_BYTES = 16 * MB
BOOK_TIMES = 1000
GRADED_BOOKS = 10_000

LIMITS = (
    Limit('BOOK_BYTES', 'a workbook or CSV file that `grade` reads', 'bytes', 'rejected'),
    Limit('BOOK_UNPACKED_BYTES', 'the sheets and texts of a workbook after decompression', 'bytes', 'rejected'),
    Limit('BOOK_INDEX_BYTES', 'each list of the parts and sheets of a workbook', 'bytes', 'rejected'),
    Limit('BOOK_PARTS', 'the files in a workbook', 'files', 'rejected'),
    Limit('BOOK_SHEETS', 'the sheets of a workbook', 'sheets', 'rejected'),
    Limit('BOOK_ROWS', 'the rows of a sheet', 'rows', 'rejected'),
    Limit('BOOK_COLUMNS', 'the columns of a sheet', 'columns', 'rejected'),
    Limit('BOOK_CELLS', 'the rows of a sheet times its columns, summed over the sheets of a workbook', 'cells',
          'rejected'),
    Limit('BOOK_TEXTS', 'the shared texts of a workbook', 'texts', 'rejected'),
    Limit('BOOK_TEXT_BYTES', 'the shared texts of a workbook, counted once per cell', 'bytes', 'rejected'),
    Limit('BOOK_TIMES', 'the times of a result that `grade` compares', 'times', 'thinned out, with a note'),
    Limit('GRADED_BOOKS', 'the workbooks of a folder that `grade` reads', 'files', 'rejected'),
)
