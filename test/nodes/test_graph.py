"""All nodes run together, and each of them works as documented."""
import os
import re
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from properties import thinned

from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.record.loss_accounting import RECEIVED
from dragon_ros.core.model import compile_scene
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import read_diagnostics, read_pose_array
from dragon_ros.scenes.load import load_scene

ROOT = Path(__file__).parents[2]
OLD_BAG = ROOT / 'test' / 'data' / 'made_by_0_1_0.mcap'
READERS = 'wait_subscribers:=[handles=2,benches=2,velocities=1]'
SHORT = 'run.start_s=412.2', 'run.stop_s=412.7'


def overrides(*pairs):
    return [part for pair in pairs for part in ('--set', pair)]


def events_of(path):
    with BagReader(path) as bag:
        return [row for message in bag.messages(['/dragon/collision']) for row in read_diagnostics(message.data)]


def heard_events(node):
    """Return a list that collects the events that a late subscriber receives."""
    from diagnostic_msgs.msg import DiagnosticArray

    from dragon_ros.nodes import qos
    out = []
    node.create_subscription(DiagnosticArray, 'collision', out.append, qos.of_channel(channels()['collision']))
    return out


def in_order(text, *words):
    places = [text.find(word) for word in words]
    return -1 not in places and places == sorted(places)


def by_topic(path):
    with BagReader(path) as bag:
        out = {}
        for message in bag.messages():
            out.setdefault(message.topic, []).append((message.t_ns, message.data))
        return out


@pytest.mark.parametrize(('scale', 'markers'), thinned(
    [(scale, markers) for scale in (0.0, 4.0) for markers in ('cubes', 'triangles')],
    lambda case: case == (0.0, 'triangles')))
def test_sim_monitor_and_recorder_as_processes_lose_and_change_no_tick(start, node, tmp_path, scale, markers):
    changes = 'run.start_s=411', f'markers={markers}'
    bag, events = tmp_path / 'run.mcap', heard_events(node)
    monitor, record = start('monitor'), start('record', '--output', bag, '--keep-going')
    record.wait_for('a monitor has been found')     # discovery may take longer than the run
    sim = start('sim', '--scene', 'first_contact', *overrides(*changes), '--ros-args', '-p', READERS,
                '-p', f'time_scale:={scale}')
    assert sim.end() == 0, sim.text
    monitor.wait_for('contact of benches 0 and 8')
    node.until(lambda: events and node.count_subscribers('collision') == 2)     # the recorder also subscribes
    assert record.stop() == 0, record.text
    assert monitor.stop() == 0, monitor.text
    with BagReader(bag) as run:
        result = compare_with_model(run, load_scene('first_contact', changes))
    assert result.faults == []
    assert result.equal == 3 * 101
    (event,) = events_of(bag)
    assert event.level == 2
    assert (event.values['inner'], event.values['outer']) == ('0', '8')
    assert float(event.values['t_contact_s']) == pytest.approx(412.4738377, abs=1e-3)
    assert (event.values['t_before_s'], event.values['t_after_s']) == ('412.460000000', '412.480000000')
    assert float(event.values['x_m']) == pytest.approx(1.474395, abs=1e-3)
    assert float(event.values['y_m']) == pytest.approx(2.110665, abs=1e-3)
    assert float(event.values['gap_m']) < 0


@pytest.mark.long       # by default, test_record.py shows this of a bag that alone makes its run again
def test_the_recorder_ends_with_the_run(start, tmp_path):
    bag = tmp_path / 'run.mcap'
    record = start('record', '--output', bag)
    sim = start('sim', '--scene', 'first_contact', *overrides(*SHORT), '--ros-args', '-p',
                'wait_subscribers:=[handles=1,benches=1,velocities=1]', '-p', 'time_scale:=0.0')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    assert 'has left' in record.text
    with BagReader(bag) as run:
        assert compare_with_model(run, load_scene('first_contact', SHORT)).faults == []


