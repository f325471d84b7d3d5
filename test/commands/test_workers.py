"""Commands produce the same output on several processes as on one; files stay valid if a process or the disk fails."""
import json
import os
import signal
import time
from itertools import chain, product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pool_jobs import EndedElsewhere, KilledElsewhere, end_at_300, squares
from processes import Forked, children
from properties import examples, thinned

from dragon_ros.__main__ import main
from dragon_ros.bags.check.compare import Comparison, compare_with_model
from dragon_ros.bags.read.frames import frames
from dragon_ros.bags.read.parts import in_parts
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.cli.pool import ALONE, Pool, workers_of
from dragon_ros.core.errors import DragonError
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import ContactTracker
from dragon_ros.messages.channels import channels
from dragon_ros.pictures.sources import dragon_in
from dragon_ros.scenes.load import load_scene

COMMAND = ['simulate', '--scene', 'winding', '--workers', '2']
WHOLE = ['run.start_s=396', 'run.stop_s=413.5']     # the last second contains the contact
LONG = ['run.start_s=408.5', 'run.stop_s=413.5', 'dragon.benches=400']      # enough benches for several parts
TICKS = 251
BAG = str(Path(__file__).parents[1] / 'data' / 'made_by_0_2_0' / 'run.mcap')


@pytest.mark.parametrize('workers', [1, 2, 3])
def test_results_come_in_the_order_of_the_jobs(workers):
    assert list(Pool(workers).in_order(squares, range(500))) == [n * n + 1 for n in range(500)]


@pytest.mark.parametrize('workers', [1, 2])
def test_an_error_of_a_job_comes_at_its_place(workers):
    results = Pool(workers).in_order(end_at_300, range(1000))
    assert [next(results) for _ in range(300)] == list(range(300))
    with pytest.raises(DragonError, match='job 300'):
        next(results)


@pytest.mark.parametrize('jobs', [KilledElsewhere, EndedElsewhere])
def test_a_killed_process_is_said(jobs):
    with pytest.raises(DragonError, match='worker processes was killed'):
        list(Pool(2).in_order(jobs(), range(10_000)))


_KILLED_AFTER_A_JOB = """
import os, signal
from threading import Timer
from dragon_ros.cli.pool import Pool
from dragon_ros.core.errors import DragonError

def work(job):
    Timer(0.01, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return bytes(2**26)

try:
    list(Pool(2).in_order(work, range(10)))
except DragonError as error:
    assert 'was killed' in str(error)
else:
    raise AssertionError
"""


def test_a_process_that_is_killed_while_it_returns_a_large_result_is_said(tmp_path):
    ends_well(tmp_path, _KILLED_AFTER_A_JOB)


def test_results_that_no_folder_can_hold_are_said(monkeypatch, tmp_path):
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path / 'missing'))
    with pytest.raises(DragonError, match='a temporary file cannot be written: No such file or directory; free'):
        list(Pool(2).in_order(squares, range(10)))


def forked(*command, program=None, cwd='.'):
    """Start a command, or another program, in a process with a single thread, which can therefore fork its workers."""
    return Forked([*map(str, command)], os.environ, cwd, stderr=True, program=program)


def ends_well(folder, code, *arguments):
    """Run a program whose assertions are about a pool of forked processes."""
    program = folder / 'program.py'
    program.write_text(code)
    with forked(*arguments, program=program) as process:
        assert (process.communicate(timeout=60), process.poll()) == (['', ''], 0)


_INTERRUPTED = """
import multiprocessing
import os
import signal
from dragon_ros.cli.pool import Pool

os.register_at_fork(after_in_parent=lambda: os.kill(os.getpid(), signal.SIGINT))
try:
    list(Pool(2).in_order(abs, range(1000)))
except KeyboardInterrupt:
    assert multiprocessing.active_children() == []
else:
    raise AssertionError
"""


def test_an_interrupt_during_the_start_of_a_pool_ends_its_processes(tmp_path):
    ends_well(tmp_path, _INTERRUPTED)


def test_short_work_is_done_by_this_process_unless_workers_are_asked_for():
    """All results come from this process, because the other processes are killed."""
    assert list(Pool().in_order(KilledElsewhere(), range(10))) == list(range(10))


