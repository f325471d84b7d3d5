"""The packed index of a file returns its entries unchanged, locates messages, and takes little memory."""
import gc
import io
import threading
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk, MessageIndex, MetadataIndex
from mcap.stream_reader import StreamReader

from dragon_ros.bags.record import simulation_clock
from dragon_ros.bags.record.loss_accounting import LossAccount
from dragon_ros.bags.record.simulation_clock import SimulationClock
from dragon_ros.bags.record.writer_thread import WriterThread
from dragon_ros.bags.write.mcap import FileParts, Stored, around, record_bytes
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.scene import Run, Scene
from dragon_ros.messages.channels import channels

NUMBERS = st.integers(0, 2**64 - 1)
COUNTS = st.lists(st.tuples(st.integers(0, 2**16 - 1), NUMBERS), max_size=5).map(tuple)
CHUNKS = st.lists(st.builds(Stored, NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS, COUNTS))


@given(chunks=CHUNKS)
def test_chunks_come_back_as_they_were_noted_the_last_one_first(chunks):
    parts = FileParts()
    for chunk in chunks:
        parts.add(chunk)
    assert list(parts.chunks()) == chunks[::-1]
    assert [parts.pop() for _ in chunks] == [chunk.start for chunk in reversed(chunks)]
    assert not parts
    with pytest.raises(IndexError):
        parts.pop()


@given(messages=st.dictionaries(st.integers(0, 2**16 - 1), st.lists(st.tuples(NUMBERS, NUMBERS)), max_size=3))
def test_the_records_after_a_chunk_have_the_bytes_that_the_library_writes(messages):
    rows = [MessageIndex(channel_id=channel, records=entries) for channel, entries in messages.items()]
    assert around(Chunk('zstd', b'', 2, 1, 3, 0), 5, messages)[1] == record_bytes(*rows)


def test_the_last_part_goes_first_whatever_it_is():
    parts = FileParts()
    for start in (10, 30):
        parts.add(Stored(start, 1, 1, 0, 0, ()))
        parts.others.append((start + 10, MetadataIndex(offset=start + 10, length=1, name='')))
    assert [parts.pop() for _ in range(4)] == [40, 30, 20, 10]


def test_the_index_of_a_chunk_finds_the_messages_of_each_topic(bag_bytes):
    summary = make_reader(io.BytesIO(bag_bytes)).get_summary()
    found = {}
    for chunk in summary.chunk_indexes:
        assert chunk.message_index_offsets
        for channel, offset in chunk.message_index_offsets.items():
            row = next(StreamReader(io.BytesIO(bag_bytes[offset:]), skip_magic=True).records)
            assert row.channel_id == channel
            found[channel] = found.get(channel, 0) + len(row.records)
    assert found == summary.statistics.channel_message_counts


RUN = Run(0.0, 1e6, 100.0)
TOPICS = ('/d/handles', '/d/benches', '/d/velocities')


class Recording:
    """All parts of a recorder that store data about messages, without ROS and with one chunk per tick."""

    def __init__(self, path):
        self.bag, self.losses, self.tick = BagWriter(path), LossAccount(), 0
        for topic in TOPICS:
            self.bag.add_channel(topic, channels()['handles'])
        self.losses.scene(Scene(run=RUN), '/d')
        self.writer = WriterThread(self.bag, flush_s=3600)
        self.clock = SimulationClock(self.log)

    def fill_ticks(self):
        """Fill the clock's list of ticks, whose length is bounded, with ticks from before the recording."""
        for k in range(-2 * simulation_clock._MARKS, 0):
            self.clock.mark(10**18 + k * 10**7, k)

    def log(self, topic, data, t_ns, sequence, source_ns):
        self.losses.note(topic, t_ns, sequence)
        self.writer.write(topic, data, t_ns, sequence, source_ns)

    def go_on(self, ticks):
        """Write a number of ticks, and return how many bytes are still in memory once the ticks are in the file."""
        for _ in range(ticks):
            self.tick += 1
            t_ns, source_ns = RUN.time_ns(self.tick - 1), 10**18 + self.tick * 10**7
            self.losses.stamp(t_ns)
            self.clock.mark(source_ns, t_ns)
            for topic in TOPICS[:2]:
                self.log(topic, bytes(100), t_ns, self.tick, source_ns)
            self.clock.unstamped(TOPICS[2], bytes(100), source_ns + 1, self.tick)
            self.writer._put(0, self.bag.flush)
        written = threading.Event()
        self.writer._put(0, written.set)
        assert written.wait(60)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]


def test_a_long_recording_holds_less_than_100_bytes_for_each_of_its_chunks(tmp_path, monkeypatch):
    monkeypatch.setattr(simulation_clock, '_MARKS', 1000)       # a tenth, so that they are full and emptied sooner
    monkeypatch.setattr(simulation_clock, '_DROPPED', 100)
    recording = Recording(tmp_path / 'a.mcap')
    tracemalloc.start()
    try:
        recording.fill_ticks()
        held = [recording.go_on(1000), recording.go_on(400), recording.go_on(400)]    # first, fill bounded buffers
    finally:
        tracemalloc.stop()
        recording.writer.stop()
        recording.bag.close()
    assert recording.losses.complete(ended=False)
    # What the recording holds grows in both spans; another thread of pytest may allocate memory in one of them.
    assert 0 < min(np.diff(held)) < 400 * 100
