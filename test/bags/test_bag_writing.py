"""Other software can read bags, which are overwritten only on request and remain complete even if the disk fills up."""
import shutil
from contextlib import suppress

import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from properties import thinned
from small_disk import small_disk

from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.read import mcap as reading
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write import writer
from dragon_ros.bags.write.mcap import CHUNK_BYTES, MESSAGE_BYTES
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core import limits
from dragon_ros.core.errors import DiskError, InputError, MissingError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.schemas import schema_text, type_hash

SCENE = Scene(run=Run(412, 412.5))
TOPICS = ['/dragon/handles', '/dragon/benches', '/dragon/velocities']


def fill(bag, ticks=range(compile_scene(SCENE).last_tick + 1)):
    """Write ticks and return the written messages."""
    encode, out = encoders(SCENE), []
    for name in encode:
        bag.add_channel(f'/dragon/{name}', channels()[name])
    for k in ticks:
        frame = tick(SCENE, k)
        for name in encode:
            out.append((f'/dragon/{name}', frame.t_ns, encode[name](frame)))
            bag.write(out[-1][0], out[-1][2], frame.t_ns, k, frame.t_ns + 7)
    return out


def read(path):
    with path.open('rb') as file:
        return [(channel.topic, message.log_time, message.data)
                for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)]


def streamed(path):
    """Return the messages in a file that is still being written."""
    found = []
    with path.open('rb') as file, suppress(EndOfFile):
        for record in StreamReader(file).records:
            found += [record.data] if isinstance(record, Message) else []
    return found


def test_channels_carry_what_rosbag2_wants(tmp_path, write_bag):
    with write_bag(tmp_path / 'a.mcap').open('rb') as file:
        summary = make_reader(file).get_summary()
        header = make_reader(file).get_header()
    assert header.profile == 'ros2'
    assert sorted(channel.topic for channel in summary.channels.values()) == sorted(
        [*TOPICS, '/dragon/scene', '/dragon/track'])
    for channel in summary.channels.values():
        assert channel.message_encoding == 'cdr'
        assert channel.metadata['topic_type_hash'].startswith('RIHS01_')
        assert 'reliability: reliable' in channel.metadata['offered_qos_profiles']
        assert summary.schemas[channel.schema_id].encoding == 'ros2msg'


@pytest.mark.parametrize('name', sorted({row.type for row in channels().values()}))
def test_bundled_schemas_and_hashes_are_those_of_the_installed_ros(name):
    pytest.importorskip('ament_index_python')
    import runpy

    from dragon_ros import configuration
    script = configuration.folder() / 'schemas' / 'make_schemas.py'
    maker = runpy.run_path(str(script))
    assert schema_text(name) == maker['schema'](name)
    assert type_hash(name) == maker['type_hash'](name)


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_what_is_written_is_read_by_the_library_with_times_and_sequence(tmp_path, compression):
    with BagWriter(tmp_path / 'a.mcap', options=BagOptions(compression=compression)) as bag:
        written = fill(bag)
    assert read(tmp_path / 'a.mcap') == written
    assert bag.kept == len(written)
    with (tmp_path / 'a.mcap').open('rb') as file:
        reader = make_reader(file)
        messages, summary = [message for _, _, message in reader.iter_messages()], reader.get_summary()
    assert all(message.publish_time == message.log_time + 7 for message in messages)
    assert sorted(message.sequence for message in messages) == sorted(3 * list(range(26)))
    assert {chunk.compression for chunk in summary.chunk_indexes} == {compression.replace('none', '')}
    assert summary.statistics.message_count == 3 * 26
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (412 * 10**9, 4125 * 10**8)


def test_the_same_messages_make_the_same_file(tmp_path, write_bag):
    assert write_bag(tmp_path / 'a.mcap').read_bytes() == write_bag(tmp_path / 'b.mcap').read_bytes()


