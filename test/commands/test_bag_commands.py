"""The output, files and exit codes of the commands inspect, export, simulate and table for bags."""
import csv
import json
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

import dragon_ros as dr
from dragon_ros.__main__ import main
from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.frames import scene_of_bag
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.configuration import folder as configuration_folder
from dragon_ros.core.batches import states
from dragon_ros.core.errors import shown
from dragon_ros.core.flags import Effect, effects_of
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import PoseArrayTemplate, Writer, float64_of, string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import read_marker_array, read_multi_array, read_pose_array
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.provenance import RECORD, run_metadata, scene_file

CORPUS = Path(__file__).parents[1] / 'data' / 'corpus'
MADE_BY_0_1_0 = CORPUS.parent / 'made_by_0_1_0.mcap'
MADE_BY_0_2_0 = CORPUS.parent / 'made_by_0_2_0' / 'run.mcap'
SCENE = ('--scene', 'first_contact', '--set', 'run.start_s=412.2', '--set', 'run.stop_s=412.7')
TICKS = 26


def run(capsys, *arguments):
    code = 0
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as stop:
        code = stop.code
    out, err = capsys.readouterr()
    return code, out, err


def messages(path):
    with BagReader(path) as bag:
        return [(m.topic, m.t_ns, m.sequence, m.data) for m in bag.messages()]


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'run.mcap'
    assert main(['simulate', *SCENE, '--output', str(path)]) == 0
    return path


@pytest.mark.parametrize(('name', 'options'), [
    ('a.mcap', ['--compression', 'none']), ('b.mcap', ['--compression', 'lz4']), ('folder', [])])
def test_a_simulated_bag_has_the_same_messages_in_every_form(capsys, tmp_path, bag, name, options):
    assert run(capsys, 'simulate', *SCENE, *options, '--output', tmp_path / name)[0] == 0
    assert messages(tmp_path / name) == messages(bag)
    assert run(capsys, 'inspect', tmp_path / name, '--check')[0] == 0


def test_a_simulated_bag_is_the_same_file_again(capsys, tmp_path, bag):
    assert run(capsys, 'simulate', *SCENE, '--output', tmp_path / 'again.mcap')[0] == 0
    assert (tmp_path / 'again.mcap').read_bytes() == bag.read_bytes()


@pytest.fixture
def of_rosbag2(tmp_path):
    """The bag of a sim as rosbag2 records it: with wall times, out of order, and with the scene only as a message."""
    scene = Scene(run=Run(412.2, 412.7))
    encode, path, wall_ns = encoders(scene, 'sea'), tmp_path / 'rosbag2.mcap', 1_800_000_000 * 10**9
    with BagWriter(path) as bag:
        for name in (*encode, 'scene', 'clearance/marker'):
            bag.add_channel(f'/red/{name}', channels()[name])
        bag.write('/red/scene', string_message(scene_file(scene, {'frame_id': 'sea'})), wall_ns, 1)
        for k in range(TICKS):
            frame = tick(scene, k)
            for late_ns, name in enumerate(encode):
                bag.write(f'/red/{name}', encode[name](frame), wall_ns + k * 20_000_000 + late_ns * 15_000_000, k + 1)
            if k % 5 == 0:      # at most ten times per second
                bag.write('/red/clearance/marker', bytes(64), wall_ns + k * 20_000_000, k + 1)
    return path


def test_a_rosbag2_recording_with_its_scene_is_checked_bit_for_bit(capsys, of_rosbag2):
    code, out, _ = run(capsys, 'inspect', of_rosbag2, '--check')
    assert code == 0, out
    assert f'{3 * TICKS} messages are bit-identical to the model, 0 are not' in out
    code, out, _ = run(capsys, 'inspect', of_rosbag2, '--format', 'json')
    values = json.loads(out)
    assert values['scene']['run']['start_s'] == 412.2
    assert all(not row['missing'] for row in values['topics'])


def test_what_is_not_published_each_tick_is_not_missing(capsys, tmp_path):
    scene, path = Scene(run=Run(0, 2), effects=Effect.NONE), tmp_path / 'a.mcap'
    with BagWriter(path) as bag:
        bag.describe(RECORD, run_metadata(scene_file(scene), scene, {}))
        for name, every in (('handles', 1), ('clearance/marker', 5), ('clearance', 1)):
            bag.add_channel(f'/dragon/{name}', channels()[name])
            for k in range(0, 101, every):
                t_ns = scene.run.time_ns(k + (name == 'clearance' and 30 < k < 50))     # guessed, as it has no stamp
                bag.write(f'/dragon/{name}', encoders(scene)['handles'](tick(scene, k)), t_ns, k + 1)
    _, out, _ = run(capsys, 'inspect', path, '--format', 'json', '--looks', '1')
    rows = {row['topic']: row for row in json.loads(out)['topics']}
    assert (rows['/dragon/handles']['missing'], rows['/dragon/handles']['last_tick']) == (0, 100)
    for name in ('clearance/marker', 'clearance'):
        assert (rows[f'/dragon/{name}']['missing'], rows[f'/dragon/{name}']['doubled']) == (None, None)


