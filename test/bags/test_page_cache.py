"""Page-cache requests for a growing file do not block the writer."""
import errno
import os
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.mcap import McapWriter
from dragon_ros.bags.write.page_cache import KEPT_BYTES, STEP_BYTES, PageCache

MB = 2**20


@pytest.fixture
def asked(monkeypatch):
    """The file ranges (start, end) that the system has been asked to drop from its page cache."""
    parts = []
    monkeypatch.setattr(os, 'posix_fadvise', lambda _, start, size, what: parts.append((start, start + size))
                        if what == os.POSIX_FADV_DONTNEED else pytest.fail('other advice'))
    return parts


def grow(cache, to_bytes):
    for size in range(0, to_bytes + 1, MB):
        cache.grown(size)
        if cache._job:
            cache._job.result(60)


def test_a_small_file_stays_in_memory(asked):
    cache = PageCache(-1)
    grow(cache, KEPT_BYTES - MB)
    cache.close()
    assert not asked


def test_each_part_is_asked_for_again_once_the_disk_has_it(asked):
    cache, end = PageCache(-1), 20 * STEP_BYTES
    grow(cache, end + MB)
    cache.close()
    for at in range(0, end - KEPT_BYTES, MB):
        assert sum(start <= at and at + MB <= stop for start, stop in asked) >= 2
    assert max(stop for _, stop in asked) == end
    assert max(stop - start for start, stop in asked) <= KEPT_BYTES + STEP_BYTES


def test_a_slow_disk_delays_the_requests_and_not_the_writer(monkeypatch):
    go, parts = threading.Event(), []

    def slow(_, start, size, __):
        parts.append((start, start + size))
        go.wait(60)
    monkeypatch.setattr(os, 'posix_fadvise', slow)
    cache = PageCache(-1)
    for size in range(0, 20 * STEP_BYTES, MB):
        cache.grown(size)       # returns while the first request waits
    go.set()
    cache._job.result(60)
    assert parts == [(0, KEPT_BYTES)]
    cache.grown(20 * STEP_BYTES)
    cache.close()
    assert parts[1:] == [(0, 20 * STEP_BYTES)]      # no part of the file was omitted


@pytest.mark.parametrize('error', [errno.ESPIPE, errno.EINVAL, errno.ENOSYS])
def test_a_file_system_without_advice_is_written_all_the_same(tmp_path, monkeypatch, error):
    def refuse(*_):
        raise OSError(error, 'no')
    monkeypatch.setattr(os, 'posix_fadvise', refuse)
    write(tmp_path / 'a.mcap')


def test_a_system_without_the_call_is_written_all_the_same(tmp_path, monkeypatch):
    monkeypatch.delattr(os, 'posix_fadvise')
    write(tmp_path / 'a.mcap')


def test_a_bag_is_written_where_no_thread_can_be_started(tmp_path, monkeypatch):
    def refuse(*_):
        raise RuntimeError("can't start new thread")
    monkeypatch.setattr(ThreadPoolExecutor, 'submit', refuse)
    write(tmp_path / 'a.mcap', threaded=False)


def test_a_large_bag_asks_for_its_start_and_can_be_read(tmp_path, monkeypatch):
    path, advise, parts = tmp_path / 'a.mcap', os.posix_fadvise, []
    monkeypatch.setattr(os, 'posix_fadvise', lambda *part: (parts.append(part[1:3]), advise(*part)))
    write(path)
    assert parts[0] == (0, KEPT_BYTES)
    with BagReader(path) as reader:
        assert [len(message.data) for message in reader.messages()] == [MB] * 100


def write(path, threaded=True):
    """Write a bag of 100 MB."""
    file, data = McapWriter(path, compression='none', threaded=threaded), os.urandom(MB)
    channel = file.add_channel('/x', file.add_schema('std_msgs/msg/String', b'string data'), {})
    for k in range(100):
        file.add_message(channel, data, k, k, k)
    file.finish()
    assert path.stat().st_size > 100 * MB
