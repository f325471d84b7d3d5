"""``dragon.launch.py`` starts the right processes, with and without the launch library; the processes are real."""
import struct

import pytest

pytest.importorskip('rclpy')

from dragon_ros.bags.read.frames import frames
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.errors import InputError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import float64_of
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import read_diagnostics
from dragon_ros.messages.encode import encoders
from dragon_ros.nodes.launch_plan import ARGUMENTS, YES_NO, misspelt, plan
from dragon_ros.scenes.provenance import RECORD, run_metadata, scene_file

SCENE = Scene(run=Run(412.2, 412.7))


def planned(**given):
    return plan({**{one.name: one.default for one in ARGUMENTS}, **given})


@pytest.fixture
def watched(tmp_path):
    """A bag that also contains a monitor's reports."""
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


def test_a_replayed_bag_moves_to_the_namespace_waits_for_the_monitor_and_leads_the_clock(
        launched, node, watched, tmp_path):
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64
    times, gaps = [], []
    node.create_subscription(Clock, '/clock', lambda m: times.append(m.clock.sec * 10**9 + m.clock.nanosec), 100)
    node.create_subscription(Float64, '/red/clearance', lambda m: gaps.append(m.data), 100)
    what = planned(replay=str(watched), namespace='red', use_sim_time='true', record='again.mcap', discovery_s='0')
    assert (what.frame_id, what.namespace) == ('sea', '/red')
    ran = launched(what)
    node.until(lambda: node.count_publishers('/red/handles') == node.count_publishers('/red/clearance') == 1)
    node.until(lambda: times[-1:] == [SCENE.run.time_ns(25)])       # at its end, the replay repeats the time
    assert node.count_publishers('/red/clearance') == 1
    assert node.count_publishers('/dragon/handles') == 0
    assert ran['replay'].stop() == 0, ran['replay'].text
    assert ran['record'].end() == 0, ran['record'].text
    assert ran['monitor'].stop() == 0
    assert 'saw 26 ticks' in ran['monitor'].text
    assert set(times) <= {SCENE.run.time_ns(k) for k in range(26)}
    assert -1.0 not in gaps         # the bag contains -1.0, but only the live monitor publishes
    with BagReader(tmp_path / 'again.mcap') as again:
        assert {topic.name: topic.messages for topic in again.topics}['/red/clearance/stamped'] == 26


def test_without_a_monitor_its_topics_are_replayed(watched):
    topics = dict(zip(planned(replay=str(watched)).source.arguments[1:],
                      planned(replay=str(watched)).source.arguments[2:], strict=False))['--topics']
    assert '/dragon/clearance' not in topics.split(',')
    assert '/dragon/clearance' in planned(replay=str(watched), monitor='false').source.arguments[4].split(',')


def test_what_launch_starts_waits_for_the_readers_it_starts():
    source = planned(record='run.mcap').source
    assert source.parameters['wait_subscribers'] == ['handles=2', 'benches=2', 'velocities=1']
    assert source.parameters['discovery_s'] > 0             # so that the recorder and other nodes discover the monitor
    alone = planned().source
    assert alone.parameters['wait_subscribers'] == ['handles=1', 'benches=1', 'velocities=0']


def test_a_launched_recorder_waits_for_the_monitor_if_one_is_started_and_the_run_waits_for_both(watched, tmp_path):
    (tmp_path / 'file.yaml').write_text('{}')
    assert [planned(record='run.mcap', **given).recorder.arguments[2:] for given in (
        {}, {'replay': str(watched)}, {'monitor': 'false'}, {'scene': 'minimal'}, {'scene': 'windin'},
        {'params_file': str(tmp_path / 'file.yaml')})] == [['--wait-monitor'], ['--wait-monitor'], [], [], [], []]


def test_what_cannot_be_read_is_left_to_the_node_that_says_why():
    assert planned(scene='windin').source.parameters['wait_subscribers'] == ['']
    assert planned(replay='nothing.mcap').source.arguments == ['nothing.mcap', '--into', '/dragon']