def test_workers_are_checked_and_one_for_each_core_by_default():
    assert workers_of(None) == Pool().workers == len(os.sched_getaffinity(0))
    assert Pool(3).workers == 3
    for wrong in (0, 1025):
        with pytest.raises(DragonError, match='--workers'):
            Pool(wrong)


@pytest.mark.parametrize(('compression', 'stop_s'), thinned([('zstd', 6), ('none', 4)],
                                                            lambda case: case[0] == 'zstd'))
def test_a_bag_has_the_same_bytes_with_any_number_of_workers(tmp_path, request, compression, stop_s):
    """The bags have 25 and 17 chunks, and with zstd, a job of three workers is two chunks."""
    bags = []
    for workers in (1, 2, 3) if request.config.getoption('--long') else (1, 3):
        bags.append(tmp_path / f'{workers}.mcap')
        assert elsewhere('simulate', '--scene', 'winding', '--set', 'dragon.benches=1000', '--set',
                         f'run.stop_s={stop_s}', '--compression', compression, '--workers', workers, '--output',
                         bags[-1]) == (0, '')
    assert bags[0].stat().st_size > 2**24
    first, *others = (bag.read_bytes() for bag in bags)
    assert all(other == first for other in others)


def begun(path, least=2**21):
    """Wait until a process has written part of a bag."""
    end = time.monotonic() + 60
    while not path.exists() or path.stat().st_size < least:
        assert time.monotonic() < end
        time.sleep(0.02)


def complete_ticks(path):
    """Return the number of ticks in a bag, and check that all are complete; a bag without an index cannot be opened."""
    with BagReader(path) as bag:
        counts = {topic.messages for topic in bag.topics if topic.name in ('/dragon/handles', '/dragon/benches')}
    assert len(counts) == 1
    return counts.pop()


@pytest.mark.parametrize('number', thinned([signal.SIGINT, signal.SIGTERM], lambda number: number == signal.SIGINT))
def test_a_signal_leaves_a_complete_bag(tmp_path, number):
    path = tmp_path / 'a.mcap'
    with forked(*COMMAND, '--output', path) as process:
        begun(path)
        assert all(os.getpgid(child) == child for child in children(process.pid))   # the terminal's signals miss it
        os.kill(process.pid, number)
        _, errors = process.communicate(timeout=60)
    assert process.poll() == 1
    assert 'Traceback' not in errors
    assert f'{complete_ticks(path)} of 21646 ticks' in errors


def test_a_killed_worker_leaves_a_complete_bag(tmp_path):
    path = tmp_path / 'a.mcap'
    with forked(*COMMAND, '--output', path) as process:
        begun(path)
        for child in children(process.pid):
            os.kill(child, signal.SIGKILL)
        _, errors = process.communicate(timeout=60)
    assert process.poll() == 1
    assert 'one of the worker processes was killed' in errors
    assert complete_ticks(path) > 0


def test_workers_end_with_the_process_that_started_them(tmp_path):
    path = tmp_path / 'a.mcap'
    with forked(*COMMAND, '--output', path) as process:
        begun(path)
        working = children(process.pid)
        process.kill()
        process.wait(60)
    assert working
    end = time.monotonic() + 60
    while any(Path(f'/proc/{child}').exists() for child in working):
        assert time.monotonic() < end
        time.sleep(0.02)


_LIMITED = """
import resource
import sys
from dragon_ros.__main__ import run

limit = int(sys.argv[1]) * 1024
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
run(sys.argv[2:])
"""


def with_full_disk(folder, kib, *command):
    """Run a command that cannot make a file larger than ``kib`` KiB, and return its exit code and errors."""
    program = folder / 'program.py'
    program.write_text(_LIMITED)
    with forked(kib, *command, program=program, cwd=folder) as process:
        _, errors = process.communicate(timeout=120)
    program.unlink()
    return process.poll(), errors