def test_a_bag_is_never_overwritten_by_simulate_unasked(capsys, bag):
    before = bag.read_bytes()
    code, _, err = run(capsys, 'simulate', *SCENE, '--output', bag)
    assert (code, bag.read_bytes()) == (2, before)
    assert '--force' in err


def test_a_scene_that_cannot_be_simulated_costs_no_bag_that_was_to_be_replaced(capsys, tmp_path, bag):
    path = tmp_path / 'kept.mcap'
    path.write_bytes(bag.read_bytes())
    code, _, said = run(capsys, 'simulate', '--set', 'head.kind=commanded', '--set', 'run.stop_s=2', '--force',
                        '--output', str(path))
    assert code == 2
    assert 'head.kind' in said
    assert path.read_bytes() == bag.read_bytes()


def test_simulate_that_is_interrupted_leaves_a_whole_bag(tmp_path):
    path = tmp_path / 'cut.mcap'
    child = subprocess.Popen([sys.executable, '-m', 'dragon_ros', 'simulate', '--output', path], stderr=subprocess.PIPE,
                             text=True)
    end = time.monotonic() + 60
    while not (path.exists() and path.stat().st_size > 10**6):
        assert time.monotonic() < end
        assert child.poll() is None
        time.sleep(0.01)
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 1
    assert 'ticks' in err
    assert 'Traceback' not in err
    with BagReader(path) as bag:
        counts = {topic.name: topic.messages for topic in bag.topics}
    assert counts['/dragon/handles'] == counts['/dragon/benches'] > 10


def test_inspect_shows_topics_scene_contact_and_clearance(capsys, bag):
    code, out, _ = run(capsys, 'inspect', bag, '--format', 'json', '--looks', '0')
    values = json.loads(out)
    assert code == 0
    rows = {row['topic']: row for row in values['topics']}
    assert {name: row['messages'] for name, row in rows.items()} == {
        '/dragon/scene': 1, '/dragon/track': 1,
        **{f'/dragon/{name}': TICKS for name in ('handles', 'benches', 'velocities')}}
    assert rows['/dragon/handles']['rate_hz'] == pytest.approx(50)
    assert (rows['/dragon/handles']['missing'], rows['/dragon/handles']['doubled']) == (0, 0)
    assert values['scene']['run']['start_s'] == 412.2
    assert (values['start_s'], values['end_s']) == (412.2, 412.7)
    contact = values['first_contact']
    assert (contact['source'], contact['benches'], contact['in_bag']) == ('scene', [0, 8], True)
    assert contact['t_s'] == pytest.approx(412.473837682, abs=1e-8)
    gaps = dict(zip(values['clearance']['t_s'], values['clearance']['gap_m'], strict=True))
    assert len(gaps) == TICKS
    assert gaps[412.46] > 0 > gaps[412.48]
    text = run(capsys, 'inspect', bag)[1]
    assert 'benches 0 and 8 at 412.47383768' in text
    assert 'every length, index and CRC is correct' in text


@pytest.mark.parametrize('command', [['inspect'], ['inspect', '--check'], ['table'], ['export', '--output', 'a.csv']])
def test_the_dragon_of_a_bag_is_named_with_or_without_its_slash_and_one_that_is_not_there_is_refused(
        capsys, tmp_path, monkeypatch, bag, command):
    monkeypatch.chdir(tmp_path)
    name, *options = command
    for namespace in ('dragon', '/dragon'):
        assert run(capsys, name, bag, *options, '--namespace', namespace)[0] == 0
        Path('a.csv').unlink(missing_ok=True)
    code, out, err = run(capsys, name, bag, *options, '--namespace', 'left')
    assert (code, out) == (2, '')
    assert '1 dragon (/dragon); none in --namespace left' in err