@pytest.mark.parametrize('scene', thinned(['turning', 'unwinding'], lambda scene: scene == 'turning'))
def test_a_composite_track_is_published_as_the_model_says(start, tmp_path, scene):
    bag = tmp_path / 'run.mcap'
    record = start('record', '--output', bag)
    short = ('run.start_s=100', 'run.stop_s=101')
    sim = start('sim', '--scene', scene, *overrides(*short), '--ros-args', '-p',
                'wait_subscribers:=[handles=1,benches=1,velocities=1]', '-p', 'time_scale:=0.0')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    with BagReader(bag) as run:
        seen = compare_with_model(run, load_scene(scene, short))
    assert seen.faults == []


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """A short bag with a contact, made offline; the test above shows that live bags equal it."""
    from dragon_ros.bags.write.writer import BagWriter
    from dragon_ros.core.geometry.tracker import ContactTracker
    from dragon_ros.core.step import tick
    from dragon_ros.messages.encode import encoders
    from dragon_ros.messages.observation import observation_of, read_benches, read_handles
    from dragon_ros.nodes.contact_messages import status_of
    scene, path = load_scene('first_contact', SHORT), tmp_path_factory.mktemp('bag') / 'short.mcap'
    encode, tracker, events = encoders(scene), ContactTracker(), []
    with BagWriter(path) as bag:
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k in range(compile_scene(scene).last_tick + 1):
            frame = tick(scene, k)
            data = {name: encode[name](frame) for name in encode}
            for name, message in data.items():
                bag.write(f'/dragon/{name}', message, frame.t_ns, k + 1)
            seen = observation_of(read_handles(data['handles']), read_benches(data['benches']))
            events += [status_of(event) for report in tracker.add(seen) for event in report.begins]
    return path, {value.key: value.value for value in events[0].values}


@pytest.mark.parametrize('rate', thinned(['0', '1', '4'], lambda rate: rate == '0'))
def test_a_replayed_bag_gives_the_same_bytes_and_the_same_event(start, node, tmp_path, recorded, rate):
    path, event = recorded
    again = tmp_path / 'again.mcap'
    monitor, record, events = start('monitor'), start('record', '--output', again, '--keep-going'), heard_events(node)
    record.wait_for('a monitor has been found')     # discovery may take longer than the run
    replay = start('replay', path, '--rate', rate, '--wait-subscribers',
                   '/dragon/handles=2,/dragon/benches=2,/dragon/velocities=1')
    assert replay.end() == 0, replay.text
    node.until(lambda: events)
    # The monitor ends when the recorder has received its event.
    assert monitor.stop(signal.SIGTERM) == 0, monitor.text
    assert record.stop() == 0, record.text
    first, second = by_topic(path), by_topic(again)
    assert {name: second[name] for name in first} == first
    assert events_of(again)[0].values == event


def test_replay_can_start_later_and_loop_until_it_is_stopped(start, node, recorded):
    from geometry_msgs.msg import PoseArray
    stamps = []
    node.create_subscription(PoseArray, 'handles', lambda data: stamps.append(read_pose_array(data).t_ns), 100,
                             raw=True)
    replay = start('replay', recorded[0], '--start', '0.3', '--loop', '--topics', '/dragon/handles',
                   '--wait-subscribers', '/dragon/handles=1')
    node.until(lambda: len(stamps) > 25)
    assert replay.stop() == 0, replay.text
    assert stamps[:12] == [412_500_000_000 + 20_000_000 * (k % 11) for k in range(12)]


def test_a_late_joiner_still_gets_the_event(start, node):

    monitor = start('monitor')
    sim = start('sim', '--scene', 'first_contact', *overrides(*SHORT), '--ros-args', '-p',
                'wait_subscribers:=[handles=1,benches=1]', '-p', 'time_scale:=0.0')
    assert sim.end() == 0, sim.text
    monitor.wait_for('contact of benches 0 and 8')
    got = heard_events(node)
    node.until(lambda: got)
    assert got[0].status[0].level == b'\x02'


