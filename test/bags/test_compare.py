"""A bag is compared with the model tick by tick, including the contact frame with which a run may end."""
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples
from recorded import introduce

from dragon_ros.bags.check import compare
from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.frames import law_on
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.record.loss_accounting import RECEIVED
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import contact_frame, led_tick, tick, ticks_before
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import decode, read_pose_array
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.latched import latched_messages
from dragon_ros.messages.markers import track_marker
from dragon_ros.scenes.load import load_scene
from dragon_ros.scenes.provenance import run_metadata, scene_file

SCENE = Scene(run=Run(412, 412.5))


def test_a_bag_of_the_model_equals_the_model(tmp_path, write_bag):
    with BagReader(write_bag(tmp_path / 'a.mcap')) as bag:
        result = compare_with_model(bag, SCENE)
        assert bag.start_ns == 412 * 10**9
    assert (result.equal, result.faults) == (3 * 26, [])


def test_a_lost_a_doubled_and_a_strange_tick_are_each_found(tmp_path, write_bag):
    ticks = [k for k in range(26) if k != 7] + [9]
    with BagReader(write_bag(tmp_path / 'a.mcap', ticks)) as bag:
        found = compare_with_model(bag, SCENE)
        faults = [f for f in found.faults if 'handles' in f]
        # Each of the 78 messages is counted.
        assert (found.equal, found.fault_count - found.missing_count) == (3 * 24, 3 * 2)
        assert faults == ['tick 7: handles is missing', 'tick 9: handles occurs 2 times']
    with BagReader(write_bag(tmp_path / 'b.mcap')) as bag:
        other = compare_with_model(bag, Scene(run=Run(412, 412.4)))
        assert len(other.faults) == 3 * 5 + 1       # the track, too, is that of another run
        assert 'belongs to no tick' in other.faults[0]


SHORT = Scene(dragon=Dragon(4), run=Run(412, 412.5))
FAULTS = st.sampled_from(['', '', '', 'lost', 'one lost', 'doubled', 'changed', 'slightly changed', 'stray'])


def write_faulty(path, faults):
    """Write a bag of ``SHORT``; each tick has one of ``FAULTS``."""
    encode = encoders(SHORT)
    with BagWriter(path) as bag:
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        introduce(bag, SHORT)
        for k, fault in enumerate(faults):
            frame = tick(SHORT, k)
            for name in () if fault == 'lost' else encode:
                data = bytearray(encode[name](frame))
                if name == 'handles' and fault in ('changed', 'slightly changed'):
                    read_pose_array(data).poses[0, 0] += 1.0 if fault == 'changed' else 1e-15
                for _ in range((fault == 'doubled') + (fault != 'one lost' or name != 'benches')):
                    bag.write(f'/dragon/{name}', bytes(data), frame.t_ns + 7 * (fault == 'stray'), k)
    return path


@examples(10)
@given(faults=st.lists(FAULTS, max_size=25).map(lambda faults: ['', *faults]))
@example(faults=['', 'stray', '', 'lost', '', 'doubled', 'one lost', '', 'changed', 'slightly changed', ''])
def test_ticks_that_are_compared_together_give_the_result_of_single_ones(tmp_path_factory, faults):
    with BagReader(write_faulty(tmp_path_factory.mktemp('faulty') / 'a.mcap', faults)) as bag:
        together = compare_with_model(bag, SHORT)
        with patch.object(compare, '_TOGETHER_BYTES', 1):
            assert compare_with_model(bag, SHORT) == together
        with patch.object(compare, '_PART_BYTES', 1):
            parts = compare_with_model(bag, SHORT)
    assert (sorted(parts.faults), parts.notes, parts.fault_count, parts.missing_count, parts.equal) == (
        sorted(together.faults), together.notes, together.fault_count, together.missing_count, together.equal)
    last = max(k for k, fault in enumerate(faults) if fault not in ('lost', 'stray'))
    wanted = {'one lost': 1, 'doubled': 6, 'changed': 1, 'slightly changed': 1, 'stray': 3}
    missing = sum(fault in ('lost', 'stray') for fault in faults[:last])
    assert together.fault_count == sum(wanted.get(fault, 0) for fault in faults) + 3 * missing
    assert together.notes == ([] if last == 25 else [
        f'the recording ends at tick {last} of 0 to 25 ({SHORT.run.time_ns(last) / 1e9:.9f} s)'])


