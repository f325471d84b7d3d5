"""Real nodes run in real processes over real DDS, in one domain per test; tests wait for conditions and never sleep."""
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager

import psutil
import pytest
from processes import Forked, Started

from dragon_ros.cli.dds_domain import free_domain, give_up_domains, local_environment

pytest.importorskip('rclpy')

PATIENCE_S = 120.0


class Process:
    """A running program whose output is collected line by line."""

    def __init__(self, child):
        self._child = child
        self.lines, self._new = [], threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._child.stdout:
            with self._new:
                self.lines.append(line)
                self._new.notify_all()
        with self._new:
            self._new.notify_all()

    @property
    def text(self):
        return ''.join(self.lines)

    def wait_for(self, words):
        """Wait until the process has printed ``words``."""
        end = time.monotonic() + PATIENCE_S
        with self._new:
            while words not in self.text:
                assert self._new.wait(timeout=max(0.0, end - time.monotonic())), f'no {words!r} in:\n{self.text}'
                assert words in self.text or self._child.poll() is None, f'ended without {words!r}:\n{self.text}'

    def stop(self, number=signal.SIGINT):
        """Signal the process and return its exit code."""
        self._child.send_signal(number)
        return self.end()

    def end(self):
        """Wait until the process ends, and return its exit code."""
        code = self._child.wait(timeout=PATIENCE_S)
        self._reader.join(timeout=PATIENCE_S)
        return code

    def signal(self, number):
        self._child.send_signal(number)

    @property
    def running(self):
        return self._child.poll() is None

    @property
    def pid(self):
        return self._child.pid

    def kill(self):
        """Kill the process and its children; the nodes of a demo that hangs would otherwise continue."""
        if self._child.poll() is None:
            for process in [*psutil.Process(self.pid).children(recursive=True), self._child]:
                process.kill()
        self._child.wait()
        self._reader.join(timeout=PATIENCE_S)
        self._child.stdout.close()


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
