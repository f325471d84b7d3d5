"""Run an executable with ``python -m dragon_ros NAME ...``; the names are those of ``ros2 run dragon_ros``."""
import signal

if __name__ == '__main__' and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)        # Ctrl-C during imports ends the process without a traceback

import gc
import importlib
import os
import sys
from collections.abc import Callable
from io import TextIOWrapper
from typing import NoReturn

from dragon_ros.executables import EXECUTABLES, NODES

_LINUX = 'fcntl', 'resource', 'termios', 'tty'      # modules that other systems lack
_SPIN = '16'            # an idle OpenBLAS thread spins for 2^16 cycles instead of the default 2^26
_GARBAGE = 20_000       # number of new containers that triggers a garbage collection; the default of 700 is far too low


def main(argv: list[str]) -> int:
    """Run ``NAME ARGUMENTS...`` and return the exit code."""
    if '_ARGCOMPLETE' in os.environ and not argv:
        from dragon_ros.cli import completion
        argv = [completion.chosen(EXECUTABLES)]
    if argv and argv[0] == 'help':
        argv = [*argv[1:2], '--help']
    if not argv or argv[0] in ('-h', '--help'):
        print(usage())
        return 0 if argv else 2
    if argv[0] in ('-V', '--version'):
        from dragon_ros.version import __version__
        print(f'dragon_ros {__version__}')
        return 0
    name, *rest = argv
    if name not in EXECUTABLES:
        from dragon_ros.core.errors import did_you_mean, shown
        hint = did_you_mean(name, EXECUTABLES, f'the names are {", ".join(EXECUTABLES)}')
        print(f'dragon_ros: unknown executable {shown(name)}; {hint}', file=sys.stderr)
        return 2
    executable = EXECUTABLES[name]
    before = signal.getsignal(signal.SIGINT)
    ended = [] if executable.module == NODES else [
        number for number in (signal.SIGTERM, getattr(signal, 'SIGHUP', signal.SIGTERM))    # Windows has no SIGHUP
        if signal.getsignal(number) is signal.SIG_DFL]
    for number in ended:
        signal.signal(number, _end)
    try:
        if before in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(signal.SIGINT, _leave if executable.module == NODES else signal.default_int_handler)
        code: int = getattr(importlib.import_module(executable.module), executable.function)(rest)
    except KeyboardInterrupt:
        return 1
    except ModuleNotFoundError as error:
        if executable.module != NODES or error.name is None or error.name.startswith('dragon_ros'):
            raise
        missing = error.name.partition('.')[0]
        print(f'{name}: nodes need Linux, because they use the module {missing}; `simulate` writes the same bag' if
              missing in _LINUX else
              f'{name}: {missing} is not installed, and nodes need ROS 2: run ./dragon {name} in a checkout, which '
              'installs ROS 2, or use an environment with ROS 2 (see README.md)', file=sys.stderr)
        return 2
    finally:
        if signal.getsignal(signal.SIGINT) is _leave:
            signal.signal(signal.SIGINT, before)
        for number in ended:
            signal.signal(number, signal.SIG_DFL)
    return code


def _end(number: int, _: object) -> NoReturn:
    """End a command by an exception, so that incomplete outputs are removed, with the exit code of shells."""
    raise SystemExit(128 + number)


def _leave(*_: object) -> NoReturn:
    """End a node that is interrupted during its start, with the exit code of one that runs.

    An exception is not enough: the import system ignores some exceptions, and libraries turn others into their own.
    """
    os._exit(0)


def usage() -> str:
    """Return the usage message, which lists all executables."""
    rows = '\n'.join(f'  {name:<9} {executable.help}' for name, executable in EXECUTABLES.items())
    from dragon_ros.cli.command_line import program
    return f'usage: {program()} NAME [ARGUMENTS]   (more: {program()} help NAME; --version)\n\n{rows}'


def dragon() -> NoReturn:
    """Run the command ``dragon`` of an installed package."""
    run(sys.argv[1:])


def run(argv: list[str], program: Callable[[list[str]], int] = main) -> NoReturn:
    """Run a program in this process and exit; by default, the program is ``main``.

    Imports create hundreds of thousands of objects but no garbage. Searching these objects for reference cycles, during
    the run and at exit, would take a tenth of a command's run time.
    """
    os.environ.setdefault('OPENBLAS_THREAD_TIMEOUT', _SPIN)
    if isinstance(sys.stdout, TextIOWrapper):       # what the locale's encoding lacks is escaped, as on standard error
        sys.stdout.reconfigure(errors='backslashreplace')
    gc.set_threshold(_GARBAGE, *gc.get_threshold()[1:])
    try:
        sys.exit(program(argv))
    finally:
        gc.freeze()


if __name__ == '__main__':
    if not getattr(sys.flags, 'safe_path', False):
        del sys.path[0]     # `python -m` inserts the working directory, from which the package must not import
    run(sys.argv[1:])