def test_ticks_are_compared_together_in_groups_of_a_mebibyte_and_at_most_one_tick_more(tmp_path, write_bag):
    """A bag with wall-clock log times is a single part, so only the groups bound the memory of its comparison."""
    sizes, compare_ticks = [], compare._compare_ticks

    def measured(result, scene, encode, compared):
        sizes.append([sum(len(data) for found in recorded.values() for data in found) for _, _, recorded in compared])
        compare_ticks(result, scene, encode, compared)
    with patch.object(compare, '_compare_ticks', measured), BagReader(write_bag(tmp_path / 'a.mcap')) as bag:
        assert compare_with_model(bag, SCENE).equal == 3 * 26
    *groups, rest = sizes
    assert groups
    for group in groups:
        assert sum(group[:-1]) < 2**20 <= sum(group)
    assert sum(rest) < 2**20


EVERYTHING = Scene(run=Run(412.4, 412.6), effects=~Effect.CLOCK)


def write_frames(path, scene, frames):
    encode = encoders(scene)
    with BagWriter(path) as bag:
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        introduce(bag, scene)
        for k, frame in enumerate(frames):
            for name in encode:
                bag.write(f'/dragon/{name}', bytes(encode[name](frame)), frame.t_ns, k)
    return path


@pytest.fixture(scope='module')
def contact_s():
    return first_contact(SCENE).t_s


@pytest.mark.parametrize('scene', [
    SCENE, EVERYTHING, replace(SCENE, accuracy='preview'), None],
    ids=['usual', 'everything', 'preview', 'from the contact on'])
def test_a_run_that_ends_in_a_contact_has_the_ticks_before_it_and_its_frame(tmp_path, contact_s, scene):
    scene = scene or Scene(run=Run(contact_s, 413))
    before = [tick(scene, k) for k in range(ticks_before(scene, contact_s))]
    end, topics = contact_frame(scene, contact_s), len(encoders(scene))

    def checked(name, frames):
        with BagReader(write_frames(tmp_path / name, scene, frames)) as bag:
            return compare_with_model(bag, scene, contact_s=contact_s)
    whole = checked('a.mcap', [*before, end])
    assert (whole.equal, whole.faults) == (topics * (len(before) + 1), [])
    if before:
        cut = checked('b.mcap', before[1:])
        assert (cut.passed, cut.missing_count) == (True, 0)
        assert [note.partition(' of')[0] for note in cut.notes] == [
            'the recording begins at tick 1', f'the recording ends at tick {len(before) - 1}']
        holed = checked('d.mcap', [*before[:-1], end])
        assert holed.missing_count == topics
        assert f'tick {len(before) - 1}: handles is missing' in holed.faults
    beyond = checked('c.mcap', [*before, end, tick(scene, len(before) + 1)])
    assert (beyond.equal, beyond.fault_count) == (whole.equal, topics)
    assert all('belongs to no tick' in fault for fault in beyond.faults)


LED = load_scene('led', ['dragon.benches=3', 'run.stop_s=100'])


def led_frames(count):
    """Yield the first frames of a led dragon that accelerates from rest."""
    law = None
    for k in range(count):
        law = law_on(LED, law, LED.run.time_ns(k), 0.01 * (k > 0))
        yield led_tick(compile_scene(LED), law, k)


def write_led(path, count, keep=lambda name, k: True, change=lambda name, k, data: data, account=False):
    """Write a led run, optionally with omitted or changed messages, or marked as completely received."""
    encode = encoders(LED)
    with BagWriter(path) as bag:
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        introduce(bag, LED)
        if account:
            bag.describe(RECEIVED, {'complete': 'true'})
        for k, frame in enumerate(led_frames(count)):
            for name in encode:
                if keep(name, k):
                    bag.write(f'/dragon/{name}', change(name, k, bytes(encode[name](frame))), frame.t_ns, k + 1)
    return path


def compared(path, scene=LED):
    with BagReader(path) as bag:
        return compare_with_model(bag, scene)


def five_metres_off(name, k, data):
    if name != 'handles' or not k:
        return data
    moved = bytearray(data)
    read_pose_array(moved).poses[:, 0] += 5.0
    return bytes(moved)


@pytest.mark.parametrize('ticks', [5, 200])
def test_a_led_run_that_lacks_a_topic_from_some_tick_on_is_checked_on_its_other_topics(tmp_path, ticks):
    lacking = compared(write_led(tmp_path / 'a.mcap', ticks, lambda name, k: name != 'velocities' or not k,
                                 five_metres_off))
    assert sum('handles' in line for line in lacking.faults) >= 1
    assert lacking.fault_count >= ticks - 1
    assert not lacking.passed


