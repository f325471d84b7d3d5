"""Services, live parameters and /clock control a running sim; nodes also run in executors of other programs."""
import gc
import json
import math
import threading
import time

import pytest
from properties import thinned

pytest.importorskip('rclpy')

from controls import Caller, called
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters, SetParametersAtomically
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from dragon_ros.core import domain
from dragon_ros.core.geometry import tracker
from dragon_ros.messages.decode import read_pose_array
from dragon_ros.nodes import params
from dragon_ros.nodes.params import SIM

TICK_NS = 20_000_000
START_NS = 400_000_000_000
PARAMETER = {bool: ParameterType.PARAMETER_BOOL, int: ParameterType.PARAMETER_INTEGER,
             float: ParameterType.PARAMETER_DOUBLE, str: ParameterType.PARAMETER_STRING}
FIELD = {bool: 'bool_value', int: 'integer_value', float: 'double_value', str: 'string_value'}


class Remote:
    """A user in another process who controls a running sim."""

    def __init__(self, node, name='/dragon/sim'):
        from geometry_msgs.msg import PoseArray
        self._node, self._name, self.stamps = node, name, []
        node.create_subscription(PoseArray, 'handles', lambda data: self.stamps.append(read_pose_array(data).t_ns),
                                 1000, raw=True)

    def _ask(self, kind, name, request):
        client = self._node.create_client(kind, f'{self._name}/{name}')
        self._node.until(client.service_is_ready)
        future = client.call_async(request)
        self._node.until(future.done)
        self._node.destroy_client(client)
        return future.result()

    def ask(self, kind, request):
        return self._ask(kind, {SetParameters: 'set_parameters'}.get(kind, 'set_parameters_atomically'), request)

    def call(self, name):
        answer = self._ask(Trigger, name, Trigger.Request())
        return answer.success, answer.message

    def set(self, name, value):
        given = Parameter(name=name, value=ParameterValue(type=PARAMETER[type(value)], **{FIELD[type(value)]: value}))
        (result,) = self._ask(SetParameters, 'set_parameters', SetParameters.Request(parameters=[given])).results
        return result.successful, result.reason

    def get(self, name):
        return self._ask(GetParameters, 'get_parameters', GetParameters.Request(names=[name])).values[0]

    def describe(self, names):
        return self._ask(DescribeParameters, 'describe_parameters', DescribeParameters.Request(names=names)).descriptors

    def shown(self, *ticks):
        """Wait until exactly these ticks have been received since the last check."""
        wanted = [START_NS + TICK_NS * k for k in ticks]
        self._node.until(lambda: len(self.stamps) >= len(wanted))
        assert self.stamps == wanted
        self.stamps.clear()


@pytest.fixture
def paused(start, node):
    """A sim of ``first_contact`` at tick 0, which was paused during its run and then reset."""
    remote = Remote(node)
    remote.process = start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'wait_subscribers:=[handles=1]',
                           '-p', 'at_end:=hold')
    node.until(lambda: len(remote.stamps) > 2)
    assert remote.call('pause')[0]
    remote.call('reset')
    node.until(lambda: remote.stamps[-1] == START_NS)
    remote.stamps.clear()
    return remote


def test_step_plays_the_requested_ticks_and_pauses_again(paused):
    assert paused.call('step') == (True, 'at 400.020 s, tick 1 of 651')
    paused.shown(1)
    assert paused.set('step_ticks', 3) == (True, '')
    assert paused.call('step') == (True, 'at 400.080 s, tick 4 of 651')
    paused.shown(2, 3, 4)


def test_seek_shows_the_last_tick_at_or_before_the_time_and_does_not_start_what_is_paused(paused):
    assert paused.set('seek_s', 410.009) == (True, '')
    assert paused.call('seek') == (True, 'at 410.000 s, tick 500 of 651; paused, call resume to continue')
    assert paused.call('step')[0]
    paused.shown(500, 501)
    assert paused.call('reset') == (True, 'at 400.000 s, tick 0 of 651; paused, call resume to continue')
    paused.shown(0)


