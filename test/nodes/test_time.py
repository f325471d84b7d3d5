"""Time on /clock and on stamps: who publishes it, how it stands and steps, and how an offset shifts all of it."""
import json
import time

import pytest

rclpy = pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseArray  # noqa: E402
from mcap.writer import Writer  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from dragon_ros.__main__ import main  # noqa: E402
from dragon_ros.bags.read.reader import BagReader  # noqa: E402
from dragon_ros.core.scene import NS, Run, Scene  # noqa: E402
from dragon_ros.core.step import tick  # noqa: E402
from dragon_ros.messages.decode import read_string, stamp_of_message  # noqa: E402
from dragon_ros.messages.encode import encoders  # noqa: E402
from dragon_ros.messages.observation import read_handles  # noqa: E402
from dragon_ros.nodes.launch_plan import ARGUMENTS, plan  # noqa: E402
from dragon_ros.scenes.load import load_scene  # noqa: E402

SHORT = '--scene', 'first_contact', '--set', 'run.start_s=412', '--set', 'run.stop_s=412.6'
AT_ONCE = '--ros-args', '-p', 'discovery_s:=0.0'


def call(node, name):
    client = node.create_client(Trigger, name)
    node.until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    node.until(future.done)
    return future.result()


def test_a_node_on_simulation_time_stands_still_while_paused_and_moves_with_steps(start, node):
    stamps = []
    node.create_subscription(PoseArray, 'handles', lambda m: stamps.append(
        m.header.stamp.sec * NS + m.header.stamp.nanosec), 1000)
    node.set_parameters([Parameter('use_sim_time', value=True)])
    start('sim', '--ros-args', '-p', 'publish_clock:=true', '-p', 'wait_subscribers:=[handles=1]')

    def now():
        return node.get_clock().now().nanoseconds
    node.until(lambda: len(stamps) > 5)
    assert call(node, '/dragon/sim/pause').success
    beats = []
    node.create_subscription(Clock, '/clock', beats.append, 10)
    node.until(lambda: len(beats) >= 2)     # repeated while time stands
    assert now() == stamps[-1]
    for _ in range(3):
        before = now()
        assert call(node, '/dragon/sim/step').success
        node.until(lambda before=before: now() > before)
    node.until(lambda: now() == stamps[-1])
    assert stamps[-1] - stamps[-4] == 3 * NS // 50


def test_a_clock_that_somebody_publishes_is_left_alone_and_a_later_one_is_named(start, node, other_node):
    first = other_node.create_publisher(Clock, '/clock', 10)
    sim = start('sim', '--ros-args', '-p', 'publish_clock:=true')
    sim.wait_for('/clock is published by /dragon/stranger, so this node does not publish it')
    node.until(lambda: node.count_publishers('/dragon/handles') == 1)
    assert [one.node_name for one in node.get_publishers_info_by_topic('/clock')] == ['stranger']
    assert sim.stop() == 0
    other_node.destroy_publisher(first)
    node.until(lambda: not node.count_publishers('/clock'))
    alone = start('sim', '--ros-args', '-p', 'publish_clock:=true')
    node.until(lambda: node.count_publishers('/clock') == 1)
    other_node.create_publisher(Clock, '/clock', 10)
    alone.wait_for('/clock is also published by /dragon/stranger; start all but one')
    assert alone.stop() == 0
    assert alone.text.count('is also published') == 1


def shifted_bag(start, tmp_path, *arguments):
    record = start('record', '--output', 'run.mcap')
    sim = start('sim', *SHORT, '--ros-args', '-p', 'wait_subscribers:=[handles=1,benches=1,velocities=1]', *arguments)
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    with BagReader(tmp_path / 'run.mcap') as bag:
        stamps = [(message.t_ns, read_handles(message.data).t_ns) for message in bag.messages(['/dragon/handles'])]
        scene = next(bag.messages(['/dragon/scene'])).data
    return stamps, read_string(scene)