def test_a_clearance_is_taken_from_the_bag_only_with_the_stamp_of_its_tick(capsys, tmp_path):
    """The bag has wall times, as from other recorders, and a topic without stamps that an old version logged late."""
    with BagWriter(tmp_path / 'a.mcap') as out:
        for name in ('handles', 'clearance', 'clearance/stamped'):
            out.add_channel(f'/dragon/{name}', channels()[name])
        for n, gap_m in enumerate((0.25, 0.125)):
            writer = Writer()
            writer.header('dragon', 10**9 * n)
            writer.put('d', gap_m, 0.0, 0.0)
            out.write('/dragon/clearance', float64_of(-1.0), 50 * 10**9, n)
            out.write('/dragon/clearance/stamped', bytes(writer.finish()), 50 * 10**9 + n, n)
        handles = PoseArrayTemplate(3, 'dragon').encode(0, np.eye(3, 2), np.eye(2))
        out.write('/dragon/handles', handles, 50 * 10**9, 1)
    found = json.loads(run(capsys, 'inspect', tmp_path / 'a.mcap', '--format', 'json')[1])['clearance']
    assert (found['source'], found['t_s'], found['gap_m']) == ('clearance/stamped', [0.0, 1.0], [0.25, 0.125])
    assert '125.000000 mm at 1.000000000 s (from the topic clearance/stamped)' in run(
        capsys, 'inspect', tmp_path / 'a.mcap')[1]


def test_inspect_examines_no_more_ticks_than_requested(capsys, bag):
    found = json.loads(run(capsys, 'inspect', bag, '--format', 'json', '--looks', '5')[1])['clearance']
    assert (found['looks'], found['ticks'], len(found['gap_m'])) == (5, TICKS, 5)
    assert (found['t_s'][0], found['t_s'][-1]) == (412.2, 412.7)


OTHER_MACHINE = {'about.cpu_features': 'MMX2'}


def changed(bag, path, change, made=MappingProxyType({})):
    """Rewrite a bag with the messages that ``change`` returns, and with the metadata ``made`` added."""
    with BagReader(bag) as old, BagWriter(path) as new:
        new.describe('dragon_ros', old.metadata('dragon_ros') | made)
        from dragon_ros.messages.channels import channels
        for topic in old.topics:
            new.add_channel(topic.name, channels()[topic.name.removeprefix('/dragon/')])
        for message in old.messages():
            for data in change(message):
                new.write(message.topic, data, message.t_ns, message.sequence)
    return path


def test_inspect_names_the_ticks_that_are_missing_and_doubled(capsys, tmp_path, bag):
    def change(m):
        k = round((m.t_ns / 1e9 - 412.2) * 50)
        return [] if m.topic == '/dragon/handles' and k in (3, 4, 9) else [m.data] * (1 + (k == 12))
    path = changed(bag, tmp_path / 'gaps.mcap', change)
    rows = {row['topic']: row for row in json.loads(run(capsys, 'inspect', path, '--format', 'json')[1])['topics']}
    assert rows['/dragon/handles']['missing_ranges'] == [[3, 4], [9, 9]]
    assert (rows['/dragon/handles']['missing'], rows['/dragon/handles']['doubled']) == (3, 1)
    assert (rows['/dragon/benches']['missing'], rows['/dragon/benches']['doubled']) == (0, 1)
    text = run(capsys, 'inspect', path)[1]
    assert '3 MISSING: 3 to 4, 9' in text
    code, out, _ = run(capsys, 'inspect', path, '--check')
    assert code == 1
    assert 'ticks 3 to 4: handles is missing' in out
    assert 'tick 12: benches occurs 2 times' in out


def test_inspect_counts_messages_that_their_type_cannot_hold_and_says_how_many_it_compared(capsys, tmp_path, bag):
    path = changed(bag, tmp_path / 'long.mcap', lambda m: [m.data + bytes(8 * (m.topic == '/dragon/handles'))])
    code, out, _ = run(capsys, 'inspect', path, '--format', 'json')
    values = json.loads(out)
    assert (code, values['problem_count']) == (1, TICKS)
    assert '/dragon/handles at 412200000000 ns: geometry_msgs/msg/PoseArray: the message ends' in values['problems'][0]
    assert {row['lengths_compared'] == row['messages'] for row in values['topics']} == {True}
    assert f'lengths: {3 * TICKS + 2} messages were compared with their types' in run(capsys, 'inspect', bag)[1]


