"""The public Python API: the names of ``import dragon_ros as dr``, and the examples on its page."""
import copy
import json
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapely import polygons

import dragon_ros as dr
from dragon_ros.__main__ import main
from dragon_ros.core.errors import DragonError, InputError, MissingError, ModelEnd
from dragon_ros.core.step import state
from dragon_ros.scenes.load import load_scene

PAGE = (Path(__file__).parents[1] / 'docs' / 'python.md').read_text()


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / 'run.mcap'
    settings = [part for one in ('dragon.benches=12', 'run.stop_s=0.2') for part in ('--set', one)]
    assert main(['simulate', '--scene', 'winding', *settings, '--output', str(path)]) == 0
    return path


def test_every_example_of_its_page_runs(bag, monkeypatch):
    monkeypatch.chdir(bag.parent)
    __import__('matplotlib').use('agg')
    names: dict = {}
    for block in re.findall(r'```python\n(.*?)```', PAGE, re.S):
        exec(compile(block, 'docs/python.md', 'exec'), names)
    assert names['found'].benches == (0, 8)
    assert names['found'].t_s == pytest.approx(412.473837682115, abs=1e-9)
    assert names['motion'].handles_m.shape == (11, 13, 2)


def test_importing_the_package_imports_nothing_else():
    code = 'import sys, dragon_ros; print([n for n in sys.modules if n.startswith(("dragon_ros.", "numpy"))])'
    assert subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True).stdout == '[]\n'
    assert set(dr.__all__) <= set(dir(dr))
    with pytest.raises(AttributeError, match='no attribute'):
        _ = dr.nothing


def test_changes_are_those_of_a_scene_file():
    assert dr.scene('winding', track={'pitch_m': 0.5}) == load_scene('winding', ['track.pitch_m=0.5'])
    line = {'kind': 'joined', 'pieces': ({'kind': 'line', 'length_m': 500},), 'start_m': 400}
    straight = dr.scene('winding', track=line, dragon={'benches': 5}, accuracy='fine', run={'stop_s': 10})
    assert (straight.dragon.benches, straight.accuracy) == (5, 'fine')
    assert pickle.loads(pickle.dumps(straight)) == straight
    assert dr.compile(straight).state(1.0).handles_m[0] == pytest.approx((401, 0))


@pytest.mark.parametrize(('changes', 'said'), [
    ({'track': {'pitch_m': -1}}, 'track.pitch_m'), ({'track': {'pich_m': 1}}, 'did you mean pitch_m'),
    ({'trak': {}}, 'did you mean track'), ({'track': 5}, 'write a mapping')])
def test_a_wrong_change_is_refused_by_its_key(changes, said):
    with pytest.raises(InputError, match=said):
        dr.scene('winding', **changes)


def test_a_scene_that_is_not_there_is_named():
    with pytest.raises(MissingError, match='nowhere'):
        dr.scene('nowhere')


def test_states_are_those_of_the_model():
    run = dr.compile(dr.scene('winding'))
    one, many = run.state(300.0), run.states(np.array([299.0, 300.0]))
    np.testing.assert_array_equal(one.handles_m, state(run.scene, 300.0).p)
    np.testing.assert_allclose(many.handles_m[1], one.handles_m, rtol=0, atol=2 * one.promise_m)
    np.testing.assert_allclose(many.speed_m_s[1], one.speed_m_s, rtol=0, atol=1e-11)
    assert not one.handles_m.flags.writeable
    assert run.frame(3).k == 3
    with pytest.raises(ModelEnd):
        run.state(1e4)