@pytest.mark.parametrize('number', thinned([signal.SIGINT, signal.SIGTERM], lambda number: number == signal.SIGINT))
def test_a_signal_closes_the_bag_properly(start, node, tmp_path, number):
    from geometry_msgs.msg import PoseArray
    bag = tmp_path / 'run.mcap'
    record = start('record', '--output', bag, anew=True)
    sim = start('sim', '--json', '--ros-args', '-p', 'wait_subscribers:=[handles=1,benches=1,velocities=1]')
    handles = []
    node.create_subscription(PoseArray, 'handles', handles.append, 100, raw=True)
    node.until(lambda: len(handles) > 30)
    assert record.stop(number) == 0, record.text
    assert sim.stop(number) == 0, sim.text
    for process in (record, sim):
        assert 'Traceback' not in process.text
    counts = {name: len(messages) for name, messages in by_topic(bag).items()
              if name not in ('/dragon/scene', '/dragon/track')}
    assert counts['/dragon/handles'] > 10
    assert max(counts.values()) - min(counts.values()) <= 2


def test_the_sim_runs_in_any_namespace_and_publishes_the_topics_of_its_effects(start, node):
    start('sim', '--set', 'effects=[]', '--ros-args', '-r', '__ns:=/another', '-p', 'rate_hz:=20')
    node.until(lambda: node.count_publishers('/another/handles') == 1)
    assert node.count_publishers('/another/benches') == 0
    assert node.count_publishers('/another/velocities') == 0
    assert node.count_publishers('/dragon/handles') == 0


@pytest.mark.parametrize('scale', thinned([0.0, 20.0], lambda scale: scale == 0.0))
def test_the_sim_publishes_no_topic_without_subscribers_and_every_tick_of_the_others(start, node, scale):
    from geometry_msgs.msg import PoseArray
    stamps = []
    node.create_subscription(PoseArray, 'handles', lambda data: stamps.append(read_pose_array(data).t_ns), 1000,
                             raw=True)
    sim = start('sim', '--scene', 'first_contact', *overrides(*SHORT), '--ros-args', '-p',
                'wait_subscribers:=[handles=1]', '-p', f'time_scale:={scale}')
    node.until(lambda: len(stamps) == 26)
    assert sim.end() == 0, sim.text
    assert 'published: handles 26, benches 0, velocities 0' in sim.text
    assert stamps == [412_200_000_000 + 20_000_000 * k for k in range(26)]


