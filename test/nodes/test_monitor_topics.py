"""The monitor's topics and a sim's reaction to a contact are tested with real nodes over real DDS."""
from importlib.util import find_spec

import numpy as np
import pytest
from properties import thinned

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import state, tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import read_diagnostics, read_pose_array
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.load import load_scene

T_STAR_NS = 412_473_837_682


class Listener:
    """A node that collects the messages of topics, with the types and QoS of topics.yaml."""

    def __init__(self, node, *names):
        from dragon_ros.nodes import qos
        from dragon_ros.nodes.shell import message_type
        self.got = {name: [] for name in names}
        for name in names:
            row = channels()[name]
            node.create_subscription(message_type(row.type), name, self.got[name].append, qos.of_channel(row))

    def statuses(self, name='collision'):
        return [status for message in self.got[name] for status in message.status]


class Publisher:
    """A node that publishes single frames of the classic or another dragon, as any publisher would."""

    def __init__(self, node, start_s=412.0, *overrides):
        from dragon_ros.nodes import qos
        from dragon_ros.nodes.shell import message_type
        self.scene = load_scene('winding', [f'run.start_s={start_s}', *overrides])
        self.encode = {name: encode for name, encode in encoders(self.scene).items() if name != 'velocities'}
        self.out = {name: node.create_publisher(message_type(channels()[name].type), name,
                                                qos.of_channel(channels()[name])) for name in self.encode}
        node.until(lambda: all(out.get_subscription_count() for out in self.out.values()))

    def show(self, *times_s):
        for t_s in times_s:
            frame = tick(self.scene, round((t_s - self.scene.run.start_s) * 50))
            for name, encode in self.encode.items():
                self.out[name].publish(encode(frame))


def values(status):
    return {pair.key: pair.value for pair in status.values}


def test_a_contact_is_reported_from_start_to_end_on_every_topic(start, node):
    from visualization_msgs.msg import Marker

    from dragon_ros.nodes import contact_messages
    monitor = start('monitor')
    heard = Listener(node, 'collision', 'collision/point', 'collision/markers', 'clearance', 'clearance/marker',
                     'collision/active')        # the last subscription to be discovered; the others are, too, then
    source = Publisher(node)
    node.until(lambda: [m.data for m in heard.got['collision/active']] == [False])
    source.show(412.44, 412.46, 412.48)
    node.until(lambda: heard.got['collision/point'] and heard.got['collision/markers'])
    point = heard.got['collision/point'][0]
    assert (point.point.x, point.point.y) == pytest.approx((1.474395, 2.110665), abs=1e-4)
    assert (point.header.frame_id, point.header.stamp.sec) == ('dragon', 412)
    clear, *touched, dot, label = heard.got['collision/markers'][0].markers
    assert clear.action == Marker.DELETEALL
    assert [marker.id for marker in touched] == [0, 8]
    assert {(round(m.color.r, 2), round(m.color.g, 2), m.color.b) for m in touched} == {(0.84, 0.37, 0.0)}
    assert (dot.type, label.type) == (Marker.SPHERE, Marker.TEXT_VIEW_FACING)
    assert label.text == '0 x 8: -0.16 mm'
    # The marker is deleted immediately.
    node.until(lambda: [m.action for m in heard.got['clearance/marker']] == [Marker.ADD, Marker.DELETE])
    source.show(413.76, 415.0, 415.02)
    node.until(lambda: len(heard.statuses()) == 2 and len(heard.got['clearance']) == 6)
    node.until(lambda: len(heard.got['collision/markers'][-1].markers) == 1)
    late = Listener(node, 'collision/contacts')
    node.until(lambda: late.got['collision/contacts'])
    (cloud,) = late.got['collision/contacts']
    (row,) = np.frombuffer(cloud.data, contact_messages.CONTACT)
    assert (row['inner'], row['outer'], cloud.header.stamp.sec) == (0, 8, 412)
    assert row['t_contact'] == pytest.approx(T_STAR_NS / 1e9, abs=1e-6)
    assert row['depth'] == pytest.approx(1.6e-4, abs=1e-5)
    begin, end = heard.statuses()
    assert (begin.level, values(begin)['phase'], values(begin)['bracket']) == (b'\x02', 'begin', 'closed')
    assert float(values(begin)['approach_m_s']) == pytest.approx(0.02632, abs=1e-3)
    assert (end.level, values(end)['phase'], values(end)['cause']) == (b'\x00', 'end', 'parted')
    assert float(values(end)['deepest_gap_m']) == pytest.approx(-0.017409, abs=1e-5)
    assert values(end)['t_deepest_s'] == '413.760000000'
    assert float(values(end)['t_end_s']) == pytest.approx(415.01566, abs=1e-4)
    assert [message.data for message in heard.got['collision/active']] == [False, True, False]
    clearance = [message.data for message in heard.got['clearance']]
    assert clearance[:3] == pytest.approx([9.015e-4, 3.67e-4, -1.618e-4], abs=1e-5)
    monitor.wait_for('end of contact')
    lines = [line for line in monitor.text.splitlines() if 'of benches 0 and 8' in line or 'end of contact' in line]
    assert ['ERROR' in line for line in lines] == ['end of contact' not in line for line in lines]
    assert len(lines) == 2


