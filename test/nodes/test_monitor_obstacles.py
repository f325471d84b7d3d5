"""The monitor over real DDS, with obstacles from the topic ``venue``, from files and from maps in several frames."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.__main__ import main
from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.check.contacts import first_contact_in
from dragon_ros.bags.read.frames import RecordedObstacles, frames
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.geometry.near_obstacles import with_obstacles
from dragon_ros.core.geometry.near_pairs import closeness
from dragon_ros.core.model import compile_scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import tick
from dragon_ros.core.venue import LineObstacle, Venue
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import decode, read_diagnostics, read_stamp_ns
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.latched import latched_messages
from dragon_ros.pictures.sources import dragon_in
from dragon_ros.scenes.load import load_scene

SCENE = """
dragon: {benches: 5}
track: {kind: joined, start_m: 25, pieces: [{kind: line, length_m: 24.5}, {kind: arc, radius_m: 400, angle_deg: 3}]}
run: {start_s: 4.2, stop_s: 5.2}
effects: [benches, clearance, contact]
venue:
  obstacles:
    - {kind: line, name: wall, points_m: [[0, 0.7], [60, 0.7]]}
    - {kind: polygon, name: post, points_m: [[30, 0.05], [30.4, 0.05], [30.4, 0.4], [30, 0.4]]}
