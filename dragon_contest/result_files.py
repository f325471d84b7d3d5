"""The result files of the contest problem (CUMCM 2024 A), as CSV and XLSX in the contest's layout."""
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.inputs import Floats

POSITION, SPEED = '位置', '速度'
ENDS = ('龙头', '龙尾（后）')
_FIRST_S, _LAST_S = 0, 300
_BEFORE_S = 100


@dataclass(frozen=True)
class ResultSheet:
    """One sheet: its title, the names of its columns and rows, and its values (rows, columns)."""

    title: str
    file: str
    columns: tuple[str, ...]
    rows: tuple[str, ...]
    values: Floats


def handle_names(benches: int) -> list[str]:
    """Return the contest's names of all handles: head, sections, tail and rear of the tail."""
    return ['龙头', *(f'第{n}节龙身' for n in range(1, benches - 1)), '龙尾', '龙尾（后）'][-(benches + 1):]


def result_1(scene: dr.Scene) -> list[ResultSheet]:
    """Return positions and speeds at 0, 1, ... 300 s."""
    times = [float(t_s) for t_s in range(_FIRST_S, _LAST_S + 1)]
    return _by_time(scene, times, times)


def result_2(scene: dr.Scene) -> list[ResultSheet]:
    """Return positions and speeds at the first contact. Raises InputError if there is no contact."""
    found = dr.compile(scene).contact()
    if not isinstance(found, dr.Contact):
        raise dr.InputError('--contest: result2 needs a first contact, which this scene does not have; choose a scene '
                         'such as winding')
    p, speed = _state(scene, [found.t_s])
    return [ResultSheet('Sheet1', 'result2', ('横坐标x (m)', '纵坐标y (m)', '速度 (m/s)'),
                        tuple(handle_names(scene.dragon.benches)), np.column_stack((p[0], speed[0])))]


def result_4(scene: dr.Scene) -> list[ResultSheet]:
    """Return positions and speeds at -100, -99, ... 100 s, counted from the start of the turn."""
    track = scene.track
    if not isinstance(track, dr.STurn):
        raise dr.InputError('--contest: result4 needs a scene with track.kind turn')
    shown = [float(t_s) for t_s in range(-_BEFORE_S, _BEFORE_S + 1)]
    entry_s = track.before_m / scene.steady_m_s
    return _by_time(scene, [entry_s + t_s for t_s in shown], shown)


def _by_time(scene: dr.Scene, times_s: list[float], shown_s: list[float]) -> list[ResultSheet]:
    p, speed = _state(scene, times_s)
    names = handle_names(scene.dragon.benches)
    columns = tuple(f'{t_s:g} s' for t_s in shown_s)
    places = tuple(f'{name}{axis} (m)' for name in names for axis in 'xy')
    return [ResultSheet(POSITION, 'positions', columns, places, p.reshape(len(times_s), -1).T),
            ResultSheet(SPEED, 'speeds', columns, tuple(map(_speed_row, names)), speed.T)]


def _speed_row(name: str) -> str:
    """Return a row's name in the sheet of speeds, with one space after the names of the ends and two after others."""
    return f'{name} (m/s)' if name in ENDS else f'{name}  (m/s)'


def _state(scene: dr.Scene, times_s: list[float]) -> tuple[Floats, Floats]:
    """Return handles (m, shape (M, N+1, 2)) and speeds (m/s, shape (M, N+1))."""
    motion = dr.compile(scene).states(times_s)
    return motion.handles_m, motion.speed_m_s


def write(folder: Path, wound: dr.Scene, turning: dr.Scene, progress: Callable[[], object] = lambda: None,
          ) -> list[Path]:
    """Write all results to a folder and return the paths; XLSX files are written only if openpyxl is installed.

    ``progress()`` is called after each of the 3 results and each of up to 8 files.
    """
    results = {}
    for name, make, scene in (('result1', result_1, wound), ('result2', result_2, wound),
                              ('result4', result_4, turning)):
        results[name] = make(scene)
        progress()
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, sheets in results.items():
            for sheet in sheets:
                paths.append(_write_csv(folder, name, sheet))
                progress()
        for name, sheets in results.items() if find_spec('openpyxl') else ():
            paths.append(_write_xlsx(folder / f'{name}.xlsx', sheets))
            progress()
    except OSError as error:
        raise dr.MissingError(f'--contest {folder}: cannot be written: {error.strerror}') from None
    return paths


def _rounded(sheet: ResultSheet) -> Floats:
    """Return values rounded to six decimals, without a minus sign on zero."""
    rounded: Floats = np.round(sheet.values, 6) + 0.0
    return rounded


def _write_csv(folder: Path, name: str, sheet: ResultSheet) -> Path:
    path = folder / (f'{name}.csv' if sheet.file == name else f'{name}_{sheet.file}.csv')
    text = command_line.csv_of(('', *sheet.columns), ([name, *(f'{value:.6f}' for value in values)]
                               for name, values in zip(sheet.rows, _rounded(sheet).tolist(), strict=True)))
    command_line.write_output(path, text.encode('utf-8-sig'), '--contest')        # without the BOM, Excel assumes GBK
    return path


def _write_xlsx(path: Path, sheets: list[ResultSheet]) -> Path:
    """Write a workbook whose numbers are shown with six decimals."""
    from openpyxl import Workbook
    book = Workbook()
    book.remove(book.active)
    for sheet in sheets:
        page = book.create_sheet(sheet.title)
        page.append((None, *sheet.columns))
        for name, values in zip(sheet.rows, _rounded(sheet).tolist(), strict=True):
            page.append((name, *values))
        for row in page.iter_rows(2, min_col=2):
            for cell in row:
                cell.number_format = '0.000000'
    data = BytesIO()
    book.save(data)
    command_line.write_output(path, data.getvalue(), '--contest')
    return path
