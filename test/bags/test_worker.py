"""Jobs run in order on a thread, with at most one pending, and each error is raised once."""
import threading

import pytest

from dragon_ros.bags.write.mcap import Worker
from dragon_ros.core.errors import DiskError


def fail():
    raise DiskError('no room')


def test_jobs_are_done_in_order_and_never_more_than_one_waits():
    thread, done, go = Worker('x'), [], threading.Event()
    thread.start(lambda: done.append(go.wait(60)))
    assert not done
    go.set()
    for k in range(100):
        thread.start(lambda k=k: done.append(k))
        assert len(done) > k       # the earlier jobs are done
    thread.settle()
    thread.close()
    assert done == [True, *range(100)]


def test_an_error_is_raised_once_and_the_job_submitted_with_it_is_not_started():
    thread, done = Worker('x'), []
    thread.start(fail)
    with pytest.raises(DiskError, match='no room'):
        thread.start(lambda: done.append(1))
    thread.settle()
    thread.close()
    assert not done


def test_a_job_has_been_taken_up_when_start_returns():
    thread = Worker('x')
    for _ in range(100):
        thread.start(lambda: None)
        assert thread._pool._work_queue.empty()
    thread.close()
