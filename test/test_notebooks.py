"""The notebooks in docs/notebooks run from top to bottom and are stored without outputs."""
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from properties import thinned

from dragon_ros.cli.dds_domain import free_domain, local_environment

NOTEBOOKS = sorted((Path(__file__).parents[1] / 'docs' / 'notebooks').glob('*.ipynb'))
LONGEST_S = 120     # a deadline for one cell, on a busy machine


def by_name(path):
    return path.stem


# By default, test_study_command.py runs a study on a worker.
@pytest.mark.parametrize('path', thinned(NOTEBOOKS, lambda path: path.stem != 'a-study'), ids=by_name)
def test_the_cells_of_a_notebook_run_from_top_to_bottom_without_a_word_on_stderr(path, tmp_path, request, monkeypatch,
                                                                                 capfd):
    if request.config.getoption('--long') and find_spec('nbclient'):
        pytest.skip('with --long, the cells run in a kernel')
    nbformat, plt = pytest.importorskip('nbformat'), pytest.importorskip('matplotlib.pyplot')
    monkeypatch.chdir(tmp_path)
    names = {'__name__': '__main__'}
    with np.errstate(all='warn'), warnings.catch_warnings():
        warnings.filterwarnings('ignore', 'FigureCanvasAgg is non-interactive')
        for cell in nbformat.read(path, as_version=4).cells:
            if cell.cell_type == 'code':
                exec(compile(cell.source, path.name, 'exec'), names)
    plt.close('all')
    assert capfd.readouterr().err == ''


@pytest.mark.long
@pytest.mark.parametrize('path', NOTEBOOKS, ids=by_name)
def test_a_notebook_runs_in_a_kernel_without_a_word_on_stderr(path, tmp_path, monkeypatch):
    nbformat, nbclient = pytest.importorskip('nbformat'), pytest.importorskip('nbclient')
    for name, value in {**local_environment(free_domain()), 'IPYTHONDIR': str(tmp_path / 'ipython')}.items():
        monkeypatch.setenv(name, value)
    book = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(book, timeout=LONGEST_S, resources={'metadata': {'path': str(tmp_path)}}).execute()
    outputs = [output for cell in book.cells for output in cell.get('outputs', [])]
    assert not [output['text'] for output in outputs if output.get('name') == 'stderr']


@pytest.mark.parametrize('path', NOTEBOOKS, ids=by_name)
def test_a_notebook_is_kept_without_outputs(path):
    nbformat = pytest.importorskip('nbformat')
    for cell in nbformat.read(path, as_version=4).cells:
        assert not cell.get('outputs')
        assert cell.get('execution_count') is None
