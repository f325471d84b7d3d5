"""The writer thread writes everything in order, in bounded memory, and reports an error once."""
import struct
import threading

import pytest
from mcap.reader import make_reader

from dragon_ros.bags.record.writer_thread import WriterThread
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core.errors import DiskError
from dragon_ros.messages.channels import channels


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / 'a.mcap', options=BagOptions(compression='none', max_size_mb=3)) as bag:
        bag.add_channel('/x', channels()['clearance'])
        yield bag


def messages(bag):
    bag.close()
    with bag.path.open('rb') as file:
        return [message.data for _, _, message in make_reader(file).iter_messages(log_time_order=False)]


def test_everything_is_written_in_order_before_it_stops(bag):
    writer = WriterThread(bag)
    for k in range(1000):
        writer.write('/x', b'%d' % k, k, k, k)
    writer.stop()
    writer.stop()
    assert messages(bag) == [b'%d' % k for k in range(1000)]
    assert writer.error is None


def test_what_was_taken_reaches_the_file_without_more_coming(bag):
    writer = WriterThread(bag, flush_s=0.05)
    writer.write('/x', b'here I am', 0, 0, 0)
    seen = threading.Event()

    def look():
        while b'here I am' not in bag.path.read_bytes():
            pass
        seen.set()
    threading.Thread(target=look, daemon=True).start()
    assert seen.wait(60)
    writer.stop()


def test_a_full_queue_holds_the_writer_back_and_drops_nothing(bag):
    writer = WriterThread(bag, queue_mb=0.1)
    go, bag_write = threading.Event(), bag.write

    def slow(*row):
        go.wait(60)
        bag_write(*row)
    bag.write = slow
    feeder = threading.Thread(target=lambda: [writer.write('/x', bytes(10_000), k, k, k) for k in range(50)])
    feeder.start()
    while not writer.waits:
        pass
    assert feeder.is_alive()
    go.set()
    feeder.join()
    writer.stop()
    assert len(messages(bag)) == 50
    assert 1 <= writer.fullest < 1.3
    assert writer.waited_s > 0


def test_after_an_error_nothing_more_is_written_and_the_bag_is_whole(bag):
    writer = WriterThread(bag)
    for k in range(50):
        writer.write('/x', bytes(100_000), k, k, k)
    writer.stop()
    assert isinstance(writer.error, DiskError)
    assert len(messages(bag)) == bag.kept == 28


def test_any_error_ends_the_writing_and_is_kept_for_the_recorder(bag):
    writer = WriterThread(bag)
    writer.write('/x', b'', 2**64, 1, 1)
    writer.write('/x', b'', 1, 2, 1)
    writer.stop()
    assert isinstance(writer.error, struct.error)
    assert messages(bag) == []
