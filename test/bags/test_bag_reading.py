"""Bags in folders, bags with gaps or messages out of order, the frames of bags, and untrusted YAML."""
from array import array
from io import BytesIO

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from dragon_ros.bags.check.examine import examine, gaps_of
from dragon_ros.bags.check.repair import repair
from dragon_ros.bags.read import reader
from dragon_ros.bags.read.frames import frames, namespace_of, scene_of_bag
from dragon_ros.bags.read.reader import BagError, BagReader, qos_of
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.load import scene_values
from dragon_ros.scenes.yaml import parse_document

SCENE = Scene(run=Run(412, 412.5))


def write(path, times, options=None, chunk=3):
    """Write the handles of these ticks in this order, ``chunk`` ticks per chunk; return each tick's (time, number)."""
    encode, out = encoders(SCENE)['handles'], []
    with BagWriter(path, options=options) as bag:
        bag.add_channel('/dragon/handles', channels()['handles'])
        for n, k in enumerate(times):
            frame = tick(SCENE, k)
            bag.write('/dragon/handles', encode(frame), frame.t_ns, n)
            out.append((frame.t_ns, n))
            if n % chunk == chunk - 1:
                bag.flush()
    return out


def read(path, **window):
    with BagReader(path) as bag:
        return [(m.t_ns, m.sequence) for m in bag.messages(**window)]


@given(st.lists(st.integers(0, 25), min_size=1, max_size=30), st.integers(1, 8))
def test_messages_come_by_time_and_then_by_place_however_chunks_overlap(tmp_path_factory, times, chunk):
    path = tmp_path_factory.mktemp('order') / 'a.mcap'
    written = write(path, times, chunk=chunk)
    assert read(path) == sorted(written, key=lambda row: row[0])
    start, end = 412_100_000_000, 412_300_000_000
    inside = [row for row in sorted(written, key=lambda row: row[0]) if start <= row[0] < end]
    assert read(path, start_ns=start, end_ns=end) == inside


def test_order_holds_where_chunks_are_closed_and_opened_again(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, 'OPEN_CHUNKS_BYTES', 1)
    written = write(tmp_path / 'a.mcap', [*range(0, 26, 2), *range(1, 26, 2)], chunk=13)
    assert read(tmp_path / 'a.mcap') == sorted(written)


def test_a_split_folder_reads_as_one_bag_with_and_without_its_metadata(tmp_path):
    written = write(tmp_path / 'run', range(26), BagOptions(compression='none', split_duration_s=0.1))
    assert len(list((tmp_path / 'run').glob('*.mcap'))) > 3
    assert read(tmp_path / 'run') == read(tmp_path / 'run' / 'metadata.yaml') == written
    with BagReader(tmp_path / 'run') as bag:
        assert [topic.messages for topic in bag.topics] == [26]
        assert (bag.start_ns, bag.end_ns) == (412 * 10**9, 412_500_000_000)
    (tmp_path / 'run' / 'metadata.yaml').unlink()
    assert read(tmp_path / 'run') == written
    assert not examine(tmp_path / 'run').problems.count


def unlist_last(folder):
    """Leave the last part of a split bag unlisted, as a killed recorder does, and return that part."""
    info = yaml.safe_load((folder / 'metadata.yaml').read_text())
    last = info['rosbag2_bagfile_information']['relative_file_paths'].pop()
    (folder / 'metadata.yaml').write_text(yaml.safe_dump(info))
    return folder / last


@pytest.mark.parametrize('compression', ['none', 'zstd', 'lz4'])
def test_a_part_that_is_not_listed_belongs_to_the_bag_and_inspect_names_it(tmp_path, compression):
    written = write(tmp_path / 'run', range(26), BagOptions(compression, split_duration_s=0.1))
    last = unlist_last(tmp_path / 'run')
    repair(tmp_path / 'run', tmp_path / 'run' / 'whole.mcap')       # in the folder, but not part of the bag
    assert read(tmp_path / 'run') == read(tmp_path / 'run' / 'whole.mcap') == written
    (problem,) = examine(tmp_path / 'run').problems.lines
    assert problem.startswith(f'{last}: is not listed in metadata.yaml')
    assert '--repair OUT' in problem