def test_health_goes_from_ok_over_warn_to_error_and_back(start, node):
    start('monitor', '--ros-args', '-p', 'warn_below_m:=0.001')
    heard = Listener(node, '/diagnostics')
    node.until(lambda: heard.got['/diagnostics'])
    source = Publisher(node, 404)
    node.until(lambda: heard.got['/diagnostics'])       # the monitor listens from now on; it misses earlier messages
    source.show(404, 412.44, 412.48, 404)

    def levels():
        rows = [status.level for status in heard.statuses('/diagnostics')]
        return [row for n, row in enumerate(rows) if n == 0 or row != rows[n - 1]]
    node.until(lambda: levels() == [b'\x00', b'\x01', b'\x02', b'\x00'])
    last = heard.statuses('/diagnostics')[-1]
    assert last.name == 'dragon: clearance'
    assert float(values(last)['clearance_m']) > 0.001


def test_the_shortest_vector_is_published_with_its_stamp_where_it_is_asked_for(start, node):
    start('monitor', '--ros-args', '-p', 'clearance_vector:=true')
    heard, source = Listener(node, 'clearance', 'clearance/vector'), Publisher(node, 412.0)
    earlier = (412 + 0.02 * k for k in range(23))

    def both_are_heard():
        if not all(heard.got.values()):
            source.show(next(earlier))
        return all(heard.got.values())
    node.until(both_are_heard)
    source.show(412.46, 412.48)
    node.until(lambda: [row.header.stamp.nanosec for row in heard.got['clearance/vector']][-2:] == [
        460_000_000, 480_000_000] and len(heard.got['clearance']) >= 3)
    for gap, row in zip(heard.got['clearance'][-2:], heard.got['clearance/vector'][-2:], strict=True):
        assert np.hypot(row.vector.x, row.vector.y) == pytest.approx(abs(gap.data), abs=1e-12)
        assert row.header.frame_id == 'dragon'
    assert heard.got['clearance'][-1].data < 0 < heard.got['clearance'][-2].data


def test_the_limit_of_a_warning_is_set_live_and_the_hardware_is_the_namespace(start, node):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter
    start('monitor', '--ros-args', '-r', '__ns:=/red', '-r', 'handles:=/dragon/handles', '-r',
          'benches:=/dragon/benches')
    heard, source = Listener(node, '/diagnostics'), Publisher(node, 404)
    node.until(lambda: heard.got['/diagnostics'])
    client = node.create_client(SetParameters, '/red/monitor/set_parameters')
    node.until(client.service_is_ready)
    done = client.call_async(SetParameters.Request(parameters=[Parameter('warn_below_m', value=3).to_parameter_msg()]))
    node.until(done.done)
    assert done.result().results[0].successful
    source.show(404)
    node.until(lambda: heard.statuses('/diagnostics')[-1].level == b'\x01')
    last = heard.statuses('/diagnostics')[-1]
    assert (last.hardware_id, last.name) == ('red', 'red: clearance')
    assert values(last)['warn_below_m'] == '3'