@pytest.mark.parametrize('cause', ['an undeclared channel', 'a record with opcode 0'])
def test_a_repair_that_loses_a_message_that_parses_says_how_many_and_exits_with_1(capsys, tmp_path, cause):
    message = struct.pack('<BQHIQQ', 5, 26, 77, 1, 5, 5) + b'\0\1\0\0'
    if cause == 'a record with opcode 0':
        rows = struct.pack('<BQ', 0, 0) + message
        message = struct.pack('<BQQQQIIQ', 6, 40 + len(rows), 5, 5, len(rows), 0, 0, len(rows)) + rows
    header, end = struct.pack('<BQII', 1, 8, 0, 0), struct.pack('<BQ20x', 2, 20)
    path = tmp_path / 'lost.mcap'
    path.write_bytes(b'\x89MCAP0\r\n' + header + message + end + b'\x89MCAP0\r\n')
    code, out, _ = run(capsys, 'inspect', path, '--repair', tmp_path / 'saved.mcap')
    assert code == 1
    assert '1 readable message was not saved' in out


def test_check_takes_a_speed_of_minus_nothing_for_rest(capsys, tmp_path):
    rest, other = tmp_path / 'rest.mcap', tmp_path / 'other.mcap'
    scene = ('--scene', 'winding', '--set', 'dragon.benches=3', '--set', 'head.speed_m_s=0', '--set', 'run.stop_s=0.1')
    assert main(['simulate', *scene, '--output', str(rest)]) == 0

    def change(m):
        if not m.topic.endswith('/velocities'):
            return [m.data]
        data = bytearray(m.data)
        read_multi_array(data)[1][...] *= -1.0
        return [bytes(data)]
    code, out, _ = run(capsys, 'inspect', changed(rest, other, change, OTHER_MACHINE), '--check')
    assert code == 0
    assert '6 are within the promise' in out


def test_check_distinguishes_other_bits_within_the_promise_from_wrong_values(capsys, tmp_path, bag):
    def moved(by_m):
        def change(m):
            if m.topic != '/dragon/handles' or m.t_ns != 412_300_000_000:
                return [m.data]
            frame = tick(scene, 5)
            return [PoseArrayTemplate(224, 'dragon').encode(m.t_ns, frame.chain.p + by_m, frame.axis)]
        return change
    scene = Scene(run=Run(412.2, 412.7))
    near = changed(bag, tmp_path / 'near.mcap', moved(1e-13), OTHER_MACHINE)
    code, out, _ = run(capsys, 'inspect', near, '--check', '--format', 'json')
    values = json.loads(out)
    assert (code, values['equal'], values['close'], values['fault_count']) == (0, 3 * TICKS - 1, 1, 0)
    assert 0 < values['worst_m'] < 1e-12
    assert '1 is within the promise' in run(capsys, 'inspect', near, '--check')[1]
    alike = changed(bag, tmp_path / 'alike.mcap', moved(1e-13))
    assert 'tick 5: handles differs' in run(capsys, 'inspect', alike, '--check')[1]     # the machine is this one
    far = changed(bag, tmp_path / 'far.mcap', moved(1e-9))
    code, out, _ = run(capsys, 'inspect', far, '--check')
    assert code == 1
    assert 'tick 5: handles differs' in out


@pytest.mark.parametrize(('by_m', 'code', 'said'), [(1e-13, 0, '1 is within'), (1e-9, 1, 'benches differs')])
def test_check_holds_edges_of_benches_in_lists_to_the_promise_as_their_faces(capsys, tmp_path, by_m, code, said):
    def move(m):
        data = bytearray(m.data)
        if m.topic == '/dragon/benches' and m.t_ns == 100_000_000:
            read_marker_array(data).geometry[1][5, 0] += by_m
        return [bytes(data)]
    lists, other = tmp_path / 'lists.mcap', tmp_path / 'other.mcap'
    scene = ('--scene', 'winding', '--set', 'dragon.benches=5', '--set', 'markers=triangles', '--set', 'run.stop_s=0.2')
    assert main(['simulate', *scene, '--output', str(lists)]) == 0
    status, out, _ = run(capsys, 'inspect', changed(lists, other, move, OTHER_MACHINE), '--check')
    assert status == code
    assert said in out


def test_check_holds_a_bag_of_another_version_to_twice_the_promise_on_every_topic_and_says_so(capsys):
    old = MADE_BY_0_1_0
    code, out, _ = run(capsys, 'inspect', old, '--check', '--format', 'json')
    values = json.loads(out)
    assert (code, values['other_version'], values['fault_count']) == (0, '0.1.0', 0)
    assert values['close'] > 30
    assert 0 < values['worst_m'] < 4e-12
    assert 'version 0.1.0 made the bag, so the limit is twice the promise for all topics' in run(
        capsys, 'inspect', old, '--check')[1]


