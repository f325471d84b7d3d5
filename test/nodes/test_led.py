"""A dragon is led by commands on ``cmd_vel``, and its bag can then be checked, searched and plotted."""
import itertools
import json
import signal

import pytest
from properties import thinned

from dragon_ros.__main__ import main
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.messages.decode import read_odometry

NS = 10**9
LED = ('--scene', 'led', '--set', 'dragon.benches=30', '--set', 'head.max_speed_m_s=1.5',
       '--set', 'head.max_acceleration_m_s2=5')
READERS = 'wait_subscribers:=[handles=1,leader=2,velocities=1,benches=1,scene=1]'


class Leader:
    """A node that commands speeds, ten times per timeout, and receives the motion of the leading handle."""

    def __init__(self, node, stamped=True):
        from geometry_msgs.msg import Twist, TwistStamped
        from nav_msgs.msg import Odometry
        self.node, self.kind, self.speeds = node, TwistStamped if stamped else Twist, []
        self.out = node.create_publisher(self.kind, 'cmd_vel', 10)
        node.create_subscription(Odometry, 'leader', lambda data: self.speeds.append(read_odometry(data)[1]), 1000,
                                 raw=True)

    def say(self, speed, off_s=0):
        """Command a speed, stamped by the node's clock plus an offset, or without a stamp if the offset is None."""
        message = self.kind()
        twist = getattr(message, 'twist', message)
        twist.linear.x = speed
        if hasattr(message, 'header') and off_s is not None:
            message.header.stamp = self.node.get_clock().now().to_msg()
            message.header.stamp.sec += off_s
        self.out.publish(message)

    def keep_saying(self, speed, until):
        """Repeat a command until a condition holds."""
        timer = self.node.create_timer(0.05, lambda: self.say(speed))
        self.node.until(until)
        self.node.destroy_timer(timer)


def leader_speeds(path):
    with BagReader(path) as bag:
        return [read_odometry(message.data)[1] for message in bag.messages(['/dragon/leader'])]


def test_a_led_dragon_walks_as_commanded_and_its_bag_is_recomputed_bit_for_bit(start, node, tmp_path, capsys):
    bag, leader = tmp_path / 'led.mcap', Leader(node)
    record = start('record', '--output', bag)
    sim = start('sim', *LED, '--ros-args', '-p', READERS)
    node.until(lambda: leader.speeds)
    for speed in (float('nan'), float('inf'), -float('inf')):
        leader.say(speed)
    leader.say(1.0, off_s=-60)
    leader.say(1.0, off_s=60)
    sim.wait_for('command dropped')
    leader.keep_saying(9.0, lambda: leader.speeds[-1] == 1.5)       # the largest speed that the scene allows
    leader.keep_saying(-0.25, lambda: leader.speeds[-1] == -0.25)
    node.until(lambda: leader.speeds[-1] == 0.0)                    # the last command has expired
    assert sim.stop() == 0, sim.text
    assert record.end() == 0, record.text
    assert '3 not finite, 2 stale' in sim.text
    speeds = leader_speeds(bag)
    assert speeds[:len(leader.speeds)] == leader.speeds
    assert max(abs(b - a) for a, b in itertools.pairwise(speeds)) <= 5 / 50 * (1 + 1e-9)
    assert main(['inspect', str(bag), '--check']) == 0
    said = capsys.readouterr().out
    assert f'{4 * len(speeds)} messages are bit-identical to the model, 0 are not' in said
    for command in (['inspect', bag], ['table', bag, '--times', '1', '--handles', '0'],
                    ['contact', bag, '--format', 'json', '--certificate', tmp_path / 'proof.json'],
                    ['contact', '--verify', tmp_path / 'proof.json'],
                    ['plot', 'dragon', '--bag', bag, '--output', tmp_path / 'led.png']):
        assert main([str(part) for part in command]) == 0, command
    assert json.loads((tmp_path / 'proof.json').read_text())['scene']['head']['kind'] == 'profile'