def test_of_two_dragons_on_one_topic_the_monitor_keeps_the_one_it_knows_and_names_both(start, node, other_node):
    monitor = start('monitor')
    heard = Listener(node, 'collision', '/diagnostics', 'clearance')
    known = Publisher(node)
    known.show(412.40, 412.42)
    node.until(lambda: len(heard.got['clearance']) == 2)
    second = Publisher(other_node, 430)
    for n in range(20):
        known.show(412.44 + 0.02 * n)
        second.show(430 + 0.02 * n)
    node.until(lambda: len(heard.got['clearance']) >= 22)
    node.until(lambda: [status for status in heard.statuses('/diagnostics')
                        if status.name == 'dragon: monitor: publishers'])
    warned = next(status for status in heard.statuses('/diagnostics') if status.name == 'dragon: monitor: publishers')
    assert warned.level == b'\x01'
    assert values(warned) == dict.fromkeys(('/dragon/handles', '/dragon/benches'), '/dragon/observer, /dragon/stranger')
    assert len(heard.got['clearance']) == 22        # nothing from the second publisher
    # The monitor has never started again.
    assert [values(status)['phase'] for status in heard.statuses()] == ['begin']
    for out in known.out.values():
        node.destroy_publisher(out)
    node.until(lambda: node.count_publishers('/dragon/handles') == 1)
    before = len(heard.got['clearance'])
    shown = iter(range(20, 4000))

    def taken():
        second.show(430 + 0.02 * next(shown))
        return len(heard.got['clearance']) > before
    node.until(taken)       # the known publisher has left, and the other publisher has taken its place
    assert 'several publishers on one topic: /dragon/handles: /dragon/observer and /dragon/stranger' in monitor.text


def test_health_is_repeated_without_a_message(start, node):
    start('monitor')
    heard = Listener(node, '/diagnostics')
    node.until(lambda: len(heard.got['/diagnostics']) >= 2)
    assert {status.message for status in heard.statuses('/diagnostics')} == {'waiting for handles and benches'}


def test_a_monitor_or_listener_that_comes_late_knows_the_contact(start, node):
    first = start('monitor')
    source = Publisher(node)
    source.show(412.46, 412.48)
    first.wait_for('contact of benches 0 and 8')
    heard = Listener(node, 'collision', 'collision/active', 'collision/point', 'collision/markers')
    node.until(lambda: all(heard.got.values()))
    assert heard.got['collision/active'][-1].data is True
    assert len(heard.got['collision/markers'][-1].markers) == 5
    assert first.stop() == 0
    second = start('monitor')
    node.until(lambda: all(out.get_subscription_count() for out in source.out.values()))
    source.show(412.5)
    second.wait_for('contact of benches 0 and 8 at 412.500000 s')


def test_lost_doubled_reordered_and_broken_messages_and_a_restart_cost_no_contact(start, node):
    monitor = start('monitor')
    heard = Listener(node, 'collision')
    source = Publisher(node)
    source.show(412.40, 412.44, 412.44, 412.42, 412.46)
    source.out['handles'].publish(b'\x00\x01\x00\x00\x07')
    source.out['benches'].publish(b'rubbish')
    source.show(412.50, 412.48, 412.50, 412.52)
    node.until(lambda: len(heard.statuses()) == 1)
    assert values(heard.statuses()[0])['t_before_s'] == '412.460000000'
    for out in source.out.values():
        node.destroy_publisher(out)
    source = Publisher(node)
    source.show(412.0, 412.46, 412.48)
    node.until(lambda: len(heard.statuses()) == 3)
    assert [values(row)['phase'] for row in heard.statuses()] == ['begin', 'end', 'begin']
    assert values(heard.statuses()[1])['cause'] == 'restart'
    assert monitor.stop() == 0
    assert 'Traceback' not in monitor.text