@pytest.mark.parametrize(('arguments', 'says'), [
    (['sim', '--scene', 'windin'], 'the scenes are first_contact'),
    (['sim', '--set', 'track.pitch_m=-1'], 'track.pitch_m'),
    (['sim', '--ros-args', '-p', 'time_scale:=-1.0'], 'time_scale'),
    (['sim', '--ros-args', '-p', 'rate_hz:=0.0'], 'run.rate_hz'),
    (['sim', '--ros-args', '-p', 'start_s:=500.0'], '432.917923'),
    (['sim', '--ros-args', '-p', 'wait_subscribers:=[tails=2]'], 'tails=2'),
    (['sim', '--set', 'head.speed_m_s=0'], 'run.stop_s'),
    (['sim', '--sceen', 'x'], '--sceen'),
    (['sim', '--ros-args', '-p', 'on_contact:=halt'], "'halt' is not one of continue, hold, stop"),
    (['sim', '--ros-args', '-p', 'rate_hz:=[]'], 'parameter rate_hz: [] is a list, not a number; give a number'),
    (['sim', '--ros-args', '-p', 'rate_hz:=fast'], "parameter rate_hz: 'fast' is text, not a number; give a number"),
    (['sim', '--ros-args', '-p', 'rate_hz:=2e6'], 'parameter rate_hz: 2000000.0 is outside -1.0 to 10000.0'),
    (['sim', '--ros-args', '-p', 'step_ticks:=1.5'], 'step_ticks: 1.5 is a number, not a whole number; give a whole'),
    (['sim', '--ros-args', '-p', 'step_ticks:=0'], 'parameter step_ticks: 0 is outside 1 to 1000'),
    (['sim', '--ros-args', '-p', 'publish_clock:=1'], 'publish_clock: 1 is a whole number, not true or false; give'),
    (['monitor', '--ros-args', '-p', 'venue:=true'], 'True is true or false, not text; quote it in YAML'),
    (['sim', '--set', 'dragon.benches=9', '--ros-args', '-p', 'set:=3'],
     'parameter set: 3 is a whole number, not a list of text; give a list of text'),
    (['sim', '--set', 'dragon.benches=9', '--ros-args', '-p', 'set:=[1, 2]'],
     "parameter set: [1, 2, 'dragon.benches=9'] is a list, not a list of text; give a list of text"),
    (['sim', '--ros-args', '-p', 'rate_hx:=5.0'], 'rate_hx: sim has no such parameter; did you mean rate_hz?'),
    (['monitor', '--ros-args', '-p', 'warn_below:=0.1'], 'did you mean warn_below_m?'),
    (['monitor', '--ros-args', '-p', 'warn_below_m:=-1.0'], 'warn_below_m'),
    (['monitor', '--ros-args', '-p', 'warn_below_m:=.nan'], 'warn_below_m'),
    (['monitor', '--ros-args', '-p', 'map:="a b"'], "topic 'a b' cannot be created: failed to resolve name"),
    (['monitor', '--ros-args', '-r', 'handles:=benches'], "the subscription of topic 'benches' cannot be created"),
    (['sim', '--ros-args', '-r', 'handles:=velocities'], 'velocities'),
    (['monitor', '--ros-args', '-r', '__ns:=/' + 300 * 'a'], 'the node cannot be created'),
    (['record', '--ros-args', '--enclave', 'x'], 'the ROS context cannot be created'),
    (['sim', '--ros-args', '-p', 'time_scale'], 'time_scale'),
    (['monitor', 'extra'], 'extra'),
    (['record', '--output', 'no/such/folder.mcap'], 'no/such/folder.mcap'),
    (['replay'], 'BAG'),
    (['replay', 'nothing.mcap'], 'nothing.mcap'),
])
def test_bad_input_is_one_clear_line_and_exit_code_2(start, arguments, says):
    process = start(*arguments)
    assert process.end() == 2, process.text
    assert says in process.text
    assert 'Traceback' not in process.text


def test_an_empty_list_is_a_value_of_a_parameter_that_is_a_list(start):
    sim = start('sim', '--set', 'run.stop_s=0.1', '--ros-args', '-p', 'set:=[]', '-p', 'rate_hz:=20', '-p', 'other:=[]',
                '-p', 'discovery_s:=0.0')
    assert sim.end() == 0, sim.text
    assert 'parameter other: sim has no such parameter' in sim.text
    assert 'tick 0 of 3' in sim.text


def test_a_parameter_for_another_node_is_named_and_ignored(start, tmp_path, recorded):
    (tmp_path / 'all.yaml').write_text('/**:\n  ros__parameters: {robot: sea, use_sim_time: false, rate_hz: 20.0}\n'
                                        '/dragon/sim:\n  ros__parameters: {publish_rate: 9.0, base_frame_id: base}\n')
    arguments = '--ros-args', '--params-file', str(tmp_path / 'all.yaml')
    sim = start('sim', '--set', 'run.stop_s=0.1', *arguments, '-p', 'discovery_s:=0.0')
    record = start('record', '--output', tmp_path / 'a.mcap', *arguments)
    assert sim.end() == 0, sim.text
    assert 'parameter robot: sim has no such parameter and ignores it; choose from scene, ' in sim.text
    assert 'parameter publish_rate: sim has no such parameter and ignores it; did you mean publish_tf?' in sim.text
    assert 'parameter base_frame_id: sim has no such parameter and ignores it; did you mean frame_id?' in sim.text
    assert 'tick 0 of 3' in sim.text
    assert 'use_sim_time' not in sim.text
    record.wait_for('parameter rate_hz: record has no such parameter and ignores it; it has no parameters of its own')
    record.stop()
    replay = start('replay', recorded[0], '--ros-args', '-p', 'publish_tf:=true', '-p', 'time_scale:=0.0', '-p',
                   'discovery_s:=0.0')
    assert replay.end() == 0, replay.text
    assert 'parameter publish_tf: replay has no such parameter and ignores it; choose from time_scale, ' in replay.text


