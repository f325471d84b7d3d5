"""Each part of a data set is complete or absent, however its writer is killed, and the data set can be continued."""
import os
import subprocess
import sys
from pathlib import Path

import pytest
from properties import thinned
from pyarrow import parquet
from slow_study import QUICK
from small_disk import small_disk

from dragon_ros.__main__ import main
from dragon_ros.core.errors import DiskError, InputError, MissingError
from dragon_studies import dataset
from dragon_studies.dataset import open_set, part_of, writing
from dragon_studies.rows import rows_of

ROOT = Path(__file__).parents[2]


@pytest.fixture
def fill(monkeypatch):
    """A function that writes the rows of the given ranges of indices, with blocks of 8 rows."""
    monkeypatch.setattr(dataset, 'BLOCK', 8)

    def write(data, *ranges):
        for start, stop in ranges:
            data.write(start, stop, part_of(data.study, rows_of(data.study, range(start, stop))))
    return write


def names(folder):
    return sorted(path.name for path in (folder / 'rows').iterdir())


def test_parts_are_joined_block_by_block_whatever_their_order(study, fill, tmp_path, without_times):
    with writing(tmp_path, study()) as data:
        fill(data, (9, 11), (2, 8), (8, 9))
        assert data.missing == [(0, 2), (11, 12)]
        fill(data, (0, 2))
        assert names(tmp_path)[0] == 'part-0000000000-0000000008.parquet'
        fill(data, (11, 12))
    assert names(tmp_path) == ['part-0000000000-0000000008.parquet', 'part-0000000008-0000000012.parquet']
    assert without_times(open_set(tmp_path).table()) == without_times(rows_of(study(), range(12)))


def test_a_data_set_carries_its_study_and_its_versions(study, fill, tmp_path):
    with writing(tmp_path, study()) as data:
        fill(data, (0, 3))
    assert open_set(tmp_path).study == study()
    assert 'dragon_ros: 0' in (tmp_path / 'study.yaml').read_text()
    schema = parquet.read_schema(next((tmp_path / 'rows').iterdir()))
    assert schema.metadata[b'dragon_ros.study'].decode() == study().text


def test_what_a_kill_left_behind_is_left_out_and_removed(study, fill, tmp_path, without_times):
    with writing(tmp_path, study()) as data:
        fill(data, (0, 3), (3, 6))
        (tmp_path / 'rows' / 'part-0000000006-0000000008.tmp').write_bytes(b'half')
        # As if the writer had been killed after joining a block and before removing its parts.
        whole = part_of(study(), rows_of(study(), range(8)))
        (tmp_path / 'rows' / 'part-0000000000-0000000008.parquet').write_bytes(whole)
    assert open_set(tmp_path).count == 8
    with writing(tmp_path, study()) as data:
        assert names(tmp_path) == ['part-0000000000-0000000008.parquet']
        assert data.missing == [(8, 12)]
    assert without_times(open_set(tmp_path).table()) == without_times(rows_of(study(), range(8)))


@pytest.mark.parametrize('size', [0, 100, 3000])
def test_a_full_disk_keeps_what_was_there_and_no_half_of_a_part(study, fill, tmp_path, size):
    with writing(tmp_path, study()) as data:
        fill(data, (0, 3))
        with small_disk(size), pytest.raises(DiskError, match='File too large; 3 rows are kept; free some space'):
            fill(data, (3, 6))
        assert names(tmp_path) == ['part-0000000000-0000000003.parquet']
        fill(data, (3, 6))
        assert data.count == 6


def test_more_samples_of_a_random_study_go_on_and_fewer_are_refused(study, fill, tmp_path, without_times):
    with writing(tmp_path, study()) as data:
        fill(data, (0, 8), (8, 12))
    with writing(tmp_path, study().with_samples(14)) as data:
        assert data.missing == [(12, 14)]
        fill(data, (12, 14))
    assert without_times(open_set(tmp_path).table()) == without_times(rows_of(study().with_samples(14), range(14)))
    with pytest.raises(InputError, match='contains a study with 14 samples'), writing(tmp_path, study()):
        pass


