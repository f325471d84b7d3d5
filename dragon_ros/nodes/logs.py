"""The log of the nodes, in ROS's format or, for machines, as one JSON object per line on standard error."""
import json
import sys
import time
from typing import Any

from dragon_ros.cli.command_line import printable

_PLAIN_ROS = ['--ros-args', '--disable-stdout-logs']
_mode = {'json': False}


class NodeLogger:
    """A logger of ROS that escapes control characters and, in JSON mode, writes what passes its severity as JSON, too.

    Texts in messages, bags and scenes come from anybody. Each severity has a line of its own, because rclpy allows one
    severity per line that logs.
    """

    def __init__(self, ros: Any) -> None:
        self._ros = ros

    def __getattr__(self, name: str) -> Any:
        return getattr(self._ros, name)

    def info(self, message: str, data: dict[str, Any] | None = None) -> None:
        """Log a message that needs no action; in JSON mode, the object also has the keys of ``data``."""
        if self._ros.info(printable(message)) and _mode['json']:
            write('info', self._ros.name, message, data)

    def warning(self, message: str) -> None:
        """Log a message about something that a user may want to change."""
        if self._ros.warning(printable(message)) and _mode['json']:
            write('warn', self._ros.name, message)

    def error(self, message: str) -> None:
        """Log a message about a failure or a contact."""
        if self._ros.error(printable(message)) and _mode['json']:
            write('error', self._ros.name, message)


class Seldom:
    """Return True when called, but at most once per period."""

    def __init__(self, period_s: float) -> None:
        self._period_s, self._next_s = period_s, 0.0

    def __call__(self) -> bool:
        """Return whether a period has passed since the last call that returned True."""
        now_s = time.monotonic()
        due = now_s >= self._next_s
        if due:
            self._next_s = now_s + self._period_s
        return due


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
        write(level, name, message)
    else:
        print(printable(f'{name}: {message}'), file=sys.stderr)


def write(level: str, name: str, message: str, data: dict[str, Any] | None = None) -> None:
    """Write a JSON object as one line to standard error; ``wall_s`` is wall time in seconds since 1970."""
    row = {'wall_s': round(time.time(), 6), 'level': level, 'name': name, 'message': message, **(data or {})}
    print(json.dumps(row), file=sys.stderr, flush=True)