@pytest.mark.parametrize(('options', 'files'), [({}, 1), ({'split_size_mb': 0.5}, 4), ({'split_duration_s': 0.2}, 3)])
def test_a_directory_is_a_rosbag2_bag_split_as_asked(tmp_path, options, files):
    with BagWriter(tmp_path / 'run', options=BagOptions(compression='none', **options)) as bag:
        bag.describe('dragon_ros', {'scene': 'x'})
        bag.attach('scene.yaml', 'application/yaml', b'x')
        written = fill(bag)
    info = yaml.safe_load((tmp_path / 'run' / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert info['relative_file_paths'] == [f'run_{k}.mcap' for k in range(files)]
    assert info['message_count'] == len(written) == sum(row['message_count'] for row in info['files'])
    assert info['duration'] == {'nanoseconds': 5 * 10**8}
    paths = [tmp_path / 'run' / name for name in info['relative_file_paths']]
    assert [message for path in paths for message in read(path)] == written
    for path in paths:
        with path.open('rb') as file:
            reader = make_reader(file)
            assert [row.data for row in reader.iter_attachments()] == [b'x']
            assert [row.metadata for row in reader.iter_metadata()] == [{'scene': 'x'}]
        if 'split_size_mb' in options:
            assert path.stat().st_size < 0.6e6


def test_one_file_cannot_be_split(tmp_path):
    with pytest.raises(InputError, match='give a directory'):
        BagWriter(tmp_path / 'a.mcap', options=BagOptions(split_size_mb=1))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('options', [{'compression': 'zip'}, {'split_size_mb': 0}, {'max_size_mb': -1.0},
                                     {'split_duration_s': float('nan')}])
def test_options_that_make_no_sense_are_refused(options):
    with pytest.raises(InputError, match=next(iter(options))):
        BagOptions(**options)


def test_a_bag_is_never_overwritten_unasked(tmp_path, write_bag):
    path = write_bag(tmp_path / 'a.mcap')
    before = path.read_bytes()
    with pytest.raises(MissingError, match='--force'):
        BagWriter(path)
    assert path.read_bytes() == before
    with pytest.raises(MissingError, match='cannot be written'):
        BagWriter(tmp_path / 'no' / 'folder.mcap')


def test_a_directory_is_replaced_only_on_request_and_only_the_files_of_the_bag(tmp_path):
    options = BagOptions(compression='none', split_size_mb=0.5)
    with BagWriter(tmp_path / 'run', options=options) as bag:
        fill(bag)
    (tmp_path / 'run' / 'notes.txt').write_text('mine')
    with pytest.raises(MissingError, match='--force'):
        BagWriter(tmp_path / 'run')
    with BagWriter(tmp_path / 'run', overwrite=True) as bag:
        fill(bag, range(2))
    assert sorted(path.name for path in (tmp_path / 'run').iterdir()) == ['metadata.yaml', 'notes.txt', 'run_0.mcap']


def test_a_read_only_file_is_not_replaced(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(b'precious')
    path.chmod(0o444)
    with pytest.raises(MissingError, match='read-only|cannot be written'):
        BagWriter(path, overwrite=True)
    assert path.read_bytes() == b'precious'


def test_a_bag_that_replaces_a_larger_one_is_whole(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(bytes(5_000_000))
    with BagWriter(path, overwrite=True) as bag:
        written = fill(bag, [0])
    with BagReader(path) as bag:
        assert sorted(message.data for message in bag.messages()) == sorted(data for *_, data in written)


def test_two_recorders_never_write_one_file(tmp_path):
    with BagWriter(tmp_path / 'a.mcap'), pytest.raises(MissingError, match='another recorder'):
        BagWriter(tmp_path / 'a.mcap', overwrite=True)


def test_what_was_flushed_can_be_read_by_the_librarys_stream_reader_before_the_end(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as bag:
        written = fill(bag, range(9))
        bag.flush()
        fill(bag, range(9, 12))
        assert streamed(tmp_path / 'a.mcap') == [data for *_, data in written]


def test_a_bag_has_the_same_bytes_with_a_thread_for_its_chunks_and_without(tmp_path):
    for name, threaded in (('a.mcap', True), ('b.mcap', False)):
        with BagWriter(tmp_path / name, threaded=threaded) as bag:
            fill(bag)
            bag.flush()
            fill(bag)
    assert (tmp_path / 'a.mcap').read_bytes() == (tmp_path / 'b.mcap').read_bytes()
    with (tmp_path / 'a.mcap').open('rb') as file:
        assert len(make_reader(file).get_summary().chunk_indexes) > 3


# Three ticks of raw messages take 240 kB, including the index.
@pytest.mark.parametrize(('size', 'compression', 'threaded'), thinned([
    (size, compression, threaded) for size in range(90_000, 300_000, 14_003) for compression in ('none', 'zstd')
    for threaded in (True, False)], lambda case: case[0] in (90_000, 160_015, 286_027)))
def test_a_full_disk_leaves_a_valid_file_with_what_fitted(tmp_path, size, compression, threaded):
    with small_disk(size):
        bag = BagWriter(tmp_path / 'a.mcap', options=BagOptions(compression=compression), threaded=threaded)
        written, errors = [], []
        try:
            for k in range(26):
                written += fill(bag, [k])
                bag.flush()
        except DiskError as error:
            errors.append(str(error))
        try:
            bag.close()
        except DiskError as error:
            errors.append(str(error))
    kept = read(tmp_path / 'a.mcap')
    assert kept == written[:len(kept)]
    assert len(kept) == bag.kept
    assert (bag.kept < 78) == bool(errors)
    assert all('a.mcap: cannot be continued: File too large' in error for error in errors)
    assert (tmp_path / 'a.mcap').stat().st_size <= size
    bag.close()


@pytest.mark.parametrize('then', [
    lambda bag: bag.write('/x', bytes(CHUNK_BYTES), 3, 3), lambda bag: bag.write('/y', b'y', 3, 3), BagWriter.flush,
    lambda bag: bag.describe('a', {}), lambda bag: bag.attach('a', 'text/plain', b''), BagWriter.close],
    ids=['full chunk', 'new topic', 'flush', 'metadata', 'attachment', 'close'])
def test_nothing_follows_a_chunk_that_was_lost(tmp_path, then):
    bag = BagWriter(tmp_path / 'a.mcap', options=BagOptions('none'))
    for topic in ('/x', '/y'):
        bag.add_channel(topic, channels()['clearance'])
    bag.write('/x', b'kept', 0, 0)
    bag.flush()
    with small_disk(100_000):
        bag.write('/x', bytes(CHUNK_BYTES), 1, 1)
        bag.write('/x', b'would fit', 2, 2)
        with pytest.raises(DiskError, match='File too large'):
            then(bag)
        bag.close()
    assert read(tmp_path / 'a.mcap') == [('/x', 0, b'kept')]


@pytest.mark.parametrize('where', ['a.mcap', 'a'])
@pytest.mark.parametrize('limit', [0.3, 1.0])
def test_a_bag_never_becomes_larger_than_its_limit(tmp_path, where, limit):
    bag = BagWriter(tmp_path / where, options=BagOptions(compression='none', max_size_mb=limit))
    with pytest.raises(DiskError, match=f'limit of {limit:g} MB'):
        fill(bag)
    bag.close()
    paths = [tmp_path / where] if where == 'a.mcap' else [*(tmp_path / where).iterdir()]
    assert 0.1e6 < sum(path.stat().st_size for path in paths) <= limit * 1e6
    assert sum(len(read(path)) for path in paths if path.suffix == '.mcap') == bag.kept > 0


def test_without_a_thread_a_chunk_that_is_lost_is_known_at_once(tmp_path):
    with small_disk(100_000):
        bag = BagWriter(tmp_path / 'a.mcap', options=BagOptions('none'), threaded=False)
        bag.add_channel('/x', channels()['clearance'])
        bag.write('/x', b'kept', 0, 0)
        bag.flush()
        with pytest.raises(DiskError, match='File too large'):
            bag.write('/x', bytes(CHUNK_BYTES), 1, 1)
        bag.close()
    assert read(tmp_path / 'a.mcap') == [('/x', 0, b'kept')]


def begun_in_parts(folder, parts=3):
    """Return a bag whose folder contains several parts, each with one small message."""
    bag = BagWriter(folder, options=BagOptions('none', split_duration_s=1e-9))
    bag.add_channel('/x', channels()['clearance'])
    for k in range(parts):
        bag.write('/x', bytes(12), k, k + 1)
        bag.flush()
    return bag


def ended(bag):
    """Finish a bag as a recorder does after an error, and return the error messages."""
    errors = []
    for act in (lambda: bag.describe('account', {'complete': 'false'}), lambda: bag.attach('a', 'text/plain', b'a'),
                bag.flush, bag.close, bag.close):
        try:
            act()
        except DiskError as error:
            errors.append(str(error))
    return errors


def test_where_the_disk_is_full_between_two_parts_all_parts_are_whole_and_listed(tmp_path):
    bag = begun_in_parts(tmp_path / 'run')
    with small_disk(30_000):        # a part fits on the disk, but the next metadata.yaml does not
        with pytest.raises(DiskError, match='no further part can begin: File too large'):
            bag.write('/x', bytes(12), 9, 9)
        assert all('no further part can begin' in error for error in ended(bag))
    assert bag.kept == 3
    assert sorted(path.name for path in (tmp_path / 'run').iterdir()) == ['metadata.yaml', *(
        f'run_{k}.mcap' for k in range(3))]
    found = examine(tmp_path / 'run')
    assert (found.topics['/x'].messages, found.problems.lines) == (3, [])


@pytest.mark.parametrize('name', ['run', 'run.mcap'])
def test_a_bag_that_cannot_begin_on_a_full_disk_leaves_nothing_so_that_it_can_begin_later(tmp_path, name):
    with small_disk(10), pytest.raises(DiskError, match='File too large'):
        BagWriter(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
    BagWriter(tmp_path / name).close()


@pytest.mark.parametrize('moved', [True, False])
@pytest.mark.parametrize('flushed', [True, False])
def test_a_folder_that_vanishes_between_two_parts_is_noticed_in_words(tmp_path, moved, flushed):
    bag = begun_in_parts(tmp_path / 'run')
    if not flushed:
        bag.write('/x', bytes(12), 2, 4)
    if moved:
        (tmp_path / 'run').rename(tmp_path / 'elsewhere')
    else:
        shutil.rmtree(tmp_path / 'run')
    with pytest.raises(DiskError, match='no longer exists; it was moved or removed during recording'):
        bag.write('/x', bytes(12), 9, 9)
    errors = ended(bag)
    assert errors
    assert all('no longer exists' in error for error in errors)


@pytest.mark.parametrize('left', [0, 30, 700, 2000])
def test_a_file_that_is_truncated_during_recording_is_noticed_and_ends_whole(tmp_path, left):
    path = tmp_path / 'a.mcap'
    bag = BagWriter(path, options=BagOptions('none'))
    bag.add_channel('/x', channels()['scene'])
    for k in range(20):
        bag.write('/x', string_message('x' * 91), k, k + 1)
        bag.flush()
    with path.open('r+b') as file:
        file.truncate(left)
    bag.write('/x', string_message('x' * 91), 20, 21)
    with pytest.raises(DiskError, match=f'truncated to {left} bytes by another program'):
        bag.flush()
    bag.close()
    found = examine(path)
    assert not found.problems.count
    assert [row.messages for row in found.topics.values()] == [bag.kept] * bool(bag.kept)
    assert bag.kept == (0 if left < 2000 else 5)


@pytest.mark.parametrize('folder', [True, False])
def test_what_is_being_recorded_is_not_replaced_even_on_request(tmp_path, folder):
    path = tmp_path / ('run' if folder else 'a.mcap')
    with BagWriter(path) as bag:
        bag.add_channel('/x', channels()['clearance'])
        bag.write('/x', bytes(12), 0, 1)
        bag.flush()
        with pytest.raises(MissingError, match='another recorder is writing it'):
            BagWriter(path, overwrite=True)
    with BagReader(path) as reader:
        assert len(list(reader.messages())) == 1


@pytest.mark.parametrize('killed', [True, False])
@pytest.mark.parametrize('folder', [True, False])
def test_a_bag_without_messages_gives_way_to_the_next_one(tmp_path, folder, killed):
    path = tmp_path / ('run' if folder else 'a.mcap')
    first = BagWriter(path)
    first.describe('account', {'complete': 'true'})
    first.close()
    if killed:      # the file has a header but no end
        file = path / 'run_0.mcap' if folder else path
        file.write_bytes(file.read_bytes()[:40])
    with BagWriter(path) as bag:
        written = fill(bag, [0])
    with BagReader(path) as reader:
        assert len(list(reader.messages())) == len(written)
    with pytest.raises(MissingError, match='--force'):
        BagWriter(path)


def test_a_message_that_no_reader_takes_is_left_out_and_counted_and_all_others_are_read(tmp_path, monkeypatch):
    for module in (limits, reading):
        monkeypatch.setattr(module, 'CHUNK_BYTES', 3000)
    monkeypatch.setattr(writer, 'MESSAGE_BYTES', 3000 - 31)
    sizes = [100, 2969, 2970, 100, 2900, 100]
    with BagWriter(tmp_path / 'a.mcap', options=BagOptions('none')) as bag:
        bag.add_channel('/x', channels()['clearance'])
        for k, size in enumerate(sizes):
            bag.write('/x', bytes(size), k, k + 1)
    assert (bag.left_out, bag.kept) == ({'/x': 1}, 5)
    with BagReader(tmp_path / 'a.mcap') as reader:
        assert [len(message.data) for message in reader.messages()] == [100, 2969, 100, 2900, 100]
    assert MESSAGE_BYTES == 128 * 2**20 - 31


@pytest.mark.parametrize('remove', [True, False])
@pytest.mark.parametrize('threaded', [True, False])
def test_a_bag_that_vanishes_is_noticed(tmp_path, remove, threaded):
    bag = BagWriter(tmp_path / 'a.mcap', threaded=threaded)
    fill(bag, [0])
    bag.flush()
    if remove:
        (tmp_path / 'a.mcap').unlink()
    else:
        (tmp_path / 'a.mcap').rename(tmp_path / 'b.mcap')
    fill(bag, [1])
    with pytest.raises(DiskError, match='no longer exists'):
        bag.flush()
    bag.close()
    assert remove or len(read(tmp_path / 'b.mcap')) == 6
