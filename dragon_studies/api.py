"""Studies in Python: ``dragon_studies.study`` computes and returns the rows of a study."""
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from threading import Event
from typing import Any

from dragon_ros.cli.inputs import FieldError, Floats, InputError, MissingError, naming_arguments, read_only


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a study, and their folder; ``table`` is a pyarrow.Table with one row per index."""

    folder: Path
    table: Any

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.table)

    def __getitem__(self, column: str) -> Floats:
        """Return a numeric column as an array of shape (rows,), with nan for empty cells."""
        from dragon_studies.answers import numbers
        return read_only(numbers(self.table, column).copy())

    def frame(self) -> Any:
        """Return a pandas DataFrame. Raises MissingError if pandas is not installed."""
        try:
            return self.table.to_pandas()
        except ImportError:
            raise MissingError('frame: pandas is not installed: pip install pandas') from None


def study(name_or_path: str | PathLike[str], output: str | PathLike[str] | None = None, samples: int | None = None,
          workers: int | None = None, scheduler: str | None = None) -> Rows:
    """Compute the missing rows of a study (a name or a file) in the folder ``output``, and return all its rows.

    ``name_or_path`` can also be the folder of a data set. Rows are computed by processes on this machine, one per core,
    or by a Dask cluster (``docs/studies.md``). In a script, put the call below ``if __name__ == '__main__':``. Raises
    InputError for an invalid study, and MissingError if a library is not installed.
    """
    try:
        from dragon_studies.dataset import DataSet, open_set, writing
        from dragon_studies.definition import load_study
        from dragon_studies.run import complete
    except ImportError as error:
        raise MissingError(f"{error.name}: it is not installed: pip install 'dragon_ros[study]'") from None
    if not isinstance(name_or_path, (str, PathLike)):
        raise FieldError('name_or_path', name_or_path, f'it is a {type(name_or_path).__name__}, not a name or a path',
                         'give a string or a Path')
    path = Path(name_or_path)
    if output is None and not path.is_dir():
        raise InputError('output: it is missing; give the folder for the rows', field='output')
    known = open_set(path) if output is None else DataSet(Path(output), load_study(fspath(name_or_path)))
    wanted = known.study if samples is None else known.study.with_samples(samples)
    with naming_arguments(), writing(known.folder, wanted) as data:
        complete(data, Event(), lambda progress: None, workers, scheduler)
    return Rows(data.folder, data.table())
