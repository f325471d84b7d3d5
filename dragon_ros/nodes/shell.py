"""The life cycle of a node: signals, spinning, one-line errors, exit codes."""
import importlib
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from dragon_ros.cli.command_line import BAD_INPUT, FAILED, OK
from dragon_ros.core.errors import DiskError, DragonError, MissingError
from dragon_ros.nodes import logs

_EMPTY_WAITS = 3


def run(name: str, argv: list[str], body: Callable[[threading.Event], int], as_json: bool = False) -> int:
    """Initialise ROS, run ``body(stop)`` and shut down; SIGINT and SIGTERM set ``stop``. Logs as JSON if asked.

    rclpy's own signal handlers would shut down the context in the middle of a tick; here a node ends between two.
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
        return FAILED if isinstance(error, DiskError) else BAD_INPUT
    finally:
        rclpy.try_shutdown()


def spin(node: Node, stop: threading.Event, until: Callable[[], bool] = lambda: False, rest_s: float = 0.0) -> int:
    """Serve a node's callbacks until a signal or ``until()``; then those already due, for ``rest_s`` at most."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set() and not until():
        executor.spin_once(timeout_sec=0.1)
    _serve_rest(executor, rest_s)
    executor.shutdown()
    return OK


def _serve_rest(executor: SingleThreadedExecutor, rest_s: float) -> None:
    """Serve what is ready; an empty wait may have consumed a wake-up call, so wait again."""
    end, empty = time.monotonic() + rest_s, 0
    while time.monotonic() < end and empty < _EMPTY_WAITS:
        try:
            handler, _, _ = executor.wait_for_ready_callbacks(timeout_sec=0.0)
        except TimeoutException:
            empty += 1
            continue
        empty = 0
        handler()
        handler.result()


def message_type(name: str) -> Any:
    """Return the class of a message type such as geometry_msgs/msg/PoseArray."""
    package, _, kind = name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError, ValueError):
        raise MissingError(f'message type {name}: is not installed here; install the package {package!r}') from None
