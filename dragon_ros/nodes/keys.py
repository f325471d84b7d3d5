"""Keyboard control of a replay in a terminal: space pauses and resumes, s steps, the arrows seek."""
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rclpy.node import Node

from dragon_ros.core.errors import DragonError
from dragon_ros.nodes.base import STEADY

RIGHT, LEFT = '\x1b[C', '\x1b[D'
_POLL_S = 0.05


@contextmanager
def keys(node: Node, actions: Mapping[str, Callable[[], str]]) -> Iterator[bool]:
    """Within the block, run the action of each pressed key and log its result; yield False if there is no terminal."""
    number = _terminal()
    if number is None:
        yield False
        return
    before = termios.tcgetattr(number)
    tty.setcbreak(number)
    timer = node.create_timer(_POLL_S, lambda: _poll(node, number, actions), clock=STEADY)
    try:
        yield True
    finally:
        node.destroy_timer(timer)
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def split(text: str, known: Mapping[str, object]) -> list[str]:
    """Return the known keys in the input, in which an arrow key is a sequence of three characters."""
    found = []
    while text:
        key = next((key for key in sorted(known, key=len, reverse=True) if text.startswith(key)), None)
        found += [key] if key else []
        text = text[len(key or ' '):]
    return found


def _terminal() -> int | None:
    """Return the descriptor of standard input if it is a terminal and this process is in the foreground."""
    try:
        number = sys.stdin.fileno()
        return number if os.isatty(number) and os.tcgetpgrp(number) == os.getpgrp() else None
    except (OSError, ValueError, AttributeError):
        return None


def _poll(node: Node, number: int, actions: Mapping[str, Callable[[], str]]) -> None:
    if not select.select([number], [], [], 0)[0]:
        return
    for key in split(os.read(number, 64).decode(errors='replace'), actions):
        try:
            node.get_logger().info(actions[key]())
        except DragonError as error:
            node.get_logger().warning(str(error))
