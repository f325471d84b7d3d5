"""``study``: run a parameter study and summarise its results."""
import json
import os
import shlex
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dragon_ros.cli import command_line, figures
from dragon_ros.cli.inputs import InputError, MissingError, counted, whole
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.signals import stopped_by_signals

if TYPE_CHECKING:
    from dragon_studies.dataset import DataSet
    from dragon_studies.run import StudyProgress


def main(argv: list[str]) -> int:
    """Compute or draw a study; return the exit code.

    The exit code is 1 if a signal ended the study; running the same command again continues the study.
    """
    options = command_line.parser(
        'study', 'Vary a scene as described in a study file, answer the questions in the file for each variant, and '
                 'store one row per variant as Parquet\n(docs/studies.md). Existing rows are not computed again.',
        'study pitch_map --output pitch_map --plot')
    options.add_argument('study', metavar='NAME|FILE|FOLDER',
                         help='name or file of a study, or the folder of a study to continue or draw')
    options.add_argument('--output', type=Path, metavar='DIR', help='folder for the data set')
    options.add_argument('--samples', type=int, metavar='N', help='number of samples (as in the study)')
    options.add_argument('--workers', type=int, metavar='N', help='number of processes on this host (one per core)')
    options.add_argument('--scheduler', metavar='ADDRESS|FILE', help='address or file of the scheduler of a '
                         'running Dask cluster to use')
    options.add_argument('--plot', action='store_true', help='draw the results as PNG and SVG files in the folder; if '
                         'a FOLDER is given, nothing is computed')
    options.add_argument('--format', choices=('text', 'json'), default='text', help='output format (%(default)s)')
    return command_line.guarded('study', partial(_run, options.parse_args(argv)))


def _run(arguments: Namespace) -> int:
    with _libraries():
        from dragon_studies import answers, dataset
        from dragon_studies.definition import load_study
    study = None if os.path.isdir(arguments.study) else load_study(arguments.study)
    folder = _folder_of(arguments)
    data = dataset.open_set(folder) if study is None else dataset.DataSet(folder, study)
    if arguments.samples is not None:
        whole('--samples', arguments.samples, low=1, high=10**9)
        data = dataset.DataSet(folder, data.study.with_samples(arguments.samples))
    code = command_line.OK
    if study is not None or not arguments.plot:
        code = _computed(arguments, data)
    elif arguments.workers is not None or arguments.scheduler is not None:
        raise InputError('--plot: with a FOLDER, no rows are computed; omit --workers and --scheduler', field='plot')
    found = answers.summary(data)
    command_line.write_output(None, json.dumps(found) if arguments.format == 'json' else answers.text(found))
    if arguments.plot:
        from dragon_studies.pictures import NEEDED, pictures
        drawn = False
        for name, figure in pictures(data):
            drawn = True
            for path in figures.save(figure, folder / name, f'study {figures.short(folder.name)}'):
                command_line.write_output(None, str(path))
        if not drawn:
            command_line.note(f'study: nothing is drawn: {NEEDED}')
    return code


@contextmanager
def _libraries() -> Iterator[None]:
    """Raise a MissingError if a library of studies that this block imports is not installed."""
    try:
        yield
    except ImportError as error:
        raise MissingError(f"{error.name}: it is not installed, but studies need it; pip install 'dragon_ros[study]', "
                           'or use ./dragon study, which installs it') from None


def _folder_of(arguments: Namespace) -> Path:
    """Return the folder of the data set, which may be given instead of a study."""
    given = Path(arguments.study)
    if os.path.isdir(given):
        if arguments.output is not None:
            raise InputError('--output: the folder of a study is its own output; omit --output', field='output')
        return given
    if arguments.output is None:
        raise InputError('--output: it is missing; give a folder for the rows, such as --output study', field='output')
    output: Path = arguments.output
    return output


def _computed(arguments: Namespace, data: 'DataSet') -> int:
    """Compute missing rows with a progress bar; return the exit code."""
    with _libraries():      # Dask takes a third of a second to import, and drawings do not need it
        from dragon_studies.run import complete
    from dragon_ros.cli.pool import workers_of
    from dragon_studies import dataset
    workers = None if arguments.workers is None else workers_of(arguments.workers)
    with stopped_by_signals() as stop, dataset.writing(data.folder, data.study) as kept:
        there = kept.count
        if there:
            command_line.note(f'study: {there} of {counted(data.study.rows, "row")} already exist')
        if arguments.scheduler is not None and workers is None:     # an attempt may take half a minute
            command_line.note(f'study: connecting to {arguments.scheduler}')
        with Progress('study', 'rows', data.study.rows, initial=there) as shown:
            done = complete(kept, stop, partial(_show, shown, there), workers, arguments.scheduler)
    if done.done == done.total:
        return command_line.OK
    command_line.note(f'study: stopped with {done.done} of {counted(done.total, "row")}; to continue: '
                      f'{_again(arguments)}')
    return command_line.FAILED


def _show(shown: Progress, there: int, state: 'StudyProgress') -> None:
    shown.note(f'{state.refused} refused, {counted(state.workers, "worker")}')
    shown.reach(state.done - there)


def _again(arguments: Namespace) -> str:
    """Return the command line that continues the study."""
    given = {'--output': arguments.output, '--samples': arguments.samples, '--workers': arguments.workers,
             '--scheduler': arguments.scheduler}
    words = [*command_line.program().split(), 'study', arguments.study]
    for name, value in given.items():
        words += [] if value is None else [name, str(value)]
    return shlex.join(words)
