"""The log of the nodes: as ROS writes it, or for machines, as one JSON object a line on standard error."""
import json
import sys
import time
from functools import cache
from typing import Any

from rclpy.impl import rcutils_logger

_PLAIN_ROS = ['--ros-args', '--disable-stdout-logs']
_mode = {'json': False}


class Logger(rcutils_logger.RcutilsLogger):
    """ROS's own logger; with JSON on, what it lets pass is also written as JSON, with ``data`` as further keys."""

    def log(self, message: str, severity: int, data: dict[str, Any] | None = None, **filters: Any) -> bool:
        """Log a message unless the severity or a filter holds it back; return whether it did."""
        passed: bool = super().log(message, severity, **filters)
        if passed and _mode['json']:
            write(rcutils_logger.LoggingSeverity(severity).name.lower(), self.name, message, data)
        return passed


# Filters such as throttle_duration_sec count by the line that logs: this file is not it.
rcutils_logger._internal_callers.append(__file__)


@cache
def logger(name: str) -> Logger:
    """Return the logger of a name, always the same one."""
    return Logger(name)


def speak_json() -> list[str]:
    """Write JSON from now on; return the ROS arguments that silence ROS's own lines on the console."""
    _mode['json'] = True
    return _PLAIN_ROS


def progress_wanted() -> bool:
    """Return whether somebody follows: a person at a terminal, or a machine that reads JSON."""
    return _mode['json'] or sys.stderr.isatty()


def say(level: str, name: str, message: str) -> None:
    """Write one line without a node: as text, or as JSON where that is on."""
    if _mode['json']:
        write(level, name, message, None)
    else:
        print(f'{name}: {message}', file=sys.stderr)


def write(level: str, name: str, message: str, data: dict[str, Any] | None) -> None:
    """Write one JSON object on a line of standard error; ``wall_s`` is wall time in seconds since 1970."""
    row = {'wall_s': round(time.time(), 6), 'level': level, 'name': name, 'message': message, **(data or {})}
    print(json.dumps(row), file=sys.stderr, flush=True)
