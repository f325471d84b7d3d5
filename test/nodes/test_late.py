"""In a namespace, monitors and recorders that start later than launched nodes report the ticks that they missed."""
import pytest

pytest.importorskip('rclpy')

from std_srvs.srv import Trigger
from test_launch_plan import planned
from test_record import received, streamed

from dragon_ros.__main__ import main
from dragon_ros.messages.decode import read_pose_array
from dragon_ros.nodes.launch_plan import LaunchPlan

NAMESPACE = '/far/one'
SIM = {'scene': 'first_contact', 'set': 'dragon.benches=20;run.stop_s=410'}
LED = {'scene': 'led', 'set': 'dragon.benches=20;run.stop_s=60'}
EACH_TICK = 'handles', 'benches', 'velocities'


@pytest.fixture
def launched_as(launched, tmp_path):
    """Start the nodes, except the monitor, that launch starts for a sim, a replay or a led dragon, at a given rate."""
    def run(form, rate):
        given = {'sim': SIM, 'led': LED, 'replay': {'replay': str(tmp_path / 'bag.mcap')}}[form]
        if form == 'replay':
            sets = [part for pair in SIM['set'].split(';') for part in ('--set', pair)]
            assert main(['simulate', '--scene', SIM['scene'], *sets, '--output', given['replay']]) == 0
        what = planned(namespace=NAMESPACE, record='early.mcap', monitor='false', time_scale=str(rate),
                       discovery_s='1', **given)
        assert isinstance(what, LaunchPlan)
        return launched(what), f'{NAMESPACE}/{"replay" if form == "replay" else "sim"}'
    return run


def call(node, name):
    client = node.create_client(Trigger, name)
    node.until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    node.until(future.done)
    node.destroy_client(client)


def late_readers(start, node, readers):
    """Start a monitor and a recorder, and wait until they have subscribed."""
    under = '--ros-args', '-r', f'__ns:={NAMESPACE}'
    monitor = start('monitor', *under)
    record = start('record', '--output', 'late.mcap', '--flush-s', '0.1', *under)
    node.until(lambda: node.count_subscribers(f'{NAMESPACE}/handles') == readers + 2)
    return monitor, record


TABLE = [(form, rate) for form in ('sim', 'replay', 'led') for rate in (0, 1, 2) if (form, rate) != ('led', 0)]
USUAL = ('sim', 0), ('replay', 2)


@pytest.mark.parametrize(('form', 'rate'), TABLE)
def test_who_comes_late_says_what_it_missed_and_who_was_there_misses_nothing(launched_as, start, node, tmp_path,
                                                                             request, form, rate):
    if (form, rate) not in USUAL and not request.config.getoption('--long'):
        pytest.skip('by default only two cases of the table run; all run with --long')
    from geometry_msgs.msg import PoseArray, Vector3Stamped
    stamps, told = [], []
    ran, name = launched_as(form, rate)
    source, early = ran[name.rpartition('/')[2]], ran['record']
    if rate:
        node.create_subscription(PoseArray, f'{NAMESPACE}/handles', lambda data: stamps.append(
            read_pose_array(data).t_ns), 1000, raw=True)
        node.create_subscription(Vector3Stamped, f'{NAMESPACE}/clearance/stamped', told.append, 10)
        node.until(lambda: len(stamps) > 3)
        call(node, f'{name}/pause')
    else:
        source.wait_for('holding until a signal')
    monitor, late = late_readers(start, node, 1 + bool(rate))
    bag = tmp_path / 'late.mcap'
    if rate:
        call(node, f'{name}/resume')
        node.until(lambda: told and {f'{NAMESPACE}/{one}' for one in EACH_TICK} <= {row[0] for row in streamed(bag)})
        assert source.stop() == 0, source.text
        assert late.end() == 3, late.text
    else:
        node.until(lambda: b'scene.yaml' in bag.read_bytes())
        assert late.stop() == 3, late.text
        assert source.stop() == 0, source.text
    says = 'the beginning is missing: ' if rate else 'no message was received'
    assert all(f'{NAMESPACE}/{one}: {says}' in late.text for one in EACH_TICK), late.text
    assert received(bag)['dragon_ros.received']['complete'] == 'false'
    assert monitor.stop() == 0, monitor.text
    assert (' were published before it subscribed' if rate else 'saw 0 ticks') in monitor.text
    assert early.end() == 0, early.text
    assert 'NOT COMPLETE' not in early.text     # the late monitor's first reports may be missing
    told = received(tmp_path / 'early.mcap')['dragon_ros.received']
    assert (told['complete'], told[f'{NAMESPACE}/handles ticks'].partition('-')[0]) == ('true', '0')
