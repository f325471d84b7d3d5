"""Workers of pytest-xdist that are forked from one process, which has imported everything that the tests import.

Otherwise each worker would spend three seconds on importing libraries and test files. The workers also share the
process from which nodes are forked (see processes.py).
"""
import atexit
import os
import select
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import pytest
from _pytest.config import _prepareconfig

_CLIENT = Path(__file__).with_name('forked_worker.py')
_SERVER = 'import sys; sys.path.insert(0, sys.argv[1]); import forked_workers; forked_workers.serve(*sys.argv[2:])'
_FILES = 3      # standard input, output and error
_PATIENCE_S = 15.0      # for workers that are still busy when the run has ended


def fork_workers(config, specs):
    """Start the process, and let the workers with the given execnet specifications be forked from it."""
    folder = tempfile.TemporaryDirectory(prefix='workers')
    path = os.path.relpath(Path(folder.name) / 'server')    # the names of sockets have at most 107 characters
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen(len(specs))
        server = subprocess.Popen(
            [sys.executable, '-c', _SERVER, _CLIENT.parent, str(listener.fileno()), *config.invocation_params.args],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, pass_fds=[listener.fileno()])

    def end():
        server.communicate()        # closes its input, after which it waits for the workers
        folder.cleanup()
    config.add_cleanup(end)
    for spec in specs:
        spec.python = shlex.join([sys.executable, '-IS', str(_CLIENT), path])


def serve(listener, *arguments):
    """Import what the tests import, and fork a worker for each client until standard input ends.

    In a worker, this function does what ``python -c`` does, with the client's standard streams.
    """
    _import_tests(arguments)
    if 'processes' in sys.modules:
        sys.modules['processes'].share()
    interrupt = signal.signal(signal.SIGINT, signal.SIG_IGN)        # the workers handle it
    workers = []
    with socket.socket(fileno=int(listener)) as clients:
        while clients in select.select([sys.stdin, clients], [], [])[0]:
            with clients.accept()[0] as client:
                _, files, _, _ = socket.recv_fds(client, 1, _FILES)
                worker = os.fork()
                if worker:
                    workers.append(worker)
                    for one in files:
                        os.close(one)
                    continue
                clients.close()
                signal.signal(signal.SIGINT, interrupt)
                _work(files)
    end_s = time.monotonic() + _PATIENCE_S
    for worker in workers:
        while not os.waitpid(worker, os.WNOHANG)[0]:
            if time.monotonic() > end_s:
                os.kill(worker, signal.SIGKILL)
            time.sleep(0.02)


def _import_tests(arguments):
    """Collect the tests as each worker will do, since pytest changes the assertions of the files that it imports."""
    config = _prepareconfig([*arguments, '--numprocesses=0', '--dist=no', '--collect-only'])
    with suppress(pytest.UsageError):       # each worker reports it
        config._do_configure()
        session = pytest.Session.from_config(config)
        config.hook.pytest_sessionstart(session=session)
        config.hook.pytest_collection(session=session)
    config._ensure_unconfigure()


def _work(files):
    """Run what execnet sends to a new Python, and exit.

    The libraries' destructors are left out, as in all forked processes: those of OpenBLAS may wait for a thread that
    only the first process had.
    """
    for number, one in enumerate(files):
        os.dup2(one, number)
        os.close(one)
    sys.stdin, sys.stdout, sys.stderr = (os.fdopen(number, mode, buffering=1, closefd=False)
                                         for number, mode in enumerate('rww'))
    sys.argv = ['-c']
    main = sys.modules['__main__'] = ModuleType('__main__')
    exec(eval(sys.stdin.readline()), vars(main))
    atexit._run_exitfuncs()
    os._exit(0)
