"""The controls of a replay (start, speed, pause, step and seek), and the order of latched messages."""
from collections import Counter

import pytest
from properties import thinned

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.errors import MissingError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import Writer, string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import read_pose_array, read_string
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.provenance import scene_file

SCENE = Scene(run=Run(10, 12, 10))
NS = 10**9


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    path, encode = tmp_path_factory.mktemp('bag') / 'short.mcap', encoders(SCENE)
    with BagWriter(path) as bag:
        for name in (*encode, 'scene'):
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k in range(21):
            frame = tick(SCENE, k)
            for name in encode:
                bag.write(f'/dragon/{name}', encode[name](frame), frame.t_ns, k + 1)
            if k == 0:
                bag.write('/dragon/scene', string_message(scene_file(SCENE)), frame.t_ns, 1)
    return path


@pytest.fixture
def stamps(node):
    """The stamps of the received handles, in tenths of a second."""
    from geometry_msgs.msg import PoseArray
    out = []
    node.create_subscription(PoseArray, 'handles',
                             lambda data: out.append(read_pose_array(data).t_ns * 10 // NS), 100, raw=True)
    return out


@pytest.fixture
def call(node):
    from std_srvs.srv import Trigger

    def serve(name):
        client = node.create_client(Trigger, f'replay/{name}')
        node.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        node.until(future.done)
        return future.result()
    return serve


@pytest.fixture
def put(node):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    def set_one(name, value):
        client = node.create_client(SetParameters, 'replay/set_parameters')
        node.until(client.service_is_ready)
        future = client.call_async(SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()]))
        node.until(future.done)
        return future.result().results[0]
    return set_one


def by_topic(path):
    out = {}
    with BagReader(path) as bag:
        for message in bag.messages():
            out.setdefault(message.topic, []).append((message.t_ns, message.sequence, message.data))
    return out


@pytest.mark.parametrize('rate', thinned(['0', '5'], lambda rate: rate == '0'))
def test_replaying_into_the_recorder_gives_the_same_messages_byte_for_byte(start, tmp_path, recorded, rate):
    record = start('record', '--output', tmp_path / 'again.mcap')
    replay = start('replay', recorded, '--rate', rate, '--wait-subscribers',
                   '/dragon/handles=1,/dragon/benches=1,/dragon/velocities=1,/dragon/scene=1')
    assert replay.end() == 0, replay.text
    assert record.end() == 0, record.text
    assert by_topic(tmp_path / 'again.mcap') == by_topic(recorded)
    assert (' late by ' in replay.text) == (rate != '0')


def test_replay_takes_names_below_the_only_dragon_of_its_bag(start, node, recorded, stamps):
    replay = start('replay', recorded, '--rate', '0', '--topics', 'handles,/dragon/scene', '--wait-subscribers',
                   'handles=1')
    assert replay.end() == 0, replay.text
    node.until(lambda: len(stamps) == 21)
    for option in ('--topics', '--wait-subscribers'):
        wrong = start('replay', recorded, option, 'handle=1')
        assert wrong.end() == 2, wrong.text
        assert '/dragon/handles' in wrong.text


def test_replay_plays_from_start_to_end(start, node, recorded, stamps):
    replay = start('replay', recorded, '--start', '0.35', '--end', '0.82', '--rate', '5', '--topics',
                   '/dragon/handles', '--wait-subscribers', '/dragon/handles=1')
    assert replay.end() == 0, replay.text
    node.until(lambda: len(stamps) >= 5)
    assert stamps == [104, 105, 106, 107, 108]


def test_what_is_latched_comes_first_wherever_it_starts(start, node, recorded):
    from geometry_msgs.msg import PoseArray
    from std_msgs.msg import String

    from dragon_ros.nodes import qos
    heard = []
    node.create_subscription(PoseArray, 'handles', lambda _: heard.append('handles'), 100, raw=True)
    node.create_subscription(String, 'scene', lambda data: heard.append(read_string(data)),
                             qos.of_channel(channels()['scene']), raw=True)
    replay = start('replay', recorded, '--start', '1.5', '--wait-subscribers', '/dragon/handles=1,/dragon/scene=1')
    assert replay.end() == 0, replay.text
    node.until(lambda: len(heard) >= 7)
    assert Counter(heard) == {scene_file(SCENE): 1, 'handles': 6}