def test_a_bag_of_0_2_0_with_every_effect_is_read_and_keeps_the_promise(capsys):
    code, out, _ = run(capsys, 'inspect', MADE_BY_0_2_0, '--check', '--format', 'json')
    values = json.loads(out)
    assert (code, values['other_version'], values['fault_count'], values['missing_count']) == (0, '0.2.0', 0, 0)
    assert values['equal'] + values['close'] == 65
    assert values['worst_m'] < 4e-12
    code, out, _ = run(capsys, 'inspect', MADE_BY_0_2_0, '--format', 'json')
    values = json.loads(out)
    assert (code, values['problem_count'], values['first_contact']['benches']) == (0, 0, [0, 15])
    every = encoders(Scene(effects=effects_of(values['scene']['effects'])))
    assert {row['topic'] for row in values['topics']} == {f'/dragon/{name}' for name in ('track', 'scene', *every)}


def test_a_bag_made_with_another_kernel_keeps_the_promise_on_every_topic_and_check_says_why_bits_differ(
        capsys, tmp_path):
    features = np.show_config(mode='dicts').get('SIMD Extensions', {}).get('found', [])
    if not features:
        pytest.skip('numpy uses no feature of this CPU that can be disabled')
    path, names = tmp_path / 'other.mcap', ', '.join((~Effect.CLOCK).names)
    command = ['simulate', *SCENE, '--set', 'run.stop_s=412.3', '--set', f'effects=[{names}]', '--output', path]
    subprocess.run([sys.executable, '-m', 'dragon_ros', *command], check=True, stderr=subprocess.DEVNULL,
                   env=os.environ | {'NPY_DISABLE_CPU_FEATURES': ' '.join(features)})
    code, out, _ = run(capsys, 'inspect', path, '--check')
    assert code == 0, out
    assert 'are within the promise but not bit-identical' in out
    assert ', 0 are not' in out
    assert f"made with another kernel: cpu_features fewer, here {shown(' '.join(features))}" in out


def test_check_of_a_bag_of_another_version_still_tells_values_beyond_the_promise(capsys, tmp_path):
    def moved(m):
        if m.topic != '/dragon/measured' or m.t_ns != 412_400_000_000:
            return [m.data]
        data = bytearray(m.data)
        read_pose_array(data).poses[7, 0] += 1e-9
        return [bytes(data)]
    far = changed(MADE_BY_0_1_0, tmp_path / 'far.mcap', moved)
    code, out, _ = run(capsys, 'inspect', far, '--check')
    assert code == 1
    assert 'tick 2: measured differs' in out


def test_check_of_a_bag_without_a_scene_is_refused(capsys):
    code, _, err = run(capsys, 'inspect', CORPUS / 'good_none.mcap', '--check')
    assert code == 2
    assert 'without its scene' in err


@pytest.mark.parametrize('command', ['contact', 'table'])
@pytest.mark.parametrize('scene', ['winding', str(configuration_folder() / 'scenes' / 'winding.yaml')])
def test_a_scene_in_the_place_of_a_bag_is_told_how_to_be_given(capsys, command, scene):
    code, _, err = run(capsys, command, scene)
    assert code == 2
    assert err == f'{command}: BAG {scene}: it is a scene, not a recording; write --scene {scene}\n'


def stranger_s(path, text, again_ns=()):
    """A bag whose scene is an arbitrary string and which contains one tick of handles, repeated at other times."""
    frame = tick(Scene(run=Run(412)), 0)
    with BagWriter(path) as bag:
        bag.describe('dragon_ros', {'scene': text})
        bag.add_channel('/dragon/handles', channels()['handles'])
        for t_ns in (frame.t_ns, *again_ns):
            bag.write('/dragon/handles', encoders(Scene())['handles'](frame), t_ns, 1)
    return path


@pytest.mark.parametrize(('text', 'says'), [
    ('head: {speed_m_s: 0}\nrun: {rate_hz: 10000, stop_s: 2000}', 'ticks'), (f'# {"x" * 2**17}', '131074 characters')])
def test_a_scene_in_a_bag_that_asks_for_too_much_is_not_computed_unless_trusted(capsys, tmp_path, text, says):
    bag = stranger_s(tmp_path / 'a.mcap', text)
    code, out, _ = run(capsys, 'inspect', bag)
    assert code == 3
    assert f'{says}; the limit for untrusted scenes is' in out
    assert 'give --trust' in out
    code, _, err = run(capsys, 'inspect', bag, '--check')
    assert code == 2
    assert f'{says}; the limit for untrusted scenes is' in err


