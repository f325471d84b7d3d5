"""Runs one node: raw messages and timers from a persistent wait set, and everything else with an rclpy executor.

For each wait, an rclpy executor collects all entities of a node in Python: its topics, two QoS events per topic, and
the services for its parameters. This costs more than handling a message: at 50 Hz, beyond their start-up, ``monitor``
and ``record`` take about twice the CPU time with that executor alone, and ``sim`` 1.4 times. Nothing is lost at 50, 200
or 1,000 Hz with either, and at 1,000 Hz they cost the same.

A middleware that was built for an old C library, as in the ROS wheels, waits until a given time on the system clock. If
that clock is set back by two hours, a wait of a tenth of a second lasts two hours. Therefore a thread ends waits that
are overdue according to the steady clock. The spinner also wakes the middleware's own thread, which discovers nodes and
resends lost messages.
"""
import os
import select
import threading
import time
from collections.abc import Callable

from rcl_interfaces.msg import ParameterEvent
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node

from dragon_ros.nodes import raw_subscription, rclpy_internals

_WAIT_NS = 100_000_000      # maximum delay until a signal is noticed
_LOOK_S = 0.25              # maximum delay until QoS events and new topics are noticed
_AT_ONCE = 8                # maximum number of callbacks that rclpy's executor runs before messages and timers
_EMPTY_WAITS = 3            # number of empty waits before giving up; a single empty wait may have consumed a wake-up
_OVERDUE_S = 0.2            # maximum duration of a wait before it is ended
_SET_BACK_S = 0.05          # change in the system clock after which the middleware is woken


class Spinner:
    """Runs a node's callbacks in the calling thread."""

    def __init__(self, node: Node, gather_s: float = 0.0) -> None:
        """Add the node to an rclpy executor, which handles rare events.

        Waits begin at least ``gather_s`` apart, so that several messages are taken after one wait. Without the wait set
        of rclpy, this executor handles everything.
        """
        self._node, self._executor = node, SingleThreadedExecutor()
        self._gather_s, self._next_wait_s = gather_s, 0.0
        self._executor.add_node(node)
        self._look_at_s = 0.0
        self._wait_set: rclpy_internals.WaitSet | None = None
        self._is_plain = rclpy_internals.wait_set_class() is None
        self._overdue, self._ahead_s = _Overdue(node), _ahead_s()

    def once(self) -> None:
        """Handle everything that is ready or becomes ready within a tenth of a second."""
        if self._is_plain:
            self._executor.spin_once(timeout_sec=_WAIT_NS / 1e9)
        elif time.monotonic() >= self._look_at_s or self._wait():
            self._serve(_AT_ONCE)
            self._look()

    def rest(self, longest_s: float, until: Callable[[], bool]) -> None:
        """Run callbacks until none are ready and ``until()`` is true, for at most ``longest_s``."""
        end_s, empty = time.monotonic() + longest_s, 0
        while time.monotonic() < end_s:
            if empty < _EMPTY_WAITS:
                empty = 0 if self._serve(1) else empty + 1
            elif until():
                return
            else:
                self.once()
                empty = 0

    def close(self) -> None:
        """Release the node."""
        self._overdue.close()
        self._release()
        self._executor.shutdown()

    def _serve(self, most: int) -> int:
        """Run ready callbacks, and those that become ready as a result, up to about ``most``; return their number."""
        served = before = 0
        while served < most:
            try:
                handler, _, _ = self._executor.wait_for_ready_callbacks(timeout_sec=0.0)
            except TimeoutException:
                if served == before:
                    break
                before = served
                continue
            handler()
            handler.result()
            served += 1
        return served

    def _look(self) -> None:
        """Collect the entities to wait for until the next call."""
        self._follow_clock()
        self._release()
        self._wait_set = rclpy_internals.WaitSet(self._node)
        self._look_at_s = time.monotonic() + _LOOK_S

    def _release(self) -> None:
        if self._wait_set:
            self._wait_set.close()

    def _follow_clock(self) -> None:
        """If the system clock was set back, wake the middleware: a new timed event makes it check all events."""
        before_s, self._ahead_s = self._ahead_s, _ahead_s()
        if self._ahead_s < before_s - _SET_BACK_S:
            added = Node.create_publisher(self._node, ParameterEvent, '/parameter_events', 1)
            self._node.destroy_publisher(added)

    def _gather(self) -> None:
        """Sleep until the next wait may begin."""
        if self._gather_s:
            time.sleep(max(0.0, self._next_wait_s - time.monotonic()))
            self._next_wait_s = time.monotonic() + self._gather_s

    def _wait(self) -> bool:
        """Wait, then handle ready timers and raw messages; return whether anything is left for rclpy's executor."""
        assert self._wait_set
        self._gather()
        with self._overdue as condition:
            ready, others = self._wait_set.wait(_WAIT_NS, condition)
        for subscription in ready:
            take = raw_subscription.taker_of(subscription)
            if take is None:
                others = True
            else:
                take()
        return others


def _ahead_s() -> float:
    """Return the difference in seconds between the system clock and the steady clock."""
    return time.time() - time.monotonic()


class _Overdue:
    """Ends overdue waits (``with self as condition``) from a thread that measures them by the steady clock.

    The thread sleeps in ``poll``, whose timeout is relative; waits on Python's locks may also follow the system clock.
    """

    def __init__(self, node: Node) -> None:
        """Start the thread."""
        self._condition = GuardCondition(None, None, node.context)
        self._since_s: float | None = None
        self._closed, self._closing = os.pipe()
        self._thread = threading.Thread(target=self._watch, name='overdue', daemon=True)
        self._thread.start()

    def __enter__(self) -> GuardCondition:
        """Return the condition to include in a wait that begins now."""
        self._since_s = time.monotonic()
        return self._condition

    def __exit__(self, *_: object) -> None:
        """Record that the wait has ended."""
        self._since_s = None

    def close(self) -> None:
        """End the thread."""
        os.close(self._closing)
        self._thread.join()
        os.close(self._closed)
        self._condition.destroy()

    def _watch(self) -> None:
        closing = select.poll()
        closing.register(self._closed)
        while not closing.poll(_OVERDUE_S * 500):
            since_s = self._since_s
            if since_s is not None and time.monotonic() - since_s > _OVERDUE_S:
                self._condition.trigger()
