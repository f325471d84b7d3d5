import pytest

from dragon_ros.core.errors import MissingError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.wire.channels import channels
from dragon_ros.wire.encode import encoders
from dragon_ros.wire.log_read import LogReader
from dragon_ros.wire.log_write import LogWriter, schema_text, type_hash

SCENE = Scene(run=Run(412, 412.5))


def test_channels_carry_what_rosbag2_wants(tmp_path, write_bag):
    from mcap.reader import make_reader
    with write_bag(tmp_path / 'a.mcap').open('rb') as file:
        summary = make_reader(file).get_summary()
        header = make_reader(file).get_header()
    assert header.profile == 'ros2'
    for channel in summary.channels.values():
        assert channel.message_encoding == 'cdr'
        assert channel.metadata['topic_type_hash'].startswith('RIHS01_')
        assert 'reliability: reliable' in channel.metadata['offered_qos_profiles']
        assert summary.schemas[channel.schema_id].encoding == 'ros2msg'


@pytest.mark.parametrize('name', sorted({row.type for row in channels().values()}))
def test_bundled_schemas_and_hashes_are_those_of_the_installed_ros(name):
    pytest.importorskip('ament_index_python')
    import runpy

    from dragon_ros.wire import config
    script = config.folder() / 'schemas' / 'make_schemas.py'
    maker = runpy.run_path(str(script))
    assert schema_text(name) == maker['schema'](name)
    assert type_hash(name) == maker['type_hash'](name)


def test_a_bag_is_never_overwritten_unasked(tmp_path, write_bag):
    path = write_bag(tmp_path / 'a.mcap')
    before = path.read_bytes()
    with pytest.raises(MissingError, match='--force'):
        LogWriter(path)
    assert path.read_bytes() == before
    with pytest.raises(MissingError, match='cannot be written'):
        LogWriter(tmp_path / 'no' / 'folder.mcap')


def test_a_bag_that_replaces_a_larger_one_is_whole(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(bytes(5_000_000))
    encode, frame = encoders(SCENE)['handles'], tick(SCENE, 0)
    with LogWriter(path, overwrite=True) as bag:
        bag.add_channel('/dragon/handles', channels()['handles'])
        bag.write('/dragon/handles', encode(frame), frame.t_ns, 0)
    with LogReader(path) as bag:
        assert [message.data for message in bag.messages()] == [encode(frame)]


def test_two_recorders_never_write_one_file(tmp_path):
    with LogWriter(tmp_path / 'a.mcap'), pytest.raises(MissingError, match='another recorder'):
        LogWriter(tmp_path / 'a.mcap', overwrite=True)


def test_a_full_disk_is_one_clear_error(tmp_path, monkeypatch):
    bag = LogWriter(tmp_path / 'a.mcap')
    bag.add_channel('/dragon/handles', channels()['handles'])

    def full(*_):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(bag._writer, 'add_message', full)
    monkeypatch.setattr(bag._writer, 'finish', full)
    with pytest.raises(MissingError, match='No space left'):
        bag.write('/dragon/handles', b'', 0, 0)
    with pytest.raises(MissingError, match='No space left'):
        bag.close()
    bag.close()
