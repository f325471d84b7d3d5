"""``study`` computes, continues, summarises and plots studies, and reports mistakes in one line."""
import json
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from processes import Forked

import dragon_studies
from dragon_ros.__main__ import main
from dragon_ros.core.errors import InputError

GRID = """
set: {dragon: {benches: 12}, run: {start_s: 408, stop_s: 413}}
vary:
  dragon.width_m: {from: 0.2, to: 0.3, steps: 3}
  dragon.hole_inset_m: [0.25, 0.275]
ask: [contact, lock]
"""
RANDOM = 'set: {dragon: {benches: 3}}\nvary: {track.pitch_m: {uniform: [0.5, 0.6]}, dragon.width_m: [0.2, 0.3]}\n' \
         'ask: [lock]\ndesign: DESIGN\nsamples: 16\n'
CURVE = 'set: {dragon: {benches: 3}}\nvary: {track.pitch_m: {from: 0.4, to: 0.6, steps: 5}}\nask: [lock]'


@pytest.fixture
def computed(tmp_path, monkeypatch):
    """A function that computes a study in this process, stores it in the folder ``data``, and returns that folder."""
    from dragon_studies.dataset import part_of, writing
    from dragon_studies.definition import load_study
    from dragon_studies.rows import rows_of

    def compute(text, rows=None):
        monkeypatch.chdir(tmp_path)
        (tmp_path / 'study.yaml').write_text(text)
        study = load_study('./study.yaml')
        count = study.rows if rows is None else rows
        with writing(tmp_path / 'data', study) as data:
            data.write(0, count, part_of(study, rows_of(study, range(count))))
        return tmp_path / 'data'
    return compute


def drawn(folder):
    return sorted(path.name for path in folder.iterdir() if path.suffix in ('.png', '.svg'))


