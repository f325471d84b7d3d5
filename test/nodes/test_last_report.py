"""A recorder gets a monitor's first report if it waits for it.

It ends only after the monitor's last report on a run, or states in one line that this report is missing.
"""
import signal
from contextlib import contextmanager

import pytest
from properties import thinned

pytest.importorskip('rclpy')

from test_graph import SHORT, events_of, overrides
from test_record import received

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.messages.channels import channels
from dragon_ros.nodes import qos
from dragon_ros.nodes.contact_messages import header_of, health_of

FOUND, WAITS = 'a monitor has been found', 'waiting for the monitor'
MISSING = "the monitor's last reports are missing"


@pytest.fixture
def held(start, node):
    """A monitor that has examined no tick because its first tick waits for a map, and the publisher of that map."""
    from nav_msgs.msg import OccupancyGrid
    from visualization_msgs.msg import MarkerArray
    monitor = start('monitor')
    maps = node.create_publisher(OccupancyGrid, '/map', qos.profile('reliable', 'transient_local', 1))
    venues = node.create_publisher(MarkerArray, 'venue', qos.of_channel(channels()['venue']))
    venues.publish(b'\0\1\0\0\7\0\0\0')
    monitor.wait_for('venue: not used')     # the map's publisher was discovered earlier
    return monitor, maps


def start_run(start, *readers):
    return start('sim', '--scene', 'first_contact', *overrides(*SHORT), '--ros-args', '-p', 'time_scale:=0.0',
                 '-p', f'wait_subscribers:=[{",".join(readers)}]')


def run_to_the_end(start, readers):
    sim = start_run(start, f'handles={readers}', f'benches={readers}')
    assert sim.end() == 0, sim.text     # all readers have acknowledged all messages


@contextmanager
def stopped(process):
    """Suspend a process for the duration of the block."""
    process.signal(signal.SIGSTOP)
    yield
    process.signal(signal.SIGCONT)


@pytest.mark.parametrize('ended_by', thinned(['the end of the run', 'a signal'], lambda what: what != 'a signal'))
def test_a_recorder_waits_for_a_monitor_that_has_not_yet_examined_the_last_tick(start, held, tmp_path, ended_by):
    from nav_msgs.msg import OccupancyGrid
    bag, (monitor, maps) = tmp_path / 'run.mcap', held
    record = start('record', '--output', bag, *(['--keep-going'] if ended_by == 'a signal' else []))
    record.wait_for(FOUND)
    run_to_the_end(start, readers=2)
    with stopped(monitor):
        if ended_by == 'a signal':
            record.signal(signal.SIGINT)
        record.wait_for(WAITS)
    maps.publish(OccupancyGrid())
    assert record.end() == 0, record.text
    assert len(events_of(bag)) == 1, record.text
    assert 'nothing is missing' in record.text
    assert MISSING not in record.text


def test_a_recorder_that_never_gets_the_last_report_of_a_monitor_says_so_and_exits_3(start, held, tmp_path):
    bag, (monitor, _) = tmp_path / 'run.mcap', held
    record = start('record', '--output', bag)
    record.wait_for(FOUND)
    run_to_the_end(start, readers=2)
    monitor.signal(signal.SIGKILL)      # a killed process does not announce that it leaves
    assert record.stop() == 3, record.text
    assert sum(MISSING in line for line in record.lines) == 1, record.text
    assert 'NOT COMPLETE' in record.text
    told = received(bag)['dragon_ros.received']
    assert (told['complete'], told['monitor last word']) == ('false', 'missing')


def test_a_monitor_that_is_stopped_during_a_run_has_given_its_last_report(start, tmp_path):
    bag, monitor = tmp_path / 'run.mcap', start('monitor')
    record = start('record', '--output', bag)
    record.wait_for(FOUND)
    sim = start('sim', '--scene', 'first_contact', *overrides('run.start_s=412.3', 'run.stop_s=430'), '--ros-args',
                '-p', 'wait_subscribers:=[handles=2,benches=2]')
    monitor.wait_for('contact of benches 0 and 8')
    assert monitor.stop() == 0, monitor.text
    assert sim.stop() == 0, sim.text
    assert record.end() == 0, record.text
    assert events_of(bag)[0].values['phase'] == 'begin'     # on a busy machine, the contact may end first
    assert MISSING not in record.text
    assert WAITS not in record.text


def test_a_recorder_that_discovers_a_monitor_late_still_receives_its_contact(start, tmp_path):
    bag = tmp_path / 'run.mcap'
    record = start('record', '--output', bag, '--keep-going')
    record.wait_for('recording to')
    with stopped(record):
        monitor = start('monitor')
        run_to_the_end(start, readers=1)
        monitor.wait_for('contact of benches 0 and 8')
    record.wait_for(FOUND)
    record.stop()
    assert len(events_of(bag)) == 1, record.text
    assert monitor.stop() == 0, monitor.text


def test_a_recorder_that_a_monitor_discovers_late_states_how_many_reports_it_lacks(start, node, tmp_path):
    """The test's node acts as the monitor, and discovers the recorder only at the last tick."""
    from diagnostic_msgs.msg import DiagnosticArray, KeyValue
    from geometry_msgs.msg import Vector3Stamped
    bag, last_ns = tmp_path / 'run.mcap', 412_700_000_000
    record = start('record', '--output', bag, '--keep-going')
    run_to_the_end(start, readers=1)
    report, health = (node.create_publisher(kind, name, qos.of_channel(channels()[name])) for kind, name in (
        (Vector3Stamped, 'clearance/stamped'), (DiagnosticArray, '/diagnostics')))
    node.until(lambda: report.get_subscription_count() and health.get_subscription_count())
    report.publish(Vector3Stamped(header=header_of('dragon', last_ns)))
    status = health_of('dragon', None, 0.0, 0, reports=26)
    status.values.append(KeyValue(key='t_s', value=f'{last_ns / 1e9:.9f}'))
    health.publish(DiagnosticArray(status=[status]))
    record.wait_for(FOUND)
    assert record.stop() == 0, record.text
    assert "the monitor's first reports are missing: 25 were published before it had found" in record.text
    assert ' topics, no tick is missing' in record.text
    assert received(bag)['dragon_ros.received']['monitor first reports missing'] == '25'


def test_a_recorder_that_waits_for_a_monitor_gets_all_reports_of_a_run_that_waits_for_both(start, node, tmp_path):
    bag = tmp_path / 'run.mcap'
    record = start('record', '--wait-monitor', '--output', bag)
    sim = start_run(start, 'handles=2', 'benches=2', 'velocities=1')
    node.until(lambda: node.count_subscribers('clearance/stamped') and node.count_publishers('handles'))
    assert node.count_subscribers('handles') == 0
    monitor = start('monitor')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    assert monitor.stop() == 0, monitor.text
    assert 'nothing is missing' in record.text
    with BagReader(bag) as run:
        told = {topic.name: topic.messages for topic in run.topics}
    assert [told[f'/dragon/{name}'] for name in ('handles', 'benches', 'clearance/stamped', 'clearance')] == [26] * 4


def test_a_recorder_without_a_monitor_waits_for_none(start, tmp_path):
    record = start('record', '--output', tmp_path / 'run.mcap')
    run_to_the_end(start, readers=1)
    assert record.end() == 0, record.text
    assert WAITS not in record.text
    assert MISSING not in record.text