@pytest.mark.parametrize('name', ['winding', 'turning', 'paper'])
def test_batches_have_all_states_and_each_takes_the_memory_of_the_last(name):
    run, times = dr.compile(dr.scene(name)), np.linspace(0.0, 30.0, 7)
    whole, tiny = run.states(times), 2e-11
    seen = [(one.t_s, one.handles_m.copy(), one.velocity_m_s.copy(), one.handles_m.__array_interface__['data'][0])
            for one in run.batches(times, 3)]
    assert [t_s.size for t_s, *_ in seen] == [3, 3, 1]
    assert len({at for *_, at in seen}) == 1
    np.testing.assert_array_equal(np.concatenate([t_s for t_s, *_ in seen]), times)
    np.testing.assert_allclose(np.concatenate([p for _, p, _, _ in seen]), whole.handles_m, rtol=0, atol=tiny)
    np.testing.assert_allclose(np.concatenate([v for _, _, v, _ in seen]), whole.velocity_m_s, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('name', ['winding', 'paper', 'street'])
def test_states_at_no_times_are_empty_with_the_shape_of_the_dragon(name):
    run = dr.compile(dr.scene(name))
    motion, handles = run.states([]), len(run.state(0.0).handles_m)
    assert motion.handles_m.shape == motion.velocity_m_s.shape == (0, handles, 2)
    assert motion.speed_m_s.shape == (0, handles)
    assert repr(motion).startswith('Motion(0 times')
    assert list(run.batches([])) == []


@pytest.mark.parametrize('name', ['winding', 'paper'])
def test_states_fill_the_arrays_that_they_are_given(name):
    run, times = dr.compile(dr.scene(name)), [0.0, 100.0]
    handles, velocity = np.full((2, 2, 224, 2), np.nan)
    motion = run.states(times, (handles, velocity))
    np.testing.assert_array_equal(handles, run.states(times).handles_m)
    np.testing.assert_array_equal(velocity, run.states(times).velocity_m_s)
    assert np.shares_memory(motion.handles_m, handles)
    assert not motion.handles_m.flags.writeable
    assert handles.flags.writeable


@pytest.mark.parametrize('out', [np.empty((2, 3, 2)), np.empty((2, 224, 2), np.float32),
                                 np.empty((2, 2, 224)).swapaxes(1, 2)])
def test_arrays_that_cannot_take_the_states_are_refused(out):
    with pytest.raises(InputError, match=r'out: .*the result has shape \(2, 224, 2\); give a writable array'):
        dr.compile(dr.scene('winding')).states([0.0, 1.0], (out, out.copy(order='K')))


def test_a_table_needs_pandas_and_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(MissingError, match='pip install pandas'):
        dr.compile(dr.scene('winding')).state(0.0).frame()


def test_a_bag_is_its_ticks_and_its_scene(bag):
    with dr.read_bag(bag) as recorded:
        assert recorded.scene.dragon.benches == 12
        motion = recorded.arrays()
    np.testing.assert_array_equal(motion.handles_m[3], dr.compile(recorded.scene).frame(3).chain.p)


def test_a_scene_draws_itself():
    run = dr.compile(dr.scene('winding', dragon={'benches': 20}, run={'stop_s': 5}))
    drawn = run._repr_svg_()
    assert drawn.lstrip().startswith('<?xml')
    assert '<svg' in drawn


WINDING = dr.scene('winding')
MISUSES = {
    "dr.compile('winding')": "write dr.scene('winding')", 'dr.scene(3)': 'not a name or a path',
    "dr.scene('winding', dragon=3)": 'write a mapping', 'run.states(5)': 'times_s: 5',
    "run.states(['a'])": 'not a sequence of numbers', 'run.states([[1, 2]])': 'not a sequence of numbers',
    'run.state([1, 2])': 't_s: [1, 2] is not valid: it is a list', "run.state('x')": 'it is text, not a number',
    "run.state(float('nan'))": 'it is not finite', 'run.frame(2.5)': 'k: 2.5', "run.frame('a')": 'k: ',
    'run.frame(-1)': 'k: -1', 'run.track_m(-1)': 'sag_m: -1', 'next(run.batches([1.0], size=0))': 'size: 0',
    "run.plot('a')": 't_s: ', 'dr.plot(3)': "write dr.scene('winding')", 'dr.read_bag(3)': 'path: 3',
    "dr.read_bag('nowhere.mcap')": 'nowhere.mcap', "dr.design.fit('winding')": "write dr.scene('winding')",
    'dr.design.fit(run, within_m=-1)': 'within_m: -1', 'dr.design.max_speed(3)': 'scene: 3',
    "dr.design.min_pitch('x')": "dragon: 'x'", "dr.design.min_pitch(diameter_m='a')": 'diameter_m: ',
    "dr.design.min_pitch(dr.scene('street'))": 'dragon: ',
    'dr.design.turn(run)': 'track.kind: '}


@pytest.mark.parametrize('call', MISUSES)
def test_a_misuse_is_a_dragon_error_that_names_what_is_wrong(call):
    with pytest.raises(DragonError) as error:
        eval(call, {'dr': dr, 'run': dr.compile(WINDING)})
    assert MISUSES[call] in str(error.value)


def test_numbers_of_numpy_are_numbers():
    scene = dr.scene('winding', dragon={'benches': np.int64(5)}, track={'pitch_m': np.float32(0.5)})
    assert (scene.dragon.benches, scene.track.pitch_m) == (5, 0.5)
    run = dr.compile(scene)
    assert run.frame(np.int16(3)).k == 3
    assert run.state(np.float64(1.0)).t_s == 1.0


def test_a_contact_is_true_and_none_is_false():
    assert dr.compile(dr.scene('first_contact')).contact()
    none = dr.compile(dr.scene('winding', dragon={'benches': 5}, run={'stop_s': 5})).contact()
    assert isinstance(none, dr.NoContact)
    assert not none


def test_what_is_returned_fits_a_screen_as_text():
    run = dr.compile(dr.scene('winding', run={'stop_s': 5}))
    for result in (run, run.state(1.0), run.states([1.0, 2.0]), run.frame(3), run.frame(3).chain, run.contact(),
                   dr.design.fit(run), dr.design.turn(dr.scene('turning'))):
        assert len(repr(result)) < 2000


def test_only_public_names_are_listed():
    assert dir(dr) == sorted([*dr.__all__, '__version__'])
    assert {'InputError', 'DragonError', 'FieldError', 'ModelEnd', 'Contact', 'NoContact'} <= set(dr.__all__)


def test_the_speed_of_the_leader_under_a_limit_is_that_of_the_command(capsys):
    assert main(['design', 'max-speed', '--set', 'dragon.benches=24', '--limit', '2', '--format', 'json']) == 0
    said = json.loads(capsys.readouterr().out)
    fastest = dr.design.max_speed(dr.scene('turning', dragon={'benches': 24}))
    assert fastest.leader_m_s(2.0) == (said['speed_m_s'], said['uncertainty_m_s'])
    with pytest.raises(InputError, match='limit_m_s: 0'):
        fastest.leader_m_s(0)


def test_the_smallest_pitch_of_a_scene_starts_where_the_scene_does_as_in_the_command(capsys):
    options = ['--set', 'dragon.benches=24', '--set', 'track.start_turns=11', '--within', '1e-3', '--format', 'json']
    assert main(['design', 'min-pitch', '--scene', 'winding', *options]) == 0
    said = json.loads(capsys.readouterr().out)
    scene = dr.scene('winding', dragon={'benches': 24}, track={'start_turns': 11})
    found = dr.design.min_pitch(scene, within_m=1e-3)
    assert (found.low_m, found.high_m, found.states) == (said['low_m'], said['high_m'], said['states'])
    assert found.states != dr.design.min_pitch(scene.dragon, within_m=1e-3).states


def test_the_turn_is_that_of_the_command(capsys):
    assert main(['design', 'turn', '--format', 'json']) == 0
    said = json.loads(capsys.readouterr().out)
    found = dr.design.turn(dr.scene('turning'))
    assert (found.length_m, found.smallest_diameter_m) == (said['length_m'], said['smallest_diameter_m'])


def test_speeds_are_computed_once():
    motion = dr.compile(WINDING).state(10.0)
    assert motion.speed_m_s is motion.speed_m_s
    np.testing.assert_allclose(motion.speed_m_s, np.hypot(*motion.velocity_m_s.T), rtol=1e-15)


@pytest.mark.parametrize('name', ['winding', 'turning'])
def test_a_pickled_frame_has_the_size_of_its_arrays(name):
    frame = dr.compile(dr.scene(name)).frame(200)
    data = pickle.dumps(frame)
    again = pickle.loads(data)
    assert len(data) < 12 * frame.chain.p.nbytes
    np.testing.assert_array_equal(again.chain.p, frame.chain.p)
    np.testing.assert_array_equal(again.velocity_m_s, frame.velocity_m_s)
    assert again.chain.solver == frame.chain.solver
    np.testing.assert_allclose(again.chain.velocities(1.0), frame.chain.velocities(1.0), rtol=0, atol=1e-12)


@pytest.mark.parametrize('name', ['winding', 'turning', 'mixed', 'street'])
def test_a_compiled_scene_is_pickled_and_copied_after_it_was_used(name):
    run = dr.compile(dr.scene(name))
    handles_m = run.state(1.0).handles_m
    run.states([0.0, 1.0])
    for other in (pickle.loads(pickle.dumps(run)), copy.copy(run), copy.deepcopy(run)):
        assert other.scene == run.scene
        assert np.array_equal(other.state(1.0).handles_m, handles_m)


def test_buffers_that_overlap_are_refused():
    run, room = dr.compile(dr.scene()), np.empty((3, 224, 2))
    for overlapping in (room[:2], room[1:]):
        with pytest.raises(dr.FieldError, match='out: .* they share memory; give separate arrays'):
            run.states([0.0, 60.0], (room[:2], overlapping))
    both = np.empty((2, 2, 224, 2))
    motion = run.states([0.0, 60.0], (both[0], both[1]))
    assert np.array_equal(motion.handles_m[1], run.states([60.0]).handles_m[0])


def test_errors_name_arguments_and_not_the_options_of_commands(bag, tmp_path):
    with pytest.raises(dr.InputError, match='none in namespace left'):
        dr.read_bag(bag, namespace='left')


def test_handles_alone_are_those_of_states():
    run = dr.compile(dr.scene('winding', dragon={'benches': 20}))
    np.testing.assert_array_equal(run.handles_m([0.0, 7.5]), run.states([0.0, 7.5]).handles_m)


def test_gaps_vanish_at_the_contact_and_have_a_sign():
    run = dr.compile(dr.scene('winding'))
    found = run.contact()
    p = run.handles_m([found.t_s - 0.1, found.t_s, found.t_s + 0.1])
    first, second = found.benches
    apart = dr.gaps(p, [first, second, 0], [second, first, 20])
    assert apart.shape == (3, 3)
    assert apart[0, 0] > 1e-3 > 1e-8 > abs(apart[1, 0]) > 0 > -1e-3 > apart[2, 0]
    np.testing.assert_allclose(apart[:, 0], apart[:, 1], atol=1e-12)
    assert (apart[:, 2] > 0.5).all()
    wide = dr.gaps(p[1], [first], [second], width_m=0.5)
    assert (wide.shape, bool(wide < -0.1)) == ((1,), True)


def test_a_turn_is_walked_from_its_entry():
    scene = dr.scene('turning')
    points, headings = dr.design.turn_poses(scene.track, [-100.0, 0.0, 13.0, 100.0])
    np.testing.assert_allclose(points, dr.compile(scene).handles_m([0.0, 100.0, 113.0, 200.0])[:, 0], atol=1e-11)
    np.testing.assert_allclose(np.hypot(*headings.T), 1.0, atol=1e-14)


def test_benches_and_places_along_the_track_are_those_of_the_handles():
    run = dr.compile(dr.scene('street', dragon={'benches': 12}, run={'stop_s': 60}, effects=['benches']))
    times = [0.0, 30.0, 60.0]
    at_m, handles_m = run.along_m(times), run.handles_m(times)
    points, headings = run.track_poses(at_m.ravel())
    np.testing.assert_allclose(points, handles_m.reshape(-1, 2), atol=1e-9)
    np.testing.assert_allclose(np.hypot(headings[..., 0], headings[..., 1]), 1, atol=1e-12)
    np.testing.assert_allclose(at_m[:, 0], run.scene.track.start_m + np.array(times), atol=1e-9)
    np.testing.assert_allclose(run.benches_m(times)[0], run.frame(0).benches.corners, atol=1e-12)
    assert (run.benches_m([]).shape, run.along_m([]).shape, run.track_poses([])[0].shape) == (
        (0, 12, 4, 2), (0, 13), (0, 2))
    for wrong in ([np.nan], [1e9], [-1e9], ['x'], 5.0):
        with pytest.raises(dr.FieldError, match='along_m'):
            run.track_poses(wrong)


def test_the_swept_area_holds_all_benches_and_the_room_is_its_width():
    run = dr.compile(dr.scene('street', dragon={'benches': 12}, run={'stop_s': 60}))
    room = dr.design.room(run)
    benches = polygons(run.benches_m(np.linspace(0, 60, 40)).reshape(-1, 4, 2))
    assert all(room.area.whole.buffer(1e-3).contains(benches))
    assert room.area.whole.area == pytest.approx(np.sum(room.left_m + room.right_m), rel=0.03)
