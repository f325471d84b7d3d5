"""The programs in docs/examples work beside real nodes over DDS."""
import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from processes import Forked, Started

from dragon_ros.core.batches import velocity_of
from dragon_ros.core.step import state
from dragon_ros.scenes.load import load_scene

EXAMPLES = Path(__file__).parents[2] / 'docs' / 'examples'
PATIENCE_S = 60.0


@pytest.fixture
def example(domain, tmp_path, monkeypatch):
    """Start an example, forked or, if necessary, ``anew``, and kill it if it prints nothing for too long."""
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))
    children = []

    def run(name, anew=False):
        children.append(Started([sys.executable, EXAMPLES / name], os.environ, tmp_path) if anew else Forked(
            [], os.environ, tmp_path, program=EXAMPLES / name))
        guard = threading.Timer(PATIENCE_S, children[-1].kill)
        guard.daemon = True
        guard.start()
        children.append(guard)
        return children[0]
    yield run
    child, guard = children
    guard.cancel()
    child.kill()
    child.wait()
    child.stdout.close()


def test_the_subscriber_of_the_tutorial_prints_the_speed_of_the_tail(example, start):
    child = example('tail_speed.py')
    sim = start('sim', '--scene', 'first_contact', '--set', 'run.stop_s=403', '--ros-args', '-p', 'time_scale:=0.0',
                '-p', 'wait_subscribers:=[handles=1]')
    lines = [child.stdout.readline() for _ in range(3)]
    assert sim.end() == 0
    scene = load_scene('first_contact')
    for line in lines:
        t_s, speed = map(float, re.fullmatch(r' +([\d.]+) s: the tail is at ([\d.]+) m/s\n', line).groups())
        vx, vy = velocity_of(scene, state(scene, t_s), t_s)[-1]
        assert speed == pytest.approx((vx * vx + vy * vy) ** 0.5, abs=1e-3)


def test_ctrl_c_ends_the_subscriber_of_the_tutorial_quietly_while_messages_come(example, start):
    child = example('tail_speed.py', anew=True)
    start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'time_scale:=0.0', '-p',
          'wait_subscribers:=[handles=1]')
    assert 'the tail is at' in child.stdout.readline()
    child.send_signal(signal.SIGINT)
    rest = child.stdout.read()
    assert child.wait() == 0
    assert 'Error' not in rest


def quiet_end(child):
    """End an example as a user would, who presses Ctrl-C again if nothing happens; it must print nothing.

    Python ignores a KeyboardInterrupt that arrives in a destructor.
    """
    for _ in range(3):
        child.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            child.wait(10)
            break
    rest = child.stdout.read()
    assert child.wait() != -signal.SIGKILL, 'it ignores Ctrl-C'
    assert 'Error' not in rest
    assert 'Traceback' not in rest


SHORT = '--scene', 'first_contact', '--set', 'run.start_s=412', '--set', 'run.stop_s=412.5'


def test_the_follower_stays_behind_the_head(example, start, node):
    from geometry_msgs.msg import PoseStamped
    heard = []
    node.create_subscription(PoseStamped, 'follower', heard.append, 1000)
    child = example('follow_head.py')
    node.until(lambda: node.count_publishers('follower') == 1)
    start('sim', '--set', 'run.stop_s=5', '--set', 'dragon.benches=9', '--ros-args', '-p', 'time_scale:=4.0', '-p',
          'wait_subscribers:=[handles=1]')
    node.until(lambda: heard and heard[-1].header.stamp.sec == 5)
    scene = load_scene('winding', ['run.stop_s=5', 'dragon.benches=9'])
    x, y = state(scene, 5.0).p[0]
    place = heard[-1].pose.position
    assert ((place.x - x) ** 2 + (place.y - y) ** 2) ** 0.5 == pytest.approx(2.0, abs=0.05)
    quiet_end(child)