def test_a_full_disk_leaves_a_complete_bag(tmp_path):
    path = tmp_path / 'a.mcap'
    code, errors = with_full_disk(tmp_path, 4096, *COMMAND, '--output', path)
    assert code == 1
    assert 'cannot be continued' in errors
    assert path.stat().st_size <= 4096 * 1024
    assert complete_ticks(path) > 0


def simulated(path, *changes):
    options = chain.from_iterable(('--set', one) for one in changes)
    assert main(['simulate', '--scene', 'winding', *options, '--workers', '1', '--output', str(path)]) == 0
    return path


@pytest.fixture(scope='module')
def long(tmp_path_factory):
    """The bag of a run that is computed in several parts."""
    return simulated(tmp_path_factory.mktemp('long') / 'long.mcap', *LONG)


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """The bag of a whole dragon's run, which commands process for long enough to be interrupted."""
    return simulated(tmp_path_factory.mktemp('whole') / 'whole.mcap', *WHOLE)


def changed(path, long, change):
    """Copy a bag, writing each message at each of the log times that ``change`` returns."""
    with BagReader(long) as bag, BagWriter(path) as out:
        for topic in bag.topics:
            out.add_channel(topic.name, channels()[topic.name.removeprefix('/dragon/')])
        for one in bag.messages():
            for t_ns in change(one.topic.removeprefix('/dragon/'), one.t_ns, one.sequence - 1):
                out.write(one.topic, one.data, t_ns, one.sequence)
    return path


def damaged(name, t_ns, k):
    """Drop ticks of one topic or several, at the ends and in between; duplicate and move some others."""
    if name in ('scene', 'track') or k is None:
        return [t_ns]
    if k < 2 or 30 <= k < 115 or (name == 'handles' and k % 5 == 0) or k > TICKS - 6:
        return []
    return [t_ns, t_ns] if k % 95 == 0 else [t_ns + 1] if k % 57 == 3 else [t_ns]


def late(name, t_ns, k):
    """Return log times like those of a recorder that logs some topics of a tick a little later than others."""
    return [t_ns + {'handles': 1, 'velocities': 1}.get(name, 4) * 10**6]


@pytest.fixture(scope='module')
def variant(tmp_path_factory, long):
    """A function that returns the long bag with a change, or as it is."""
    folder, made = tmp_path_factory.mktemp('changed'), {None: long}

    def of(change):
        if change not in made:
            made[change] = changed(folder / f'{change.__name__}.mcap', long, change)
        return made[change]
    return of


def run(capsys, *command):
    code = main([*map(str, command)])
    return code, capsys.readouterr().out


def elsewhere(*command):
    """Run a command in a separate process, whose workers are forked, and return its exit code and output."""
    with forked(*command) as process:
        output, errors = process.communicate(timeout=120)
    assert 'Traceback' not in errors
    return process.poll(), output


@pytest.mark.parametrize('change', thinned([None, damaged, late], lambda change: change is damaged))
def test_a_check_says_the_same_with_any_number_of_workers(capsys, variant, change):
    path = variant(change)
    check = ['inspect', path, '--check', '--format', 'json']
    if change is not None:      # the bag has no record of its run
        with BagReader(path) as bag:
            scene, sizes = load_scene('winding', LONG), []

            def alone(part, spans):
                sizes.append(len(spans))
                return [part((spans[0][0], spans[-1][1])), *(Comparison() for _ in spans[1:])]

            def faults(compared):
                found = compare_with_model(bag, scene, compared=compared)
                return (found.equal, found.close, found.fault_count, found.missing_count, found.faults, found.seen,
                        found.unchecked)
            whole = faults(alone)
            assert whole == faults(Pool(2).in_order) == faults(ALONE.in_order)
            assert (sizes[0] > 3) == (change is damaged)
            assert whole[2] > 300 if change is damaged else whole[2] == 0
        return
    one, two = run(capsys, *check, '--workers', 1), elsewhere(*check, '--workers', 2)
    assert one == two
    assert json.loads(one[1])['equal'] == 3 * TICKS