@pytest.mark.parametrize('loaded', thinned(['_multiarray_umath', '_rclpy_pybind11'], '_multiarray_umath'.__eq__))
def test_a_node_that_is_interrupted_while_it_starts_ends_as_one_that_runs(start, loaded):
    process = start('sim', anew=True)
    while loaded not in Path(f'/proc/{process.pid}/maps').read_text():
        assert process.running
    assert process.stop() == 0, process.text
    assert 'Traceback' not in process.text


SITE = """
import os, signal, sys

class Interrupt:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == 'dragon_ros.nodes.params':
            Interrupt()

sys.meta_path.insert(0, Finder)
"""


def test_a_node_that_is_interrupted_where_python_ignores_exceptions_ends_too(start, tmp_path):
    (tmp_path / 'sitecustomize.py').write_text(SITE)
    process = start('sim', '--set', 'run.stop_s=1', anew=True,
                    PYTHONPATH=os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get('PYTHONPATH')])]))
    assert (process.end(), process.text) == (0, '')


@pytest.mark.parametrize(('content', 'says'), [(b'', 'empty'), (b'x' * 500, 'not an MCAP')])
def test_replay_of_what_is_no_bag_is_refused(start, tmp_path, content, says):
    (tmp_path / 'bad.mcap').write_bytes(content)
    process = start('replay', tmp_path / 'bad.mcap')
    assert process.end() == 2
    assert says in process.text


