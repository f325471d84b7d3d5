"""The log of the nodes, in ROS's format or, for machines, as one JSON object per line on standard error."""
import json
import sys
import time
from functools import cache
from typing import Any

from rclpy.impl import rcutils_logger

_PLAIN_ROS = ['--ros-args', '--disable-stdout-logs']
_mode = {'json': False}


class Logger(rcutils_logger.RcutilsLogger):
    """ROS's logger; in JSON mode, it also writes messages that pass its filters as JSON with the keys of ``data``."""

    def log(self, message: str, severity: int, data: dict[str, Any] | None = None, **filters: Any) -> bool:
        """Log a message unless its severity or a filter suppresses it; return whether it was logged."""
        passed: bool = super().log(message, severity, **filters)
        if passed and _mode['json']:
            write(rcutils_logger.LoggingSeverity(severity).name.lower(), self.name, message, data)
        return passed


# rclpy treats the first line outside these files as the caller, and applies filters such as throttle_duration_sec to
# each caller separately. This list is not public, but files can be added to it. Only this module does so.
rcutils_logger._internal_callers.append(__file__)


@cache
def logger(name: str) -> Logger:
    """Return the logger with a name; the same name always returns the same object."""
    return Logger(name)


def speak_json() -> list[str]:
    """Switch to JSON; return the ROS arguments that silence ROS's own console output."""
    _mode['json'] = True
    return _PLAIN_ROS


def progress_wanted() -> bool:
    """Return whether anyone reads the log: a person at a terminal, or a program that parses JSON."""
    return _mode['json'] or sys.stderr.isatty()


def say(level: str, name: str, message: str) -> None:
    """Log one line without a node, as text or as JSON."""
    if _mode['json']:
        write(level, name, message, None)
    else:
        print(f'{name}: {message}', file=sys.stderr)


def write(level: str, name: str, message: str, data: dict[str, Any] | None) -> None:
    """Write a JSON object as one line to standard error; ``wall_s`` is wall time in seconds since 1970."""
    row = {'wall_s': round(time.time(), 6), 'level': level, 'name': name, 'message': message, **(data or {})}
    print(json.dumps(row), file=sys.stderr, flush=True)