def test_a_resumed_run_continues_where_it_was_without_a_gap(paused, node):
    paused.set('seek_s', 405.0)
    paused.call('seek')
    assert paused.call('resume') == (True, 'resumed at 405.000 s, tick 250 of 651')
    node.until(lambda: len(paused.stamps) > 10)
    assert paused.call('pause')[0]
    steps = {after - before for before, after in zip(paused.stamps, paused.stamps[1:], strict=False)}
    assert (paused.stamps[0], steps) == (405_000_000_000, {TICK_NS})


def test_a_run_that_holds_at_its_end_is_there_for_control(paused, node):
    paused.set('seek_s', 412.98)
    paused.call('seek')
    paused.call('resume')
    paused.process.wait_for('holding until a signal')
    paused.shown(649, 650)
    for name in ('resume', 'step'):
        succeeded, why = paused.call(name)
        assert not succeeded
        assert 'the run stops at 413.000000 s after 651 ticks: no frame follows; reset or seek' in why
    assert paused.call('reset') == (True, 'at 400.000 s, tick 0 of 651')
    node.until(lambda: len(paused.stamps) > 2)      # it runs again
    assert paused.stamps[:3] == [START_NS + TICK_NS * k for k in range(3)]
    assert paused.process.stop() == 0


def test_seek_as_it_is_goes_to_the_start(paused):
    assert paused.call('step')[0]
    assert paused.call('seek') == (True, 'at 400.000 s, tick 0 of 651; paused, call resume to continue')
    paused.shown(1, 0)


def test_a_run_can_loop_and_be_stopped_at_its_end(start, node):
    remote = Remote(node)
    process = start('sim', '--scene', 'first_contact', '--set', 'run.stop_s=400.1', '--ros-args', '-p',
                    'wait_subscribers:=[handles=1]', '-p', 'at_end:=loop')
    node.until(lambda: len(remote.stamps) >= 13)
    assert remote.stamps[:13] == [START_NS + TICK_NS * (k % 6) for k in range(13)]
    assert remote.set('at_end', 'stop') == (True, '')
    assert process.end() == 0, process.text


def test_the_speed_changes_live_and_whole_numbers_are_taken(paused, node):
    assert paused.set('time_scale', 100) == (True, '')
    assert paused.get('time_scale').double_value == 100.0
    paused.call('resume')
    paused.process.wait_for('holding until a signal')
    node.until(lambda: len(paused.stamps) == 650)
    assert paused.process.stop() == 0


REFUSED = [
    ('scene', 'winding', 'read-only'), ('rate_hz', 10.0, 'read-only'), ('publish_clock', True, 'read-only'),
    ('time_scale', 0.0, 'start sim with time_scale:=0.0'), ('time_scale', -1.0, 'range'),
    ('time_scale', float('nan'), 'range'), ('time_scale', 'fast', 'type'), ('step_ticks', 0, 'range'),
    ('step_ticks', 1.5, 'type'), ('at_end', 'explode', 'not one of stop, hold, loop'),
    ('seek_s', -2.0, 'range'), ('at_end', 'x' * 70_000, '...xxx'),
    ('time_scale', math.nextafter(1e6, math.inf), 'is outside 0.0 to 1000000.0'),
    ('seek_s', 399.0, 'the run goes from 400 s to 413 s'), ('seek_s', 414.0, 'the run goes from 400 s to 413 s')]


def test_a_parameter_that_cannot_be_is_refused_with_the_reason_and_keeps_its_value(paused):
    for name, value, says in REFUSED:
        before = paused.get(name)
        accepted, reason = paused.set(name, value)
        assert (name, value, accepted) == (name, value, False)
        assert says in reason
        assert paused.get(name) == before


@pytest.mark.parametrize('name', ['sim', 'monitor', 'record'])
def test_parameters_of_a_type_that_does_not_exist_are_refused_and_the_node_lives_on(start, node, tmp_path, name):
    process = start(name, *(['--output', tmp_path / 'a.mcap'] if name == 'record' else []))
    remote = Remote(node, f'/dragon/{name}')
    odd = Parameter(name='use_sim_time', value=ParameterValue(type=99))
    many = remote.ask(SetParameters, SetParameters.Request(parameters=[odd, odd])).results
    one = remote.ask(SetParametersAtomically, SetParametersAtomically.Request(parameters=[odd])).result
    assert [(row.successful, row.reason) for row in (*many, one)] == 3 * [
        (False, "parameter 'use_sim_time': its type, 99, is unknown; nothing is set")]
    assert not remote.get('use_sim_time').bool_value
    assert process.running