def test_replay_of_a_truncated_bag_is_refused(start, tmp_path, recorded):
    data = recorded[0].read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(data[:len(data) // 2])
    process = start('replay', tmp_path / 'cut.mcap')
    assert process.end() == 2
    assert 'is truncated and has no index' in process.text


@pytest.mark.parametrize(('options', 'says'), [(['--rate', '-1'], '--rate'), (['--start', '9'], '--start'),
                                               (['--topics', '/dragon/tails'], '/dragon/tails')])
def test_replay_options_that_do_not_fit_are_refused(start, recorded, options, says):
    process = start('replay', recorded[0], *options)
    assert process.end() == 2
    assert says in process.text


def test_record_never_overwrites_unasked(start, tmp_path):
    (tmp_path / 'mine.mcap').write_bytes(b'precious')
    process = start('record', '--output', tmp_path / 'mine.mcap')
    assert process.end() == 2
    assert '--force' in process.text
    assert (tmp_path / 'mine.mcap').read_bytes() == b'precious'


def test_record_writes_to_a_dated_file_by_default(start, tmp_path):
    process = start('record')
    process.wait_for('recording to dragon_')
    assert process.stop() == 0
    assert len(list(tmp_path.glob('dragon_20*.mcap'))) == 1


def test_the_monitor_survives_every_unusable_message(start, node):
    from geometry_msgs.msg import Pose, PoseArray
    from visualization_msgs.msg import Marker, MarkerArray
    monitor = start('monitor')
    handles = node.create_publisher(PoseArray, 'handles', 10)
    benches = node.create_publisher(MarkerArray, 'benches', 10)
    node.until(lambda: handles.get_subscription_count() and benches.get_subscription_count())

    def poses(count, sec, x=0.0):
        message = PoseArray(poses=[Pose() for _ in range(count)])
        message.header.stamp.sec = sec
        for n, pose in enumerate(message.poses):
            pose.position.x = x + n
        return message

    handles.publish(poses(3, 0, 1e5))
    monitor.wait_for('expected finite numbers below 10000')
    handles.publish(PoseArray())
    handles.publish(poses(1, 1))
    handles.publish(poses(3, 2, float('nan')))
    handles.publish(poses(3, 3))
    benches.publish(MarkerArray())
    benches.publish(MarkerArray(markers=[Marker(ns='bench', type=Marker.CUBE)]))
    sim = start('sim', '--scene', 'first_contact', *overrides(*SHORT), '--ros-args', '-p',
                'wait_subscribers:=[handles=1,benches=1]', '-p', 'time_scale:=2.0')
    monitor.wait_for('contact of benches 0 and 8')
    assert sim.end() == 0
    assert monitor.stop() == 0
    assert re.search(r'dropped \d messages', monitor.text)
    assert 'Traceback' not in monitor.text


@pytest.mark.long       # by default, test_overload.py shows that the monitor drops such handles when their wait ends
def test_handles_without_benches_are_counted_and_logged(start, node):
    from geometry_msgs.msg import Pose, PoseArray
    monitor = start('monitor')
    handles = node.create_publisher(PoseArray, 'handles', 10)
    node.until(handles.get_subscription_count)
    message = PoseArray(poses=[Pose(), Pose()])
    message.header.stamp.sec = 1
    handles.publish(message)
    monitor.wait_for('handles at 1.000000000 s: no benches')
    assert monitor.stop() == 0
    assert 'dropped 1 message' in monitor.text


def test_the_recorder_survives_stamps_that_no_clock_shows(start, node, tmp_path):
    from geometry_msgs.msg import PoseArray
    record = start('record', '--output', tmp_path / 'a.mcap')
    handles = node.create_publisher(PoseArray, 'handles', 10)
    node.until(handles.get_subscription_count)
    for sec in (7, -1, 8):
        message = PoseArray()
        message.header.stamp.sec = sec
        handles.publish(message)
    record.wait_for('not recorded')
    assert handles.wait_for_all_acked()
    assert record.stop() == 3, record.text
    assert '/dragon/handles: left out 1 invalid message' in record.text
    with BagReader(tmp_path / 'a.mcap') as bag:
        account = bag.metadata(RECEIVED)
    assert [account[key] for key in ('complete', '/dragon/handles invalid', '/dragon/handles lost')] == [
        'false', '1', '0']
    assert [t_ns for t_ns, _ in by_topic(tmp_path / 'a.mcap')['/dragon/handles']] == [7 * 10**9, 8 * 10**9]


def test_a_sim_that_its_reader_holds_back_still_ends_on_a_signal(start):
    monitor = start('monitor')
    sim = start('sim', '--json', '--set', 'dragon.benches=5', '--ros-args', '-p', 'time_scale:=0.0', '-p',
                'wait_subscribers:=[handles=1,benches=1]')
    sim.wait_for('starting')
    monitor.signal(signal.SIGSTOP)
    sim.wait_for('"t_s"')
    assert sim.stop() == 0, sim.text
    assert 'Traceback' not in sim.text
    monitor.signal(signal.SIGCONT)


def test_a_demo_that_is_terminated_leaves_no_process_behind(start, tmp_path):
    import psutil
    demo = start('demo', '--output', tmp_path / 'demo', '--pace', '0.5')
    demo.wait_for('at 400')
    children = psutil.Process(demo.pid).children(recursive=True)
    assert len(children) >= 3
    assert demo.stop(signal.SIGTERM) == 1
    _, alive = psutil.wait_procs(children, timeout=20)
    assert not alive


@pytest.mark.long       # by default, other tests show how the demo ends
def test_a_demo_whose_monitor_is_killed_ends_with_one_line(start, tmp_path):
    import psutil
    demo = start('demo', '--output', tmp_path / 'demo', '--pace', '0.5')
    demo.wait_for('at 400')
    next(one for one in psutil.Process(demo.pid).children() if one.cmdline()[-1] == 'monitor').kill()
    assert demo.end() == 1
    assert 'monitor ended with exit code -9; see the .log files' in demo.text
    assert 'Traceback' not in demo.text


@pytest.mark.long       # by default, other tests show what the parts of the demo do, and that it starts and ends
def test_the_demo_can_be_run_again_in_one_place(start, tmp_path):
    folder, names = tmp_path / 'demo', ('first_contact.mcap', 'replayed.mcap', 'contact.png', 'contact.svg')
    folder.mkdir()
    for name in names:      # an earlier version left these files
        shutil.copy(OLD_BAG, folder / name)
    for _ in range(2):
        demo = start('demo', '--output', folder, '--pace', '10')
        assert demo.end() == 0, demo.text
        assert '1953 messages are bit-identical to the model, 0 are not' in demo.text
        assert 'the same bytes, the same event' in demo.text
        for log in ('live.log', 'replay.log'):      # the monitor waits until the recorder has received everything
            assert in_order((folder / log).read_text(), 'a monitor has been found', 'nothing is missing', 'saw 651')
    assert all((folder / name).read_bytes() != OLD_BAG.read_bytes() for name in names)


def test_security_that_the_wheels_cannot_give_is_refused_in_one_line(start):
    pytest.importorskip('ros_wheels_bootstrapper')
    process = start('sim', '--scene', 'minimal', anew=True, ROS_SECURITY_ENABLE='true')
    assert process.end() == 2
    assert process.text.startswith('sim: ROS_SECURITY_ENABLE: the ROS wheels have no DDS security plugins')
    assert len(process.text.splitlines()) == 1


SOCKETS = """
import os, rclpy
rclpy.init()
node = rclpy.create_node('bound')
links = [f'/proc/self/fd/{fd}' for fd in os.listdir('/proc/self/fd')]
own = {os.readlink(link) for link in links if os.path.lexists(link)}
rows = [line.split() for line in open('/proc/self/net/udp').read().splitlines()[1:]]
print(sorted({row[1].partition(':')[0] for row in rows if f'socket:[{row[9]}]' in own}))
"""


def by_script(*arguments, **variables):
    """Run the script as if from a shell in which only the ROS domain is set, and return its output."""
    kept = {key: os.environ[key] for key in ('PATH', 'HOME', 'ROS_DOMAIN_ID', 'ROS_LOG_DIR') if key in os.environ}
    return subprocess.run([ROOT / 'dragon', *arguments], env=kept | variables, capture_output=True, text=True,
                          check=True, timeout=60).stdout


@pytest.mark.skipif(not (ROOT / '.venv/requirements.installed').exists(), reason='./dragon is not set up here')
def test_nodes_of_the_script_bind_this_host_alone_unless_told_otherwise(domain):
    # 127.0.0.1, and the multicast group that Fast DDS uses for discovery on that interface
    assert by_script('python', '-c', SOCKETS).strip() == "['0100007F', '0100FFEF']"
    shown = 'import os; print(os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE", ""))'
    assert by_script('python', '-c', shown).strip().endswith('loopback.xml')
    for arguments, variables in ((('--network', 'python'), {}), (('python', '--network'), {}),
                                 (('python',), {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}),
                                 (('python',), {'ROS_STATIC_PEERS': '127.0.0.1'}),
                                 (('python',), {'ROS_DISCOVERY_SERVER': '127.0.0.1:11811'})):
        assert by_script(*arguments, '-c', shown, **variables).strip() == ''


@pytest.mark.skipif(not (ROOT / '.venv/requirements.installed').exists(), reason='./dragon is not set up here')
def test_the_script_keeps_bytecode_although_the_shell_wants_none_beside_sources():
    shown = 'import sys; print(sys.dont_write_bytecode, sys.pycache_prefix)'
    assert by_script('python', '-c', shown) == 'False None\n'
    kept = f'False {ROOT.resolve()}/.venv/cache/bytecode\n'
    assert by_script('python', '-c', shown, PYTHONDONTWRITEBYTECODE='1') == kept


def test_the_quality_of_a_topic_can_be_overridden_and_what_cannot_gets_a_word(start, node):
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
    sim = start('sim', '--ros-args', '-p', 'qos_overrides./dragon/handles.publisher.reliability:=best_effort',
                '-p', 'qos_overrides./dragon/velocities.publisher.durability:=transient_local',
                '-p', 'qos_overrides./dragon/handle.publisher.depth:=5')
    start('monitor', '--ros-args', '-p', 'qos_overrides./dragon/handles.subscription.reliability:=best_effort')
    node.until(lambda: node.count_publishers('velocities') and node.count_subscribers('handles'))
    quality = {name: node.get_publishers_info_by_topic(f'/dragon/{name}')[0].qos_profile
               for name in ('handles', 'velocities', 'benches')}
    assert [one.reliability == ReliabilityPolicy.BEST_EFFORT for one in quality.values()] == [True, False, False]
    assert [one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in quality.values()] == [False, True, False]
    (heard,) = node.get_subscriptions_info_by_topic('/dragon/handles')
    assert heard.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    sim.wait_for('parameter qos_overrides./dragon/handle.publisher.depth: sim has no such topic and ignores the ')
    for wrong, says in (('history:=some', "'history'|`history`: `some`"), ('depht:=5', 'depht: it is not a QoS policy'),
                        ('depth:=many', 'depth')):
        failed = start('sim', '--ros-args', '-p', f'qos_overrides./dragon/handles.publisher.{wrong}')
        assert failed.end() == 2, failed.text
        assert any(part in failed.text for part in says.split('|')), failed.text
        assert 'Traceback' not in failed.text


@pytest.mark.parametrize('given', ['reliability:=best_effort', 'history:=keep_last', 'lifespan:=1000000'])
def test_a_run_as_fast_as_its_readers_follow_cannot_be_made_to_lose_messages(start, given):
    sim = start('sim', '--ros-args', '-p', 'time_scale:=0.0', '-p', f'qos_overrides./dragon/handles.publisher.{given}')
    assert sim.end() == 2, sim.text
    assert 'omit it, or set time_scale above 0' in sim.text


def test_the_dragon_as_a_robot_is_published_and_latched_where_asked_for(start, node):
    from nav_msgs.msg import Path as TrackPath
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    from dragon_ros.messages.urdf import urdf_of
    from dragon_ros.nodes import qos
    got = {}
    for name, kind in (('robot_description', String), ('path', TrackPath), ('joint_states', JointState)):
        node.create_subscription(kind, name, lambda message, name=name: got.setdefault(name, message),
                                 qos.of_channel(channels()[name]))
    changes = 'dragon.benches=5', 'effects=[joints, path]'
    sim = start('sim', *overrides(*changes), '--ros-args', '-p', 'robot_description:=true', '-p', 'discovery_s:=0.0')
    node.until(lambda: len(got) == 3)
    assert got['robot_description'].data == urdf_of(load_scene('winding', changes))
    assert got['joint_states'].name == ['joint_1', 'joint_2', 'joint_3', 'joint_4']
    assert {pose.header.frame_id for pose in got['path'].poses} == {'dragon'}
    assert sim.stop() == 0, sim.text
    plain = start('sim', '--ros-args', '-r', '__ns:=/plain', '-p', 'discovery_s:=0.0')
    node.until(lambda: node.count_publishers('/plain/handles'))
    assert [node.count_publishers(f'/plain/{name}') for name in got] == [0, 0, 0]
    assert plain.stop() == 0, plain.text
