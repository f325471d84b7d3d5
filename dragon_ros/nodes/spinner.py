"""Serves one node: its raw messages and timers from a persistent wait set, all else by an executor of rclpy.

For each wait, an executor of rclpy collects all entities of a node in Python: its topics, two QoS events per topic, and
the services of its parameters. That costs more than handling a message of a dragon.
"""
import time
from contextlib import ExitStack

from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.timer import Timer

from dragon_ros.nodes import raw_subscription

_WAIT_NS = 100_000_000      # longest time until a signal is noticed
_LOOK_S = 0.25              # longest time until QoS events and new topics are noticed
_AT_ONCE = 8                # most callbacks of rclpy's executor before messages and timers are served again
_EMPTY_WAITS = 3            # an empty wait may have consumed a wake-up, so wait again


class Spinner:
    """Serves a node in the thread that calls it."""

    def __init__(self, node: Node) -> None:
        """Add the node to an executor of rclpy, which serves rare events."""
        self._node, self._executor = node, SingleThreadedExecutor()
        self._executor.add_node(node)
        self._look_at_s, self._held = 0.0, ExitStack()

    def once(self) -> None:
        """Serve everything that is ready or becomes ready within a tenth of a second."""
        if time.monotonic() >= self._look_at_s or self._wait():
            self._serve(_AT_ONCE)
            self._look()

    def rest(self, longest_s: float) -> None:
        """Serve until nothing is ready."""
        end_s, empty = time.monotonic() + longest_s, 0
        while time.monotonic() < end_s and empty < _EMPTY_WAITS:
            empty = 0 if self._serve(1) else empty + 1

    def close(self) -> None:
        """Release the node."""
        self._held.close()
        self._executor.shutdown()

    def _serve(self, most: int) -> int:
        """Serve at most ``most`` callbacks that rclpy finds ready; return their number."""
        for served in range(most):
            try:
                handler, _, _ = self._executor.wait_for_ready_callbacks(timeout_sec=0.0)
            except TimeoutException:
                return served
            handler()
            handler.result()
        return most

    def _look(self) -> None:
        """Collect the entities to wait for until the next look; destroyed ones are kept until then."""
        node = self._node
        self._takers = dict(raw_subscription.takers(node))
        self._timers = tuple(node.timers)
        self._subscriptions, self._services, self._clients = (
            tuple(one.handle for one in kind) for kind in (node.subscriptions, node.services, node.clients))
        self._held.close()
        for handle in (node.context.handle, *self._subscriptions, *self._services, *self._clients,
                       *(timer.handle for timer in self._timers)):
            self._held.enter_context(handle)
        self._wait_set = rclpy_implementation.WaitSet(
            len(self._subscriptions), 0, len(self._timers), len(self._clients), len(self._services), 0,
            node.context.handle)
        self._look_at_s = time.monotonic() + _LOOK_S

    def _wait(self) -> bool:
        """Wait, and serve the timers and raw messages that are ready. Return whether rclpy must serve something."""
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in self._subscriptions:
            wait_set.add_subscription(subscription)
        for timer in self._timers:
            wait_set.add_timer(timer.handle)
        for service in self._services:
            wait_set.add_service(service)
        for client in self._clients:
            wait_set.add_client(client)
        wait_set.wait(_WAIT_NS)
        messages = wait_set.get_ready_entities('subscription')
        others = bool(wait_set.get_ready_entities('service') or wait_set.get_ready_entities('client'))
        if wait_set.get_ready_entities('timer'):
            for timer in self._timers:
                _call(timer)
        for pointer in messages:
            take = self._takers.get(pointer)
            if take is None:
                others = True
            else:
                take()
        return others


def _call(timer: Timer) -> None:
    """Call a timer that is ready, unless it was cancelled or destroyed meanwhile."""
    try:
        if not timer.is_ready():
            return
        with timer.handle:
            timer.handle.call_timer()
    except InvalidHandle:
        return
    timer.callback()