def test_a_check_counts_ticks_that_are_missing_without_walking_them(capsys, tmp_path):
    bag = stranger_s(tmp_path / 'a.mcap', 'run: {rate_hz: 10000, start_s: 412, stop_s: 1000000}', [432 * 10**9])
    code, out, _ = run(capsys, 'inspect', bag, '--check', '--trust')
    assert code == 1
    assert '1 message is bit-identical to the model, 1 is not; 600003 are missing' in out
    assert 'ticks 1 to 199999: handles is missing' in out
    assert 'the recording ends at tick 200000 of 0 to 209179 (432.000000000 s)' in out
    values = json.loads(run(capsys, 'inspect', bag, '--check', '--trust', '--format', 'json')[1])
    assert (values['fault_count'], values['missing_count']) == (600004, 600003)
    parts = []
    with BagReader(bag) as one:
        compare_with_model(one, scene_of_bag(one, trust=True), compared=lambda part, spans: (
            parts.extend(spans) or map(part, spans)))
    assert len(parts) <= 3      # at most one more than the number of messages


def test_the_first_contact_of_a_large_scene_is_searched_only_if_it_is_trusted(capsys, tmp_path):
    bag = stranger_s(tmp_path / 'a.mcap', 'dragon: {benches: 2500}\nrun: {start_s: 412, stop_s: 412.1}')
    text = run(capsys, 'inspect', bag)[1]
    assert 'first contact: unknown; the scene has 2500 benches, but only scenes with up to 2000 are searched' in text
    assert 'no contact (recomputed from the scene)' in run(capsys, 'inspect', bag, '--trust')[1]


def test_a_truncated_bag_is_reported_and_repaired(capsys, tmp_path, bag):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(bag.read_bytes()[:-5000])
    code, out, _ = run(capsys, 'inspect', cut)
    assert code == 1
    assert 'is truncated and has no index' in out
    assert run(capsys, 'inspect', cut, '--repair', tmp_path / 'whole.mcap')[0] == 0
    assert run(capsys, 'inspect', tmp_path / 'whole.mcap')[0] == 0
    assert set(messages(tmp_path / 'whole.mcap')) <= set(messages(bag))
    code, out, _ = run(capsys, 'inspect', tmp_path / 'whole.mcap', '--check', '--format', 'json')
    assert json.loads(out)['equal'] > TICKS
    code, _, err = run(capsys, 'inspect', cut, '--repair', tmp_path / 'whole.mcap')
    assert code == 2
    assert 'already exists' in err


@pytest.mark.parametrize('messages_are_left', [True, False])
def test_inspect_shows_the_scene_of_a_cut_bag(capsys, tmp_path, bag, messages_are_left):
    cut = tmp_path / 'cut.mcap'
    whole = bag.read_bytes()
    cut.write_bytes(whole[:-5000] if messages_are_left else whole[:whole.index(b'/dragon/')])
    code, out, _ = run(capsys, 'inspect', cut)
    assert code == 1
    assert 'scene: 223 benches, pitch 0.55 m, 50 Hz from 412.2 s' in out
    assert 'is truncated and has no index' in out
    values = json.loads(run(capsys, 'inspect', cut, '--format', 'json')[1])
    assert values['about']['promise_m'] == '2e-12'
    assert ('start_s' in values) == messages_are_left
    if messages_are_left:
        assert values['first_contact']['benches'] == [0, 8]
        assert values['start_s'] == 412.2


@pytest.mark.parametrize(('override', 'closest_m'), [('dragon.benches=1', None), ('markers=triangles', -0.005462)])
def test_bags_of_one_bench_and_of_triangles_are_simulated_inspected_and_checked(capsys, tmp_path, override, closest_m):
    path = tmp_path / 'run.mcap'
    assert run(capsys, 'simulate', *SCENE, '--set', override, '--output', path)[0] == 0
    code, out, _ = run(capsys, 'inspect', path, '--check', '--format', 'json')
    values = json.loads(out)
    assert (code, values['equal'], values['fault_count']) == (0, 3 * TICKS, 0)
    code, out, _ = run(capsys, 'inspect', path, '--format', 'json')
    gaps = json.loads(out)['clearance']['gap_m']
    assert code == 0
    assert min(gaps, default=None) == (None if closest_m is None else pytest.approx(closest_m, abs=1e-6))