@pytest.mark.long       # by default, test_compare.py checks such bags, and test_record.py kills recorders
def test_what_a_killed_recorder_got_of_a_led_run_is_recomputed_up_to_its_last_tick(start, node, tmp_path, capsys):
    bag, leader = tmp_path / 'led.mcap', Leader(node, stamped=False)
    record = start('record', '--output', bag, '--flush-s', '0.2')
    sim = start('sim', *LED, '--ros-args', '-p', READERS, '-p', 'cmd_vel_stamped:=false')
    node.until(lambda: leader.speeds)
    leader.keep_saying(0.5, lambda: leader.speeds[-1] == 0.5 and len(leader.speeds) > 60)
    record.signal(signal.SIGKILL)
    assert sim.stop() == 0, sim.text
    record.end()
    assert main(['inspect', str(bag), '--repair', str(tmp_path / 'whole.mcap')]) == 0
    capsys.readouterr()
    assert main(['inspect', str(tmp_path / 'whole.mcap'), '--check', '--format', 'json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['equal'] >= 4 * 25
    assert found['equal'] % 4 == 0 or any(' lacks ' in note for note in found['notes'])     # of the last tick


@pytest.mark.parametrize('act', thinned(['hold', 'stop'], lambda act: act == 'hold'))
def test_a_led_dragon_stops_with_the_first_tick_in_contact(start, node, act):
    leader = Leader(node)
    sim = start('sim', '--scene', 'led', '--set', 'track.start_turns=4.2', '--set', 'effects=[contact, clearance, '
                'benches]', '--ros-args', '-p', f'on_contact:={act}', '-p', 'wait_subscribers:=[leader=1]')
    node.until(lambda: leader.speeds)
    leader.keep_saying(2.0, lambda: 'are in contact at' in sim.text)
    if act == 'hold':
        sim.wait_for('holding until a signal')
        assert sim.stop() == 0, sim.text
    assert sim.end() == 0, sim.text
    node.until(lambda: f'stopping: benches 0 and 8 are in contact at {(len(leader.speeds) - 1) / 50:.9f} s' in sim.text)


def test_a_led_dragon_has_a_pace_and_no_other_ticks(start, node):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter
    from std_srvs.srv import Trigger
    fast = start('sim', *LED, '--ros-args', '-p', 'time_scale:=0.0')
    assert fast.end() == 2
    assert 'commands arrive in real time' in fast.text
    leader = Leader(node)
    start('sim', *LED, '--ros-args', '-p', 'wait_subscribers:=[leader=1]')
    node.until(lambda: leader.speeds)
    client = node.create_client(Trigger, 'sim/seek')
    node.until(client.service_is_ready)
    done = client.call_async(Trigger.Request())      # seek without a time returns to the start, like reset
    node.until(done.done)
    assert not done.result().success
    assert 'seek_s: -1' in done.result().message
    assert 'reset it' in done.result().message
    put = node.create_client(SetParameters, 'sim/set_parameters')
    node.until(put.service_is_ready)
    done = put.call_async(SetParameters.Request(parameters=[Parameter('seek_s', value=0.0).to_parameter_msg()]))
    node.until(done.done)
    assert 'a led dragon cannot seek' in done.result().results[0].reason


def test_a_command_of_the_other_type_gets_a_word_with_its_cure(start, node):
    from geometry_msgs.msg import Twist
    node.create_publisher(Twist, 'cmd_vel', 1)
    sim = start('sim', *LED)
    sim.wait_for('/dragon/cmd_vel: /dragon/observer publishes geometry_msgs/msg/Twist, but this sim accepts only '
                 'geometry_msgs/msg/TwistStamped; start')
    assert 'cmd_vel_stamped:=false' in sim.text


def test_commands_are_accepted_again_after_the_clock_was_set_back(node):
    from geometry_msgs.msg import TwistStamped
    from rclpy.parameter import Parameter
    from rosgraph_msgs.msg import Clock

    from dragon_ros.nodes.led import Commands
    node.set_parameters([Parameter('use_sim_time', value=True)])
    commands, times, out = (Commands(node, 0.5, stamped=True), node.create_publisher(Clock, '/clock', 1),
                            node.create_publisher(TwistStamped, 'cmd_vel', 10))

    def say(t_ns, stamp_ns):
        """Set the clock, and send a command."""
        now, message = Clock(), TwistStamped()
        for stamp, value in (now.clock, t_ns), (message.header.stamp, stamp_ns):
            stamp.sec, stamp.nanosec = divmod(value, NS)
        node.until(lambda: times.publish(now) or node.get_clock().now().nanoseconds == t_ns)
        before = commands.taken + commands.dropped.total()
        out.publish(message)
        node.until(lambda: commands.taken + commands.dropped.total() == before + 1)

    for t_s in (10, 20, 5):     # as after a reset of a sim that leads the clock
        say(t_s * NS, t_s * NS)
    assert (commands.taken, commands.dropped.total()) == (3, 0)
    say(5 * NS, 5 * NS - 1)     # older than the last command
    say(5 * NS, 6 * NS)
    say(5 * NS + 1, 5 * NS)
    assert (commands.taken, dict(commands.dropped)) == (4, {'stale': 2})


def test_a_stale_command_is_said_to_be_ahead_or_behind_and_of_which_clock(start, node):
    from geometry_msgs.msg import TwistStamped
    out = node.create_publisher(TwistStamped, 'cmd_vel', 10)
    sim = start('sim', *LED, '--ros-args', '-p', 'discovery_s:=0.0')
    node.until(lambda: node.count_subscribers('/dragon/cmd_vel') == 1)
    message = TwistStamped()

    def said(words, sec):
        message.header.stamp.sec = sec
        out.publish(message)
        return words in sim.text
    node.until(lambda: said('s behind the wall clock, which this node follows', 100))
    node.until(lambda: said('s ahead of the wall clock, which this node follows', 2**31 - 1))
    assert ' -' not in sim.text.partition('command dropped')[2].partition('\n')[0]
