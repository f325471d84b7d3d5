"""The sums, exponents, verdicts and files of the pages ``cost tick``, ``cost first`` and ``cost scale`` are correct."""
import numpy as np
import pytest

from benchmarks import command, first_ticks, growth, live, scale, stages, ticks
from benchmarks.scale import build
from benchmarks.solvers import CHAIN_SOLVERS
from benchmarks.stages import STAGES, stages_of
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.cost.measure import Timing


def timing(seconds):
    return Timing(seconds, seconds, seconds, 9)


@pytest.mark.parametrize('benches', sorted({*growth.SIZES, *scale.SIZES, *scale.LIVE}))
def test_every_dragon_of_the_pages_on_growth_lies_within_the_world(benches):
    assert Scene(dragon=Dragon(benches)).dragon.benches == benches


@pytest.mark.parametrize('solver', CHAIN_SOLVERS)
def test_the_stages_of_a_tick_are_those_of_the_model(solver):
    scene = Scene(dragon=Dragon(30))
    calls = stages_of(scene, solver, 300.0)
    assert tuple(calls) == STAGES
    np.testing.assert_allclose(calls['chain']().p, state(scene, 300.0).p, atol=compile_scene(scene).promise_m)
    assert len(calls['encode']()) == 3
    assert calls['look']().clearance_m > 0


LIMITS_S = {'head': 0.0, 'chain': 1e-6, 'velocities': 1e-6, 'benches': 5e-7, 'look': 5e-7, 'encode': 2e-6,
            'publish': 2e-6}


def tick_rows():
    spent = {name: timing(1e-5) for name in (*STAGES, 'publish')}
    return ticks.Measured([ticks.Row('march', 'objects', {**spent, 'encode': timing(73e-5)}),
                           ticks.Row('march', 'bytes', spent)], LIMITS_S)


def test_the_tick_page_says_how_many_times_faster_than_before(tmp_path):
    with np.errstate(all='warn'):
        paths = command.write('tick', tick_rows(), tmp_path)
    assert [path.name for path in paths] == ['tick.md', 'tick.csv', 'tick.png', 'tick.svg']
    assert all(path.stat().st_size for path in paths)
    assert '| 70 | 11.3 | 10 |' in ticks.table(tick_rows())     # 70 us, where the machine needs 7
    last = ticks.table(tick_rows()).splitlines()[-1]
    assert last == '| limit of the machine | | - | 1 | 1 | 0.5 | 0.5 | 2 | 2 | 7 | | 1.00 |'
    assert len(ticks.csv_text(tick_rows()).splitlines()) == 1 + 2 * 7


def test_without_ros_the_tick_page_leaves_publishing_out(monkeypatch, capsys):
    monkeypatch.setattr(ticks.sys, 'executable', 'false')
    assert ticks._messages(0.0) == {}
    assert 'publishing is omitted' in capsys.readouterr().err
    row = ticks.Row('march', 'bytes', {name: timing(1e-5) for name in STAGES})
    assert '| - | 60 | 1.0 | 12 |' in ticks.table(ticks.Measured([row], LIMITS_S))      # the limit is 5 us


def test_the_limits_of_stages_are_what_they_need_at_the_rates_of_the_machine(monkeypatch):
    monkeypatch.setattr(ticks, 'tick_rates', lambda budget_s: {'product': 1e9, 'cache': 1e9})
    found = ticks._limits_s(0.0)
    assert (found['head'], found['look'], found['publish']) == (0.0, pytest.approx(8e-9 * 4 * 223), found['encode'])
    terms = [stages.multiplications(state(Scene(), t_s)) for t_s in ticks._TIMES_S]
    assert found['chain'] == found['velocities'] == pytest.approx(8e-9 * np.mean(terms))


@pytest.mark.long
def test_publishing_is_measured_where_ros_is():
    pytest.importorskip('rclpy')
    assert set(ticks._messages(0.01)) == {'bytes publish', 'objects encode', 'objects publish'}


def first_row(*seconds):
    return first_ticks.Row('bend', 224, 3, dict(zip(first_ticks.CALLS, map(timing, seconds), strict=True)), 2e-4)


