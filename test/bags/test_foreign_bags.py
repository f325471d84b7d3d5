"""Bags written by other libraries are read if possible, and otherwise rejected without a traceback."""
import pytest

from dragon_ros.__main__ import main
from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.read.frames import frames, namespace_of
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.errors import InputError

TIMES = [3, 1, 2]


def robot_of_mcap_ros2(path):
    """Write strings and points with mcap-ros2-support."""
    Writer = pytest.importorskip('mcap_ros2.writer').Writer
    with path.open('wb') as file:
        writer = Writer(file)
        text = writer.register_msgdef('std_msgs/msg/String', 'string data')
        point = writer.register_msgdef('geometry_msgs/msg/Point', 'float64 x\nfloat64 y\nfloat64 z')
        for t_ns in TIMES:
            writer.write_message('/chatter', text, {'data': f'at {t_ns}'}, t_ns, t_ns)
            writer.write_message('/where', point, {'x': 1.0, 'y': 2.0, 'z': t_ns}, t_ns, t_ns)
        writer.finish()
    return path


def robot_of_rosbags(path, compression=None, storage='MCAP'):
    """Write strings with rosbags, as a rosbag2 folder."""
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_JAZZY)
    String = store.types['std_msgs/msg/String']
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
    if compression:
        writer.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection('/chatter', String.__msgtype__, typestore=store)
        for t_ns in TIMES:
            writer.write(connection, t_ns, store.serialize_cdr(String(f'at {t_ns}'), String.__msgtype__))
    return path


@pytest.mark.parametrize('make', [robot_of_mcap_ros2, robot_of_rosbags,
                                  lambda path: robot_of_rosbags(path, 'STORAGE')],
                         ids=['mcap-ros2-support', 'rosbags', 'rosbags compressed'])
def test_the_bag_of_another_robot_is_read_and_reported_to_hold_no_dragon(tmp_path, capsys, make):
    path = make(tmp_path / 'robot.mcap')
    with BagReader(path) as bag:
        chatter = [(m.t_ns, m.data[8:12]) for m in bag.messages(['/chatter'])]
        with pytest.raises(InputError, match='no dragon'):
            namespace_of(bag)
        with pytest.raises(InputError, match='no dragon'):
            next(frames(bag))
    assert chatter == [(1, b'at 1'), (2, b'at 2'), (3, b'at 3')]
    assert not examine(path).problems.count
    assert main(['inspect', str(path)]) == 0
    out = capsys.readouterr().out
    assert 'std_msgs/msg/String' in out
    assert 'lengths: 3 messages were compared with their types' in out
    assert ('3 of /where (the schema of geometry_msgs/msg/Point is not known here)' in out) == (
        make is robot_of_mcap_ros2)


@pytest.mark.parametrize(('options', 'says'), [
    ({'compression': 'FILE'}, 'names of .mcap files'), ({'compression': 'MESSAGE'}, 'compressed individually'),
    ({'storage': 'SQLITE3'}, 'names of .mcap files')])
def test_rosbag2_folders_without_plain_mcap_are_refused_in_words(tmp_path, options, says):
    path = robot_of_rosbags(tmp_path / 'robot', **options)
    with pytest.raises(InputError, match=says):
        BagReader(path)