def test_the_consumer_of_two_topics_pairs_the_messages_of_a_tick(example, start):
    child = example('synchronized.py')
    sim = start('sim', *SHORT, '--ros-args', '-p', 'wait_subscribers:=[handles=1,benches=1]')
    lines = [child.stdout.readline() for _ in range(26)]
    assert sim.end() == 0, sim.text
    assert [line.split(' s: ')[0] for line in lines] == [f'{412 + 0.02 * k:.2f}' for k in range(26)]
    assert all(float(line.split()[2]) < 1e-12 for line in lines)
    quiet_end(child)


def test_the_checker_of_the_chain_finds_the_lengths_of_the_links(example, start):
    child = example('chain_error.py')
    sim = start('sim', '--scene', 'first_contact', '--set', 'run.stop_s=402.5', '--ros-args', '-p',
                'wait_subscribers:=[handles=1]')
    lines = [child.stdout.readline() for _ in range(3)]
    assert sim.end() == 0, sim.text
    assert [line.split(' s: ')[0] for line in lines] == ['400', '401', '402']
    assert all(float(line.split()[2]) < 1e-12 for line in lines)
    quiet_end(child)


def test_the_checker_of_joints_finds_each_bench_where_sim_has_it(example, start):
    child = example('joint_check.py')
    sim = start('sim', *SHORT, '--set', 'effects=[benches, joints]', '--ros-args', '-p', 'robot_description:=true',
                '-p', 'wait_subscribers:=[joint_states=1,benches=1,robot_description=1]')
    lines = [child.stdout.readline() for _ in range(15)]
    assert sim.end() == 0, sim.text
    assert all(float(line.split()[2]) < 1e-9 for line in lines), lines
    quiet_end(child)


@pytest.mark.parametrize('name', ['chain_error.py', 'joint_check.py', 'lead.py'])
def test_the_three_small_nodes_have_at_most_forty_lines(name):
    assert len((EXAMPLES / name).read_text().splitlines()) <= 40


def test_the_leader_leads_a_dragon(example, start, node):
    from nav_msgs.msg import Odometry
    speeds = []
    node.create_subscription(Odometry, 'leader', lambda message: speeds.append(message.twist.twist.linear.x), 1000)
    sim = start('sim', '--scene', 'led', '--set', 'dragon.benches=9', '--set', 'head.max_acceleration_m_s2=5',
                '--ros-args', '-p', 'wait_subscribers:=[leader=1]')
    child = example('lead.py')
    node.until(lambda: speeds and speeds[-1] == 1.0)
    quiet_end(child)
    node.until(lambda: speeds[-1] == 0.0)
    assert sim.stop() == 0, sim.text


def test_a_dragon_of_ones_own_is_watched(example, start, node):
    from geometry_msgs.msg import PoseArray

    from dragon_ros.core.step import tick
    from dragon_ros.messages.encode import encoders
    scene = load_scene('first_contact', ['run.start_s=412', 'run.stop_s=413'])
    child, monitor = example('my_dragon.py'), start('monitor', '--ros-args', '-r', '__ns:=/mine')
    handles = node.create_publisher(PoseArray, '/mine/handles', 100)
    node.until(lambda: handles.get_subscription_count() == 2 and node.count_subscribers('/mine/benches') == 1
               and node.count_publishers('/mine/benches') == 1)
    encode, seen = encoders(scene)['handles'], iter(range(51))

    def contact():
        if (k := next(seen, None)) is not None:
            handles.publish(encode(tick(scene, k)))
        return 'contact of benches 0 and 8' in monitor.text
    node.until(contact)
    quiet_end(child)


def test_the_reader_of_a_bag_prints_what_the_model_says(tmp_path):
    from dragon_ros.__main__ import main
    assert main(['simulate', *SHORT, '--output', str(tmp_path / 'run.mcap')]) == 0
    done = subprocess.run([sys.executable, EXAMPLES / 'read_bag.py', tmp_path / 'run.mcap'], capture_output=True,
                          text=True, check=True)
    x, y = state(load_scene('first_contact'), 412.0).p[0]
    assert done.stdout.startswith(f'412 s: head at ({x:.3f}, {y:.3f}) m, clearance 0.0')