@pytest.mark.parametrize(('overrides', 'says'), [
    (('dragon.kind=mixed', 'dragon.groups=[{length_m: 3.41}, {count: 6, length_m: 1.5}]'),
     '7 mixed benches, pitch 0.55'),
    (('dragon.benches=4', 'track.kind=joined', 'track.pieces=[{kind: line, length_m: 500}]'),
     '4 benches, 1 piece of track')])
def test_bags_of_mixed_benches_and_of_composite_tracks_are_described_and_checked(capsys, tmp_path, overrides, says):
    path = tmp_path / 'run.mcap'
    changes = [part for one in overrides for part in ('--set', one)]
    assert run(capsys, 'simulate', *SCENE, *changes, '--output', path)[0] == 0
    code, out, _ = run(capsys, 'inspect', path)
    assert (code, says in out) == (0, True)
    assert f'{3 * TICKS} messages are bit-identical' in run(capsys, 'inspect', path, '--check')[1]


@pytest.mark.parametrize(('form', 'read'), [
    ('csv', lambda path: _csv(path)), ('parquet', lambda path: _parquet(path))])
def test_export_writes_a_row_for_each_tick_and_handle(capsys, tmp_path, bag, form, read):
    path = tmp_path / f'run.{form}'
    assert run(capsys, 'export', bag, '--format', form, '--every', '5', '--handles', '0,7', '--output', path)[0] == 0
    rows = read(path)
    assert rows.shape == (2 * 6, 7)
    scene = Scene(run=Run(412.2, 412.7))
    assert rows[:, 0].tolist() == sorted([412.2, 412.3, 412.4, 412.5, 412.6, 412.7] * 2)
    frame = tick(scene, 5)
    assert rows[3, 1:4].tolist() == [7, *frame.chain.p[7].tolist()]
    assert rows[3, 4:6].tolist() == frame.velocity_m_s[7].tolist()


def _csv(path):
    header, *rows = csv.reader(path.read_text().splitlines())
    assert header[:2] == ['t_s', 'handle']
    return np.array([[float(cell) for cell in row] for row in rows])


def _parquet(path):
    parquet = pytest.importorskip('pyarrow.parquet')
    table = parquet.read_table(path)
    assert table.column_names[0] == 't_ns'
    return np.stack([column.to_numpy() for column in table.columns[1:]], axis=1).astype(float)


def test_export_of_arrays_has_every_tick(capsys, tmp_path, bag):
    path = tmp_path / 'run.npz'
    assert run(capsys, 'export', bag, '--format', 'npz', '--output', path)[0] == 0
    scene = Scene(run=Run(412.2, 412.7))
    with np.load(path) as arrays:
        frames = [tick(scene, k) for k in range(TICKS)]
        assert np.array_equal(arrays['t_ns'], [frame.t_ns for frame in frames])
        assert np.array_equal(arrays['handles_m'], [frame.chain.p for frame in frames])
        assert np.array_equal(arrays['velocities_m_s'], [frame.velocity_m_s for frame in frames])
        assert np.array_equal(arrays['bench_centres_m'], [frame.benches.centre for frame in frames])
        assert np.allclose(arrays['bench_axes'], [frame.axis for frame in frames], rtol=0, atol=1e-15)
        assert arrays['bench_sizes_m'].shape == (223, 2)


@pytest.mark.parametrize(('kind', 'every'), [('csv', 1), ('csv', 4), ('npz', 1)])
def test_the_progress_of_an_export_ends_at_its_last_tick(tmp_path, bag, kind, every):
    counts = []
    with dr.read_bag(bag) as recorded:
        recorded.export(tmp_path / 'run', kind, every=every, progress=counts.append)
        assert sum(counts) == recorded.ticks


