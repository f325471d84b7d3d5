"""The programs in docs/examples, beside real nodes over DDS."""
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from dragon_ros.core.step import state, velocity_of
from dragon_ros.scenes.load import load_scene

EXAMPLES = Path(__file__).parents[2] / 'docs' / 'examples'
PATIENCE_S = 60.0


@pytest.fixture
def example(domain, tmp_path, monkeypatch):
    """Start an example; it is killed when it says nothing for too long."""
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))
    children = []

    def run(name):
        children.append(subprocess.Popen([sys.executable, EXAMPLES / name], stdout=subprocess.PIPE,
                                         stderr=subprocess.STDOUT, text=True))
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
    child = example('tail_speed.py')
    start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'time_scale:=0.0', '-p',
          'wait_subscribers:=[handles=1]')
    assert 'the tail is at' in child.stdout.readline()
    child.send_signal(signal.SIGINT)
    rest = child.stdout.read()
    assert child.wait() == 0
    assert 'Error' not in rest
