"""The figures of ``cost --scene``, its notes on parts that do not apply, its formats and its requirements."""
import json
import subprocess
import sys

import numpy as np
import pictures
import pytest
from properties import thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.cost import accuracy, bags, costs
from dragon_ros.cost.command import main
from dragon_ros.cost.picture import picture
from dragon_ros.scenes.load import load_scene

SOON = 0.01
SMALL = ['dragon.benches=12', 'run.stop_s=2']


def quiet(what):
    pass


def measured(name, overrides=()):
    return costs.measure(load_scene(name, [*SMALL, *overrides]), name, SOON, quiet)


@pytest.fixture(scope='module')
def winding():
    return measured('winding')


@pytest.mark.parametrize('name', ['winding', 'turning', 'unwinding'])
def test_table_and_march_keep_the_promise(name):
    rows = {row.name: row for row in accuracy.measure(load_scene(name, SMALL), SOON, quiet).solvers}
    for row in (rows['table'], rows['march']):
        assert 0 <= row.error_m <= row.promise_m
        assert row.positions.median_s > 0
        assert row.with_velocities.median_s > 0
    assert rows['table'].speed_error_m_s < 1e-12


def test_the_paper_and_simple_solvers_stand_beside_table_and_march(winding):
    rows = {row.name: row for row in winding.accuracy.solvers}
    assert rows['paper'].error_m > 0.01
    assert rows['paper'].promise_m is None
    assert 1e-12 < rows['plain Newton 1e-3 rad'].error_m < 1e-2
    assert rows['plain Newton 1e-3 rad'].with_velocities is None


def test_solvers_of_one_spiral_have_a_note_on_other_tracks():
    rows = {row.name: row for row in accuracy.measure(load_scene('turning', SMALL), SOON, quiet).solvers}
    for name in ('paper', 'plain Newton 1e-6 rad'):
        assert 'one spiral, led by the head' in rows[name].note
        assert rows[name].positions is None


def test_the_effects_of_the_scene_are_told_from_the_others(winding):
    rows = {row['effect']: row for row in costs.values_of(winding)['effects']}
    assert [name for name, row in rows.items() if row['in_scene']] == ['velocity', 'benches']
    assert rows['accelerations']['tick_s'] > 0
    assert rows['accelerations']['bytes'] > 0


def test_a_contact_is_found_or_cut_off_and_says_so():
    scene = Scene(dragon=Dragon(20))
    found = costs.search(scene, 100.0)
    assert found.complete
    assert 'contact at 412.473837682 s, benches 0 and 8' in found.found
    cut = costs.search(scene, 0.0)
    assert (cut.complete, cut.states < found.states) == (False, True)
    assert 'stopped after 0 s' in cut.found
    none = costs.search(Scene(dragon=Dragon(20), run=Run(0, 10)), 100.0)
    assert 'no contact; the run stops at 10' in none.found


def test_a_bag_has_as_many_ticks_as_fit_its_time_and_is_removed(tmp_path, monkeypatch):
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    monkeypatch.setattr(bags.tempfile, 'tempdir', None)
    scene = load_scene('winding', ['dragon.benches=12'])
    rows = bags.measure(scene, 0.0, quiet)
    assert [row.compression for row in rows] == ['zstd', 'lz4', 'none']
    assert {row.ticks for row in rows} == {rows[0].ticks}
    assert 1 < rows[0].ticks < compile_scene(scene).last_tick
    assert rows[2].file_bytes > rows[2].message_bytes == rows[0].message_bytes
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('name', thinned(['winding', 'turning'], lambda name: name == 'winding'))
def test_the_picture_is_readable(winding, name, tmp_path, request):
    from dragon_ros.cli import figures

    with np.errstate(all='warn'), figures.style(log_ticks=True):
        save = pictures.readable(figures.save, request.config.getoption('--long'))
        paths = save(picture(winding if name == 'winding' else measured(name)), tmp_path / 'costs')
    assert all(path.stat().st_size for path in paths)


def test_json_is_strict_and_text_has_every_row(winding):
    values = json.loads(json.dumps(costs.values_of(winding), allow_nan=False))
    text = costs.text_of(winding)
    for row in values['accuracy']['solvers']:
        assert f'  {row["solver"]} ' in text
    assert values['ticks'] == 101
    assert values['bags'][0]['bytes_per_tick'] > 0
    assert set(values['contact']) == {'elapsed_s', 'states', 'complete', 'found'}


def test_a_led_dragon_is_refused_in_one_line_with_the_cure(capsys):
    assert main(['--scene', 'led']) == 2
    error = capsys.readouterr().err
    assert 'head.kind=constant' in error
    assert len(error.splitlines()) == 1


def test_without_arguments_both_uses_are_explained(capsys):
    assert main([]) == 2
    out = capsys.readouterr().out
    assert 'cost --scene NAME' in out
    assert './dragon cost PAGE' in out


def test_a_file_that_cannot_be_written_is_refused_before_measuring(tmp_path, capsys):
    assert main(['--scene', 'winding', '--output', str(tmp_path / 'no' / 'x.png')]) == 2
    assert 'there is no folder' in capsys.readouterr().err


@pytest.mark.long
def test_an_install_needs_neither_scipy_nor_mpmath_nor_the_checkout(tmp_path):
    code = ('import sys\n'
            'for name in ("scipy", "mpmath", "benchmarks", "hard_cases", "rclpy"): sys.modules[name] = None\n'
            'from dragon_ros.cost.command import main\n'
            'sys.exit(main(["--scene", "winding", "--set", "dragon.benches=5", "--set", "run.stop_s=1", "--budget", '
            '"0.01", "--format", "json", "--output", "costs.png"]))')
    done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)['benches'] == 5
    assert (tmp_path / 'costs.png').stat().st_size