def test_a_dragon_with_another_number_of_benches_ends_open_contacts_and_is_tracked_anew(start, node):
    monitor = start('monitor')
    heard = Listener(node, 'collision', 'collision/active', 'clearance')
    source = Publisher(node)
    source.show(412.46, 412.48)
    node.until(lambda: len(heard.statuses()) == 1)
    for out in source.out.values():
        node.destroy_publisher(out)
    source = Publisher(node, 412.0, 'dragon.benches=50')
    source.show(412.50, 415.02)
    node.until(lambda: len(heard.statuses()) == 4 and len(heard.got['clearance']) == 4)
    begin, ended, again, parted = (values(row) for row in heard.statuses())
    assert [row['phase'] for row in (begin, ended, again, parted)] == ['begin', 'end', 'begin', 'end']
    assert (ended['cause'], ended['t_end_s'][:10], parted['cause']) == ('restart', '412.480000', 'parted')
    assert (again['bracket'], again['t_contact_s'][:10]) == ('open', '412.500000')
    assert monitor.stop() == 0
    assert 'Traceback' not in monitor.text


def test_a_monitor_that_is_stopped_looks_at_all_that_had_come(start, node):
    from rclpy.duration import Duration
    monitor, source = start('monitor'), Publisher(node, 300.0)
    source.show(*(300 + 0.02 * k for k in range(100)))
    for out in source.out.values():
        assert out.wait_for_all_acked(Duration(seconds=30))
    assert monitor.stop() == 0, monitor.text
    assert 'saw 100 ticks' in monitor.text


def test_the_sim_never_publishes_what_only_a_monitor_may_say(start, node):
    start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'discovery_s:=0.0')
    node.until(lambda: node.count_publishers('handles') == 1)
    mine = [row.name for row in channels().values() if row.publisher == 'monitor']
    assert len(mine) == 11
    assert [node.count_publishers(name) for name in mine] == [0] * len(mine)


def test_a_recorder_keeps_every_topic_at_simulation_time(start, tmp_path):
    bag = tmp_path / 'run.mcap'
    monitor, record = start('monitor'), start('record', '--output', bag)
    record.wait_for('a monitor has been found')     # discovery may take longer than the run
    sim = start('sim', '--scene', 'first_contact', '--set', 'run.start_s=412.3', '--ros-args', '-p',
                'wait_subscribers:=[handles=2,benches=2,velocities=1]', '-p', 'time_scale:=0.5')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    assert monitor.stop() == 0, monitor.text
    with BagReader(bag) as run:
        counts = {topic.name: topic.messages for topic in run.topics}
        assert run.start_ns >= 412_300_000_000
        assert run.end_ns <= 413 * 10**9
        (begin,) = [row for message in run.messages(['/dragon/collision']) for row in read_diagnostics(message.data)]
    assert begin.values['phase'] == 'begin'
    assert counts['/diagnostics'] >= 1
    assert counts['/dragon/clearance'] >= 1
    assert (counts['/dragon/collision'], counts['/dragon/collision/point']) == (1, 1)
    assert counts['/dragon/collision/active'] == 2   # the latched message from before the run is included
    # There is one message per tick in contact, and only the last one is kept for late subscribers.
    assert 1 <= counts['/dragon/collision/markers'] <= 27


# By default, test_record.py checks each frame of a run that is held in its contact.
@pytest.mark.parametrize('mode', thinned(['stop', 'hold'], lambda mode: mode == 'stop'))
def test_the_sim_ends_or_holds_in_exactly_the_contact(start, node, mode):
    from geometry_msgs.msg import PoseArray
    heard, bytes_ = Listener(node, 'collision'), []
    node.create_subscription(PoseArray, 'handles', bytes_.append, 1000, raw=True)
    start('monitor')
    sim = start('sim', '--scene', 'first_contact', '--set', 'run.start_s=412.3', '--ros-args', '-p',
                f'on_contact:={mode}', '-p', 'wait_subscribers:=[handles=2,benches=1]', '-p', 'time_scale:=0.0')
    node.until(lambda: len(bytes_) == 10 and heard.statuses())
    if mode == 'hold':
        sim.wait_for('holding until a signal')
        assert sim.stop() == 0, sim.text
    assert sim.end() == 0, sim.text
    assert 'contact of benches 0 and 8 at 412.473837682 s' in sim.text
    assert len(bytes_) == 10
    last = read_pose_array(bytes_[-1])
    scene = load_scene('first_contact', ['run.start_s=412.3'])
    assert last.t_ns == T_STAR_NS
    assert np.array_equal(last.poses[:, :2], state(scene, first_contact(scene).t_s).p)
    assert read_pose_array(bytes_[-2]).t_ns == 412_460_000_000
    assert values(heard.statuses()[0])['t_contact_s'] == '412.473837682'