@pytest.mark.parametrize(('account', 'passed'), [(False, True), (True, False)])
def test_the_last_ticks_of_a_led_run_may_lack_topics_only_where_a_recorder_was_killed(tmp_path, account, passed):
    found = compared(write_led(tmp_path / 'a.mcap', 20, lambda name, k: name == 'handles' or k < (
        19 if name == 'leader' else 17), account=account))
    topics = len(encoders(LED))
    assert found.passed == passed
    assert found.equal == 17 * topics + 2 * 2
    assert (found.unchecked != {}) == passed
    if passed:
        assert found.unchecked == {'handles': (1, 'the speed of tick 19 is not known')}
        assert [note.partition(',')[0] for note in found.notes] == [
            'tick 17 lacks benches', 'tick 18 lacks benches']
    else:
        assert found.missing_count == 2 * (topics - 2)
        assert found.faults[-1] == ('tick 19: handles cannot be compared, because the speed of tick 19 does not occur '
                                    'exactly once')


@pytest.mark.parametrize('gone', [1, 60, 126])
def test_a_led_run_that_lacks_one_speed_is_not_excused_for_the_ticks_after_it(tmp_path, gone):
    found = compared(write_led(tmp_path / 'a.mcap', 128, lambda name, k: name != 'leader' or k != gone,
                               five_metres_off))
    topics, after = len(encoders(LED)), 128 - gone
    assert not found.passed
    assert found.unchecked == {}
    assert found.fault_count == (gone - 1) + after * topics - 1     # handles before the missing speed, then everything
    assert f'the speed of tick {gone} does not occur exactly once' in found.faults[-1]


def test_in_the_last_ticks_of_a_killed_recorder_nothing_follows_what_is_missing(tmp_path):
    kept = {'velocities': (0, 1, 18), 'benches': range(18)}
    found = compared(write_led(tmp_path / 'a.mcap', 20, lambda name, k: k in kept.get(name, range(20))))
    assert not found.passed
    assert found.faults == ['ticks 2 to 17: velocities is missing']


@pytest.mark.parametrize('ticks', [20, 128])
def test_a_killed_recorder_does_not_excuse_the_speeds_of_many_ticks(tmp_path, ticks):
    found = compared(write_led(tmp_path / 'a.mcap', ticks, lambda name, k: name != 'leader' or k < 2, five_metres_off))
    assert not found.passed
    assert 'cannot be compared, because the speed of tick 2' in found.faults[-1]


def test_a_led_run_that_begins_late_says_so_and_is_not_passed(tmp_path):
    found = compared(write_led(tmp_path / 'a.mcap', 9, lambda name, k: k > 4))
    assert (found.passed, found.notes) == (False, ['the recording begins at tick 5 (0.100000000 s)'])
    assert found.faults[0].startswith('ticks 5 to 8: handles cannot be compared, because the speed of tick 0')


def test_a_led_run_that_lacks_a_topic_is_not_passed(tmp_path):
    found = compared(write_led(tmp_path / 'a.mcap', 3, lambda name, k: name != 'velocities'))
    assert (found.faults, found.passed) == (['ticks 0 to 2: velocities is missing'], False)


def test_another_recorder_may_lack_topics_which_is_noted(tmp_path):
    encode = encoders(SHORT)
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for name in ('handles', 'velocities', 'scene'):
            bag.add_channel(f'/dragon/{name}', channels()[name])
        bag.write('/dragon/scene', string_message(scene_file(SHORT)), SHORT.run.start_ns, 1)
        for k in range(3, 20):
            for name in ('handles', 'velocities'):
                bag.write(f'/dragon/{name}', encode[name](tick(SHORT, k)), SHORT.run.time_ns(k), k + 1)
    found = compared(tmp_path / 'a.mcap', SHORT)
    assert (found.equal, found.once, found.faults, found.passed) == (2 * 17, 1, [], True)
    assert found.notes == ['the recording lacks benches, track',
                           'the recording begins at tick 3 of 0 to 25 (412.060000000 s)',
                           'the recording ends at tick 19 of 0 to 25 (412.380000000 s)']


def test_topics_of_each_tick_that_the_scene_does_not_declare_are_faults(tmp_path):
    scene, bare = Scene(run=Run(412, 412.1)), Scene(run=Run(412, 412.1), effects=Effect(0))
    path = write_frames(tmp_path / 'a.mcap', scene, [tick(scene, k) for k in range(6)])
    found = compared(path, bare)
    assert (found.equal, found.passed) == (6, False)
    assert found.faults == ['benches: 6 messages on a topic that the scene does not declare',
                            'velocities: 6 messages on a topic that the scene does not declare']