def test_a_study_is_computed_drawn_and_not_computed_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'study.yaml').write_text(GRID)
    assert main(['study', './study.yaml', '--output', 'data', '--workers', '1', '--plot']) == 0
    first = capsys.readouterr().out
    assert 'data: 6 of 6 rows (6 ok)' in first
    assert drawn(tmp_path / 'data') == ['contact_t_s.png', 'contact_t_s.svg', 'lock_t_s.png', 'lock_t_s.svg']
    monkeypatch.setattr('dragon_studies.run.rows_of', None)      # no row is computed again
    assert main(['study', 'data', '--format', 'json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['statuses'] == {'ok': 6, 'refused': 0, 'over_budget': 0, 'failed': 0}
    assert found['answers']['lock_t_s']['count'] == 6


@pytest.mark.parametrize(('text', 'rows', 'said'), [
    pytest.param(RANDOM.replace('DESIGN', 'random'), None, 'needs 2,995 rows', marks=pytest.mark.long),
    pytest.param(RANDOM.replace('DESIGN', 'sobol'), 9, 'data: 9 of 16 rows', marks=pytest.mark.long),
    (RANDOM.replace('DESIGN', 'saltelli'), None, 'data: 64 of 64 rows'),
    (CURVE, None, 'data: 5 of 5 rows')])
def test_each_design_has_its_picture_and_drawing_it_needs_no_dask(computed, capsys, monkeypatch, request, text, rows,
                                                                  said):
    folder = computed(text, rows)
    monkeypatch.setitem(sys.modules, 'dragon_studies.run', None)
    assert main(['study', 'data', '--plot']) == 0
    assert said in capsys.readouterr().out
    assert drawn(folder) == ['lock_t_s.png', 'lock_t_s.svg']
    if text != CURVE and not request.config.getoption('--long'):
        return      # one picture drawn twice is enough
    before = {name: (folder / name).read_bytes() for name in drawn(folder)}
    assert main(['study', 'data', '--plot']) == 0
    assert {name: (folder / name).read_bytes() for name in drawn(folder)} == before


def test_lists_in_any_order_give_the_picture_of_sorted_lists(computed):
    from dragon_studies.dataset import open_set
    from dragon_studies.pictures import pictures
    text = 'set: {dragon: {benches: 3}}\nvary: {track.pitch_m: PITCHES, dragon.hole_inset_m: INSETS}\nask: [lock]'
    maps, curves = [], []
    for name, pitches, insets in (('sorted', '[0.5, 0.55, 0.6]', '[0.2, 0.25]'),
                                  ('not', '[0.6, 0.5, 0.55, 0.5]', '[0.25, 0.2]')):
        for drawn_as, list_of in ((maps, insets), (curves, '[0.2]')):
            folder = computed(text.replace('PITCHES', pitches).replace('INSETS', list_of))
            ((_, figure),) = pictures(open_set(folder))
            drawn_as.append(figure.axes[0])
            folder.rename(folder.with_name(f'{name} {list_of}'))
    one, other = (axes.collections[0] for axes in maps)
    assert np.array_equal(one.get_coordinates(), other.get_coordinates())
    assert np.array_equal(one.get_array(), other.get_array())
    assert np.ptp(one.get_array()) > 1
    one, other = (np.unique(axes.lines[0].get_xydata(), axis=0) for axes in curves)
    assert np.array_equal(one, other)
    assert np.all(np.diff(curves[1].lines[0].get_xdata()) >= 0)


def test_a_map_shows_the_first_values_of_other_keys_that_have_answers_and_names_them(computed):
    from dragon_studies.dataset import open_set
    from dragon_studies.pictures import pictures
    folder = computed('set: {dragon: {benches: 24}, run: {start_s: 411}}\n'
                      'vary: {dragon.width_m: [0.29, 0.3], accuracy: [exact, fine], run.stop_s: [412, 413]}\n'
                      'ask: [contact]')
    ((name, figure),) = pictures(open_set(folder))
    assert name == 'contact_t_s'
    above, below = figure.axes[:2]
    assert above.get_title(loc='left').endswith('8 rows\nrun.stop_s = 413')
    assert [one.get_text() for one in above.get_yticklabels()] == ['exact', 'fine']
    assert np.all(np.isfinite(above.collections[0].get_array()))
    assert below.get_title(loc='left') == 'which benches touch first'


@pytest.mark.parametrize('text', [
    RANDOM.replace('DESIGN', 'saltelli').replace('samples: 16', 'samples: 8'),
    pytest.param(RANDOM.replace('DESIGN', 'random').replace('samples: 16', 'samples: 7'), marks=pytest.mark.long)])
def test_too_few_rows_for_a_picture_are_said(computed, capsys, text):
    folder = computed(text)
    assert main(['study', 'data', '--plot']) == 0
    assert re.search('study: nothing is drawn: .* a distribution 8 such rows, and Sobol indices all rows of 16 or more',
                     capsys.readouterr().err)
    assert drawn(folder) == []


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='the system has no /dev/full')
def test_a_summary_that_cannot_be_written_is_one_line(computed, monkeypatch, capsys):
    computed(CURVE)
    with open('/dev/full', 'w') as full:
        monkeypatch.setattr('sys.stdout', full)
        assert main(['study', 'data', '--plot']) == 2
    assert capsys.readouterr().err == 'study: standard output cannot be written: No space left on device\n'


def test_rows_that_are_refused_are_counted_with_their_reason_and_left_out_of_pictures(computed, capsys):
    folder = computed('set: {dragon: {benches: 3}}\nvary: {track.pitch_m: [-1, 0.5, 0.6]}\nask: [lock]')
    assert main(['study', 'data', '--plot']) == 0
    out = capsys.readouterr().out
    assert 'data: 3 of 3 rows (2 ok, 1 refused)' in out
    assert '1 row: scene: scene: track.pitch_m: -1' in out
    assert drawn(folder) == ['lock_t_s.png', 'lock_t_s.svg']


def test_the_rows_of_a_study_are_arrays_in_python(computed):
    import dragon_studies
    folder = computed(RANDOM.replace('DESIGN', 'random'))
    rows = dragon_studies.study(folder)
    assert len(rows) == 16
    assert rows['lock_t_s'].shape == (16,)
    assert dragon_studies.study('./study.yaml', output=folder).table == rows.table
    with pytest.raises(InputError, match='give the folder for the rows'):
        dragon_studies.study('./study.yaml')


@pytest.mark.parametrize(('arguments', 'said'), [
    (['nothing', '--output', 'x'], "study: no study is called 'nothing'; the studies are pitch_map, tolerances"),
    (['pitch_map'], 'study: --output: it is missing; give a folder'),
    (['no_such_folder'], "study: no study is called 'no_such_folder'; the studies are "),
    (['.'], 'study.yaml: cannot be read'),
    (['.', '--output', 'x'], '--output: the folder of a study is its own output'),
    (['pitch_map', '--output', 'x', '--samples', '3'],
     'samples: 3 is not valid: the number of points of a grid is fixed at 77'),
    (['tolerances', '--output', 'x', '--samples', '0'], '--samples: 0'),
    (['tolerances', '--output', 'x', '--workers', '0'], '--workers: 0'),
    (['tolerances', '--output', 'x', '--workers', '2', '--scheduler', 'tcp://127.0.0.1:9'], 'has its own workers'),
    (['./nothing.yaml', '--output', 'x'], 'nothing.yaml: cannot be read')])
def test_a_mistake_is_one_line_and_exit_code_2(tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert main(['study', *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count('\n') == 1


def test_a_scheduler_is_named_before_it_is_asked(tmp_path, capsys):
    pytest.importorskip('distributed')
    assert main(['study', 'tolerances', '--output', str(tmp_path / 'x'), '--scheduler', 'nonsense://']) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first == 'study: connecting to nonsense://'
    assert 'cannot be reached' in second


@pytest.mark.parametrize(('name', 'options', 'extra'), [
    ('pyarrow', [], 'study'), ('distributed', ['--scheduler', 'tcp://127.0.0.1:9'], 'cluster')])
def test_a_missing_library_is_named_with_the_cure(tmp_path, name, options, extra):
    program = tmp_path / 'program.py'
    program.write_text(f'import sys\nfrom dragon_ros.__main__ import main\nsys.modules[{name!r}] = None\n'
                       f'assert main(["study", "pitch_map", "--output", "there", *{options}]) == 2\n')
    with Forked([], os.environ, tmp_path, program=program) as process:
        text, _ = process.communicate(timeout=60)
    assert process.poll() == 0, text
    assert f'{name}: it is not installed, but ' in text
    assert f"pip install 'dragon_ros[{extra}]'" in text
    assert 'Traceback' not in text


@pytest.mark.parametrize(('given', 'says'), [
    ({'output': 'file/rows'}, 'output file/rows: cannot be written: Not a directory'),
    ({'output': 'rows', 'workers': 0}, 'workers: 0 is not valid'),
    ({'output': 'rows', 'workers': 1, 'scheduler': 'a:1'}, 'workers: a running cluster has its own workers')])
def test_errors_of_the_function_name_its_arguments(tmp_path, monkeypatch, given, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').touch()
    with pytest.raises(InputError) as error:
        dragon_studies.study('tolerances', samples=2, **given)
    assert str(error.value).startswith(says)
