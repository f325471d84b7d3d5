"""Nodes log at every severity from a package behind a symlink, and write JSON for machines."""
import json
import os
import sys
from pathlib import Path

import pytest
from processes import Process, Started

pytest.importorskip('rclpy')

from geometry_msgs.msg import Point

from dragon_ros.messages.channels import channels
from dragon_ros.nodes import logs, qos

PACKAGE = Path(__file__).parents[2]


def test_sim_and_monitor_run_from_a_symlinked_package_through_an_overrun_and_a_contact(domain, tmp_path):
    # `colcon build --symlink-install` and workspaces behind a link import every module through a symlink.
    linked = tmp_path / 'linked'
    linked.mkdir()
    (linked / 'dragon_ros').symlink_to(PACKAGE / 'dragon_ros')
    environment = {**os.environ, 'PYTHONPATH': str(linked), 'PYTHONUNBUFFERED': '1',
                   'ROS_LOG_DIR': str(tmp_path / 'log')}

    def run(*words):
        return Process(Started([sys.executable, '-m', 'dragon_ros', *words], environment, tmp_path))
    monitor = run('monitor')
    sim = run('sim', '--scene', 'first_contact', '--set', 'run.start_s=400', '--set', 'run.stop_s=412.7',
              '--ros-args', '-p', 'wait_subscribers:=[handles=1,benches=1]', '-p', 'time_scale:=100000.0', '-p',
              'at_end:=stop')       # ticks are late
    try:
        assert sim.end() == 0, sim.text
        monitor.wait_for('benches 0 and 8')
        assert monitor.stop() == 0, monitor.text
    finally:
        sim.kill()
        monitor.kill()
    assert 'WARN' in sim.text
    assert 'overrun' in sim.text


class RosLogger:
    """Stands for a logger of ROS whose level is INFO, warnings excepted."""

    name = 'a node'

    def info(self, message):
        return True

    def warning(self, message):
        return False


def test_json_has_the_messages_that_pass_the_severity(capsys, monkeypatch):
    monkeypatch.setitem(logs._mode, 'json', True)
    one = logs.NodeLogger(RosLogger())
    one.info('here')
    one.warning('not here')
    (row,) = map(json.loads, capsys.readouterr().err.splitlines())
    assert (row['level'], row['name'], row['message']) == ('info', 'a node', 'here')


def test_control_characters_of_others_do_not_reach_the_terminal(start, node, capsys):
    from visualization_msgs.msg import Marker, MarkerArray
    logs.say('error', 'replay', 'a\x1b[2Jb')
    assert capsys.readouterr().err == 'replay: a\\x1b[2Jb\n'
    monitor = start('monitor')
    venue = node.create_publisher(MarkerArray, 'venue', qos.of_channel(channels()['venue']))
    marker = Marker(ns='venue', type=Marker.LINE_STRIP, points=[Point(), Point(x=1.0)])
    marker.header.frame_id = 'a\x1b[2Jb'
    venue.publish(MarkerArray(markers=[marker, Marker(ns='venue', type=Marker.LINE_STRIP, points=marker.points)]))
    monitor.wait_for('several frames: , a\\x1b[2Jb')
    assert '\x1b' not in monitor.text


def test_seldom_is_true_once_per_period(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(logs.time, 'monotonic', lambda: now_s[0])
    seldom, due = logs.Seldom(1.0), []
    for now_s[0] in (100.0, 100.5, 101.0, 101.9, 102.1):
        due.append(seldom())
    assert due == [True, False, True, False, True]