"""
READERS = 'wait_subscribers:=[handles=2,benches=2,venue=2,model/clearance=1]'


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / 'post.yaml'
    path.write_text(SCENE)
    return path


def collisions(bag, topic='/dragon/collision'):
    return [row for message in bag.messages([topic]) for row in read_diagnostics(message.data)]


def clearances(bag):
    kind = channels()['clearance/stamped'].type
    return {read_stamp_ns(m.data): float(decode(kind, m.data)['vector'][0])
            for m in bag.messages(['/dragon/clearance/stamped'])}


def searched(bag):
    """The clearance at each tick, computed from the benches and obstacles in the bag without any earlier state."""
    obstacles = RecordedObstacles(bag, '/dragon', 'dragon')
    return {one.t_ns: with_obstacles(obstacles.at(one.t_ns), closeness(one.handles_m, one.benches), one.benches
                                     ).clearance_m for one in frames(bag)}


def recorded_replay(start, bag, again, topics, *parameters):
    """Replay topics of a bag to a monitor and a recorder until the replay ends."""
    monitor, record = start('monitor', '--ros-args', *parameters), start('record', '--output', again)
    record.wait_for('a monitor has been found')     # discovery may take longer than the run
    names = [f'/dragon/{topic}' for topic in topics]
    needed = [f'{name}={1 + (name.split("/")[-1] in ("handles", "benches", "obstacles"))}' for name in names]
    replay = start('replay', bag, '--rate', '0', '--topics', ','.join(names), '--wait-subscribers', ','.join(needed))
    assert (replay.end(), record.end(), monitor.stop()) == (0, 0, 0), replay.text + record.text + monitor.text


def test_a_live_run_a_replay_and_the_offline_answers_agree_on_the_contact_with_an_obstacle(start, tmp_path, scene_file,
                                                                                          capsys):
    bag, again, third = (tmp_path / f'{name}.mcap' for name in ('run', 'again', 'third'))
    monitor, record = start('monitor'), start('record', '--output', bag)
    record.wait_for('a monitor has been found')     # discovery may take longer than the run
    sim = start('sim', '--scene', scene_file, '--ros-args', '-p', READERS, '-p', 'time_scale:=0.0')
    assert (sim.end(), record.end(), monitor.stop()) == (0, 0, 0), sim.text + record.text + monitor.text
    scene = load_scene(str(scene_file))
    found = first_contact(scene)
    with BagReader(bag) as run:
        assert compare_with_model(run, scene).faults == []
        first, *_ = collisions(run)
        seen = clearances(run)
        reported = first_contact_in(run, '/dragon', scene)
        again_seen = searched(run)
        reports, names = collisions(run), [topic.name for topic in run.topics if topic.messages]
    assert (first.values['inner'], first.values['outer'], first.values['obstacle']) == ('0', '6', 'post')
    assert "contact of bench 0 and obstacle 'post' at" in first.message
    assert float(first.values['t_before_s']) < found.t_s <= float(first.values['t_after_s'])
    assert float(first.values['t_contact_s']) == pytest.approx(found.t_s, abs=1e-8)
    assert reported.obstacle == found.obstacle.name == 'post'
    assert seen == again_seen       # equal to the last bit, although computed without any earlier state
    model = {t_ns: tick(scene, scene.run.tick_at(t_ns)).closeness.clearance_m for t_ns in seen}
    assert len(seen) == compile_scene(scene).last_tick + 1
    assert seen == pytest.approx(model, abs=1e-14)      # conversion to quaternions loses the last bits
    assert main(['inspect', str(bag), '--check']) == 0, capsys.readouterr().out

    assert '/dragon/collision/obstacles' not in names

    # The monitor of a replay without a venue reads the obstacles from a file; the third monitor receives them only from
    # the second bag.
    recorded_replay(start, bag, again, ('handles', 'benches', 'scene', 'model/clearance', 'model/contacts'),
                    '-p', f'venue:={scene_file}')
    recorded_replay(start, again, third, ('handles', 'benches', 'collision/obstacles'),
                    '-r', 'venue:=collision/obstacles')
    for one in (again, third):
        with BagReader(one) as run:
            names = [topic.name for topic in run.topics if topic.messages]
            assert '/dragon/venue' not in names
            assert '/dragon/collision/obstacles' in names
            assert clearances(run) == searched(run) == seen
            assert collisions(run) == reports
            touch = dragon_in(run).first_touch(iter)
        assert (touch.obstacle, touch.benches) == ('post', (0,))
        assert f'{touch.t_s:.9f}' == first.values['t_contact_s']
    capsys.readouterr()
    assert main(['inspect', str(again), '--check']) == 1     # the replay left out two topics
    checked = capsys.readouterr().out
    assert '0 are not; 2 are missing' in checked
    assert 'of collision/obstacles (published by monitor at its own rate)' in checked
    assert main(['contact', str(again)]) == 0
    assert f'in the recorded ticks, bench 0 touches post at {touch.t_s:.9f} s' in capsys.readouterr().err
    assert main(['inspect', str(again)]) == 0
    assert "first contact: bench 0 and obstacle 'post' at" in capsys.readouterr().out


class Map:
    """A map server in the test's node that publishes latched grids, like the map server of Nav2."""

    def __init__(self, node, topic='/map'):
        from nav_msgs.msg import OccupancyGrid
        from rclpy.qos import DurabilityPolicy, QoSProfile
        self._kind = OccupancyGrid
        self._out = node.create_publisher(OccupancyGrid, topic, QoSProfile(
            depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))

    def show(self, cells, resolution_m, corner, degrees, frame='map'):
        """Publish rows of cells whose outer corner is at a position, turned about this corner by ``degrees``."""
        grid = self._kind()
        grid.header.frame_id = frame
        grid.info.height, grid.info.width = cells.shape
        grid.info.resolution = resolution_m
        grid.info.origin.position.x, grid.info.origin.position.y = corner
        grid.info.origin.orientation.z = float(np.sin(np.radians(degrees) / 2))
        grid.info.origin.orientation.w = float(np.cos(np.radians(degrees) / 2))
        grid.data.frombytes(cells.astype(np.int8).tobytes())
        self._out.publish(grid)


