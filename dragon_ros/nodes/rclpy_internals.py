"""The only module that uses private names of rclpy; each use has a substitute that needs public names alone.

A substitute is used if its name is missing, and all of them if rclpy is newer than the versions with which the names
were tested. The nodes then take more CPU time, and otherwise do the same.
"""
from collections.abc import Iterator
from contextlib import ExitStack
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from dragon_ros.core.errors import InputError

NEWEST = 9      # newest major version with which the private names were tested: Jazzy has 7, Kilted 9


def version_of_rclpy() -> str:
    """Return the version of rclpy, or 'of an unknown version'."""
    try:
        return version('rclpy')
    except PackageNotFoundError:
        return 'of an unknown version'


@cache
def is_tested() -> bool:
    """Return whether the private names were tested with a version at least as new as this one."""
    major = version_of_rclpy().partition('.')[0]
    return major.isdecimal() and int(major) <= NEWEST


def _private(owner: Any, name: str) -> Any:
    """Return a private attribute, or None if it is missing or has not been tested."""
    return getattr(owner, name, None) if is_tested() else None


def notice() -> str:
    """Return the line that a node logs at its start if this rclpy has not been tested, or ''."""
    return '' if is_tested() else (
        f'rclpy {version_of_rclpy()} has not been tested with this package (the newest was {NEWEST}): only its public '
        'functions are used, which takes more CPU time')


def given_parameters(node: Node) -> dict[str, Any]:
    """Return, by name, the parameter values that the command line, files and ``parameter_overrides`` set for a node.

    No public function returns these values without declaring the parameters. The substitute declares those of the
    command line and of files on a second node of the same name, which fails for an empty list, because it has no type.
    """
    overrides = _private(node, '_parameter_overrides')
    if overrides is not None:
        return {name: [] if given.value is None else given.value for name, given in overrides.items()}
    try:
        helper = Node(node.get_name(), context=node.context, namespace=node.get_namespace(), enable_rosout=False,
                      start_parameter_services=False, automatically_declare_parameters_from_overrides=True)
    except ValueError:
        raise InputError(f"parameters of {node.get_name()}: one is an empty list; omit it, or give ['']") from None
    given = {name: parameter.value for name, parameter in helper.get_parameters_by_prefix('').items()}
    helper.destroy_node()
    return given


def waiting_messages(subscription: Subscription) -> Iterator[tuple[bytes, Any]]:
    """Yield the messages that have arrived on a raw subscription, with their information, unless it was destroyed.

    The substitute yields none: an executor then passes on each message, one for each wait.
    """
    handle = subscription.handle
    take_message = _private(handle, 'take_message')
    if take_message is None:
        return
    with ExitStack() as held:
        try:
            held.enter_context(handle)
        except InvalidHandle:
            return
        while (message := take_message(subscription.msg_type, subscription.raw)) is not None:
            yield message


def wait_set_class() -> Any:
    """Return the class of the middleware's wait sets, or None; its substitute is an executor of rclpy."""
    return _private(rclpy_implementation, 'WaitSet')


class WaitSet:
    """The entities of a node to wait for, collected once; until ``close``, even destroyed ones are kept alive."""

    def __init__(self, node: Node) -> None:
        """Collect the entities."""
        self._subscriptions = {one.handle.pointer: one for one in node.subscriptions}
        self._services, self._clients = tuple(node.services), tuple(node.clients)
        self._timers, self._guards = tuple(node.timers), tuple(node.guards)
        self._actions = tuple(one for one in node.waitables if one.get_num_entities().num_services)
        self._held = ExitStack()
        for one in (*self._subscriptions.values(), *self._services, *self._clients, *self._guards, *self._timers):
            self._held.enter_context(one.handle)
        for action in self._actions:
            self._held.enter_context(action)
        self._held.enter_context(node.context.handle)
        inside = [one.get_num_entities() for one in self._actions]
        self._wait_set = wait_set_class()(
            len(self._subscriptions), len(self._guards) + 1, len(self._timers) + sum(one.num_timers for one in inside),
            len(self._clients), len(self._services) + sum(one.num_services for one in inside), 0, node.context.handle)

    def close(self) -> None:
        """Release the entities."""
        self._held.close()

    def wait(self, timeout_ns: int, condition: Any) -> tuple[list[Subscription], bool]:
        """Wait until something is ready or ``condition`` is triggered, and call the timers that are ready.

        Return the subscriptions that have messages, and whether anything else is left for an executor of rclpy.
        """
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in self._subscriptions.values():
            wait_set.add_subscription(subscription.handle)
        for timer in self._timers:
            wait_set.add_timer(timer.handle)
        for service in self._services:
            wait_set.add_service(service.handle)
        for client in self._clients:
            wait_set.add_client(client.handle)
        for guard in (*self._guards, condition):
            wait_set.add_guard_condition(guard.handle)
        for action in self._actions:
            action.add_to_wait_set(wait_set)
        wait_set.wait(timeout_ns)
        others = bool(wait_set.get_ready_entities('service') or wait_set.get_ready_entities('client'))
        messages = wait_set.get_ready_entities('subscription')
        triggered = wait_set.get_ready_entities('guard_condition')
        for guard in self._guards:
            if guard.handle.pointer in triggered:
                guard.trigger()     # again, because this wait has consumed the trigger that rclpy needs
                others = True
        if wait_set.get_ready_entities('timer'):
            for timer in self._timers:
                _call(timer)
        return [self._subscriptions[pointer] for pointer in messages], others


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
