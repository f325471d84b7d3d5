"""Studies on local workers, and on a real Dask cluster, which are killed, interrupted or run out of disk space.

Each study ends with the same data set as an uninterrupted run, which this process computes on its own.
"""
import json
import os
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from threading import Event

import pytest
from slow_study import SLOWER
from small_disk import small_disk

from dragon_ros.core.errors import DiskError, DragonError, InputError, MissingError
from dragon_studies.dataset import open_set, writing
from dragon_studies.rows import rows_of

psutil = pytest.importorskip('psutil')
ROOT = Path(__file__).parents[2]
LONGEST_S = 120
# One row kills its worker, as the system does when it runs out of memory.
DEADLY = """
import os, signal
from dragon_studies.questions import QUESTIONS
answer = QUESTIONS['lock'].answer
def deadly(self, asked):
    if asked.scene.dragon.width_m == 0.25:
        os.kill(os.getpid(), signal.SIGKILL)
    return answer(self, asked)
QUESTIONS['lock'].answer = deadly
"""


@contextmanager
def started(*arguments, **environment):
    """Run a Dask program for the duration of the block."""
    process = subprocess.Popen([sys.executable, '-m', 'dask', *map(str, arguments)], start_new_session=True,
                               env={**os.environ, 'PYTHONPATH': str(ROOT), **environment},
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def wait_for_workers(file, count, **options):
    import distributed  # slow to import
    with distributed.Client(scheduler_file=str(file), timeout=LONGEST_S, set_as_default=False, **options) as client:
        client.wait_for_workers(count, timeout=LONGEST_S)


@contextmanager
def dask_cluster(folder, *options, count=1, scheduler=(), **environment):
    """Start a scheduler and workers on this host; yield the scheduler file and both processes."""
    pytest.importorskip('distributed')
    file = folder / 'scheduler.json'
    alone = ('--host', '127.0.0.1', '--no-dashboard', '--dashboard-address', '127.0.0.1:0')
    with started('scheduler', *alone, '--port', 0, '--scheduler-file', file, *scheduler, **environment) as one, \
            started('worker', *alone, '--scheduler-file', file, '--nthreads', 1, '--nworkers', count,
                    '--local-directory', folder / 'scratch', *options, **environment) as other:
        wait_for_workers(file, count)
        yield str(file), one, other


@pytest.fixture(scope='module')
def cluster():
    """The module under test."""
    from dragon_studies import run
    return run


@pytest.fixture(scope='module')
def shared(tmp_path_factory):
    """A scheduler, and two workers with nannies that restart them."""
    with dask_cluster(tmp_path_factory.mktemp('dask'), count=2) as (file, _, workers):
        yield file, workers


@pytest.fixture(scope='module')
def undisturbed(study, without_times):
    return without_times(rows_of(study(SLOWER), range(48)))


def half_way(act):
    """Return a progress callback that acts once, halfway through the study."""
    acts = [act]

    def tell(progress):
        if progress.done >= progress.total // 2 and acts:
            acts.pop()()
    return tell


def nothing(progress):
    pass


@pytest.mark.long
def test_a_worker_that_is_killed_half_way_costs_no_row(cluster, study, undisturbed, without_times, shared, tmp_path):
    file, workers = shared
    victim = next(one for one in psutil.Process(workers.pid).children() if 'spawn_main' in ' '.join(one.cmdline()))
    with writing(tmp_path, study(SLOWER)) as data:
        done = cluster.complete(data, Event(), half_way(victim.kill), scheduler=file)
    assert not victim.is_running()
    assert done.done == 48
    assert without_times(open_set(tmp_path).table()) == undisturbed


@pytest.mark.long
def test_a_full_disk_half_way_keeps_what_was_there_and_the_next_run_goes_on(cluster, study, undisturbed, without_times,
                                                                            shared, tmp_path):
    with writing(tmp_path, study(SLOWER)) as data:
        with ExitStack() as full, pytest.raises(DiskError, match='rows are kept'):
            cluster.complete(data, Event(), half_way(lambda: full.enter_context(small_disk(100))), scheduler=shared[0])
        assert 24 <= data.count < 48
        cluster.complete(data, Event(), nothing, scheduler=shared[0])
    assert without_times(open_set(tmp_path).table()) == undisturbed


@pytest.mark.parametrize('workers', [1, 2, 3])
def test_any_number_of_workers_computes_the_same_rows(cluster, study, undisturbed, without_times, tmp_path, workers):
    with writing(tmp_path, study(SLOWER)) as data:
        done = cluster.complete(data, Event(), nothing, workers=workers)
    assert (done.done, done.workers) == (48, workers)
    assert without_times(open_set(tmp_path).table()) == undisturbed


def test_a_local_worker_that_is_killed_half_way_costs_no_row(cluster, study, undisturbed, without_times, tmp_path):
    before = set(psutil.Process().children())

    def kill():
        victim, *_ = set(psutil.Process().children()) - before
        victim.kill()
    with writing(tmp_path, study(SLOWER)) as data:
        done = cluster.complete(data, Event(), half_way(kill), workers=2)
    assert done.done == 48
    assert without_times(open_set(tmp_path).table()) == undisturbed


# The worker processes are forked from this program.
DEADLY_HERE = """
import sys
from pathlib import Path
from threading import Event
from dragon_ros.scenes.yaml import parse_document
from dragon_studies.dataset import writing
from dragon_studies.definition import study_of
from dragon_studies.run import complete
study = study_of(parse_document('f.yaml', sys.argv[1]), Path())
with writing(Path('data'), study) as data:
    complete(data, Event(), lambda progress: None, workers=2)
"""


def test_a_row_that_kills_its_local_workers_is_a_row_that_says_so(tmp_path):
    text = 'set: {dragon: {benches: 3}}\nvary: {dragon.width_m: [0.2, 0.22, 0.25, 0.3, 0.35, 0.4]}\nask: [lock]'
    subprocess.run([sys.executable, '-c', DEADLY + DEADLY_HERE, text], cwd=tmp_path, check=True, timeout=LONGEST_S,
                   env={**os.environ, 'PYTHONPATH': str(ROOT)})
    table = open_set(tmp_path / 'data').table()
    assert table.column('status').to_pylist() == ['ok', 'ok', 'failed', 'ok', 'ok', 'ok']
    assert 'every worker that computed it died' in table.column('reason').to_pylist()[2]


def listened(process):
    return [one for one in psutil.net_connections() if (one.pid, one.status) == (process.pid, psutil.CONN_LISTEN)]


def test_local_workers_do_not_listen(cluster, study, tmp_path):
    listening, others = [], set(psutil.Process().children(recursive=True))      # a cluster of other tests listens

    def look(progress):
        for process in set(psutil.Process().children(recursive=True)) - others:
            with suppress(psutil.NoSuchProcess):
                listening.extend(listened(process))
    before = listened(psutil.Process())
    with writing(tmp_path, study(SLOWER)) as data:
        cluster.complete(data, Event(), look, workers=2)
    assert listening == []
    assert listened(psutil.Process()) == before


@pytest.mark.long
def test_a_study_that_is_killed_half_way_goes_on(cluster, study, undisturbed, without_times, shared, tmp_path):
    (tmp_path / 'study.yaml').write_text(SLOWER)
    command = [sys.executable, '-m', 'dragon_ros', 'study', str(tmp_path / 'study.yaml'), '--output',
               str(tmp_path / 'data'), '--scheduler', shared[0]]
    process = subprocess.Popen(command, env={**os.environ, 'PYTHONPATH': str(ROOT)}, stderr=subprocess.DEVNULL)
    while process.poll() is None and not list((tmp_path / 'data').glob('rows/*.parquet')):
        Event().wait(0.01)
    process.kill()
    assert process.wait() in (-signal.SIGKILL, 0)
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / 'data').glob('rows/*.parquet')}
    assert before
    with writing(tmp_path / 'data', study(SLOWER)) as data:
        there = data.count
        done = cluster.complete(data, Event(), nothing, scheduler=shared[0])
    assert sum(done.statuses.values()) == 48 - there
    assert without_times(open_set(tmp_path / 'data').table()) == undisturbed


