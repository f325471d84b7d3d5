"""Kill a writer of a study just before its n-th change to a file, for every n, and continue in another process.

``python killed_writer.py FOLDER STEP`` uses every STEP-th n. It prints the number of changes and ends with an error if
a row is lost or duplicated.
"""
import os
import signal
import sys
from pathlib import Path

import pyarrow.dataset  # noqa: F401 - else every child process would import it
from slow_study import QUICK

from dragon_ros.scenes.yaml import parse_document
from dragon_studies import dataset
from dragon_studies.definition import study_of
from dragon_studies.rows import rows_of

_CHANGES = ('os.rename', 'os.remove', 'os.mkdir')


def write(folder: Path) -> None:
    """Write the missing rows in batches of three rows, which do not match the blocks."""
    study = study_of(parse_document('f.yaml', QUICK), Path())
    with dataset.writing(folder, study) as data:
        for first, last in data.missing:
            for start in range(first, last, 3):
                stop = min(start + 3, last, start // 8 * 8 + 8)
                data.write(start, stop, dataset.part_of(study, rows_of(study, range(start, stop))))
                if stop < min(start + 3, last):
                    data.write(stop, min(start + 3, last), dataset.part_of(
                        study, rows_of(study, range(stop, min(start + 3, last)))))
        data.join_blocks()


def kill_at(number: int, folder: Path) -> None:
    """Kill this process just before change number ``number`` to a file in the folder."""
    left = [number]

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        opens = event == 'open' and isinstance(arguments[1], str) and 'w' in arguments[1]
        if (opens or event in _CHANGES) and str(arguments[0]).startswith(str(folder)):
            left[0] -= 1
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(hook)


def went_on(folder: Path) -> None:
    """Continue the study, and compare all rows with those of an uninterrupted study."""
    write(folder)
    data = dataset.open_set(folder)
    found = [{**row, 'cpu_s': 0} for row in data.table().to_pylist()]
    assert found == [{**row, 'cpu_s': 0} for row in rows_of(data.study, range(12))]
    assert sorted(path.name for path in (folder / 'rows').iterdir()) == [
        'part-0000000000-0000000008.parquet', 'part-0000000008-0000000012.parquet']


def ended(act, *arguments) -> int:
    """Run a function in a child process, and return its exit code."""
    child = os.fork()
    if child == 0:
        try:
            act(*arguments)
        except BaseException as error:  # noqa: BLE001 - the child must not continue as its parent
            print(repr(error), file=sys.stderr)
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed(number: int, folder: Path) -> None:
    """Write until change number ``number`` kills the process."""
    kill_at(number, folder)
    write(folder)


def main(folder: Path, step: int) -> None:
    """Kill the writer before every ``step``-th change."""
    dataset.BLOCK = 8
    rows_of(study_of(parse_document('f.yaml', QUICK), Path()), range(1))      # fills caches for the child processes
    for number in range(1, 1000, step):
        each = folder / str(number)
        code = ended(killed, number, each)
        if code == 0:
            print(number - 1)
            return
        assert code == -signal.SIGKILL, code
        assert ended(went_on, each) == 0, f'killed before change {number}'


if __name__ == '__main__':
    main(Path(sys.argv[1]), int(sys.argv[2]))
