"""``simulate`` on several processes: the same bytes, and the remaining bag if a process or the disk fails."""
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dragon_ros.__main__ import main
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cli.pool import in_order, workers_of
from dragon_ros.core.errors import DragonError

COMMAND = [sys.executable, '-m', 'dragon_ros', 'simulate', '--scene', 'winding', '--workers', '2']


def squares(offset):
    return lambda job: job * job + offset


def end_at(job):
    def work(one):
        if one == job:
            raise DragonError(f'job {one}: no')
        return one
    return work


def killed_in_another(parent):
    def work(job):
        if os.getpid() != parent:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.01)        # so that others have jobs
        return job
    return work


@pytest.mark.parametrize('workers', [1, 2, 3])
def test_results_come_in_the_order_of_the_jobs(workers):
    assert list(in_order(squares, (1,), iter(range(500)), workers)) == [n * n + 1 for n in range(500)]


@pytest.mark.parametrize('workers', [1, 2])
def test_an_error_of_a_job_comes_at_its_place(workers):
    results = in_order(end_at, (300,), iter(range(1000)), workers)
    assert [next(results) for _ in range(300)] == list(range(300))
    with pytest.raises(DragonError, match='job 300'):
        next(results)


def test_a_killed_process_is_said():
    with pytest.raises(DragonError, match='worker processes was killed'):
        list(in_order(killed_in_another, (os.getpid(),), iter(range(10_000)), 2))


def test_workers_are_checked_and_one_for_each_core_by_default():
    assert workers_of(None) == len(os.sched_getaffinity(0))
    assert workers_of(3) == 3
    for wrong in (0, 1025):
        with pytest.raises(DragonError, match='--workers'):
            workers_of(wrong)


@pytest.mark.parametrize('compression', ['zstd', pytest.param('none', marks=pytest.mark.long)])
def test_a_bag_has_the_same_bytes_with_any_number_of_workers(tmp_path, compression):
    bags = []
    for workers in (1, 2, 3):
        bags.append(tmp_path / f'{workers}.mcap')
        assert main(['simulate', '--scene', 'winding', '--set', 'run.stop_s=32', '--compression', compression,
                     '--workers', str(workers), '--output', str(bags[-1])]) == 0
    assert bags[0].stat().st_size > 2**24
    assert bags[1].read_bytes() == bags[0].read_bytes() == bags[2].read_bytes()


def begun(path, least=2**22):
    """Wait until a process writes a bag."""
    end = time.monotonic() + 60
    while not path.exists() or path.stat().st_size < least:
        assert time.monotonic() < end
        time.sleep(0.02)


def children(pid):
    """The processes that a process has started to work, without the tracker of resources."""
    of = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    return [int(one) for one in of if b'spawn_main' in Path(f'/proc/{one}/cmdline').read_bytes()]


def complete_ticks(path):
    """The number of ticks in a bag, all complete; a bag without an index is not opened."""
    with BagReader(path) as bag:
        counts = {topic.messages for topic in bag.topics if topic.name in ('/dragon/handles', '/dragon/benches')}
    assert len(counts) == 1
    return counts.pop()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_all_processes_leaves_a_complete_bag(tmp_path, number):
    path = tmp_path / 'a.mcap'
    with subprocess.Popen([*COMMAND, '--output', path], stderr=subprocess.PIPE, text=True,
                          start_new_session=True) as process:
        begun(path)
        os.killpg(process.pid, number)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert 'Traceback' not in errors
    assert f'{complete_ticks(path)} of 21646 ticks' in errors


def test_a_killed_worker_leaves_a_complete_bag(tmp_path):
    path = tmp_path / 'a.mcap'
    with subprocess.Popen([*COMMAND, '--output', path], stderr=subprocess.PIPE, text=True) as process:
        begun(path)
        for child in children(process.pid):
            os.kill(child, signal.SIGKILL)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert 'one of the worker processes was killed' in errors
    assert complete_ticks(path) > 0


def test_workers_end_with_the_process_that_started_them(tmp_path):
    path = tmp_path / 'a.mcap'
    with subprocess.Popen([*COMMAND, '--output', path], stderr=subprocess.PIPE, text=True) as process:
        begun(path)
        working = children(process.pid)
        process.kill()
        process.wait(60)
    assert working
    end = time.monotonic() + 60
    while any(Path(f'/proc/{child}').exists() for child in working):
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_full_disk_leaves_a_complete_bag(tmp_path):
    path = tmp_path / 'a.mcap'
    limited = ['bash', '-c', 'ulimit -f 8192; trap "" XFSZ; exec "$@"', 'bash']
    done = subprocess.run([*limited, *COMMAND, '--output', path], stderr=subprocess.PIPE, text=True, timeout=120)
    assert done.returncode == 1
    assert 'cannot be continued' in done.stderr
    assert path.stat().st_size <= 8192 * 1024
    assert complete_ticks(path) > 0