class Dragon:
    """A node that publishes ticks of a scene to monitors, each in its own namespace, and receives their messages."""

    def __init__(self, node, scene, *monitors):
        from diagnostic_msgs.msg import DiagnosticArray

        from dragon_ros.nodes import qos
        from dragon_ros.nodes.shell import message_type
        self.node, self.scene, self.encode = node, scene, encoders(scene)
        self.out = {name: node.create_publisher(message_type(channels()[name].type), name, qos.of_channel(
            channels()[name])) for name in ('handles', 'benches')}
        self.health, self.events = {one: [] for one in monitors}, {one: [] for one in monitors}
        for one in monitors:
            node.create_subscription(DiagnosticArray, f'/{one}/collision', lambda message, to=self.events[one]:
                                     to.extend(message.status), qos.of_channel(channels()['collision']))
        node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, 100)
        node.until(lambda: all(out.get_subscription_count() == len(monitors) for out in self.out.values()))

    def _hear(self, message):
        for status in message.status:
            if status.name.endswith('monitor: obstacles'):
                self.health[status.hardware_id].append(status)

    def show(self, *ticks):
        for k in ticks:
            frame = tick(self.scene, k)
            for name, out in self.out.items():
                out.publish(self.encode[name](frame))

    def heard(self, monitor, words):
        return any(words in status.message for status in self.events[monitor] + self.health[monitor])

    def wait(self, monitor, words):
        self.node.until(lambda: self.heard(monitor, words))


def watching(start, name, **given):
    return start('monitor', '--ros-args', '-r', f'__ns:=/{name}', '-r', 'handles:=/dragon/handles', '-r',
                 'benches:=/dragon/benches', '-r', 'venue:=/dragon/venue',
                 *(part for key, value in given.items() for part in ('-p', f'{key}:={value}')))


def test_a_map_is_turned_by_its_origin_moved_by_the_declared_pose_and_never_overlaid_without_one(start, node):
    from visualization_msgs.msg import MarkerArray

    from dragon_ros.nodes import qos
    scene = load_scene('street', ['dragon.benches=5', 'venue=null', 'run.stop_s=20'])
    # The head walks along y = 0, from x = 20 m on. In the dragon's frame the grid's corner is (25, -0.75), and its rows
    # are parallel to the x axis, so that one occupied cell goes from (26, -0.25) to (26.5, 0.25).
    cells = np.full((3, 4), -1)
    cells[1, 2], cells[0, 0], cells[2, 3] = 65, 0, 64
    lost = watching(start, 'lost')
    moved = watching(start, 'moved', venue_pose='"10,0,90"')
    unknown = watching(start, 'unknown', venue_pose='"10,0,90"', map_unknown='occupied')
    server, dragon = Map(node), Dragon(node, scene, 'lost', 'moved', 'unknown')
    shown = []
    node.create_subscription(MarkerArray, '/moved/collision/obstacles', shown.append,
                             qos.of_channel(channels()['collision/obstacles']))
    corner = -1j * ((25 - 0.75j) - 10)      # in the frame map, whose pose is (10, 0), 90 degrees
    server.show(cells, 0.5, (corner.real, corner.imag), -90)
    for one in (lost, moved, unknown):
        one.wait_for('/map: 1 obstacle with ')
    dragon.show(*range(0, 400, 2))
    dragon.wait('lost', "/map: not used: its frame is 'map', the frame of the dragon is 'dragon'")
    lost.wait_for('give venue_pose:=X,Y,DEGREES')
    dragon.wait('moved', "contact of bench 0 and obstacle 'map' at")
    (begin,) = [{pair.key: pair.value for pair in status.values} for status in dragon.events['moved'][:1]]
    assert float(begin['x_m']) == pytest.approx(26, abs=0.01)
    # The front of the head is ahead of its handle.
    assert float(begin['t_contact_s']) == pytest.approx(26 - 20 - 0.275, abs=1e-6)
    dragon.wait('unknown', "contact of bench 0 and obstacle 'map' at")
    (first,) = [{pair.key: pair.value for pair in status.values} for status in dragon.events['unknown'][:1]]
    assert float(first['t_contact_s']) == pytest.approx(25 - 20 - 0.275, abs=1e-6)
    assert not dragon.events['lost']
    node.until(lambda: shown)
    (one,) = shown
    assert [marker.text for marker in one.markers] == ['', 'polygon', 'map']
    server.show(np.indices((150, 150)).sum(axis=0) % 2 * 100, 0.5, (1000.0, 0.0), 0)
    moved.wait_for('/map: 1 obstacle with 45000 edges')
    dragon.show(400)
    moved.wait_for('obstacles from files and maps are not published, because they have more than 20000 edges')
    node.until(lambda: [len(one.markers) for one in shown] == [3, 1])


