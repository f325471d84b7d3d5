"""The life of a node: signals, spinning, errors in one line, exit codes."""
import importlib
import signal
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from dragon_ros.core.errors import DragonError, MissingError
from dragon_ros.nodes import logs
from dragon_ros.wire.cli import BAD_INPUT, OK


def run(name: str, argv: list[str], body: Callable[[threading.Event], int], as_json: bool = False) -> int:
    """Initialise ROS, run ``body(stop)`` and shut down; SIGINT and SIGTERM set ``stop``. Logs as JSON if asked.

    rclpy's own signal handlers would end the context in the middle of a tick; here a node always ends between two.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    quiet = logs.speak_json() if as_json else []
    rclpy.init(args=[name, *argv, *quiet], signal_handler_options=SignalHandlerOptions.NO)
    try:
        return body(stop)
    except (DragonError, ParameterException, NameValidationException) as error:
        logs.say('error', name, ' '.join(str(error).split()))
        return BAD_INPUT
    finally:
        rclpy.try_shutdown()


def spin(node: Node, stop: threading.Event, until: Callable[[], bool] = lambda: False) -> int:
    """Serve a node's callbacks until a signal or until ``until()``; then serve what is already queued."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set() and not until():
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    return OK


def message_type(name: str) -> Any:
    """Return the class of a message type such as geometry_msgs/msg/PoseArray."""
    package, _, kind = name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError, ValueError):
        raise MissingError(f'message type {name}: is not installed here; install the package {package!r}') from None