@pytest.mark.parametrize(('seconds', 'tick'), [
    ((10.2e-3, 1e-5, 2e-4, 2.1e-4), 51), ((1e-3, 1e-5, 2e-3, 2e-4), 1), ((1e-2, 3e-4, 2e-4, 2e-4), np.inf)])
def test_a_map_has_paid_where_the_march_has_taken_longer(seconds, tick):
    row = first_row(*seconds)
    assert row.pays_from == pytest.approx(tick)
    if 1 < tick < np.inf:
        first, later, first_marched, marched = seconds
        assert first + later * (tick - 2) > first_marched + marched * (tick - 2) - 1e-9
        assert first + later * (tick - 1) <= first_marched + marched * (tick - 1) + 1e-9


def test_the_street_of_the_page_has_tables():
    scene = first_ticks.street(60)
    assert state(scene, 0.0).solver.startswith('table')
    assert len(compile_scene(scene).model.track.segments) == 62


def test_every_scene_of_the_page_of_first_ticks_uses_a_map_for_all_ticks_that_are_timed():
    for name, scene in first_ticks.scenes().items():
        ends = [state(scene, scene.run.seconds(scene.run.time_ns(k))).solver for k in (0, first_ticks.TICKS - 1)]
        assert all(solver.startswith('table') for solver in ends), name


def test_the_page_of_first_ticks_has_a_line_a_scene_and_a_picture(tmp_path):
    rows = [first_row(10.2e-3, 1e-5, 2e-4, 2.1e-4), first_row(1e-2, 3e-4, 2e-4, 2e-4)]
    with np.errstate(all='warn'):
        paths = command.write('first', rows, tmp_path)
    assert [path.name for path in paths] == ['first.md', 'first.csv', 'first.png', 'first.svg']
    assert '| bend | 224 | 3 | 10.2 | 10.2 to 10.2 | 10 | 0.2 | 210 | 51 | 0.2 | 51 |' in first_ticks.table(rows)
    assert first_ticks.table(rows).endswith('| 200 | - | 0.2 | 50 |')
    assert len(first_ticks.csv_text(rows).splitlines()) == 1 + 2 * 4


def test_a_first_tick_is_that_of_the_run_with_a_table_of_its_own():
    scene = Scene(dragon=Dragon(30))
    kept = compile_scene(scene).model.placement
    chain = first_ticks.first_tick(scene)
    np.testing.assert_array_equal(chain.p, state(scene, scene.run.start_s).p)
    assert chain.solver == 'table'
    assert compile_scene(scene).model.placement is kept


def test_a_table_needs_the_products_that_make_its_series():
    scene = Scene(dragon=Dragon(30, width_m=0.301))      # its own model, which no other test has asked for tables
    state(scene, scene.run.start_s)
    (tile,) = (tile for shift in compile_scene(scene).model.placement.maps.values() for tile in shift.tiles)
    table = tile.table
    assert first_ticks.needs_of_first(scene) == [first_ticks.needs_of_table(table)]
    series = table.coordinates.size + table.places.size + table.motions.size
    assert first_ticks.needs_of_table(table)['product'] == 2 * table.nodes * series
    assert first_ticks.needs_of_table(table)['cache'] == table.memory_bytes
    assert first_ticks.needs_of_first(Scene(dragon=Dragon(3))) == []


def run(benches, rate_hz, overruns=0, missing=0, wall_s=2.0):
    usage = {role: live.Usage(0.5, 80.0, 1.0) for role in live.ROLES}
    return live.Live(benches, rate_hz, 100, wall_s, overruns, {'handles': missing}, usage)


def test_the_page_says_what_a_table_takes_and_nothing_where_there_is_none():
    scene = Scene(dragon=Dragon(30, width_m=0.302))
    row = build(scene)
    state(scene, 0.0)
    (tile,) = (tile for shift in compile_scene(scene).model.placement.maps.values() for tile in shift.tiles)
    assert (row.rows, row.terms, row.memory_bytes) == (tile.table.rows, tile.table.nodes, tile.table.memory_bytes)
    assert row.seconds > 0
    assert build(Scene(dragon=Dragon(3))) is None