def test_rows_of_another_study_or_version_are_never_mixed(study, tmp_path, monkeypatch):
    with writing(tmp_path, study()):
        pass
    other = study('vary: {track.pitch_m: [1]}\nask: [lock]')
    with pytest.raises(InputError, match='rows of another study, which differs in scene'), writing(tmp_path, other):
        pass
    monkeypatch.setattr(dataset, 'versions', lambda: {'dragon_ros': '9.9'})
    with pytest.raises(InputError, match=r'rows of dragon_ros \S+, but this is 9.9'), writing(tmp_path, study()):
        pass


def test_a_part_of_another_study_is_rejected_before_anything_is_computed(study, fill, tmp_path):
    with writing(tmp_path, study()) as data:
        fill(data, (0, 3))
    other = study(QUICK + 'seed: 6\n')
    path = next((tmp_path / 'rows').iterdir())
    path.write_bytes(part_of(other, rows_of(other, range(3))))
    with pytest.raises(InputError, match=f'{path.name}: it contains rows of another study; remove it'), \
            writing(tmp_path, study()):
        pass
    for columns in (None, ['status']):
        with pytest.raises(InputError, match='rows of another study'):
            open_set(tmp_path).table(columns)
    path.write_bytes(b'PAR1')
    with pytest.raises(InputError, match=f'{path.name}: cannot be read as rows'), writing(tmp_path, study()):
        pass


def test_rows_without_their_study_are_not_taken_for_rows_of_this_one(study, fill, tmp_path):
    with writing(tmp_path, study()) as data:
        fill(data, (0, 3))
    (tmp_path / 'study.yaml').unlink()
    with pytest.raises(InputError, match=r'it contains rows, but no study.yaml that describes them'), \
            writing(tmp_path, study()):
        pass


def test_two_processes_never_write_one_data_set(study, tmp_path):
    with writing(tmp_path, study()), pytest.raises(InputError, match='another process is writing'), \
            writing(tmp_path, study()):
        pass


def test_a_second_study_in_one_folder_is_refused_in_one_line(study, tmp_path, capsys):
    (tmp_path / 'study.yaml').write_text(QUICK)
    with writing(tmp_path / 'data', study()):
        assert main(['study', str(tmp_path / 'study.yaml'), '--output', str(tmp_path / 'data')]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'another process is writing this study; wait for it, or give another --output' in line


@pytest.mark.parametrize('step', thinned([1, 9], lambda step: step > 1))
def test_a_study_killed_before_any_change_of_a_file_goes_on_and_has_each_row_once(tmp_path, step):
    path = Path(__file__).with_name('killed_writer.py')
    done = subprocess.run([sys.executable, str(path), str(tmp_path), str(step)], capture_output=True, text=True,
                          check=False, env={**os.environ, 'PYTHONPATH': os.pathsep.join((str(ROOT), str(path.parent)))})
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 20


def test_a_part_that_is_none_is_named(study, fill, tmp_path):
    with writing(tmp_path, study()) as data:
        fill(data, (0, 3))
    path = tmp_path / 'rows' / 'part-0000000003-0000000006.parquet'
    for content in (b'', b'PAR1', next((tmp_path / 'rows').iterdir()).read_bytes()[:-50]):
        path.write_bytes(content)
        with pytest.raises(InputError, match='part-0000000003-0000000006.parquet: cannot be read as rows'):
            open_set(tmp_path).table()
    path.write_bytes(next(iter(sorted((tmp_path / 'rows').iterdir()))).read_bytes())
    assert len(open_set(tmp_path).table()) == 6, 'a part with three rows counts as three rows'


def test_a_folder_without_a_study_is_no_data_set(tmp_path):
    with pytest.raises(MissingError, match=r'study.yaml: cannot be read'):
        open_set(tmp_path)