def test_every_message_of_a_bag_is_accounted_for(tmp_path):
    scene = Scene(run=Run(412, 412.1))
    text = scene_file(scene)
    encode = encoders(scene)
    others = {'/dragon/clearance': 'clearance', '/diagnostics': '/diagnostics', '/other/handles': 'handles',
              '/dragon/battery': 'clearance', '/tf': 'clearance'}
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for topic, name in others.items():
            bag.add_channel(topic, channels()[name])
        for name in (*encode, 'scene', 'track'):
            bag.add_channel(f'/dragon/{name}', channels()[name])
        bag.describe('dragon_ros', run_metadata(text, scene, {}))
        bag.write('/dragon/scene', string_message(text), scene.run.start_ns, 1)
        bag.write('/dragon/track', track_marker(scene, 'dragon'), scene.run.start_ns, 1)
        for k in range(6):
            frame = tick(scene, k)
            for name in encode:
                bag.write(f'/dragon/{name}', bytes(encode[name](frame)), frame.t_ns, k + 1)
            for topic in others:
                bag.write(topic, bytes(12), frame.t_ns, k + 1)
    found = compared(tmp_path / 'a.mcap', scene)
    with BagReader(tmp_path / 'a.mcap') as reader:
        messages = sum(topic.messages for topic in reader.topics)
    assert found.passed
    assert found.equal + found.once + sum(count for count, _ in found.unchecked.values()) == messages == 18 + 2 + 30
    assert [why for _, why in found.unchecked.values()] == [
        'published by monitor at its own rate', 'published by all nodes at any time',
        'belongs to another dragon or to none', 'unknown to this version', 'belongs to another dragon or to none']


@pytest.mark.parametrize('name', ['scene', 'track'])
def test_a_scene_or_a_track_of_another_run_is_a_fault(tmp_path, name):
    scene, other = Scene(run=Run(412, 412.1)), Scene(run=Run(400, 400.1), markers='triangles')
    path = write_frames(tmp_path / 'a.mcap', scene, [tick(scene, k) for k in range(6)])
    made = {'scene': string_message(scene_file(other)), 'track': track_marker(load_scene('turning'), 'dragon')}
    encode = encoders(scene)
    with BagWriter(path, overwrite=True) as bag:
        bag.describe('dragon_ros', run_metadata(scene_file(scene), scene, {}))
        made = {'scene': string_message(scene_file(scene)), 'track': track_marker(scene, 'dragon'), name: made[name]}
        for topic in (*encode, *made):
            bag.add_channel(f'/dragon/{topic}', channels()[topic])
        for topic, data in made.items():
            bag.write(f'/dragon/{topic}', data, scene.run.start_ns, 1)
        for k in range(6):
            for topic in encode:
                bag.write(f'/dragon/{topic}', bytes(encode[topic](tick(scene, k))), scene.run.time_ns(k), k + 1)
    found = compared(path, scene)
    assert (found.equal, found.faults) == (18, [f'{name} at {scene.run.start_ns} ns does not match the scene'])


POINT = np.dtype({'names': ['x', 'speed', 'handle'], 'formats': ['<f4', '<f8', '<u4'], 'offsets': [0, 32, 40],
                  'itemsize': 48})


@pytest.mark.parametrize(('name', 'change', 'close'), [
    ('x', lambda x: np.nextafter(x, np.float32(np.inf)), True), ('x', lambda x: x + np.float32(1e-5), False),
    ('x', lambda x: x * np.float32(np.nan), False), ('speed', lambda speed: speed * (1 + 1e-15), True),
    ('speed', lambda speed: speed * (1 + 1e-9), False), ('handle', lambda handle: handle + 1, False)])
