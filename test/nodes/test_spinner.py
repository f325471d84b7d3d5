"""A spinner handles everything that an rclpy executor does: messages, timers, requests, events and later additions."""
import gc
import threading
import time
import weakref
from contextlib import closing, contextmanager
from functools import partial
from importlib.util import find_spec

import pytest

rclpy = pytest.importorskip('rclpy')

from rclpy.clock import Clock, ClockType  # noqa: E402
from rclpy.event_handler import SubscriptionEventCallbacks  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from rosgraph_msgs.msg import Clock as ClockMessage  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from dragon_ros.nodes import raw_subscription, shell  # noqa: E402
from dragon_ros.nodes import spinner as spinner_module  # noqa: E402
from dragon_ros.nodes.spinner import Spinner  # noqa: E402

PATIENCE_S = 60.0
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


@pytest.fixture
def served(domain):
    """A node, and a function that spins it with a spinner until a condition holds."""
    rclpy.init()
    node = rclpy.create_node('served')
    spinner = Spinner(node)

    def until(condition):
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, 'the condition was not met in time'
            spinner.once()
    yield node, until
    spinner.close()
    node.destroy_node()
    rclpy.shutdown()


@contextmanager
def beats(node, take=lambda data, info: None):
    """Keep the node busy with a message every two milliseconds on a separate raw topic."""
    raw_subscription.subscribe_raw(node, Float64, 'busy', take, QoSProfile(depth=10))
    publisher = node.create_publisher(Float64, 'busy', 10)
    timer = node.create_timer(0.002, lambda: publisher.publish(Float64(data=1.0)), clock=STEADY)
    yield publisher
    timer.cancel()


def test_raw_messages_arrive_in_order_with_their_numbers(served):
    node, until = served
    got = []
    raw_subscription.subscribe_raw(node, Float64, 'x', lambda data, info: got.append(
        (data[-8:], raw_subscription.number(info))), QoSProfile(depth=1000))
    publisher = node.create_publisher(Float64, 'x', 1000)
    until(publisher.get_subscription_count)
    for value in range(200):
        publisher.publish(Float64(data=float(value)))
    until(lambda: len(got) == 200)
    assert [number for _, number in got] == list(range(1, 201))
    assert len({data for data, _ in got}) == 200


def test_other_subscriptions_services_and_clients_are_served_between_raw_messages(served):
    node, until = served
    got, answers = [], []
    node.create_subscription(Float64, 'plain', lambda message: got.append(message.data), 10)
    node.create_service(Trigger, 'ask', lambda _, response: Trigger.Response(success=True, message='yes'))
    client, plain = node.create_client(Trigger, 'ask'), node.create_publisher(Float64, 'plain', 10)
    with beats(node):
        until(lambda: client.service_is_ready() and plain.get_subscription_count())
        for value in range(5):
            plain.publish(Float64(data=float(value)))
            future = client.call_async(Trigger.Request())
            until(future.done)
            answers.append(future.result().message)
        until(lambda: len(got) == 5)
    assert answers == ['yes'] * 5
    assert got == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_what_is_added_and_removed_while_it_spins_is_noticed(served):
    node, until = served
    got, ticks = [], []
    with beats(node):
        until(lambda: True)
        later = node.create_subscription(Float64, 'later', lambda message: got.append(message.data), 10)
        publisher = node.create_publisher(Float64, 'later', 10)
        timer = node.create_timer(0.01, lambda: ticks.append(1), clock=STEADY)
        until(publisher.get_subscription_count)
        publisher.publish(Float64(data=3.0))
        until(lambda: got == [3.0] and len(ticks) > 2)
        node.destroy_subscription(later)
        node.destroy_timer(timer)
        seen = len(ticks)
        until(lambda: not publisher.get_subscription_count())
        begin = time.monotonic()
        until(lambda: time.monotonic() - begin > 0.5)       # long enough for two calls of ``_look``
        assert len(ticks) == seen


def test_a_raw_subscription_that_its_own_callback_destroys_takes_no_more(served):
    node, until = served
    got = []

    def take(data, info):
        got.append(data)
        node.destroy_subscription(next(one for one in node.subscriptions if one.topic_name == '/once'))
    raw_subscription.subscribe_raw(node, Float64, 'once', take, QoSProfile(depth=10))
    publisher = node.create_publisher(Float64, 'once', 10)
    until(publisher.get_subscription_count)
    for value in range(5):
        publisher.publish(Float64(data=float(value)))
    until(lambda: got and not publisher.get_subscription_count())
    assert len(got) == 1


def test_a_clock_that_comes_and_goes_with_a_parameter_is_followed(served):
    node, until = served
    clock = node.create_publisher(ClockMessage, '/clock', 10)
    with beats(node):
        for stamp in (5, 6):
            node.set_parameters([Parameter('use_sim_time', value=True)])
            until(clock.get_subscription_count)
            message = ClockMessage()
            message.clock.sec = stamp
            clock.publish(message)
            until(lambda stamp=stamp: node.get_clock().now().nanoseconds == stamp * 10**9)
            node.set_parameters([Parameter('use_sim_time', value=False)])
            until(lambda: not clock.get_subscription_count())


def test_a_cancelled_timer_rests_until_it_is_reset_with_another_period(served):
    node, until = served
    calls = []

    def call():
        calls.append(1)
        timer.cancel()
    timer = node.create_timer(0.01, call, clock=STEADY)
    with beats(node):
        for count in (1, 2, 3):
            until(lambda count=count: len(calls) == count)
            begin = time.monotonic()
            until(lambda begin=begin: time.monotonic() - begin > 0.1)
            assert len(calls) == count
            timer.timer_period_ns = 0
            timer.reset()