def test_a_running_sim_takes_both_ends_of_every_live_parameter_and_plays_on(paused, node):
    assert paused.call('resume')[0]
    for scale in (5e-324, 1e-300, 2e-12, 1e6, 1e-9):
        assert paused.set('time_scale', scale) == (True, '')
        assert paused.get('time_scale').double_value == scale
    for name, low, high in (('step_ticks', 1, 1000), ('seek_s', -1.0, 413.0)):
        for value in (low, high):
            assert paused.call('reset')[0]
            assert paused.set(name, value) == (True, '')
            assert paused.call(name.partition('_')[0])[0]
    assert paused.call('reset')[0]
    assert paused.set('time_scale', 1e6) == (True, '')
    assert paused.call('resume')[0]
    node.until(lambda: paused.stamps[-1:] == [413 * 10**9])
    assert paused.process.stop() == 0, paused.process.text


def test_any_call_and_any_value_of_any_parameter_is_answered_as_the_table_says(start, domain, request):
    sim = start('sim', '--scene', 'unwinding', '--ros-args', '-p', 'discovery_s:=0.0', '-p', 'at_end:=hold')
    caller, calls = Caller(seed=1), 120 if request.config.getoption('--long') else 60
    try:
        while called(caller.counts) < calls:
            caller.any_call()
    finally:
        caller.close()
    assert not caller.faults
    assert min(caller.counts['taken'], caller.counts['refused']) > 2
    assert sim.running


def test_parameters_are_described_with_type_range_text_and_whether_they_are_live(start, node):
    start('sim', '--ros-args', '-p', 'discovery_s:=0.0')
    rows = {row.name: row for row in Remote(node).describe([parameter.name for parameter in SIM])}
    assert all(row.description for row in rows.values())
    assert {name for name, row in rows.items() if not row.read_only} == {'time_scale', 'step_ticks', 'seek_s', 'at_end'}
    assert rows['time_scale'].floating_point_range[0].to_value == 1e6
    assert rows['step_ticks'].integer_range[0].to_value == 1000
    assert rows['on_contact'].additional_constraints == 'one of continue, hold, stop'


def test_the_tables_that_import_little_have_the_limits_of_the_core():
    assert (tracker.NEAR_M, domain.TIME.high, domain.RATE.high) == (params.NEAR_M, params.LONGEST_RUN_S, params.MOST_HZ)


def test_the_clock_follows_every_tick_jumps_back_at_a_reset_and_repeats_while_time_stands(start, node):
    times = []
    node.create_subscription(Clock, '/clock', lambda m: times.append(m.clock.sec * 10**9 + m.clock.nanosec), 100)
    remote = Remote(node)
    start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'wait_subscribers:=[handles=2]', '-p',
          'publish_clock:=true')
    node.until(lambda: times[:2] == [START_NS] * 2)
    _ = Remote(node)
    node.until(lambda: len(remote.stamps) > 5)
    remote.call('pause')
    node.until(lambda: times[-1:] == remote.stamps[-1:] and times[-2:-1] == times[-1:])
    assert sorted(set(times)) == remote.stamps
    remote.call('reset')
    node.until(lambda: times[-1] == START_NS)


def test_a_node_on_simulation_time_says_once_that_no_clock_comes(start):
    monitor = start('monitor', '--ros-args', '-p', 'use_sim_time:=true')
    monitor.wait_for('nothing arrived on /clock for 3 s')
    assert 'publish_clock:=true' in monitor.text
    assert monitor.stop() == 0
    assert monitor.text.count('nothing arrived on /clock') == 1


def test_the_stamps_of_the_monitor_follow_the_clock(start, node):
    from diagnostic_msgs.msg import DiagnosticArray
    stamps = []
    node.create_subscription(DiagnosticArray, '/diagnostics', lambda m: stamps.append(m.header.stamp.sec), 10)
    start('monitor', '--ros-args', '-p', 'use_sim_time:=true')
    start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'publish_clock:=true', '-p', 'at_end:=loop')
    node.until(lambda: stamps and 400 <= stamps[-1] <= 413)