@pytest.mark.parametrize('left', [0, 5, 60, 0.5, -1])
def test_a_part_that_is_not_listed_and_cut_anywhere_is_named_and_saved(tmp_path, left):
    written = write(tmp_path / 'run', range(26), BagOptions('none', split_duration_s=0.1), chunk=2)
    last = unlist_last(tmp_path / 'run')
    data = last.read_bytes()
    last.write_bytes(data[:int(left * len(data)) if isinstance(left, float) else left])
    with pytest.raises(BagError, match=f'{last.name}.* --repair OUT'):
        read(tmp_path / 'run')
    assert any(line.startswith(f'{last}: is') for line in examine(tmp_path / 'run').problems.lines)
    saved = repair(tmp_path / 'run', tmp_path / 'whole.mcap')
    assert saved.lost.count or left == -1       # -1 cuts off only the last byte of the closing magic
    kept = read(tmp_path / 'whole.mcap')
    assert kept == written[:len(kept)]
    assert len(kept) >= (26 if left == -1 else 20)


@pytest.mark.parametrize(('text', 'says'), [
    ('rosbag2_bagfile_information: {relative_file_paths: [a.mcap, b.mcap, a.mcap]}', 'lists a.mcap 2 times'),
    ('', 'relative_file_paths'), ('a: [', 'not YAML'), ('rosbag2_bagfile_information: 3', 'relative_file_paths'),
    ('rosbag2_bagfile_information: {relative_file_paths: [gone.mcap]}', 'does not exist'),
    ('rosbag2_bagfile_information: {relative_file_paths: [../a.mcap]}', 'in its folder'),
    ('rosbag2_bagfile_information: {relative_file_paths: [a.db3]}', 'names of .mcap files'),
    ('rosbag2_bagfile_information: {relative_file_paths: []}', 'without .mcap files')])
def test_a_folder_with_bad_metadata_is_refused(tmp_path, text, says):
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(InputError, match=says):
        BagReader(tmp_path)


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path):
    import os
    os.mkfifo(tmp_path / 'pipe.mcap')
    with pytest.raises(MissingError, match='is not a file'):
        BagReader(tmp_path / 'pipe.mcap')


def test_a_bag_of_one_message_at_time_zero_is_a_bag(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as bag:
        bag.add_channel('/x', channels()['clearance'])
        bag.write('/x', bytes(12), 0, 1)
    assert read(tmp_path / 'a.mcap') == [(0, 1)]
    with BagReader(tmp_path / 'a.mcap') as bag:
        assert (bag.start_ns, bag.end_ns) == (0, 0)


def test_frames_are_the_model_and_know_their_clearance(tmp_path, write_bag):
    with BagReader(write_bag(tmp_path / 'a.mcap')) as bag:
        seen = list(frames(bag))
        later = list(frames(bag, start_ns=412_400_000_000))
    for k, frame in enumerate(seen):
        model = tick(SCENE, k)
        assert frame.t_ns == model.t_ns
        assert np.array_equal(frame.handles_m, model.chain.p)
        assert np.array_equal(frame.velocity_m_s, model.velocity_m_s)
        assert np.array_equal(frame.benches.centre, model.benches.centre)
    assert seen[23].clearance_m > 0 > seen[24].clearance_m
    assert [frame.t_ns for frame in later] == [frame.t_ns for frame in seen[20:]]


def test_frames_without_benches_or_velocities_say_so(tmp_path):
    write(tmp_path / 'a.mcap', range(3))
    with BagReader(tmp_path / 'a.mcap') as bag:
        assert [(f.benches, f.velocity_m_s, f.clearance_m) for f in frames(bag)] == [(None, None, None)] * 3


def another_recorder(delays):
    """Return a bag that logs each message a few nanoseconds after its stamp, as rosbag2 does."""
    out, encode = BytesIO(), encoders(SCENE)
    writer = Writer(out, compression=CompressionType.NONE)
    writer.start('ros2')
    rows = []
    for name, delay in delays.items():
        schema = writer.register_schema(channels()[name].type, 'ros2msg', b'')
        channel = writer.register_channel(f'/robot/{name}', 'cdr', schema)
        frames_ = (tick(SCENE, k) for k in range(26))
        rows += [(frame.t_ns + delay + 10**15, channel, encode[name](frame)) for frame in frames_]
    for t_ns, channel, data in sorted(rows):
        writer.add_message(channel, t_ns, data, t_ns)
    writer.finish()
    return out.getvalue()


@pytest.mark.parametrize('delays', [{'handles': 5, 'benches': 70_000_000}, {'benches': 5, 'handles': 70_000_000}])
def test_another_recorders_bag_is_paired_by_stamps(tmp_path, delays):
    path = tmp_path / 'other.mcap'
    path.write_bytes(another_recorder(delays))
    with BagReader(path) as bag:
        assert {namespace_of(bag, asked) for asked in (None, 'robot', '/robot', '/robot/')} == {'/robot'}
        assert scene_of_bag(bag) is None
        seen = list(frames(bag))
    assert [frame.t_ns for frame in seen] == [SCENE.run.time_ns(k) for k in range(26)]
    assert all(frame.benches is not None for frame in seen)


def test_handles_whose_benches_are_missing_are_frames_without_benches(tmp_path, write_bag):
    with BagReader(write_bag(tmp_path / 'a.mcap')) as bag:
        rows = list(bag.messages())
    with BagWriter(tmp_path / 'b.mcap') as out:
        for name, row in channels().items():
            out.add_channel(f'/dragon/{name}', row)
        for m in rows:
            if not (m.topic == '/dragon/benches' and m.sequence in (4, 5)):
                out.write(m.topic, m.data, m.t_ns, m.sequence)
    with BagReader(tmp_path / 'b.mcap') as bag:
        seen = list(frames(bag))
    assert [k for k, frame in enumerate(seen) if frame.benches is None] == [4, 5]
    assert len(seen) == 26


@pytest.mark.parametrize(('ticks', 'missing', 'doubled', 'ranges'), [
    (range(50), 0, 0, ()), ([*range(10), *range(12, 50)], 2, 0, ((10, 11),)),
    ([*range(50), 7, 7], 0, 2, ()), ([*range(30), *range(31, 50), 0], 1, 1, ((30, 30),))])
@pytest.mark.parametrize('rate_hz', [50.0, 30.0, 1000.0, 1 / 3])
@pytest.mark.parametrize('known', [True, False])
def test_gaps_and_doubles_are_counted_at_any_rate(ticks, missing, doubled, ranges, rate_hz, known):
    run = Run(10, None, rate_hz)
    gaps = gaps_of(array('Q', [run.time_ns(k) for k in ticks]), run if known else None)
    assert (gaps.missing, gaps.doubled, gaps.ranges) == (missing, doubled, ranges)
    assert (gaps.first, gaps.last) == (0, 49)


def test_what_comes_at_no_regular_times_has_no_gaps():
    assert gaps_of(array('Q', [1, 5, 6, 100, 1000]), None).missing is None
    assert gaps_of(array('Q'), None).rate_hz is None


def laughs(levels):
    """Return YAML whose aliases expand to 9^levels values."""
    lines = ['a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]']
    lines += [f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, levels)]
    return '\n'.join(lines)


