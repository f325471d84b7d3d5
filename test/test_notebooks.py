"""The notebooks of docs/notebooks run from top to bottom, and are kept without their outputs."""
from pathlib import Path

import pytest

from dragon_ros.cli.dds_domain import free_domain, local_environment

NOTEBOOKS = sorted((Path(__file__).parents[1] / 'docs' / 'notebooks').glob('*.ipynb'))
LONGEST_S = 120     # a deadline for one cell, on a busy machine


def by_name(path):
    return path.stem


@pytest.mark.parametrize('path', NOTEBOOKS, ids=by_name)
def test_a_notebook_runs_from_top_to_bottom_without_a_word_on_stderr(path, tmp_path, monkeypatch):
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