def test_an_offset_shifts_stamps_the_clock_and_the_bag_which_says_so_and_is_complete(start, node, tmp_path, capfd):
    clock = []
    node.create_subscription(Clock, '/clock', lambda m: clock.append(m.clock.sec * NS + m.clock.nanosec), 1000)
    stamps, text = shifted_bag(start, tmp_path, '-p', 'stamp_offset:=1000.5', '-p', 'publish_clock:=true', '-p',
                               'discovery_s:=1.0')
    wanted = [round(1412.5 * NS) + k * NS // 50 for k in range(31)]
    assert stamps == [(t_ns, t_ns) for t_ns in wanted]
    assert 'stamp_offset_s: 1000.5' in text
    node.until(lambda: clock and clock[-1] == wanted[-1])
    assert set(clock) <= set(wanted)
    assert main(['inspect', str(tmp_path / 'run.mcap'), '--check']) == 0
    assert main(['inspect', str(tmp_path / 'run.mcap')]) == 0
    assert 'stamps are 1000.5 s later' in capfd.readouterr().out
    assert main(['inspect', str(tmp_path / 'run.mcap'), '--format', 'json']) == 0
    contact = json.loads(capfd.readouterr().out)['first_contact']
    assert contact['t_s'] == pytest.approx(1000.5 + 412.473837, abs=1e-6)
    assert (contact['source'], contact['in_bag']) == ('scene', True)


def test_wall_stamps_begin_at_the_wall_time_of_the_first_tick(start, tmp_path):
    before_s = time.time()
    stamps, _ = shifted_bag(start, tmp_path, '-p', 'stamp_offset:=wall')
    assert before_s - 1e-3 <= stamps[0][0] / NS <= time.time()
    assert main(['inspect', str(tmp_path / 'run.mcap'), '--check']) == 0


@pytest.mark.parametrize('given', ['walll', '-413.0', '3e9'])
def test_an_offset_that_cannot_be_is_one_line(start, given):
    sim = start('sim', *SHORT, *AT_ONCE, '-p', f'stamp_offset:={given}')
    assert sim.end() == 2
    assert 'stamp_offset' in sim.text
    assert 'Traceback' not in sim.text


def test_a_shifted_run_that_was_simulated_or_stops_at_its_contact_checks(start, tmp_path, capfd):
    assert main(['simulate', *SHORT, '--set', 'run.stamp_offset_s=1e9', '--output', str(tmp_path / 'a.mcap')]) == 0
    assert main(['inspect', str(tmp_path / 'a.mcap'), '--check']) == 0
    record = start('record', '--output', 'b.mcap')
    sim = start('sim', *SHORT, '--ros-args', '-p', 'wait_subscribers:=[handles=1,benches=1,velocities=1]', '-p',
                'stamp_offset:=1e9', '-p', 'on_contact:=stop')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    assert main(['inspect', str(tmp_path / 'b.mcap'), '--check']) == 0
    with BagReader(tmp_path / 'b.mcap') as bag:
        assert bag.end_ns == 10**18 + 412_473_837_492 - 1 or abs(bag.end_ns - 10**18 - 412.473837 * NS) < 1e3


def test_a_shifted_led_run_checks_and_is_examined_to_its_end(start, tmp_path, capfd):
    record = start('record', '--output', 'led.mcap')
    sim = start('sim', '--scene', 'led', '--set', 'dragon.benches=9', '--set', 'run.stop_s=0.5', '--ros-args', '-p',
                'wait_subscribers:=[handles=1,leader=1]', '-p', 'stamp_offset:=1000.25')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    assert main(['inspect', str(tmp_path / 'led.mcap'), '--check']) == 0
    assert main(['contact', str(tmp_path / 'led.mcap')]) == 0
    assert 'examined only' not in ''.join(capfd.readouterr())


def test_a_replay_uses_the_recorded_clock(start, node, tmp_path):
    scene = Scene(run=Run(10, 10.4, 50))
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        places = []
        for topic, kind in (('/dragon/handles', 'geometry_msgs/msg/PoseArray'), ('/clock', 'rosgraph_msgs/msg/Clock')):
            places.append(writer.register_channel(topic, 'cdr', writer.register_schema(kind, 'ros2msg', b'')))
        for k in range(21):
            t_ns = scene.run.time_ns(k)
            clock = b'\0\1\0\0' + (77).to_bytes(4, 'little') + k.to_bytes(4, 'little')
            for place, data in zip(places, (encoders(scene)['handles'](tick(scene, k)), clock), strict=True):
                writer.add_message(place, t_ns, bytes(data), t_ns)
        writer.finish()
    times = []
    node.create_subscription(Clock, '/clock', lambda m: times.append((m.clock.sec, m.clock.nanosec)), 100)
    replay = start('replay', tmp_path / 'a.mcap', '--clock', '--wait-subscribers', '/clock=1')
    assert replay.end() == 0, replay.text
    node.until(lambda: len(times) == 21)
    assert times == [(77, k) for k in range(21)]


def planned(**given):
    return plan({**{one.name: one.default for one in ARGUMENTS}, **given}).source.parameters


def test_a_launch_publishes_the_clock_whether_or_not_its_nodes_follow_it():
    assert planned()['publish_clock'] is True
    assert planned()['use_sim_time'] is False
    assert planned(clock='False', use_sim_time='true')['publish_clock'] is False
    assert planned(clock='False', use_sim_time='true')['use_sim_time'] is True
    assert planned(stamp_offset='wall')['stamp_offset'] == 'wall'


@pytest.mark.parametrize('offset_s', [0.0, 1e9, -400.0, 0.1])
def test_an_offset_changes_stamps_alone(offset_s):
    plain = load_scene('first_contact', ['run.start_s=412'])
    moved = load_scene('first_contact', ['run.start_s=412', f'run.stamp_offset_s={offset_s}'])
    for k in (0, 7, 40):
        one, two = tick(plain, k), tick(moved, k)
        assert (one.chain.p == two.chain.p).all()
        assert (one.velocity_m_s == two.velocity_m_s).all()
        assert two.t_ns - one.t_ns == round(offset_s * NS)
        assert stamp_of_message('geometry_msgs/msg/PoseArray', encoders(moved)['handles'](two)) == two.t_ns