def shut_down(executor):
    """Shut an executor down after its last callback, since rclpy 7.1 does not wait for threads that use the node."""
    if threads := getattr(executor, '_executor', None):
        threads.shutdown()
    executor.shutdown()


@pytest.mark.parametrize(('kind', 'scale'), thinned([
    (f'{kind}ThreadedExecutor', scale) for kind in ('Single', 'Multi') for scale in (0.0, 50.0)],
    lambda case: case[0].startswith('Single') == (case[1] == 0.0)))
def test_sim_and_monitor_share_an_executor_of_somebody_else(domain, kind, scale, capfd):
    import rclpy
    from rclpy import executors

    from dragon_ros.nodes.monitor import Monitor
    from dragon_ros.nodes.sim import Sim
    rclpy.init()
    executor, nodes = getattr(executors, kind)(), []
    try:
        nodes += [Monitor(), Sim(scene='first_contact', set=['run.start_s=412.2', 'run.stop_s=412.7'],
                                 time_scale=scale, wait_subscribers=['handles=1', 'benches=1'])]
        for one in nodes:
            executor.add_node(one)
        found, end = [], threading.Event()
        nodes[0].get_logger().error = lambda text: (found.append(text), end.set())
        # ``spin_once`` may return immediately, so the limit is a time rather than a number of calls.
        until = time.monotonic() + 60
        while time.monotonic() < until and not (end.is_set() and nodes[1].player.done):
            executor.spin_once(timeout_sec=0.01)
        assert 'contact of benches 0 and 8 at 412.473838 s' in found[0]
        assert nodes[1].player.done
    finally:
        shut_down(executor)
        for one in nodes:
            one.destroy_node()
        rclpy.shutdown()
    del executor
    gc.collect()
    assert 'never retrieved' not in capfd.readouterr().err      # the text of an unhandled exception in a callback


@pytest.mark.parametrize('arguments', [['sim', '--scene', 'first_contact', '--set', 'run.stop_s=403'],
                                       ['monitor'], ['record', '--output', 'run.mcap']], ids=lambda v: v[0])
def test_logs_for_machines_are_one_json_object_a_line(start, arguments):
    process = start(arguments[0], '--json', *arguments[1:], '--ros-args', '-p', 'use_sim_time:=true', '-p',
                    'discovery_s:=0.0')
    process.wait_for('/clock' if arguments[0] == 'monitor' else '}')
    if arguments[0] != 'sim':
        process.stop()
    assert process.end() == 0, process.text
    rows = [json.loads(row) for row in process.text.splitlines()]
    assert all({'wall_s', 'level', 'name', 'message'} <= row.keys() for row in rows)
    assert {row['name'] for row in rows} == {f'dragon.{arguments[0]}'}
    if arguments[0] == 'sim':
        told = [row for row in rows if 't_s' in row]
        progress = told[-1]
        assert 400 < progress['t_s'] < 403
        assert told[0]['left_s'] is None        # the speed is known from the second line on
        assert told[1]['left_s'] > 0
        assert progress['overruns'] >= 0


def test_without_a_terminal_no_progress_is_logged(start):
    sim = start('sim', '--scene', 'first_contact', '--set', 'run.stop_s=402.5', '--ros-args', '-p', 'discovery_s:=0.0')
    assert sim.end() == 0
    assert [line.partition(']: ')[2].split()[0] for line in sim.lines] == ['starting', 'the', 'published:']


def test_what_came_before_the_signal_is_served_before_the_end(domain):
    import rclpy
    from rclpy.duration import Duration
    from std_msgs.msg import Float64

    from dragon_ros.nodes import shell
    rclpy.init()
    try:
        node, got, stop = rclpy.create_node('reader'), [], threading.Event()
        publisher = node.create_publisher(Float64, 'x', 100)
        node.create_subscription(Float64, 'x', lambda message: got.append(message.data), 100)
        shell.spin(node, stop, publisher.get_subscription_count)
        for value in range(100):
            publisher.publish(Float64(data=float(value)))
        assert publisher.wait_for_all_acked(Duration(seconds=30))
        stop.set()
        shell.spin(node, stop, rest_s=30.0)
        assert got == list(range(100))
        node.destroy_node()
    finally:
        rclpy.shutdown()