@pytest.mark.parametrize('changes', [{'scene': 'minimal'}, {'set': 'effects=[velocity]; dragon.benches=9'}])
def test_no_monitor_is_started_that_could_see_nothing(changes):
    what = planned(**changes, record='run.mcap')
    assert [one.executable for one in what.readers] == ['record']
    assert 'handles=1' in what.source.parameters['wait_subscribers']
    assert "add benches to the scene's effects" in what.notes[0]
    assert not planned(scene='winding').notes


def test_no_monitor_is_started_on_a_bag_without_benches(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as bag:
        bag.add_channel('/dragon/handles', channels()['handles'])
        bag.write('/dragon/handles', encoders(SCENE)['handles'](tick(SCENE, 0)), SCENE.run.time_ns(0), 1)
    what = planned(replay=str(tmp_path / 'a.mcap'))
    assert what.readers == []
    assert what.notes == ('no monitor is started, because no benches are published: the bag has none',)


def test_what_stops_at_a_contact_stops_everything_unless_told_otherwise():
    ends = {text: planned(on_contact=text).source.parameters['at_end'] for text in ('continue', 'hold', 'stop')}
    assert ends == {'continue': 'hold', 'hold': 'hold', 'stop': 'stop'}
    assert planned(on_contact='stop', at_end='loop').source.parameters['at_end'] == 'loop'


def test_each_argument_of_a_run_is_passed_to_the_node_that_it_is_for(watched):
    sim = planned(set=' run.stop_s=9 ; effects=[benches, clearance];', start_s='1.5', stop_s='8',
                  discovery_s='0.5').source
    assert sim.parameters['set'] == ['run.stop_s=9', 'effects=[benches, clearance]']
    assert [sim.parameters[name] for name in ('start_s', 'stop_s', 'discovery_s')] == [1.5, 8.0, 0.5]
    assert not {'start_s', 'stop_s', 'rate_hz'} & set(planned().source.parameters)
    replay = planned(replay=str(watched), start_s='412.3', stop_s='412.35', discovery_s='0.5').source
    assert replay.arguments[-4:] == ['--start', '0.1', '--end', '0.15']
    assert replay.parameters['discovery_s'] == 0.5
    with pytest.raises(InputError, match='start_s:=400: the bag goes from 412.2 s to 412.7 s'):
        planned(replay=str(watched), start_s='400')


@pytest.mark.parametrize('name', [one.name for one in ARGUMENTS if one.concerns])
def test_an_argument_that_concerns_nothing_that_is_started_is_refused(watched, name):
    who = next(one.concerns for one in ARGUMENTS if one.name == name)
    given = {'replay': str(watched)} if who == 'sim' else {'monitor': 'false'}
    with pytest.raises(InputError, match=f'launch argument {name}:=0.5: applies only to {who}, which is not started'):
        planned(**given, **{name: '0.5'})


def test_a_file_of_parameters_yields_to_arguments_alone_and_only_what_is_always_there_is_waited_for(tmp_path):
    what = planned(params_file='mine.yaml', rate='10', warn_below='0.1', record='run.mcap')
    assert {one.file for one in (*what.readers, what.source)} == {'mine.yaml'}
    assert what.source.asked == {'rate_hz'}
    assert what.readers[0].asked == {'warn_below_m'}
    assert what.source.parameters['wait_subscribers'] == ['']       # the file may name another scene


@pytest.mark.parametrize('name', ['time_scale', 'rate', 'warn_below', 'start_s', 'discovery_s'])
def test_an_argument_that_is_no_number_is_named(name):
    with pytest.raises(InputError, match=f'launch argument {name}:=abc'):
        planned(**{name: 'abc'})


WATCHED = 'clearance', 'clearance/stamped', 'collision', 'collision/active', 'collision/point'


def said(path, dragon):
    """Return a monitor's messages in a bag by topic, each as (time, message), and its diagnostics as (time, t_s)."""
    found = {name: [] for name in (*WATCHED, '/diagnostics')}
    with BagReader(path) as bag:
        for message in bag.messages():
            name = message.topic.removeprefix(f'/{dragon}/')
            if name in WATCHED:
                found[name].append((message.t_ns, message.data.replace(dragon.encode(), b'___')))
            elif name == '/diagnostics':
                found[name].extend(
                    (message.t_ns, status.values['t_s']) for status in read_diagnostics(message.data)
                    if status.name == f'{dragon}: clearance' and 't_s' in status.values)
    return found


def test_at_any_rate_every_recorded_value_stands_at_the_time_of_its_tick(launched, watched, tmp_path):
    """A monitor lags behind a source that publishes as fast as possible, but its reports equal those in real time."""
    short, ran = {'start_s': '412.2', 'stop_s': '412.7'}, {}
    for dragon, given in {'one': short, 'two': {'time_scale': '0.0', **short},
                          'six': {'time_scale': '0.0', 'replay': str(watched)}}.items():
        ran[dragon] = launched(planned(namespace=dragon, frame_id=dragon, record=f'{dragon}.mcap', at_end='stop',
                                       discovery_s='1', **given))
    for nodes in ran.values():
        assert nodes['record'].end() == 0, nodes['record'].text
    live, quick, again = (said(tmp_path / f'{dragon}.mcap', dragon) for dragon in ran)
    assert {name: live[name] for name in WATCHED} == {name: quick[name] for name in WATCHED}
    assert live['clearance'] == again['clearance']
    with BagReader(tmp_path / 'two.mcap') as bag:
        assert [(frame.t_ns, frame.clearance_m) for frame in frames(bag, '/two')] == [
            (t_ns, struct.unpack('<4xd', data)[0]) for t_ns, data in quick['clearance']]
    assert [t_ns for t_ns, _ in quick['collision/active']] == [SCENE.run.time_ns(0), SCENE.run.time_ns(14)]
    for one in (live, quick, again):
        assert one['/diagnostics']
        assert [f'{t_ns / 1e9:.9f}' for t_ns, _ in one['/diagnostics']] == [t_s for _, t_s in one['/diagnostics']]


@pytest.mark.parametrize('value', ['nan', 'inf', '-inf'])
def test_a_part_of_a_bag_has_finite_ends(watched, value):
    with pytest.raises(InputError, match=f'launch argument start_s:={value}: it is not a finite number; write for'):
        planned(replay=str(watched), start_s=value)


@pytest.mark.parametrize(('given', 'pushed', 'absolute'), [
    ('dragon', '', '/dragon'), ('dragon', '/robot1', '/robot1/dragon'), ('dragon/', 'robot1', '/robot1/dragon'),
    ('/red', '/robot1', '/red'), ('', '/robot1', '/robot1'), ('a/b', '/robot1/', '/robot1/a/b')])
def test_a_relative_namespace_lies_in_the_pushed_one_and_an_absolute_one_does_not(watched, given, pushed, absolute):
    arguments = {one.name: one.default for one in ARGUMENTS} | {'namespace': given}
    assert plan(arguments, pushed).namespace == absolute
    replay = plan({**arguments, 'replay': str(watched)}, pushed)
    assert replay.source.arguments[1:3] == ['--into', absolute]


def test_two_robots_have_frames_of_their_own():
    arguments = {one.name: one.default for one in ARGUMENTS}
    assert [plan(arguments, robot).frame_id for robot in ('/one', '/two', '')] == ['one_dragon', 'two_dragon', 'dragon']


def test_launch_files_in_python_may_write_true(watched):
    assert planned(publish_tf='True', rviz='False').source.parameters['publish_tf'] is True
    assert planned(monitor='False').readers == []
    assert planned(replay=str(watched), publish_tf='False').source.executable == 'replay'      # as by default
    assert {one.choices for one in ARGUMENTS if one.default in YES_NO} == {YES_NO}


def test_a_misspelt_argument_is_named_with_a_suggestion():
    (line,) = misspelt([*(one.name for one in ARGUMENTS), 'scen', 'use_rviz', 'robot_name'])
    assert line == 'launch argument scen is not known and is ignored; did you mean scene?'