def test_a_wait_that_lasts_for_hours_because_the_system_clock_was_set_back_is_ended(domain, monkeypatch):
    monkeypatch.setattr(spinner_module, '_WAIT_NS', 7200 * 10**9)      # how long the middleware then waits
    rclpy.init()
    node, late = rclpy.create_node('waiting'), []
    with closing(Spinner(node)) as spinner:
        spinner.once()      # this function only collects the entities to wait for
        rescue = threading.Timer(PATIENCE_S, lambda: (late.append(True), spinner._overdue._condition.trigger()))
        rescue.start()
        spinner.once()
        rescue.cancel()
    node.destroy_node()
    rclpy.shutdown()
    assert not late


def test_messages_that_arrive_before_the_next_wait_may_begin_are_taken_together(domain, monkeypatch):
    """Here, three messages arrive while the spinner sleeps; without the sleep, they would never arrive."""
    rclpy.init()
    node, got, batches = rclpy.create_node('gathering'), [], []
    raw_subscription.subscribe_raw(node, Float64, 'x', lambda data, info: got.append(data), QoSProfile(depth=10),
                                   lambda: batches.append(len(got)))
    publisher = node.create_publisher(Float64, 'x', 10)

    def sleep(pause_s):
        if publisher.get_subscription_count() and pause_s > 0:
            for value in range(0 if got else 3):
                publisher.publish(Float64(data=float(value)))
    monkeypatch.setattr(time, 'sleep', sleep)
    end = time.monotonic() + PATIENCE_S
    with closing(Spinner(node, gather_s=PATIENCE_S)) as spinner:
        while not got and time.monotonic() < end:
            spinner.once()
    node.destroy_node()
    rclpy.shutdown()
    assert batches == [3]


@pytest.mark.parametrize(('by_s', 'woken'), [(-7200.0, 1), (-0.1, 1), (7200.0, 0), (-0.01, 0)])
def test_the_middleware_is_woken_once_if_the_system_clock_was_set_back(domain, monkeypatch, by_s, woken):
    rclpy.init()
    node, added = rclpy.create_node('awake'), []
    create, real = rclpy.node.Node.create_publisher, time.time
    with closing(Spinner(node)) as spinner:
        monkeypatch.setattr(rclpy.node.Node, 'create_publisher', lambda *given: (added.append(1), create(*given))[1])
        monkeypatch.setattr(time, 'time', lambda: real() + by_s)
        for _ in range(3):
            spinner._look()
    node.destroy_node()
    rclpy.shutdown()
    assert len(added) == woken


def test_an_incompatible_publisher_is_reported(served, other_node):
    node, until = served
    events = []
    node.create_subscription(Float64, 'y', lambda _: None, QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=events.append))
    with beats(node):
        other_node.create_publisher(Float64, '/y', QoSProfile(depth=1, durability=DurabilityPolicy.VOLATILE))
        until(lambda: events)
    assert events[0].total_count == 1


def test_a_guard_condition_and_an_action_wake_it_without_a_look_at_all_else(served, other_node, monkeypatch):
    monkeypatch.setattr(spinner_module, '_LOOK_S', 3600.0)
    node, until = served
    called, each = [], []
    guard = node.create_guard_condition(lambda: called.append(1))
    server = action_server(node, each.append)
    until(lambda: True)
    spun = threading.Thread(target=until, args=(lambda: len(called) == 2,))
    spun.start()
    try:
        guard.trigger()
        other_node.until(lambda: called == [1])
        if server:
            call_action(other_node)
            assert each == [3]
        guard.trigger()
    finally:
        spun.join(PATIENCE_S)
        if server:
            server.destroy()
    assert called == [1, 1]


def action_server(node, take):
    """Return a server of the only action type that may be installed, or None; the ROS wheels contain no action type."""
    if find_spec('simulation_interfaces') is None:
        return None
    from rclpy.action import ActionServer
    from simulation_interfaces.action import SimulateSteps

    def execute(goal):
        take(goal.request.steps)
        goal.succeed()
        return SimulateSteps.Result()
    return ActionServer(node, SimulateSteps, 'steps', execute)


def call_action(node):
    from rclpy.action import ActionClient
    from simulation_interfaces.action import SimulateSteps
    client = ActionClient(node, SimulateSteps, '/steps')
    node.until(client.server_is_ready)
    sent = client.send_goal_async(SimulateSteps.Goal(steps=3))
    node.until(sent.done)
    answered = sent.result().get_result_async()
    node.until(answered.done)
    client.destroy()


@pytest.mark.parametrize('where', ['timer', 'raw', 'plain'])
def test_an_error_in_a_callback_ends_the_spin(domain, where):
    def fail(*_):
        raise ZeroDivisionError('of the test')
    rclpy.init()
    try:
        node = rclpy.create_node('failing')
        with beats(node, fail if where == 'raw' else lambda data, info: None):
            if where == 'timer':
                node.create_timer(0.01, fail, clock=STEADY)
            if where == 'plain':
                node.create_subscription(Float64, 'busy', fail, 10)
            with pytest.raises(ZeroDivisionError, match='of the test'):
                shell.spin(node, threading.Event())
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_node_with_raw_subscriptions_is_freed_with_its_last_name(domain):
    rclpy.init()
    try:
        node = rclpy.create_node('short')
        raw_subscription.subscribe_raw(node, Float64, 'x', partial(print, node), QoSProfile(depth=1))
        stop = threading.Event()
        stop.set()
        shell.spin(node, stop)
        node.destroy_node()
        gone = weakref.ref(node)
        del node
        gc.collect()
        assert gone() is None
    finally:
        rclpy.shutdown()