def wall(x, name):
    return Venue((LineObstacle(name, ((x, -1.0), (x, 1.0))),))


def test_a_venue_may_come_late_change_and_vanish_and_one_of_a_file_counts_with_it(start, node, tmp_path):
    from geometry_msgs.msg import Vector3Stamped
    from visualization_msgs.msg import Marker, MarkerArray

    from dragon_ros.nodes import qos
    (tmp_path / 'far.geojson').write_text('{"type": "Feature", "units": "m", "properties": {"name": "far wall"}, '
                                          '"geometry": {"type": "LineString", "coordinates": [[28, -1], [28, 1]]}}')
    scene = load_scene('street', ['dragon.benches=5', 'venue=null', 'run.stop_s=20'])
    start('monitor', '--ros-args', '-p', 'venue:=far.geojson', '-p', 'clearance_vector:=true')
    vectors, shown = list[Vector3Stamped](), list[MarkerArray]()
    for kind, topic, to in ((Vector3Stamped, 'clearance/vector', vectors), (MarkerArray, 'collision/obstacles', shown)):
        node.create_subscription(kind, topic, to.append, qos.of_channel(channels()[topic]))
    dragon = Dragon(node, scene, 'dragon')
    dragon.show(0, 200)      # the front is at 24.275 m
    dragon.wait('dragon', '1 obstacle with 1 edge from file far.geojson')
    out = node.create_publisher(MarkerArray, 'venue', qos.of_channel(channels()['venue']))
    out.publish(latched_messages(replace(scene, venue=wall(24.0, 'gate')), 'dragon')['venue'])
    dragon.wait('dragon', '1 obstacle with 1 edge from file far.geojson, 1 obstacle with 1 edge from venue')
    dragon.show(201)
    dragon.wait('dragon', "contact of bench 0 and obstacle 'gate' at 4.020000 s")
    out.publish(latched_messages(replace(scene, venue=wall(50.0, 'other gate')), 'dragon')['venue'])
    dragon.show(202)
    dragon.wait('dragon', "contact ended by a change of the venue: bench 0 and obstacle 'gate'")
    out.publish(b'\x00\x01\x00\x00\x07\x00\x00\x00')
    dragon.wait('dragon', '1 obstacle with 1 edge from file far.geojson, 1 obstacle with 1 edge from venue; venue: not '
                          'used: 8 bytes cannot hold 7 markers; the last valid message stays in use: 1 obstacle with')
    values = {pair.key: pair.value for pair in dragon.health['dragon'][-1].values}
    assert values['venue'] == '1 obstacle with 1 edge'
    assert values['not used from venue'].startswith('8 bytes cannot hold 7 markers')
    out.publish(bytes.fromhex('0001000000000000'))
    later = iter(range(203, 380))

    def vector_is_heard():
        if not vectors:
            dragon.show(next(later))
        return vectors
    node.until(vector_is_heard)
    dragon.show(380, 400)
    dragon.wait('dragon', "contact of bench 0 and obstacle 'far wall' at 7.725")
    node.until(lambda: dragon.health['dragon'][-1].message == '1 obstacle with 1 edge from file far.geojson')
    begins = [status for status in dragon.events['dragon'] if status.level == b'\x02']
    assert len(begins) == 2
    node.until(lambda: vectors[-1].header.stamp.sec == 8)
    (gap,) = [one.vector for one in vectors if (one.header.stamp.sec, one.header.stamp.nanosec) == (7, 600_000_000)]
    assert (gap.x, gap.y) == pytest.approx((0.125, 0), abs=1e-9)     # from the front at 27.875 m to the far wall
    assert {one.markers[0].action for one in shown} == {Marker.DELETEALL}
    names = [[marker.text for marker in one.markers if marker.ns == 'venue names'] for one in shown]
    assert names == [['far wall'], ['far wall', 'gate'], ['far wall', 'other gate'], ['far wall']]
    assert [round(one.markers[0].header.stamp.sec + 1e-9 * one.markers[0].header.stamp.nanosec, 9) for one in shown[:3]
            ] == [0, 4.02, 4.04]