@pytest.mark.long
def test_batches_grow_with_the_speed_of_rows(cluster, study, shared, tmp_path):
    told = []
    with writing(tmp_path, study().with_samples(300)) as data:
        cluster.complete(data, Event(), lambda state: told.append(state.done), scheduler=shared[0])
    assert told[-1] == 300
    assert max(later - sooner for sooner, later in pairwise(told)) > 20


@pytest.mark.long
def test_a_stopped_study_goes_on_where_it_was(cluster, study, undisturbed, without_times, shared, tmp_path):
    stop = Event()
    with writing(tmp_path, study(SLOWER)) as data:
        first = cluster.complete(data, stop, half_way(stop.set), scheduler=shared[0])
        assert 24 <= first.done < 48
        second = cluster.complete(data, Event(), nothing, scheduler=shared[0])
        assert first.done + sum(second.statuses.values()) == 48
    assert without_times(open_set(tmp_path).table()) == undisturbed


@pytest.mark.long
def test_a_row_that_kills_its_workers_is_a_row_that_says_so(cluster, study, tmp_path):
    (tmp_path / 'deadly.py').write_text(DEADLY)
    one = study('set: {dragon: {benches: 3}}\nvary: {dragon.width_m: [0.2, 0.25, 0.3, 0.35]}\nask: [lock]')
    with dask_cluster(tmp_path, '--preload', 'deadly', count=2, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES='1',
                      PYTHONPATH=os.pathsep.join((str(ROOT), str(tmp_path)))) as (file, *_), \
            writing(tmp_path / 'data', one) as data:
        cluster.complete(data, Event(), nothing, scheduler=file)
        table = data.table()
    row = table.to_pylist()[1]
    assert (row['status'], row['lock_t_s']) == ('failed', None)
    assert 'every worker that computed it died' in row['reason']
    assert 'ok' in table.column('status').to_pylist()


