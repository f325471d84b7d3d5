"""Real nodes run in real processes over real DDS, in one domain per test; tests wait for conditions and never sleep."""
import os
import sys
import time
from contextlib import contextmanager

import pytest
from processes import PATIENCE_S, Forked, Process, Started

from dragon_ros.cli.dds_domain import free_domain, give_up_domains, local_environment

pytest.importorskip('rclpy')

@pytest.fixture
def domain(monkeypatch):
    """A domain for the test and for nodes in this process; parallel tests choose from disjoint sets of domains."""
    worker, workers = os.environ.get('PYTEST_XDIST_WORKER', 'gw0'), os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1')
    number = free_domain(range(1 + int(worker.removeprefix('gw')), 102, int(workers)))
    for key, value in local_environment(number).items():
        monkeypatch.setenv(key, value)
    yield number
    give_up_domains()


@pytest.fixture
def start(domain, tmp_path):
    """A function that starts executables, which end with the test.

    They are forked, or started ``anew`` if necessary, and may run ``under`` another command.
    """
    running = []

    def run(*arguments, anew=False, under=(), **variables):
        words = list(map(str, arguments))
        environment = {**os.environ, 'PYTHONUNBUFFERED': '1', 'ROS_LOG_DIR': str(tmp_path / 'log'), **variables}
        kind, command = (Started, [*under, sys.executable, '-m', 'dragon_ros', *words]) if anew or under else (
            Forked, words)
        running.append(Process(kind(command, environment, tmp_path)))
        return running[-1]
    yield run
    for process in running:
        process.kill()


@pytest.fixture
def launched(start):
    """A function that starts the executables of a launch plan, as ``ros2 launch`` would."""
    def text(value):
        return str(value).lower() if isinstance(value, bool) else str(value) or '""'

    def run(what):
        return {one.executable: start(
            one.executable, *one.arguments, '--ros-args', '-r', f'__ns:={what.namespace}',
            *(part for name, value in one.parameters.items() for part in ('-p', f'{name}:={text(value)}')))
            for one in (*what.readers, what.source)}
    return run


@pytest.fixture
def node(domain):
    """A node of the test itself."""
    with made_node('observer') as node:
        yield node


@pytest.fixture
def other_node(domain):
    """A second node of the test, which acts as another program."""
    with made_node('stranger') as node:
        yield node


@contextmanager
def made_node(name):
    import rclpy
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node(name, context=context, namespace='/dragon')
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def until(condition):
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, 'the condition was not met in time'
            executor.spin_once(timeout_sec=0.05)
    node.until = until
    yield node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)