@pytest.mark.parametrize(('given', 'why'), [
    (('venue:=nowhere.wkt',), 'nowhere.wkt: cannot be read'), (('venue:=winding',), 'the scene has none'),
    (('venue_pose:="1,2"',), "parameter venue_pose: '1,2' is not valid: it must be X,Y,DEGREES"),
    (('map_occupied:=0',), 'parameter map_occupied: 0 is outside 1 to 100'),
    (('map_unknown:=maybe',), "parameter map_unknown: 'maybe' is not one of free, occupied")])
def test_an_invalid_parameter_of_obstacles_ends_the_monitor_with_one_line(start, given, why):
    monitor = start('monitor', '--ros-args', *(part for one in given for part in ('-p', one)))
    assert monitor.end() == 2
    assert why in monitor.text
    assert 'Traceback' not in monitor.text


def test_a_map_is_moved_by_static_and_other_transforms_where_there_are_some(start, node):
    tf2 = pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs has no wheel; it comes with ROS 2')
    from geometry_msgs.msg import TransformStamped
    from rclpy.qos import DurabilityPolicy, QoSProfile
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    outs = {'/tf_static': node.create_publisher(tf2.TFMessage, '/tf_static', latched),
            '/tf': node.create_publisher(tf2.TFMessage, '/tf', 10)}

    def show(topic, parent, child, x, degrees):
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id = parent
        one.transform.translation.x = float(x)
        one.transform.rotation.z = float(np.sin(np.radians(degrees) / 2))
        one.transform.rotation.w = float(np.cos(np.radians(degrees) / 2))
        outs[topic].publish(tf2.TFMessage(transforms=[one]))
    scene = load_scene('street', ['dragon.benches=5', 'venue=null', 'run.stop_s=20'])
    monitor = start('monitor')
    server, dragon = Map(node), Dragon(node, scene, 'dragon')
    show('/tf_static', 'hall', 'map', 30, 180)
    server.show(np.array([[100]]), 1.0, (4.0, -0.5), 0)     # in the frame hall, from (25, -0.5) to (26, 0.5)
    dragon.show(0, 50)
    monitor.wait_for('and /tf and /tf_static do not connect them')
    node.until(lambda: outs['/tf'].get_subscription_count())
    show('/tf', 'hall', 'dragon', -1, 0)
    monitor.wait_for('moved to (31, 0) m, 180 deg')
    dragon.show(*range(260, 300, 2))
    dragon.wait('dragon', "contact of bench 0 and obstacle 'map' at 5.725000 s")      # a wall at x = 26 m
    show('/tf', 'hall', 'dragon', -3, 0)
    monitor.wait_for('moved to (33, 0) m, 180 deg')
    dragon.show(300)
    dragon.wait('dragon', "end of contact: bench 0 and obstacle 'map'")