def test_export_without_pyarrow_says_what_to_do(capsys, tmp_path, bag, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    code, _, err = run(capsys, 'export', bag, '--format', 'parquet', '--output', tmp_path / 'run.parquet')
    assert code == 2
    assert 'pip install pyarrow' in err
    assert not (tmp_path / 'run.parquet').exists()


def test_a_table_of_a_bag_is_the_table_of_its_scene(capsys, bag):
    code, out, _ = run(capsys, 'table', bag, '--times', '412.3,412.5', '--handles', '0,223', '--format', 'json')
    assert code == 0
    rows = json.loads(out)
    assert [(row['t_s'], row['handle']) for row in rows] == [(412.3, 0), (412.3, 223), (412.5, 0), (412.5, 223)]
    chain = states(Scene(), [412.3])
    assert [rows[1]['x_m'], rows[1]['y_m']] == pytest.approx(chain.p[0, 223].tolist(), abs=1e-11)


@pytest.mark.parametrize(('arguments', 'says'), [
    (['inspect', 'nothing.mcap'], 'nothing.mcap'),
    (['inspect', CORPUS / 'text.mcap'], 'not an MCAP file'),
    pytest.param(['inspect', CORPUS], None, marks=pytest.mark.long),      # takes a second
    (['inspect', CORPUS / 'good_none.mcap', '--looks', '-1'], '--looks'),
    (['inspect', CORPUS / 'good_none.mcap', '--check', '--looks', '3'], '--looks: --check does not accept it'),
    (['inspect', CORPUS / 'good_none.mcap', '--repair', 'a.mcap', '--check'], '--check: --repair does not accept it'),
    (['contact', CORPUS / 'good_none.mcap', '--verify', 'a.json'], 'BAG: --verify does not accept it'),
    (['contact', '--verify', 'a.json', '--output', 'b.json'],
     '--output b.json: --verify writes only text; give a name that ends in .txt'),
    (['contact', '--near-misses', '-1'], '--near-misses: -1.0 is not valid: it is not positive'),
    (['contact', '--certificate', 'a.json', '--output', './a.json'],
     '--output a.json: the certificate is written to this file; give another file'),
    (['contact', '--near-misses', '1', '--format', 'csv'], '--near-misses: --format csv contains only the contact'),
    (['cost', 'tick'], 'unrecognized arguments: tick'),
    (['table', CORPUS / 'good_none.mcap', '--times', '99'], 'ends at'),
    (['table', CORPUS / 'good_none.mcap', '--times', 'inf'], '--times: t_s: inf is not valid'),
    (['table', CORPUS / 'good_none.mcap', '--times', '1e300'], '--times: t_s: 1e+300 is not valid'),
    (['table', CORPUS / 'good_none.mcap', '--times', '0:nan:1'], '--times: t_s: nan is not valid'),
    (['table', CORPUS / 'good_none.mcap', '--handles', '9' * 5000], "--handles '999"),
    (['table', '--set', f'dragon.benches={"9" * 400}'], 'it is not finite'),
    (['table', '--set', f'dragon.benches={"9" * 5000}'], 'it is not YAML'),
    (['table', '--scene', '/dev/zero'], 'is too large'),
    (['inspect', '/proc/self/mem'], '/proc/self/mem: cannot be read: Invalid argument'),
    (['inspect', '/dev/zero'], 'is not a file'),
    (['inspect', CORPUS / 'good_none.mcap', '--looks', '9' * 5000], 'argument --looks: invalid int value'),
    (['export', CORPUS / 'good_none.mcap', '--every', '9' * 400, '--output', 'x.csv'], 'is too large'),
    (['simulate', '--rate', 'inf', '--output', 'x.mcap'], "argument --rate: 'inf' is not a finite number"),
    (['contact', '--near-misses', 'nan'], "argument --near-misses: 'nan' is not a finite number"),
    (['view', '--port', '9' * 400], 'is too large'),
    (['table', CORPUS / 'foreign.mcap'], 'no dragon'),
    (['table', CORPUS / 'foreign_broken_handles.mcap'], 'foreign_broken_handles.mcap'),
    (['export', CORPUS / 'foreign.mcap', '--output', 'x.csv'], 'no dragon'),
    (['export', CORPUS / 'good_none.mcap', '--every', '0', '--output', 'x.csv'], '--every'),
    (['export', CORPUS / 'good_none.mcap', '--output', 'no/such/x.csv'], 'no/such'),
    (['simulate', '--rate', '0', '--output', 'x.mcap'], 'rate_hz'),
    (['simulate', '--output', 'no/such/x.mcap'], 'no/such')])
def test_bad_input_exits_with_2_and_one_clear_line(capsys, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *arguments)
    assert code == (2 if says else code)
    assert (says or '') in err
    assert len(err.splitlines()) <= 1
    assert len(err) < 700
    assert not os.listdir(tmp_path)


def test_a_bag_of_an_earlier_version_whose_scene_is_outside_the_world_is_read_and_says_so(capsys):
    bag = CORPUS.parent / 'outside_by_0_3_0.mcap'
    code, out, _ = run(capsys, 'inspect', bag)
    assert code == 3
    assert 'NOT READ' in out
    assert 'links are 0.05 to 50 m long' in out
    assert '3 ' in out.partition('/dragon/handles')[2].splitlines()[0]
    assert len(run(capsys, 'table', bag, '--times', '0.2')[1].splitlines()) == 1 + 5
