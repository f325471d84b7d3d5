"""Nodes work without any private name of rclpy, and with an rclpy that is newer than those tested."""
import os
import sys
import threading
from pathlib import Path

import pytest

rclpy = pytest.importorskip('rclpy')

from processes import Process, Started  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from dragon_ros.bags.read.reader import BagReader  # noqa: E402
from dragon_ros.core.errors import InputError  # noqa: E402
from dragon_ros.nodes import raw_subscription, rclpy_internals, shell  # noqa: E402

ROOT = Path(__file__).parents[2]
NAMES = 'WaitSet', 'take_message', '_parameter_overrides'
NEWER = ('import sys; from dragon_ros.nodes import rclpy_internals; rclpy_internals.NEWEST = 0; '
         'from dragon_ros.__main__ import main; sys.exit(main(sys.argv[1:]))')


@pytest.fixture(params=['', *NAMES, 'all'])
def hidden(monkeypatch, request):
    """Hide one private name of rclpy, none of them or all of them; the result is the hidden name."""
    real = rclpy_internals._private

    def private(owner, name):
        assert name in NAMES
        return None if request.param in (name, 'all') else real(owner, name)
    monkeypatch.setattr(rclpy_internals, '_private', private)
    return request.param


@pytest.fixture
def context(domain):
    rclpy.init(args=['--ros-args', '-p', 'a:=1', '-p', 'b:=[x]', '-p', 'd:=2.5'])
    yield
    rclpy.shutdown()


def test_given_parameters_are_found(hidden, context):
    node = rclpy.create_node('reader')
    given = rclpy_internals.given_parameters(node)
    assert {name: given[name] for name in given if not node.has_parameter(name)} == {'a': 1, 'b': ['x'], 'd': 2.5}
    assert [name for name in node.get_node_names() if name == 'reader'] == ['reader']
    node.destroy_node()


def test_an_empty_list_is_a_value_or_an_error_of_one_line(hidden, domain):
    rclpy.init(args=['--ros-args', '-p', 'c:=[]'])
    node = rclpy.create_node('reader')
    if hidden in ('_parameter_overrides', 'all'):
        with pytest.raises(InputError, match='parameters of reader: one is an empty list; omit it'):
            rclpy_internals.given_parameters(node)
    else:
        assert rclpy_internals.given_parameters(node) == {'c': []}
    node.destroy_node()
    rclpy.shutdown()


def test_messages_timers_and_requests_are_served(hidden, context):
    node, got, ticks = rclpy.create_node('served'), [], []
    raw_subscription.subscribe_raw(node, Float64, 'x', lambda data, info: got.append(
        raw_subscription.number(info)), QoSProfile(depth=1000))
    publisher, client = node.create_publisher(Float64, 'x', 1000), node.create_client(Trigger, 'ask')
    node.create_service(Trigger, 'ask', lambda _, response: Trigger.Response(success=True, message='yes'))
    node.create_timer(0.005, lambda: ticks.append(1))
    stop = threading.Event()
    rescue = threading.Timer(60, stop.set)
    rescue.start()
    shell.spin(node, stop, lambda: publisher.get_subscription_count() and client.service_is_ready())
    future = client.call_async(Trigger.Request())
    for value in range(200):
        publisher.publish(Float64(data=float(value)))
    shell.spin(node, stop, lambda: len(got) == 200 and future.done() and len(ticks) > 3)
    shell.spin(node, stop, lambda: True, rest_s=60)
    rescue.cancel()
    node.destroy_node()
    assert got == list(range(1, 201))
    assert future.result().message == 'yes'


@pytest.mark.parametrize(('version', 'tested'), [
    ('7.1.5', True), (f'{rclpy_internals.NEWEST}.9.9', True), (f'{rclpy_internals.NEWEST + 1}.0.0', False),
    ('of an unknown version', False)])
def test_only_versions_up_to_the_newest_tested_one_count_as_tested(monkeypatch, version, tested):
    monkeypatch.setattr(rclpy_internals, 'version_of_rclpy', lambda: version)
    assert rclpy_internals.is_tested.__wrapped__() == tested


def test_with_a_newer_rclpy_each_node_says_so_in_one_line_and_a_recording_is_complete(domain, tmp_path):
    environment = {**os.environ, 'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': '1', 'ROS_LOG_DIR': str(tmp_path / 'log')}

    def run(*words):
        return Process(Started([sys.executable, '-c', NEWER, *words], environment, tmp_path))
    nodes = [run('monitor'), run('record', '--output', 'run.mcap', '--wait-monitor')]
    nodes.append(run('sim', '--scene', 'first_contact', '--set', 'run.start_s=412', '--set', 'run.stop_s=412.7',
                     '--ros-args', '-p', 'wait_subscribers:=[handles=2,benches=2,velocities=1]',
                     '-p', 'discovery_s:=1.0'))
    monitor, record, sim = nodes
    try:
        assert sim.end() == 0, sim.text
        assert record.end() == 0, record.text
        assert monitor.stop() == 0, monitor.text
    finally:
        for one in nodes:
            one.kill()
    assert [one.text.count('has not been tested with this package (the newest was 0)') for one in nodes] == [1, 1, 1]
    assert 'contact of benches 0 and 8 at 412.47383' in monitor.text
    with BagReader(tmp_path / 'run.mcap') as bag:
        counts = {topic.name: topic.messages for topic in bag.topics}
    assert [counts[f'/dragon/{name}'] for name in ('handles', 'benches', 'velocities', 'collision')] == [36] * 3 + [1]