@pytest.mark.parametrize('fault', ['nan', 'tilted'])
def test_the_status_names_the_obstacles_in_use_after_a_refused_venue(start, node, fault):
    from geometry_msgs.msg import Point
    from visualization_msgs.msg import Marker, MarkerArray

    from dragon_ros.nodes import qos
    scene = load_scene('street', ['dragon.benches=5', 'venue=null', 'run.stop_s=20'])
    monitor = start('monitor')
    dragon = Dragon(node, scene, 'dragon')
    out = node.create_publisher(MarkerArray, 'venue', qos.of_channel(channels()['venue']))
    out.publish(latched_messages(replace(scene, venue=wall(24.0, 'gate')), 'dragon')['venue'])
    monitor.wait_for('venue: 1 obstacle')
    dragon.show(0, 202)
    dragon.wait('dragon', "contact of bench 0 and obstacle 'gate'")
    one = Marker(ns='venue', type=Marker.LINE_LIST, action=Marker.ADD, points=[Point(x=50.0, y=0.0), Point(x=51.0)])
    one.header.frame_id = 'dragon'
    if fault == 'nan':
        one.points[0].y = float('nan')
    one.pose.orientation.x, one.pose.orientation.w = (0.7, 0.7) if fault == 'tilted' else (0.0, 1.0)
    out.publish(MarkerArray(markers=[one]))
    dragon.wait('dragon', '1 obstacle with 1 edge from venue; venue: not used: ')
    dragon.wait('dragon', 'the last valid message stays in use: 1 obstacle with 1 edge from venue')
    dragon.show(203)
    node.until(lambda: len(dragon.health['dragon']) > 3)
    assert not dragon.heard('dragon', 'contact ended')


def test_the_status_names_the_map_in_use_after_one_with_too_many_edges(start, node):
    scene = load_scene('street', ['dragon.benches=5', 'venue=null', 'run.stop_s=20'])
    monitor = start('monitor')
    server, dragon = Map(node), Dragon(node, scene, 'dragon')
    server.show(np.array([[100]]), 0.5, (26.0, -0.25), 0, 'dragon')
    monitor.wait_for('/map: 1 obstacle')
    dragon.show(0)
    dragon.wait('dragon', '1 obstacle with 4 edges from /map')
    server.show(np.indices((500, 500)).sum(axis=0) % 2 * 100, 0.5, (1000.0, 0.0), 0, 'dragon')
    dragon.wait('dragon', '1 obstacle with 4 edges from /map; /map: not used: ')
    dragon.wait('dragon', 'the last valid message stays in use: 1 obstacle with 4 edges from /map')


def test_an_empty_array_of_markers_is_valid(start, node, tmp_path):
    from visualization_msgs.msg import MarkerArray

    from dragon_ros.nodes import qos
    from dragon_ros.nodes.shell import message_type
    scene = load_scene('street', ['dragon.benches=5', 'venue=null', 'run.stop_s=20'])
    monitor, record = start('monitor'), start('record', '--output', 'a.mcap', '--keep-going')
    record.wait_for('recording to')
    node.until(lambda: node.count_subscribers('/dragon/benches') == 2)
    dragon, row, seen = Dragon(node, scene, 'dragon', 'record'), channels()['clearance/stamped'], []
    node.create_subscription(message_type(row.type), '/dragon/clearance/stamped', seen.append, qos.of_channel(row))
    node.until(lambda: node.count_publishers('/dragon/clearance/stamped') == 1)
    dragon.show(0)
    node.until(lambda: seen)
    dragon.out['benches'].publish(MarkerArray())
    dragon.show(1)
    node.until(lambda: len(seen) == 2)
    assert monitor.stop() == 0
    assert 'saw 2 ticks' in monitor.text
    assert 'dropped' not in monitor.text
    record.stop()
    assert 'invalid' not in record.text
    with BagReader(tmp_path / 'a.mcap') as bag:
        assert {topic.name: topic.messages for topic in bag.topics}['/dragon/benches'] == 3
        assert [one.t_ns for one in frames(bag)] == [scene.run.time_ns(k) for k in (0, 1)]