def test_a_contact_at_the_start_is_the_only_frame_and_without_contact_the_run_continues(start, node):
    from geometry_msgs.msg import PoseArray
    stamps = []
    node.create_subscription(PoseArray, 'handles', lambda data: stamps.append(read_pose_array(data).t_ns), 1000,
                             raw=True)

    def run(*overrides):
        stamps.clear()
        return start('sim', *(part for one in overrides for part in ('--set', one)), '--ros-args', '-p',
                    'on_contact:=stop', '-p', 'wait_subscribers:=[handles=1]', '-p', 'time_scale:=0.0')
    sim = run('run.start_s=412.6', 'run.stop_s=413')
    node.until(lambda: len(stamps) == 1)
    assert (sim.end(), stamps) == (0, [412_600_000_000])
    sim = run('run.start_s=10', 'run.stop_s=10.2')
    node.until(lambda: len(stamps) == 11)
    assert sim.end() == 0


def test_late_subscribers_receive_the_track_and_current_ones_the_clearance(start, node):
    from visualization_msgs.msg import Marker
    start('monitor')
    start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'wait_subscribers:=[handles=1,benches=1]',
          '-p', 'frame_id:=sea', '-p', 'at_end:=hold')
    heard = Listener(node, 'clearance/marker')
    node.until(lambda: heard.got['clearance/marker'])
    late = Listener(node, 'track')
    node.until(lambda: late.got['track'])
    (track,) = late.got['track']
    assert (track.type, track.header.frame_id, track.header.stamp.sec) == (Marker.LINE_STRIP, 'sea', 400)
    assert len(track.points) > 1000
    label = heard.got['clearance/marker'][0]
    assert (label.type, label.header.frame_id) == (Marker.TEXT_VIEW_FACING, 'sea')
    assert label.text.endswith(' mm')
    assert float(label.text.split()[0]) > 0


def test_the_ends_of_the_dragon_are_frames_with_the_pose_of_their_handles():
    from dragon_ros.nodes.tf_publisher import transforms_of
    scene = load_scene('winding')
    frame = tick(scene, 500)
    head, tail = transforms_of(frame, 'sea')
    assert [(one.header.frame_id, one.child_frame_id) for one in (head, tail)] == [
        ('sea', 'sea/head'), ('sea', 'sea/tail')]
    assert (head.header.stamp.sec, head.header.stamp.nanosec) == (10, 0)
    poses = read_pose_array(encoders(scene, 'sea')['handles'](frame)).poses
    for transform, pose in ((head.transform, poses[0]), (tail.transform, poses[-1])):
        assert (transform.translation.x, transform.translation.y) == tuple(pose[:2])
        assert (transform.rotation.z, transform.rotation.w) == tuple(pose[5:])


@pytest.mark.skipif(find_spec('tf2_msgs') is not None, reason='tf2_msgs is installed here')
def test_without_tf2_msgs_the_sim_says_what_to_install(start):
    sim = start('sim', '--ros-args', '-p', 'publish_tf:=true', '-p', 'discovery_s:=0.0')
    assert sim.end() == 2
    assert "install the package 'tf2_msgs'" in sim.text


def test_both_ends_are_on_tf_when_asked_for(start, node):
    tf2 = pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs has no wheel; it comes with ROS 2')
    messages = []
    node.create_subscription(tf2.TFMessage, '/tf', messages.append, 10)
    start('sim', '--ros-args', '-p', 'publish_tf:=true', '-p', 'discovery_s:=0.0')
    node.until(lambda: messages)
    assert [one.child_frame_id for one in messages[0].transforms] == ['dragon/head', 'dragon/tail']