@examples(50, long=100)
@given(st.lists(st.sampled_from([*product(range(4), 'ab', ['differs', 'is late'])]), max_size=40), st.integers(0, 40))
def test_faults_of_two_parts_are_those_of_the_whole(ticks, cut):
    def compared(first, some):
        out = Comparison()
        for k, (kind, name, what) in enumerate(some, first):
            if kind == 0:
                out.missing(name, k, k)
            elif kind == 1:
                out.note(name, k, what, 2)
            elif kind == 2:
                out.stray(name, k, 1)
            else:
                out.equal += 1
        return out
    whole, parts = compared(0, ticks), Comparison()
    parts.add(compared(0, ticks[:cut]), 'ab')
    parts.add(compared(cut, ticks[cut:]), 'ab')
    assert parts.faults == whole.faults
    assert (parts.fault_count, parts.missing_count, parts.equal, parts.seen) == (
        whole.fault_count, whole.missing_count, whole.equal, whole.seen)


@pytest.mark.parametrize('suffix', thinned(['csv', 'npz', 'parquet'], lambda suffix: suffix == 'csv'))
def test_an_export_has_the_same_bytes_with_any_number_of_workers(capsys, tmp_path, long, suffix):
    more = ['--handles', '0-5', '--every', '3' if suffix == 'parquet' else '1']
    files = [tmp_path / f'{name}.{suffix}' for name in 'ab']
    assert run(capsys, 'export', long, '--output', files[0], '--workers', 1, *more)[0] == 0
    assert elsewhere('export', long, '--output', files[1], '--workers', 2, *more)[0] == 0
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.long       # by default, an export has the same bytes, and the ticks of such a bag are read in parts
def test_an_export_of_a_bag_at_wall_time_has_the_same_bytes_too(capsys, tmp_path, variant):
    files = [tmp_path / f'{name}.csv' for name in 'abc']
    for change, file, workers in ((None, files[0], 1), (late, files[1], 1), (late, files[2], 2)):
        assert run(capsys, 'export', variant(change), '--output', file, '--workers', workers, '--handles', '7')[0] == 0
    assert files[1].read_bytes() == files[2].read_bytes()
    without = [[line.rsplit(',', 3)[0] for line in file.read_text().splitlines()] for file in files[:2]]
    assert without[0] == without[1]


def stamps(some):
    return [frame.t_ns for frame in some]


@pytest.mark.parametrize('change', thinned([None, damaged, late], lambda change: change is not None))
def test_ticks_in_parts_are_those_of_the_bag(variant, change):
    with BagReader(variant(change)) as bag:
        parts = list(in_parts(bag, '/dragon', stamps, ALONE.in_order))
        assert list(chain.from_iterable(parts)) == stamps(frames(bag))
        assert len(parts) > (1 if change is damaged else 6)


_DRAWN = """
import sys
from pathlib import Path
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cli.pool import Pool
from dragon_ros.pictures.sources import dragon_in

with BagReader(Path(sys.argv[1])) as bag:
    one, two = dragon_in(bag), dragon_in(bag, pool=Pool(2))
    assert one.span_s == two.span_s
    ticks = []
    touch = one.first_touch(lambda rows: (ticks.append(0) or row for row in rows))
    assert touch == two.first_touch(iter) is not None
    assert len(ticks) > 50
    times_s = one.ticks_s(*one.span_s, 100)
    assert list(one.gaps(times_s)) == list(two.gaps(times_s))
"""


@pytest.mark.parametrize('change', thinned([None, damaged, late], lambda change: change is damaged))
def test_a_bag_is_drawn_from_the_same_numbers_with_any_number_of_workers(tmp_path, variant, change):
    ends_well(tmp_path, _DRAWN, variant(change))


def test_a_touch_in_a_bag_is_the_one_that_a_monitor_finds(long):
    tracker, begins = ContactTracker(), []
    with BagReader(long) as bag:
        touch = dragon_in(bag).first_touch(iter)
        for one in frames(bag, '/dragon', bag.end_ns - 2 * 10**9):      # it is in the end
            for report in tracker.add(Observation(one.t_ns, one.handles_m, one.benches, one.frame_id)):
                begins += report.begins
    assert (touch.t_s, touch.benches, touch.point_m) == (begins[0].t_contact_s, begins[0].benches, begins[0].point_m)