@pytest.mark.parametrize('features', ['MMX2', None], ids=['another kernel', 'this kernel'])
def test_clouds_are_held_to_the_promise_and_the_steps_of_their_floats_where_another_kernel_made_them(
        tmp_path, name, change, close, features):
    scene = Scene(run=Run(412, 412), effects=Effect.CLOUD | Effect.VELOCITY)
    made = run_metadata(scene_file(scene), scene, {}) | ({'about.cpu_features': features} if features else {})
    encode = encoders(scene)
    with BagWriter(tmp_path / 'a.mcap') as bag:
        bag.describe('dragon_ros', made)
        for topic, data in {'scene': string_message(made['scene']), 'track': track_marker(scene, 'dragon')}.items():
            bag.add_channel(f'/dragon/{topic}', channels()[topic])
            bag.write(f'/dragon/{topic}', data, scene.run.start_ns, 1)
        for topic in encode:
            bag.add_channel(f'/dragon/{topic}', channels()[topic])
            data = bytearray(encode[topic](tick(scene, 0)))
            if topic == 'cloud':
                numbers = decode(channels()[topic].type, data)['data'].tobytes()
                points = np.frombuffer(data, POINT, len(numbers) // POINT.itemsize, data.index(numbers))
                points[name][7] = change(points[name][7])
            bag.write(f'/dragon/{topic}', bytes(data), scene.run.start_ns, 1)
    found = compared(tmp_path / 'a.mcap', scene)
    assert (found.other_kernel is None) == (features is None)
    assert (found.passed, found.close) == ((True, 1) if close and features else (False, 0))


TRAILING = {'one byte': lambda data: data + b'\0', 'a word': lambda data: data + bytes(4),
            'a long tail': lambda data: data + b'more', 'changed': lambda data: data.replace(b'dragon', b'drAgon')}


@pytest.mark.parametrize('change', ['gone', 'twice', *TRAILING])
@pytest.mark.parametrize('name', ['scene', 'track', 'venue'])
@pytest.mark.parametrize('describes', [True, False])
def test_a_latched_message_that_is_missing_doubled_altered_or_lengthened_is_a_fault(tmp_path, name, change, describes):
    scene = load_scene('street', ['dragon.benches=3', 'run.stop_s=0.04'])
    text, encode = scene_file(scene), encoders(scene)
    latched = {'scene': string_message(text), **latched_messages(scene, 'dragon')}
    with BagWriter(tmp_path / 'a.mcap') as bag:
        if describes:
            bag.describe('dragon_ros', run_metadata(text, scene, {}))
        for topic in (*latched, *encode):
            bag.add_channel(f'/dragon/{topic}', channels()[topic])
        for topic, data in latched.items():
            copies = {'gone': [], 'twice': [data, data]}.get(change) if topic == name else [data]
            for one in [TRAILING[change](data)] if copies is None else copies:
                bag.write(f'/dragon/{topic}', one, scene.run.start_ns, 1)
        for k in range(3):
            for topic in encode:
                bag.write(f'/dragon/{topic}', bytes(encode[topic](tick(scene, k))), scene.run.time_ns(k), k + 1)
    found = compared(tmp_path / 'a.mcap', scene)
    if not describes and (change == 'gone' or (name, change) == ('scene', 'changed')):
        # Nothing else in the bag names its scene.
        assert (found.passed, found.notes) == (True, [f'the recording lacks {name}'] if change == 'gone' else [])
        return
    assert (found.equal, found.fault_count) == (9, 1), found.faults
    assert name in found.faults[0]


def test_a_message_at_a_time_that_no_reader_reaches_is_a_fault(tmp_path):
    scene = Scene(run=Run(412, 412.1))
    path = write_frames(tmp_path / 'a.mcap', scene, [tick(scene, k) for k in range(6)])
    encode = encoders(scene)
    with BagWriter(path, overwrite=True) as bag:
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k in range(6):
            for name in encode:
                bag.write(f'/dragon/{name}', bytes(encode[name](tick(scene, k))), scene.run.time_ns(k), k + 1)
        bag.write('/dragon/handles', bytes(encode['handles'](tick(scene, 2))), 0, 9)
    found = compared(path, scene)
    assert not found.passed
    assert found.fault_count == 1


def test_bits_may_differ_only_in_a_bag_that_names_another_kernel_or_none(tmp_path):
    def written(describe):
        scene, encode = Scene(run=Run(412, 412)), encoders(Scene())
        with BagWriter(tmp_path / 'a.mcap', overwrite=True) as bag:
            if describe:
                introduce(bag, scene)
            for name in encode:
                bag.add_channel(f'/dragon/{name}', channels()[name])
                data = bytearray(encode[name](tick(scene, 0)))
                if name == 'handles':
                    read_pose_array(data).poses[7, 0] += 1e-13
                bag.write(f'/dragon/{name}', bytes(data), scene.run.start_ns, 1)
        return compared(tmp_path / 'a.mcap', scene)
    assert (written(True).passed, written(False).passed) == (False, True)