def test_replay_pauses_steps_seeks_and_resumes_by_service(start, node, recorded, stamps, call, put):
    replay = start('replay', recorded, '--rate', '2', '--topics', '/dragon/handles', '--wait-subscribers',
                   '/dragon/handles=1')
    node.until(lambda: len(stamps) >= 3)
    assert call('pause').success
    assert put('seek_s', 11.55).successful
    assert call('seek').success
    node.until(lambda: stamps[-1] == 115)
    assert put('step_ticks', 2).successful
    assert call('step').success
    node.until(lambda: stamps[-1] == 117)
    assert stamps[-3:] == [115, 116, 117]
    assert not put('seek_s', 12.5).successful
    assert call('resume').success
    assert replay.end() == 0, replay.text
    node.until(lambda: stamps[-1] == 120)
    assert stamps[-4:] == [117, 118, 119, 120]


def test_replay_publishes_the_time_of_the_bag_on_request(start, node, recorded):
    from rosgraph_msgs.msg import Clock
    times = []
    node.create_subscription(Clock, '/clock', lambda m: times.append(m.clock.sec * NS + m.clock.nanosec), 100)
    replay = start('replay', recorded, '--clock', '--loop', '--rate', '5', '--ros-args', '-p', 'discovery_s:=0.0')
    node.until(lambda: 12 * NS in times and 10 * NS in times)
    assert set(times) <= {SCENE.run.time_ns(k) for k in range(21)}
    assert replay.stop() == 0, replay.text


def test_a_single_message_is_repeated_every_second(start, node, recorded):
    from std_msgs.msg import String

    from dragon_ros.nodes import qos
    sent_ns = []
    node.create_subscription(String, 'scene', lambda data, info: sent_ns.append(info['source_timestamp']),
                             qos.of_channel(channels()['scene']), raw=True)
    start('replay', recorded, '--topics', '/dragon/scene', '--loop', '--wait-subscribers', '/dragon/scene=1')
    node.until(lambda: len(sent_ns) >= 2)
    assert sent_ns[1] - sent_ns[0] > 0.9 * NS       # a busy machine only makes this longer


@pytest.mark.parametrize(('options', 'says'), [(['--end', '-1'], '--end'), (['--rate', '2e6'], '--rate')])
def test_replay_options_that_do_not_fit_are_refused(start, recorded, options, says):
    process = start('replay', recorded, *options)
    assert process.end() == 2
    assert says in process.text


def test_typed_keys_are_distinguished():
    from dragon_ros.nodes import keys
    known = {' ': 0, 's': 0, keys.RIGHT: 0, keys.LEFT: 0}
    assert keys.split('s \x1b[C\x1b[Dxs\x1b[', known) == ['s', ' ', keys.RIGHT, keys.LEFT, 's']


def test_keys_of_a_terminal_control_the_replay(domain, recorded, tmp_path):
    """The test types into the other end of a real pseudo-terminal."""
    import os
    import pty
    import sys
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, [sys.executable, '-m', 'dragon_ros', 'replay', str(recorded), '--rate', '0.5',
                                  '--loop', '--ros-args', '-p', 'discovery_s:=0.0'])
    text = ''

    def wait_for(words):
        nonlocal text
        while words not in text:
            text += os.read(terminal, 4096).decode()
        text = text.partition(words)[2]
    wait_for('keys: space pauses')
    wait_for('starting')
    os.write(terminal, b' ')
    wait_for('paused at')
    os.write(terminal, b's')
    wait_for('at ')
    os.write(terminal, b' ')
    wait_for('resumed at')
    os.write(terminal, b'\x1b[C')       # the bag is shorter than the jump of 5 s
    wait_for('at 12.000 s of 12.000 s')
    os.write(terminal, b' \x1b[D')
    wait_for('at 10.000 s of 12.000 s')
    os.write(terminal, b'\x03')
    wait_for('messages published')
    assert os.waitpid(child, 0)[1] == 0


def stranger_s_bag(path, schema):
    """A bag with one message of a given type, or without a schema."""
    from mcap.writer import Writer
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'a stranger')
        kind = 0 if schema is None else writer.register_schema(schema, 'ros2msg', b'')
        writer.add_message(writer.register_channel('/x', 'cdr', kind), 1, bytes(8), 1)
        writer.finish()