def test_an_animation_has_the_same_bytes_with_any_number_of_workers(capsys, tmp_path):
    files = [tmp_path / f'{name}.gif' for name in 'ab']
    more = ['--start', '411.5', '--stop', '413', '--pace', '5', '--around', 'head', '--follow',
            '--set', 'dragon.benches=30', '--dpi', '50', '--output']
    assert run(capsys, 'plot', 'animation', '--workers', 1, *more, files[0])[0] == 0
    assert elsewhere('plot', 'animation', '--workers', 2, *more, files[1])[0] == 0
    assert files[0].read_bytes() == files[1].read_bytes()


_CURVE = """
import numpy as np
from dragon_ros.cli.pool import Pool
from dragon_ros.pictures.sources import SceneSource
from dragon_ros.scenes.load import load_scene

scene, times_s = load_scene('winding'), np.linspace(400, 413, 200)
assert list(SceneSource('a', scene, Pool(2)).gaps(times_s)) == list(SceneSource('a', scene).gaps(times_s))
"""


def test_a_curve_of_a_scene_has_the_same_values_with_any_number_of_workers(tmp_path):
    ends_well(tmp_path, _CURVE)


BROKEN_OFF = {'check': ['inspect', 'BAG', '--check'],
              'export': ['export', 'BAG', '--output', 'a.csv'],
              'curve': ['plot', 'clearance', '--bag', 'BAG', '--output', 'a.png'],
              'animation': ['plot', 'animation', '--dpi', '60', '--output', 'a.gif']}


def broken_off(folder, request, what, end):
    """Start a command, call ``end`` once it has started a worker, and return its exit code and errors.

    Afterwards, the folder must be empty.
    """
    command = [request.getfixturevalue('whole') if one == 'BAG' else one for one in BROKEN_OFF[what]]
    with forked(*command, '--workers', '2', cwd=folder) as process:
        until = time.monotonic() + 60
        while not children(process.pid):
            assert time.monotonic() < until
            time.sleep(0.005)
        end(process)
        _, errors = process.communicate(timeout=60)
    assert list(folder.iterdir()) == []
    assert 'Traceback' not in errors
    return process.poll(), errors


@pytest.mark.parametrize('what', thinned(BROKEN_OFF, lambda what: what == 'export'))
def test_an_interrupt_ends_a_command_as_it_ends_a_single_process(tmp_path, request, what):
    assert broken_off(tmp_path, request, what, lambda process: os.kill(process.pid, signal.SIGINT))[0] == 1


@pytest.mark.parametrize('what', thinned(BROKEN_OFF, lambda what: what == 'export'))
def test_a_killed_worker_ends_a_command_in_one_line(tmp_path, request, what):
    code, errors = broken_off(tmp_path, request, what, lambda process: [
        os.kill(child, signal.SIGKILL) for child in children(process.pid)])
    assert (code, len(errors.splitlines())) == (1, 1)
    assert 'one of the worker processes was killed' in errors


@pytest.mark.parametrize(('what', 'more'), thinned(
    [('export', ()), ('animation', ('--start', '412', '--stop', '413'))], lambda case: case[0] == 'export'),
    ids=['export', 'animation'])
def test_a_full_disk_leaves_nothing_of_a_file(tmp_path, long, what, more):
    command = [long if one == 'BAG' else one for one in BROKEN_OFF[what]]
    code, errors = with_full_disk(tmp_path, 8, *command, *more, '--workers', '2')
    assert (code, len(errors.splitlines()), list(tmp_path.iterdir())) == (2, 1, [])
    assert 'cannot be written' in errors


@pytest.mark.parametrize('command', [('inspect', BAG, '--check'), ('export', BAG, '--output', 'a.csv'),
                                     ('plot', 'speeds'), ('simulate', '--output', 'a.mcap')])
def test_every_command_checks_the_number_of_workers(capsys, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    assert main([*command, '--workers', '0']) == 2
    assert '--workers' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_summary_of_a_bag_takes_no_workers(capsys):
    assert main(['inspect', 'a.mcap', '--workers', '2']) == 2
    assert '--workers' in capsys.readouterr().err
