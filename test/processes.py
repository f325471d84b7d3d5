"""Processes of the package that start quickly because they are forked from one that has imported their libraries.

An executable needs a second to import its libraries, and the tests start hundreds of executables. Tests of the start
and the end of processes (signals during imports, exit codes, security, the shell) run ``python -m dragon_ros`` instead.
"""
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import psutil

PATIENCE_S = 120.0

_FORKS = multiprocessing.get_context('forkserver')
# Modules that rclpy and the messages import when the first node is created.
_ROS = ('rosidl_generator_py', *(f'{name}_msgs.msg' for name in ('geometry', 'nav', 'rosgraph', 'sensor', 'service',
                                                                 'visualization')),
        'std_srvs.srv', 'type_description_interfaces.msg')
_FORKS.set_forkserver_preload([
    *(f'dragon_ros.nodes.{name}' for name in ('command_lines', 'sim', 'monitor', 'record', 'replay')), *_ROS,
    *(f'dragon_ros.commands.{name}' for name in ('simulate', 'inspect', 'export')),
    *(f'dragon_ros.{name}' for name in ('api.bag', 'bags.check.compare', 'bags.check.summary', 'bags.read.export',
                                        'bags.write.simulate'))])


class Started(subprocess.Popen):
    """Any running program; errors include its output."""

    def __init__(self, command, env, cwd):
        super().__init__(command, env=env, cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                         stderr=subprocess.STDOUT, text=True)


class Forked:
    """A running executable, or another program in Python, with the required part of ``subprocess.Popen``'s interface.

    ``stdout`` includes errors, unless they have a pipe of their own.
    """

    def __init__(self, arguments, env, cwd, stderr=False, program=None):
        pipes = [_FORKS.Pipe(duplex=False) for _ in range(1 + stderr)]
        self._process = _FORKS.Process(target=_run, args=(
            arguments, dict(env), str(cwd), [inside for _, inside in pipes], program))
        self._process.start()
        outputs = []
        for outside, inside in pipes:
            inside.close()
            outputs.append(os.fdopen(os.dup(outside.fileno())))
            outside.close()
        self.stdout, self.stderr = outputs if stderr else (*outputs, None)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.kill()
        self.wait()
        for one in filter(None, (self.stdout, self.stderr)):
            one.close()

    def communicate(self, timeout=None):
        """Wait until the process ends, and return what it has printed to each stream; kill it after the timeout."""
        with ThreadPoolExecutor(2) as readers:
            printed = [one and readers.submit(one.read) for one in (self.stdout, self.stderr)]
            try:
                self.wait(timeout)
            except subprocess.TimeoutExpired:
                self.kill()
                raise
            return [one and one.result() for one in printed]

    @property
    def pid(self):
        return self._process.pid

    def poll(self):
        return self._process.exitcode

    def wait(self, timeout=None):
        self._process.join(timeout)
        if self.poll() is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout)
        return self.poll()

    def send_signal(self, number):
        if self.poll() is None:
            with suppress(ProcessLookupError):      # the process has ended, and its exit code will arrive soon
                os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)


def children(pid):
    """Return the IDs of the processes that a process has started, without the time that psutil takes."""
    return [int(one) for one in Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]


def _run(arguments, environment, cwd, outputs, program):
    """In the new process, do what ``python -m dragon_ros`` does, without the environment of the first process.

    If another program is given, it runs instead.
    """
    from dragon_ros.__main__ import run
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(cwd)
    for number, output in ((1, outputs[0]), (2, outputs[-1])):
        os.dup2(output.fileno(), number)
    for output in outputs:
        output.close()
    # The streams of the first process may be those of files, in which one can seek.
    sys.stdout = os.fdopen(1, 'w', buffering=1, closefd=False)
    sys.stderr = os.fdopen(2, 'w', buffering=1, errors='backslashreplace', closefd=False)
    sys.argv = [str(program or 'dragon_ros'), *arguments]
    if program is None:
        run(arguments)
    else:
        runpy.run_path(str(program), run_name='__main__')


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