@pytest.mark.long
def test_other_versions_are_refused_before_anything_is_computed(cluster, study, shared, tmp_path, monkeypatch):
    pytest.importorskip('distributed')
    scheduler = import_module('dragon_studies.scheduler')
    wanted = scheduler.versions() | {'numpy': '0.9'}
    monkeypatch.setattr(scheduler, 'versions', lambda: wanted)
    with writing(tmp_path, study()) as data, \
            pytest.raises(InputError, match=r'has numpy \S+, but this process has 0.9'):
        cluster.complete(data, Event(), nothing, scheduler=shared[0])
    assert list((tmp_path / 'rows').iterdir()) == []


def test_a_worker_of_another_version_that_joins_later_computes_nothing():
    pytest.importorskip('distributed')
    scheduler = import_module('dragon_studies.scheduler')
    with pytest.raises(InputError, match='worker has dragon_ros'):
        scheduler.checked(lambda rows: None, {'dragon_ros': '0.0.1'}, (0, 1))


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:9', 'nonsense://', 'nowhere.json'])
def test_a_scheduler_that_is_not_there_is_named(cluster, study, tmp_path, monkeypatch, address):
    pytest.importorskip('distributed')
    scheduler = import_module('dragon_studies.scheduler')
    monkeypatch.setattr(scheduler, '_CONNECT_S', 0.5)
    with writing(tmp_path, study()) as data, pytest.raises(MissingError, match='--scheduler .* cannot be reached'):
        cluster.complete(data, Event(), nothing, scheduler=address)


@pytest.mark.long
def test_a_scheduler_that_goes_away_is_told_and_what_came_is_kept(cluster, study, tmp_path):
    with dask_cluster(tmp_path) as (file, scheduler, _), writing(tmp_path / 'data', study(SLOWER)) as data:
        with pytest.raises(DragonError, match='rows are kept'):
            cluster.complete(data, Event(), half_way(scheduler.kill), scheduler=file)
        assert 24 <= data.count < 48


@pytest.mark.long
def test_ctrl_c_ends_a_study_in_order_and_says_how_to_go_on(tmp_path):
    (tmp_path / 'study.yaml').write_text(SLOWER.replace('samples: 48', 'samples: 20000'))
    command = [sys.executable, '-m', 'dragon_ros', 'study', 'study.yaml', '--output', 'data', '--workers', '1']
    process = subprocess.Popen(command, cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)}, text=True,
                               start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    while process.poll() is None and not list(tmp_path.glob('data/rows/*.parquet')):
        Event().wait(0.01)
    os.killpg(process.pid, signal.SIGINT)       # sent to all processes, as by a terminal
    out, err = process.communicate(timeout=LONGEST_S)
    assert process.returncode == 1, err
    assert 'to continue: ./dragon study study.yaml --output data --workers 1' in err
    assert 'Traceback' not in err, err
    assert 'rows (' in out
    assert open_set(tmp_path / 'data').count > 0


@pytest.mark.long
def test_tls_settings_of_dask_are_honoured(cluster, study, without_times, tmp_path):
    Security = pytest.importorskip('distributed.security').Security
    security = Security.temporary()
    made = {'ca': security.tls_ca_file, 'key': security.tls_client_key, 'cert': security.tls_client_cert}
    for name, text in made.items():
        (tmp_path / f'{name}.pem').write_text(text)
    paths = {name: str(tmp_path / f'{name}.pem') for name in ('ca', 'key', 'cert')}
    tls = ('--tls-ca-file', paths['ca'], '--tls-cert', paths['cert'], '--tls-key', paths['key'])
    alone = ('--host', 'tls://127.0.0.1', '--no-dashboard', '--dashboard-address', '127.0.0.1:0', *tls)
    file = tmp_path / 'scheduler.json'
    with started('scheduler', *alone, '--port', 0, '--scheduler-file', file), \
            started('worker', *alone, '--scheduler-file', file, '--nthreads', 1, '--no-nanny', '--local-directory',
                    tmp_path / 'scratch'), writing(tmp_path / 'data', study()) as data:
        wait_for_workers(file, 1, security=Security(tls_ca_file=paths['ca'], tls_client_key=paths['key'],
                                                    tls_client_cert=paths['cert'], require_encryption=True))
        address = json.loads(file.read_text())['address']
        import dask
        with dask.config.set({'distributed.comm.tls.ca-file': paths['ca'],
                              'distributed.comm.tls.client.key': paths['key'],
                              'distributed.comm.tls.client.cert': paths['cert']}):
            cluster.complete(data, Event(), nothing, scheduler=address)
        assert without_times(data.table()) == without_times(rows_of(study(), range(12)))
    with writing(tmp_path / 'other', study()) as data, pytest.raises(MissingError, match='cannot be reached'):
        cluster.complete(data, Event(), nothing, scheduler=address)
