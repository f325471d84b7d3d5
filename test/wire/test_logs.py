import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.errors import DragonError, InputError, MissingError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.wire.cdr_markers import CubesTemplate
from dragon_ros.wire.cdr_read import Poses
from dragon_ros.wire.channels import channels
from dragon_ros.wire.compare import compare_with_model
from dragon_ros.wire.encode import encoders
from dragon_ros.wire.log import LogReader, LogWriter, schema_text, type_hash
from dragon_ros.wire.pairing import Pairing
from dragon_ros.wire.recording import SimulationClock
from dragon_ros.wire.sights import read_benches

SCENE = Scene(run=Run(412, 412.5))


def write_bag(path, ticks=range(SCENE.last_tick + 1)):
    encode = encoders(SCENE)
    with LogWriter(path) as bag:
        for name, row in channels().items():
            bag.add_channel(f'/dragon/{name}', row)
        for k in ticks:
            frame = tick(SCENE, k)
            for name in encode:
                bag.write(f'/dragon/{name}', encode[name](frame), frame.t_ns, k)
    return path


@pytest.fixture(scope='module')
def bag_bytes(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp('bag') / 'a.mcap').read_bytes()


def test_a_bag_of_the_model_equals_the_model(tmp_path):
    with LogReader(write_bag(tmp_path / 'a.mcap')) as bag:
        result = compare_with_model(bag, SCENE)
        assert bag.start_ns == 412 * 10**9
    assert (result.equal, result.faults) == (3 * 26, [])


def test_a_lost_a_doubled_and_a_strange_tick_are_each_found(tmp_path):
    ticks = [k for k in range(26) if k != 7] + [9]
    with LogReader(write_bag(tmp_path / 'a.mcap', ticks)) as bag:
        faults = [f for f in compare_with_model(bag, SCENE).faults if 'handles' in f]
        assert faults == ['tick 7: handles is missing', 'tick 9: handles is there 2 times']
    with LogReader(write_bag(tmp_path / 'b.mcap')) as bag:
        other = compare_with_model(bag, Scene(run=Run(412, 412.4)))
        assert len(other.faults) == 3 * 5
        assert 'belongs to no tick' in other.faults[0]


def test_channels_carry_what_rosbag2_wants(tmp_path):
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


def test_a_bag_is_never_overwritten_unasked(tmp_path):
    path = write_bag(tmp_path / 'a.mcap')
    before = path.read_bytes()
    with pytest.raises(MissingError, match='--force'):
        LogWriter(path)
    assert path.read_bytes() == before
    with pytest.raises(MissingError, match='cannot be written'):
        LogWriter(tmp_path / 'no' / 'folder.mcap')


@pytest.mark.parametrize('damage', ['empty', 'text', 'truncated', 'magic only', 'no messages'])
def test_a_damaged_bag_is_a_clear_error_naming_the_file(tmp_path, bag_bytes, damage):
    path = tmp_path / 'bad.mcap'
    if damage == 'no messages':
        LogWriter(path).close()
    else:
        path.write_bytes({'empty': b'', 'text': b'hello world, I am not a bag' * 9, 'magic only': bag_bytes[:8],
                          'truncated': bag_bytes[:len(bag_bytes) // 2]}[damage])
    with pytest.raises(InputError, match='bad.mcap'), LogReader(path) as bag:
        list(bag.messages())


def test_a_missing_bag_is_a_clear_error(tmp_path):
    with pytest.raises(MissingError, match='nothing.mcap'):
        LogReader(tmp_path / 'nothing.mcap')


@given(st.booleans(), st.integers(0, 2**20), st.integers(1, 255))
def test_a_flipped_byte_is_noticed_or_harmless(tmp_path_factory, bag_bytes, from_the_end, place, flip):
    path = tmp_path_factory.mktemp('flip') / 'a.mcap'
    at = len(bag_bytes) - 1 - place % 3000 if from_the_end else place % len(bag_bytes)
    path.write_bytes(bag_bytes[:at] + bytes([bag_bytes[at] ^ flip]) + bag_bytes[at + 1:])
    try:
        with LogReader(path) as bag:
            for _ in bag.messages():
                pass
    except DragonError:
        pass


def test_messages_without_a_stamp_get_the_tick_that_was_published_before_them():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[0::2]))
    clock.unstamped('v', b'early', 5, 0)        # of a tick before the first that was seen
    clock.mark(10, 100)
    clock.mark(20, 200)
    clock.unstamped('v', b'1', 12, 1)           # overtaken by the next handles
    clock.unstamped('v', b'2', 22, 2)           # must wait for the next handles
    assert out == [('v', 100)]
    clock.unstamped('v', b'3', 32, 3)           # came before its own handles
    clock.mark(30, 300)
    clock.flush()
    assert out == [('v', 100), ('v', 200), ('v', 300)]


def test_what_comes_long_before_a_run_is_held_in_bounds():
    clock = SimulationClock(lambda *_: None)
    for n in range(5000):
        clock.unstamped('/diagnostics', b'', n, n)
    assert len(clock._held) <= 1000


def poses(t_ns, values=7):
    return Poses(t_ns, 'dragon', np.zeros(values))


def shown(t_ns):
    template = CubesTemplate(np.array([3.41]), 0.3, 'dragon')
    return read_benches(template.encode(t_ns, np.zeros((1, 2)), np.array([[1.0, 0.0]])))


def test_pairs_are_made_by_stamp_and_what_was_overtaken_is_given_up():
    pairs = Pairing()
    assert pairs.add_handles(poses(1), 0.0) is None
    assert pairs.add_handles(second := poses(2), 0.1) is None
    assert pairs.add_benches(benches := shown(2), 0.2) == (second, benches)
    assert pairs.take_unmatched() == [('handles', 1)]
    assert pairs.add_benches(other := shown(3), 0.3) is None
    assert pairs.add_handles(third := poses(3), 0.4) == (third, other)
    assert pairs.take_unmatched() == []


def test_a_run_that_starts_afresh_while_one_topic_lags_costs_no_pair():
    pairs = Pairing()
    for first in (poses(1), poses(2), again := poses(1)):
        pairs.add_handles(first, 0.0)
    found = [pairs.add_benches(shown(t_ns), 0.0) for t_ns in (1, 2, 1)]
    assert [one.t_ns for one, _ in found] == [1, 2, 1]
    assert found[-1][0] is again
    assert pairs.take_unmatched() == []


def test_a_partner_that_does_not_come_in_time_is_given_up_on_both_topics():
    pairs = Pairing()
    pairs.add_handles(poses(1), 10.0)
    pairs.add_benches(shown(2), 11.0)
    pairs.expire(10.5)
    assert pairs.take_unmatched() == [('handles', 1)]
    pairs.expire(11.5)
    assert pairs.take_unmatched() == [('benches', 2)]


def test_waiting_for_partners_is_bounded():
    pairs = Pairing()
    for t_ns in range(300):
        pairs.add_handles(poses(t_ns, 2**20), 0.0)
    assert len(pairs.take_unmatched()) == 300 - 128


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


def test_a_bag_of_another_encoding_is_refused(tmp_path):
    from mcap.writer import Writer
    with (tmp_path / 'j.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel('/x', 'json', writer.register_schema('std_msgs/msg/String', 'ros2msg', b''))
        writer.add_message(channel, 0, b'{}', 0)
        writer.finish()
    with pytest.raises(InputError, match='only cdr'):
        LogReader(tmp_path / 'j.mcap')
