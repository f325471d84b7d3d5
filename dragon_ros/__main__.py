"""All executables, which run with ``python -m dragon_ros NAME ...`` or ``ros2 run dragon_ros NAME ...``."""
import signal

if __name__ == '__main__' and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)        # Ctrl-C during imports ends the process without a traceback

import gc
import importlib
import os
import sys
from collections.abc import Callable
from io import TextIOWrapper
from typing import NamedTuple, NoReturn

from dragon_ros.guests import installed

_LINUX = 'fcntl', 'resource', 'termios', 'tty'      # modules that other systems lack
_SPIN = '16'            # an idle OpenBLAS thread spins for 2^16 cycles instead of the default 2^26
_GARBAGE = 20_000       # number of new containers that triggers a garbage collection; the default of 700 is far too low


class Executable(NamedTuple):
    """An executable: its module, its function ``f(argv) -> exit code``, and its purpose, which is shown as help."""

    module: str
    help: str
    function: str = 'main'


NODES = 'dragon_ros.nodes.command_lines'
_COMMANDS = 'dragon_ros.commands.command_lines'
EXECUTABLES = {
    'sim': Executable(NODES, 'simulate a scene and publish it', 'sim'),
    'monitor': Executable(NODES, 'monitor a published dragon and report its contacts',
                          'monitor'),
    'record': Executable(NODES, 'record the topics of a dragon as an MCAP bag', 'record'),
    'replay': Executable(NODES, 'publish a bag with its original timing', 'replay'),
    'table': Executable('dragon_ros.commands.table', 'print positions and velocities, without ROS'),
    'contact': Executable('dragon_ros.commands.contact', 'find the first contact of a scene, without ROS'),
    'inspect': Executable('dragon_ros.commands.inspect', 'summarise, check or repair a bag'),
    'export': Executable('dragon_ros.commands.export', 'export a bag as CSV, Parquet or NumPy arrays'),
    'simulate': Executable('dragon_ros.commands.simulate',
                           'write the bag of a scene, without ROS and faster than real time'),
    'plot': Executable('dragon_ros.commands.plot',
                       'draw a scene or a bag: dragon, contact, clearance, speeds, animation'),
    'urdf': Executable('dragon_ros.commands.urdf', 'write the dragon of a scene as a URDF robot, without ROS'),
    'view': Executable('dragon_ros.commands.view.command', 'play a scene or a bag in the browser, without ROS'),
    'design': Executable('dragon_ros.commands.design', 'answer design questions: turn, speed, pitch, room'),
    'plan': Executable(_COMMANDS, 'draw a scene to scale for printing: swept area, gaps and times', 'plan'),
    'route': Executable(_COMMANDS, 'make a scene whose track follows a drawing', 'route'),
    'cost': Executable('dragon_ros.cost.command', 'measure the cost of accuracy, effects, contact and bags'),
    'demo': Executable('dragon_ros.commands.demo', 'run everything once: sim, monitor, bag, replay, picture'),
    **{name: Executable(*guest) for name, guest in installed().items() if ' ' not in name},
}


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
