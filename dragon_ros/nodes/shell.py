"""The life cycle of a node: signals, spinning, one-line errors and exit codes."""
import importlib.util
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from dragon_ros.cli.command_line import BAD_INPUT, FAILED, OK
from dragon_ros.cli.signals import ending
from dragon_ros.core.errors import DiskError, DragonError, InputError, MissingError, shown
from dragon_ros.nodes import logs
from dragon_ros.nodes.spinner import Spinner

_WORD = re.compile('[A-Za-z][A-Za-z0-9_]*')      # name of a package or of a message type


def run(name: str, argv: list[str], body: Callable[[threading.Event], int], as_json: bool = False) -> int:
    """Initialise ROS, run ``body(stop)`` and shut down; termination signals set ``stop``. ``as_json`` logs JSON.

    rclpy's own signal handlers would shut down the context during a tick. With the handlers set here, a node ends
    between two ticks.
    """
    stop = threading.Event()
    for number in ending():
        signal.signal(number, lambda *_: stop.set())
    quiet = logs.speak_json() if as_json else []
    try:
        if os.environ.get('ROS_SECURITY_ENABLE') == 'true' and importlib.util.find_spec('ros_wheels_bootstrapper'):
            raise InputError('ROS_SECURITY_ENABLE: the ROS wheels have no DDS security plugins, so nothing would be '
                             'secured; use a ROS 2 install, or unset the variable')
        with in_one_line('the ROS context'):
            rclpy.init(args=[name, *argv, *quiet], signal_handler_options=SignalHandlerOptions.NO)
        return body(stop)
    except (DragonError, ParameterException, NameValidationException) as error:
        logs.say('error', name, ' '.join(str(error).split()))
        return FAILED if isinstance(error, DiskError) else BAD_INPUT
    finally:
        rclpy.try_shutdown()


def spin(node: Node, stop: threading.Event, until: Callable[[], bool] = lambda: False, rest_s: float = 0.0,
         rested: Callable[[], bool] = lambda: True, gather_s: float = 0.0) -> int:
    """Run a node's callbacks until a signal arrives or ``until()`` is true; return the exit code.

    Afterwards, callbacks continue to run until none are due and ``rested()`` is true, for at most ``rest_s`` seconds.
    Messages may wait for up to ``gather_s``, so that several of them are taken together.
    """
    with closing(Spinner(node, gather_s)) as spinner:
        while not stop.is_set() and not until():
            spinner.once()
        spinner.rest(rest_s, rested)
    return OK


@contextmanager
def in_one_line(what: str) -> Iterator[None]:
    """Raise InputError, which names the part of the node that cannot be created, instead of RuntimeError.

    Settings such as names and remappings cause these errors of the middleware.
    """
    try:
        yield
    except RuntimeError as error:
        secured = 'ROS_SECURITY_ENABLE: ' if os.environ.get('ROS_SECURITY_ENABLE') == 'true' else ''
        raise InputError(f'{secured}{what} cannot be created: {" ".join(str(error).split())}; check the names, '
                         'parameters and remappings that the node was started with') from None


@cache
def message_type(name: str) -> Any:
    """Return the class of a message type such as geometry_msgs/msg/PoseArray. Raises MissingError.

    The name may come from a bag. Therefore a type is imported only if the ament index lists it, and only from the
    prefix that lists it, regardless of the Python path.
    """
    package, _, kind = name.partition('/msg/')
    if not (_WORD.fullmatch(package) and _WORD.fullmatch(kind)):
        raise MissingError(f'message type {shown(name)}: it is not of the form package/msg/Type')
    if not any(f'msg/{kind}.idl' in _listed(prefix, package) and _stands_below(package, prefix)
               for prefix in _prefixes()):
        raise MissingError(f'message type {name}: it is not installed; install the package {package!r}')
    return getattr(importlib.import_module(f'{package}.msg'), kind)


def is_installed(package: str) -> bool:
    """Return whether a package can be imported, without importing it."""
    return importlib.util.find_spec(package) is not None


def _prefixes() -> list[Path]:
    """Return the prefixes of ROS packages; the ROS wheels do not set AMENT_PREFIX_PATH."""
    named = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    return [Path(prefix) for prefix in (*named, sys.prefix) if prefix]


def _listed(prefix: Path, package: str) -> list[str]:
    """Return the interface files that a prefix's ament index lists for a package."""
    try:
        return (prefix / 'share/ament_index/resource_index/rosidl_interfaces' / package).read_text().split()
    except (OSError, UnicodeDecodeError):
        return []


def _stands_below(package: str, prefix: Path) -> bool:
    """Return whether a package would be imported from inside a prefix, without importing it."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return False
    origin = Path(spec.origin)
    return Path(os.path.abspath(origin)).is_relative_to(os.path.abspath(prefix)) or (
        origin.resolve().is_relative_to(prefix.resolve()))