def test_a_rate_is_held_only_without_overruns_and_losses():
    assert run(223, 50).held
    assert not run(223, 50, overruns=1).held
    assert not run(223, 50, missing=1).held


@pytest.mark.parametrize(('guess_hz', 'limit_hz', 'tried'), [
    (60, 100, [50, 70, 100, 150]), (600, 60, [50, 70, 100, 150, 200, 300, 500]), (1, 1e9, list(live.RATES_HZ)),
    (0.1, 1, [5])])
def test_the_search_ends_with_the_highest_rate_that_is_held(monkeypatch, guess_hz, limit_hz, tried):
    monkeypatch.setattr(live, 'run', lambda benches, rate_hz, _: run(benches, rate_hz, overruns=rate_hz > limit_hz))
    assert [row.rate_hz for row in live.highest(223, 1.0, guess_hz)] == tried


@pytest.mark.long
def test_the_scale_page_has_exponents_and_verdicts(tmp_path):
    spent = [scale.Stage('march', name, size, timing(1e-6 * size), 100 * size) for size in scale.SIZES
              for name in STAGES]
    rates = [run(223, 50), run(223, 70, overruns=3)]
    rows = scale.Measured(spent, [run(223, 0)], rates, [build(Scene(dragon=Dragon(30)))],
                          {size: 2e-6 * size for size in scale.SIZES})
    with np.errstate(all='warn'):
        paths = command.write('scale', rows, tmp_path)
    assert [path.name for path in paths] == ['scale.md', 'scale.csv', 'scale.png', 'scale.svg']
    text = scale.table(rows)
    assert text.count('N^1.00') == 2 * len(STAGES)
    assert '| 3 of 100 | 0 | no |' in text
    assert '| 0 of 100 | 0 | yes |' in text
    assert '| 3,000 | 3 | 3 | 3 | 3 | 3 | 3 | 3.00 |' in text       # six stages of 1 us a bench, where 2 us are needed
    assert len({line.count(',') for line in scale.csv_text(rows).splitlines()}) == 1


def test_the_limit_of_a_size_copies_as_fast_as_the_bytes_of_each_stage_are_copied(monkeypatch):
    sizes = []
    monkeypatch.setattr(scale, 'stage_copy_rate', lambda size, budget_s: sizes.append(size) or 1e9)
    scene = Scene(dragon=Dragon(30))
    needs = [one for one in stages.needs_of(scene, 300.0).values() if one]
    assert scale.limit_of(scene, 1e15, 0.0) == pytest.approx(1e-9 * sum(one['cache'] for one in needs))
    assert sizes == [one['cache'] for one in needs]
    assert scale.limit_of(scene, 1.0, 0.0) == pytest.approx(sum(one.get('product', 0.0) for one in needs), rel=1e-3)


@pytest.mark.parametrize(('rate_hz', 'ticks'), [(0, 20), (0, 16_646), (0, 20_000), (0, 99_999), (70, 21_000)])
def test_a_live_run_has_all_its_ticks_before_the_dragon_locks(rate_hz, ticks):
    plan = live.planned(223, rate_hz, ticks)
    assert compile_scene(Scene(run=plan)).last_tick + 1 == ticks
    assert plan.rate_hz == rate_hz or plan.rate_hz >= 50


def test_a_live_run_that_the_lock_would_end_is_refused():
    with pytest.raises(DragonError, match='20000 ticks at 50 Hz: the dragon locks after 16646 ticks'):
        live.planned(223, 50, 20_000)


@pytest.mark.long
def test_processes_over_dds_are_counted_to_the_last_message():
    pytest.importorskip('rclpy')
    row = live.run(20, 0, 60)
    assert (row.lost, row.overruns) == (0, 0)
    assert set(row.usage) == set(live.ROLES)
    assert all(usage.cores >= 0 and usage.rss_mb > 10 for usage in row.usage.values())