@pytest.mark.parametrize('name', ['this/msg/s', 'antigravity/msg/x', 'rclpy.msg/msg/x', 'geometry_msgs/msg/Trap',
                                  'geometry_msgs/msg/geometry_msgs', '../msg/x', '/msg/', 'Pose', '', 'a\0/msg/b'])
def test_only_the_ament_index_says_what_a_message_type_is(name):
    from dragon_ros.nodes.shell import message_type
    with pytest.raises(MissingError, match='^message type '):
        message_type(name)


@pytest.mark.parametrize('name', ['trap/msg/Trap', 'geometry_msgs/msg/Trap', None])
def test_a_bag_names_message_types_and_nothing_that_is_run(start, tmp_path, name):
    for folder in ('trap/msg', 'geometry_msgs/msg', 'std_msgs/msg'):
        (tmp_path / folder).mkdir(parents=True)
        for path in (tmp_path / folder).parent, tmp_path / folder:
            (path / '__init__.py').write_text('open("sprung", "w").close()\nTrap = PoseArray = String = object')
    stranger_s_bag(tmp_path / 'a.mcap', name)
    replay = start('replay', 'a.mcap', '--rate', '0')
    assert replay.end() == 2, replay.text
    assert replay.text.startswith('replay: message type ')
    assert len(replay.text.splitlines()) == 1
    assert not (tmp_path / 'sprung').exists()


@pytest.mark.parametrize('rate', [0, 1000])
def test_what_its_type_cannot_hold_is_left_out_named_once_and_counted_and_all_else_is_played(start, node, tmp_path,
                                                                                            rate):
    from geometry_msgs.msg import PoseArray
    from std_msgs.msg import Float64
    encode, heard, seen = encoders(SCENE)['handles'], [], []
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for name in ('handles', 'clearance'):
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k in range(20):
            bag.write('/dragon/clearance', b'\0\1\0\0' + bytes(8 if k < 2 else 16), SCENE.run.time_ns(k), k + 1)
            bag.write('/dragon/handles', encode(tick(SCENE, k)), SCENE.run.time_ns(k), k + 1)
    node.create_subscription(PoseArray, 'handles', heard.append, 100, raw=True)
    node.create_subscription(Float64, 'clearance', seen.append, 100, raw=True)
    replay = start('replay', 'a.mcap', '--rate', rate, '--wait-subscribers', '/dragon/handles=1,/dragon/clearance=1')
    node.until(lambda: len(heard) == 20 and len(seen) == 2)
    assert replay.end() == 0, replay.text
    assert replay.text.count('/dragon/clearance: messages that are too long for their type are left out; the first '
                             'has 20 bytes') == 1
    assert '22 messages published, 18 left out' in replay.text


def test_a_seek_leaves_the_latched_reports_of_a_monitor_at_their_ticks(start, node, tmp_path, stamps, call, put):
    """The recorder logs a report without a stamp at the tick that precedes it; a seek must not change that tick."""
    source, again = tmp_path / 'source.mcap', tmp_path / 'again.mcap'
    with BagWriter(source) as bag:
        for name in ('handles', 'clearance/stamped', 'collision/active'):
            bag.add_channel(f'/dragon/{name}', channels()[name])
        encode = encoders(SCENE)['handles']
        for k in range(21):
            frame = tick(SCENE, k)
            stamped = Writer()
            stamped.header('dragon', frame.t_ns)
            stamped.put('d', 0.1, 0.0, 0.0)
            bag.write('/dragon/handles', encode(frame), frame.t_ns, k + 1)
            bag.write('/dragon/clearance/stamped', bytes(stamped.finish()), frame.t_ns, k + 1)
            if k in (0, 10):
                bag.write('/dragon/collision/active', bytes([0, 1, 0, 0, k == 10]), frame.t_ns, 1 + (k == 10))
    record = start('record', '--output', again)
    replay = start('replay', source, '--rate', '1', '--wait-subscribers',
                   '/dragon/handles=2,/dragon/clearance/stamped=1,/dragon/collision/active=1')
    node.until(lambda: len(stamps) >= 3)
    assert call('pause').success
    assert put('seek_s', 11.55).successful
    assert call('seek').success
    assert call('resume').success
    assert replay.end() == 0, replay.text
    record.end()
    active = [(t_ns / NS, data[4]) for t_ns, _, data in by_topic(again)['/dragon/collision/active']]
    assert active == [(10.0, 0), (11.5, 1)]
