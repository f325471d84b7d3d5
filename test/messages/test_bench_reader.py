"""Benches read by comparison with the previous message equal those read by a parser, whatever bytes have changed."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.bench_reader import BenchReader
from dragon_ros.messages.cdr import Writer
from dragon_ros.messages.decode import MessageError
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.markers import BENCH, CUBE, MarkerSpec, put_marker
from dragon_ros.messages.observation import BenchCubes, read_benches

HANDLES = np.zeros((6, 2))


def messages(markers='cubes', benches=5, ticks=3):
    scene = Scene(dragon=Dragon(benches), run=Run(412, 415.2), markers=markers)
    encode = encoders(scene)['benches']
    return [bytes(bytearray(encode(tick(scene, k)))) for k in range(ticks)]


CUBES = messages()


def outcome(read, data):
    """Return the contents of a message, or the reason why it is invalid."""
    try:
        shown = read(data)
    except MessageError as error:
        return str(error)
    try:
        benches = shown.rectangles(HANDLES)
    except MessageError as error:
        return shown.t_ns, shown.frame_id, str(error)
    return shown.t_ns, shown.frame_id, *(values.tobytes() for values in vars(benches).values())


@pytest.mark.parametrize('benches', [1, 2, 5, 223])
def test_messages_of_a_run_are_compared_and_not_parsed(benches):
    reader, kinds = BenchReader(), []
    for data in messages(benches=benches):
        assert outcome(reader.read, data) == outcome(read_benches, data)
        kinds.append(type(reader.read(data)))
    assert kinds == [BenchCubes] * 3


def test_what_waits_for_its_handles_is_the_same():
    reader = BenchReader()
    reader.read(CUBES[0])
    mine, theirs = reader.read(CUBES[1]).to_wait(), read_benches(CUBES[1]).to_wait()
    assert type(mine) is type(theirs)
    assert mine.size_bytes == theirs.size_bytes
    assert outcome(lambda _: mine, b'') == outcome(lambda _: theirs, b'')


@given(st.lists(st.tuples(st.integers(0, len(CUBES[1]) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_any_change_of_bytes_has_the_effect_that_it_has_on_a_parser(changes):
    reader = BenchReader()
    reader.read(CUBES[0])
    data = bytearray(CUBES[1])
    for at, value in changes:
        data[at] = value
    assert outcome(reader.read, bytes(data)) == outcome(read_benches, bytes(data))


@given(st.data())
def test_words_that_matter_are_drawn_more_often(data):
    """Any word of two markers may change to a value that a length, id, type, stamp or float can have."""
    reader, words = BenchReader(), np.frombuffer(CUBES[1], 'u4').copy()
    reader.read(CUBES[0])
    marker = data.draw(st.sampled_from([0, 4]))
    at = 2 + marker * 58 + data.draw(st.integers(0, 57))
    words[min(at, words.size - 1)] = data.draw(st.sampled_from(
        [0, 1, 2, 4, 11, 0x7ff00000, 0xfff80000, 2**31, 2**32 - 1]))
    changed = words.tobytes()
    assert outcome(reader.read, changed) == outcome(read_benches, changed)


@pytest.mark.parametrize('cut', [1, 3, 4, 58 * 4])
def test_a_message_cut_short_or_with_bytes_after_it_is_parsed(cut):
    reader = BenchReader()
    reader.read(CUBES[0])
    for data in (CUBES[1][:-cut], CUBES[1] + bytes(cut)):
        assert outcome(reader.read, data) == outcome(read_benches, data)


def test_styles_may_change_from_message_to_message():
    reader = BenchReader()
    for data in (*messages('triangles'), CUBES[0], *messages('triangles'), *CUBES):
        assert outcome(reader.read, data) == outcome(read_benches, data)


@pytest.mark.parametrize('ids', [(0, 1, 2), (2, 1, 0), (1, 2, 3)])
@pytest.mark.parametrize('frame', ['d', 'dragon', 'odom/dragon'])
@pytest.mark.parametrize('widths', [(0.3, 0.3, 0.3), (0.3, -0.3, 0.3), (0.3, 0.4, 0.5)])
def test_cubes_of_another_publisher_in_any_order_and_size_are_read_as_they_are(ids, frame, widths):
    writer, reader = Writer(), BenchReader()
    writer.put('I', 3)
    for bench, width_m in zip(ids, widths, strict=True):
        put_marker(writer, MarkerSpec(BENCH, bench, CUBE, (2.0, width_m, 0.1), (1.0, 0.0, 0.0, 1.0)), frame)
    data = bytes(writer.finish())
    for _ in range(3):
        assert outcome(reader.read, data) == outcome(read_benches, data)


@pytest.mark.parametrize('markers', ['cubes', 'triangles'])
def test_every_byte_of_a_message_counts_as_it_does_for_a_parser(markers, request):
    """Without --long, every fifth byte is changed."""
    known, data = messages(markers, 2, 2)
    for place in range(0, len(data), 1 if request.config.getoption('--long') else 5):
        changed = bytearray(data)
        changed[place] ^= 0x40
        reader = BenchReader()
        reader.read(known)
        assert outcome(reader.read, bytes(changed)) == outcome(read_benches, bytes(changed)), place
