"""What dragon.launch.py starts, with or without the launch library; the processes are real."""
import pytest

pytest.importorskip('rclpy')

from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.errors import InputError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import float64_of
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.nodes.launch_plan import plan
from dragon_ros.scenes.provenance import RECORD, run_metadata, scene_file

SCENE = Scene(run=Run(412.2, 412.7))
DEFAULTS = {'scene': 'winding', 'accuracy': '', 'rate': '', 'time_scale': '1.0', 'at_end': 'hold',
            'on_contact': 'continue', 'namespace': 'dragon', 'frame_id': '', 'use_sim_time': 'false',
            'publish_tf': 'false', 'monitor': 'true', 'warn_below': '0.02', 'clearance_vector': 'false',
            'record': '', 'replay': '', 'json': 'false'}


def planned(**given):
    return plan({**DEFAULTS, **given})


@pytest.fixture
def watched(tmp_path):
    """A bag that holds what a monitor reported, too."""
    encode, path = encoders(SCENE), tmp_path / 'watched.mcap'
    with BagWriter(path) as bag:
        for name in (*encode, 'clearance'):
            bag.add_channel(f'/dragon/{name}', channels()[name])
        bag.describe(RECORD, run_metadata(scene_file(SCENE, {'frame_id': 'sea'}), SCENE, {}))
        for k in range(26):
            frame = tick(SCENE, k)
            for name in encode:
                bag.write(f'/dragon/{name}', encode[name](frame), frame.t_ns, k + 1)
            bag.write('/dragon/clearance', float64_of(-1.0), frame.t_ns, k + 1)
    return path


@pytest.fixture
def launched(start):
    """Start what launch would start, as launch would."""
    def text(value):
        return str(value).lower() if isinstance(value, bool) else str(value) or '""'

    def run(what):
        return {one.executable: start(
            one.executable, *one.arguments, '--ros-args', '-r', f'__ns:={what.namespace}',
            *(part for name, value in one.parameters.items() for part in ('-p', f'{name}:={text(value)}')))
            for one in (*what.readers, what.source)}
    return run


def test_a_replayed_bag_moves_to_the_namespace_waits_for_the_monitor_and_leads_the_clock(launched, node, watched):
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64
    times, gaps = [], []
    node.create_subscription(Clock, '/clock', lambda m: times.append(m.clock.sec * 10**9 + m.clock.nanosec), 100)
    node.create_subscription(Float64, '/red/clearance', lambda m: gaps.append(m.data), 100)
    what = planned(replay=str(watched), namespace='red', use_sim_time='true', record='again.mcap')
    assert (what.frame_id, what.namespace) == ('sea', '/red')
    ran = launched(what)
    node.until(lambda: node.count_publishers('/red/handles') == node.count_publishers('/red/clearance') == 1)
    node.until(lambda: times[-1:] == [SCENE.run.time_ns(25)])       # it holds, and repeats the time
    assert node.count_publishers('/red/clearance') == 1
    assert node.count_publishers('/dragon/handles') == 0
    assert ran['replay'].stop() == 0, ran['replay'].text
    assert ran['record'].end() == 0, ran['record'].text
    assert ran['monitor'].stop() == 0
    assert 'saw 26 ticks' in ran['monitor'].text
    assert set(times) <= {SCENE.run.time_ns(k) for k in range(26)}
    assert -1.0 not in gaps         # those of the bag: only the live monitor speaks


def test_without_a_monitor_its_topics_are_replayed(watched):
    topics = dict(zip(planned(replay=str(watched)).source.arguments[1:],
                      planned(replay=str(watched)).source.arguments[2:], strict=False))['--topics']
    assert '/dragon/clearance' not in topics.split(',')
    assert '/dragon/clearance' in planned(replay=str(watched), monitor='false').source.arguments[4].split(',')


def test_what_launch_starts_waits_for_the_readers_it_starts():
    source = planned(record='run.mcap').source
    assert source.parameters['wait_subscribers'] == ['handles=2', 'benches=2', 'velocities=1']
    assert source.parameters['discovery_s'] > 0             # for the recorder to find the monitor, and for others
    alone = planned().source
    assert alone.parameters['wait_subscribers'] == ['handles=1', 'benches=1', 'velocities=0']


def test_what_cannot_be_read_is_left_to_the_node_that_says_why():
    assert planned(scene='windin').source.parameters['wait_subscribers'] == ['']
    assert planned(replay='nothing.mcap').source.arguments == ['nothing.mcap', '--into', '/dragon']


@pytest.mark.parametrize('name', ['time_scale', 'rate', 'warn_below'])
def test_an_argument_that_is_no_number_is_named(name):
    with pytest.raises(InputError, match=f'launch argument {name}:=abc'):
        planned(**{name: 'abc'})