@pytest.mark.parametrize('text', [laughs(12), 'a: &a [*a]', 'a: &a {b: *a}', '[' * 5000,
                                  'a0: &a0 {x: 1}\n' + '\n'.join(f'a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}'
                                                                 for n in range(1, 40))])
def test_yaml_that_makes_much_out_of_little_is_refused(text):
    with pytest.raises(InputError, match='scene'):
        parse_document('scene', text)
    assert qos_of({'offered_qos_profiles': text}) == {}


def test_yaml_with_a_few_aliases_is_read():
    assert parse_document('x', 'a: &a {b: 1}\nc: *a').values == {'a': {'b': 1}, 'c': {'b': 1}}


@pytest.mark.parametrize(('scene', 'says'), [
    ('dragon: {benches: 0}', 'dragon.benches'), ('nonsense: 3', 'nonsense'), ('x' * 10**5, 'characters'),
    ('dragon: {benches: 1.0e+300}', 'dragon.benches'), ('- 1', 'not a mapping')])
def test_a_bad_scene_in_a_bag_is_refused_in_words_that_name_bag_and_key(tmp_path, scene, says):
    path = tmp_path / 'a.mcap'
    with BagWriter(path) as bag:
        bag.describe('dragon_ros', {'scene': scene})
        bag.add_channel('/x', channels()['clearance'])
        bag.write('/x', bytes(12), 1, 1)
    with BagReader(path) as bag, pytest.raises(InputError, match=says) as caught:
        scene_of_bag(bag)
    assert 'a.mcap' in str(caught.value)


def test_the_scene_of_a_bag_is_read_from_its_attachment_where_there_is_no_metadata(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as bag:
        bag.attach('scene.yaml', 'application/yaml', yaml.safe_dump(scene_values(SCENE)).encode())
        bag.add_channel('/x', channels()['clearance'])
        bag.write('/x', bytes(12), 1, 1)
    with BagReader(tmp_path / 'a.mcap') as bag:
        assert scene_of_bag(bag) == SCENE
        assert yaml.safe_load(bag.attachment('scene.yaml'))['run']['start_s'] == 412
