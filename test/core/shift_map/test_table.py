"""The shift map of a spiral places all handles at once, as exactly as forward placement.

The promises are tested against the 50-digit reference in test_accuracy.
"""
from dataclasses import replace
from threading import Thread

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.chain import MarchedLink, marched
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.forward import Block, forward_many
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import ChainLockError, FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.shift_map import build
from dragon_ros.core.shift_map.blocks import Placement, TabulatedLinks, TabulatedStates, lengths_with_maps
from dragon_ros.core.shift_map.table import ShiftMap, Tile
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.core.tracks.spiral import SpiralSegment
from hard_cases import hard_cases

CLASSIC, MARCHED = Scene(), Scene(solver='march')
LONG = ('most-benches', 'longest-chain')
# Six links, and next to a lock.
MARCHED_CASES = {'centre', 'mixed-lock'}


def tiles(scene):
    """Return the tiles that are built for a scene with one shift map."""
    shift, = compile_scene(scene).model.placement.maps.values()
    return shift.tiles


def tile(scene, t_s):
    """Return the only tile that a state of a scene needs, built in a new shift map."""
    (link_m, links), = lengths_with_maps(scene.dragon.link_lengths_m).items()
    model = compile_scene(scene).model
    shift = ShiftMap(model.track, link_m, links, model.direction)
    Placement(model.track, model.links_m, model.direction, {link_m: shift}).place(
        model.leader.place(scene.head.travelled_m(t_s)))
    one, = shift.tiles
    return one


@pytest.mark.parametrize('scene', [CLASSIC, Scene(track=Spiral(0.55, 750.0)), Scene(track=Spiral(0.2, 16.0)),
                                   Scene(track=STurn(before_m=100.0), run=Run(0, 200)),
                                   Scene(track=Spiral(0.55, 6.0), head=Head(1.0, 'tail'), run=Run(0, 300)),
                                   Scene(track=Composite((Arc(30.0, 700.0), Line(50.0), Arc(9.0, -90.0))))],
                         ids=['classic', 'far', 'near', 'turning', 'tail', 'joined'])
def test_rows_that_are_found_all_at_once_are_those_found_one_by_one(monkeypatch, scene):
    found, along, track = [], build._along, compile_scene(scene).model.track

    def checked(segment, link_m, first, count):
        rows = along(segment, link_m, first, count)
        found.append(rows is not None)
        one_by_one, _ = forward_many(track, (Block(0, count, link_m),), first, BEHIND)
        off = rows[1] - one_by_one[1][1:]
        unit_m = segment.curve.b_m if isinstance(segment, SpiralSegment) else abs(segment.rate(0.0))
        assert np.max(np.abs(off)) < 1e-13 * max(1.0, link_m / unit_m)
        np.testing.assert_array_equal(rows[0], one_by_one[0][1:])
        return rows
    monkeypatch.setattr(build, '_along', checked)
    tile(scene, 0.0)
    assert found
    assert all(found)


def test_stats_say_which_solver_ran():
    assert state(CLASSIC, 300.0).solver == states(CLASSIC, [300.0]).solver == 'table'
    assert state(MARCHED, 300.0).solver == states(MARCHED, [300.0]).solver == 'march'
    assert state(replace(CLASSIC, accuracy='paper'), 300.0).solver == 'paper'


@pytest.mark.parametrize('problem', thinned(hard_cases(), lambda problem: problem.name not in LONG),
                         ids=lambda problem: problem.name)
def test_the_table_serves_every_hard_case_but_these(problem):
    solvers = {state(problem.scene, t_s).solver for t_s in problem.times_s}
    assert ('march' in solvers) == (problem.name in MARCHED_CASES)


@pytest.mark.parametrize('t_s', [0.0, 60.3, 300.0, 412.47, 432.0, 432.6, 432.9])
def test_table_and_march_agree_within_half_the_promise(t_s):
    one, other = state(CLASSIC, t_s), state(MARCHED, t_s)
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.velocities(1.5), other.velocities(1.5), rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.headings, other.headings, rtol=0, atol=1e-13)


def test_many_states_agree_with_single_ones_in_any_order():
    times = [300.0, 0.0, 412.0, 300.05, 432.5, 1.0, 1.0]
    many = states(CLASSIC, times)
    speed = many.velocities(np.arange(1.0, 8.0))
    for k, t_s in enumerate(times):
        np.testing.assert_allclose(many.p[k], state(CLASSIC, t_s).p, rtol=0, atol=1e-13)
        np.testing.assert_allclose(speed[k], state(CLASSIC, t_s).velocities(k + 1.0), rtol=0, atol=1e-12)
        np.testing.assert_allclose(many.headings[k], state(MARCHED, t_s).headings, rtol=0, atol=1e-13)


def test_no_states_are_a_chain_of_no_states():
    assert states(CLASSIC, []).p.shape == (0, 224, 2)


@examples(50, long=100)
@given(st.floats(0.3, 2), st.floats(4, 40), st.integers(8, 80), st.floats(0.8, 4), st.floats(0.8, 3), st.floats(-1, 1),
       st.floats(0, 0.999))
def test_any_dragon_on_the_table_is_where_the_march_puts_it(pitch, turns, benches, head, body, speed, part):
    try:
        scene = Scene(dragon=Dragon(benches, head, body), track=Spiral(pitch, turns), head=Head(speed), run=Run(0, 100))
        t_s = part * compile_scene(scene).end.t_s
    except (ChainLockError, FieldError):
        assume(False)
    one, other = state(scene, t_s), state(replace(scene, solver='march'), t_s)
    faster = max(1.0, float(np.max(np.hypot(*other.velocities(1.0).T))))
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=0.5 * compile_scene(scene).promise_m * faster)


def test_runs_on_one_track_share_their_bits():
    late = replace(CLASSIC, run=Run(400, 413, 10))
    assert tick(late, 7).chain.p.tobytes() == state(CLASSIC, 400.7).p.tobytes()


def test_a_track_however_long_is_served_in_tiles_wherever_the_run_is():
    far = Scene(dragon=Dragon(20), track=Spiral(0.55, 750.0), run=Run(1000, 1010))
    for t_s in (1005.0, 2.0, 9e5):
        assert state(far, t_s).solver == 'table'
        assert tile(far, t_s).table.rows < 600


def test_a_tile_is_bounded_in_size():
    assert tile(CLASSIC, 300.0).table.memory_bytes < 350_000
    assert tile(Scene(track=Spiral(0.55, 750.0), run=Run(0, 1e6)), 0.0).table.memory_bytes < 350_000


def test_a_shift_map_keeps_the_tiles_that_were_used_last_within_its_bytes(monkeypatch):
    scene = Scene(dragon=Dragon(20), track=Spiral(0.55, 750.0), accuracy='standard', run=Run(0, 1e6))
    most = 3.5 * tile(scene, 0.0).memory_bytes
    monkeypatch.setattr('dragon_ros.core.shift_map.table._MOST_BYTES', most)
    first = state(scene, 100.0).p
    for t_s in np.linspace(0, 2e4, 15).tolist():
        state(scene, t_s)
    for _ in range(2):
        assert 2 <= len(tiles(scene)) < 15
        assert sum(one.memory_bytes for one in tiles(scene)) <= most
        assert state(scene, 100.0).p.tobytes() == first.tobytes()


def test_a_dragon_without_eight_equal_links_has_no_shift_map():
    assert compile_scene(Scene(dragon=Dragon(8))).model.placement.maps == {}
    assert len(compile_scene(Scene(dragon=Dragon(9))).model.placement.maps) == 1


def test_products_in_parts_join_without_a_seam():
    long = Scene(dragon=Dragon(3000), run=Run(0, 400))
    np.testing.assert_allclose(state(long, 200.0).p, state(replace(long, solver='march'), 200.0).p, rtol=0,
                               atol=compile_scene(long).promise_m)


def test_what_the_table_returns_is_closed_for_writing():
    for chain in (state(CLASSIC, 1.0), states(CLASSIC, [1.0])):
        for array in (chain.p, chain.velocities(1.0), chain.headings):
            with pytest.raises(ValueError, match='read-only'):
                array[0] = 0


def test_a_head_without_a_place_for_its_link_is_a_lock():
    with pytest.raises(ChainLockError, match='link 0'):
        compile_scene(CLASSIC).model.place(432.93)
    with pytest.raises(ChainLockError, match='link 0'):
        compile_scene(CLASSIC).model.place_many(np.array([100.0, 432.93]))


def test_an_unknown_solver_is_refused():
    with pytest.raises(FieldError, match='table, march'):
        Scene(solver='magic')


def test_far_out_fewer_terms_are_summed_and_no_digit_is_lost():
    long = Scene(dragon=Dragon(3000), run=Run(0, 400))
    terms = tile(long, 1.0).table.terms
    assert np.all(terms[:, -1] < terms[:, 0])
    assert np.all(np.diff(terms) <= 0)
    np.testing.assert_allclose(state(long, 1.0).p[-9:], state(replace(long, solver='march'), 1.0).p[-9:], rtol=0,
                               atol=1e-12)


def test_the_cells_of_a_long_run_are_views_of_its_tables_and_count_as_memory():
    """The run of 3 km covers several tiles; in a soak test, copies of their series once grew by 45 kB/s."""
    scene = Scene(dragon=Dragon(60), track=Spiral(0.55, 750.0), run=Run(0.0, 3000.0, 1.0))
    first = tick(scene, 0).chain.p.tobytes()
    for k in range(0, 3000, 4):
        tick(scene, k)
    products = [(product, one) for one in tiles(scene) for cell in one._cells.values()
                for some in cell.products.values() for product in some]
    assert len(tiles(scene)) > 3
    assert len(products) > 700
    assert all(np.shares_memory(product.places, one.table.places) for product, one in products)
    sizes = [one.memory_bytes - one.table.memory_bytes for one in tiles(scene)]
    assert sum(sizes) > 1000 * len(products)
    assert tick(scene, 0).chain.p.tobytes() == first


@pytest.mark.parametrize('name', ['wiggle', 'spirals', 'after-a-long-way', 'mixed-by-the-tail'])
def test_many_places_are_on_the_sections_where_each_is_to_the_last_bit(name):
    scene = next(case.scene for case in hard_cases() if case.name == name)
    model = compile_scene(scene).model
    low_m, high_m = compile_scene(scene).span_m
    for shift in model.placement.maps.values():
        first, last = (shift._number(model.track.place_at(metres)) for metres in (low_m, high_m))
        begins = [place for number in range(first, last + 2) if (place := shift._boundary(number))]
        nearby = [Place.of(place.segment, u) for place in begins
                  for u in (np.nextafter(place.u, -np.inf), place.u, np.nextafter(place.u, np.inf))]
        places = [*nearby, *(model.track.place_at(metres) for metres in np.linspace(low_m, high_m, 200).tolist())]
        segment, u = (np.array(values) for values in zip(*places, strict=True))
        assert begins
        assert shift._numbers((segment, u)).tolist() == [shift._number(place) for place in places]
        for place in places:        # each place lies within its section
            number = shift._number(place)
            assert not shift._is_behind(place, number)
            assert shift._is_behind(place, number + 1)


@pytest.mark.parametrize('error', [IndexError, KeyError, AttributeError])
def test_a_mistake_in_looking_up_a_cell_is_not_taken_for_a_place_without_a_table(monkeypatch, error):
    def mistaken(self, number):
        raise error('planted')
    model = compile_scene(Scene(dragon=Dragon(8, 2.2))).model
    placement = Placement(model.track, model.links_m, model.direction, {
        link_m: ShiftMap(model.track, link_m, 8, model.direction)
        for link_m in lengths_with_maps(model.links_m)})
    assert 'table' in placement.place(model.leader.place(0.0)).solver
    monkeypatch.setattr(Tile, '_cell', mistaken)
    with pytest.raises(error, match='planted'):     # the leader is on the same section, in another cell
        placement.place(model.leader.place(3.0))


LAST = {'places': (1.0, 1.0), 'motions': (1.0, 2.0), 'coordinates': (5.0, 1.0), 'inverse': (5.0, 1.0)}


@pytest.mark.parametrize('term', [-2, -1])
@pytest.mark.parametrize('name', LAST)
def test_what_either_of_the_last_two_terms_contributes_is_told_in_units_of_the_error(name, term):
    """A coordinate's term is scaled by half a part, 5 m, and a velocity's term by a link, 2 m."""
    parts, rows, error_m = 2, 3, np.array([1e-3, 1e-6, 1e-3])
    series = {key: np.zeros((parts, build.NODES, rows * (2 if key in ('places', 'motions') else 1))) for key in LAST}
    series['places'][:, 1, ::2] = 5.0
    series[name][1, term, 2 if name in ('places', 'motions') else 1] = -0.25
    half_m, link_m = LAST[name]
    found = build._left(build._RowSeries(np.zeros((rows, parts), dtype=np.int64), np.zeros(1),
                                         slice(0, rows), error_m, series['coordinates'], series['places'],
                                         series['motions']), series['coordinates'], series['inverse'], 2.0)
    assert found == pytest.approx([0.0, 0.25 * half_m * link_m / 1e-6])


def street(pieces, turns_deg, seed):
    """Return a street of arcs almost too tight for the head's link, with a dragon at its far end."""
    rng = np.random.default_rng(seed)
    track = (Line(500.0), *(Arc(rng.uniform(1.46, 1.6), (-1) ** k * rng.uniform(*turns_deg)) for k in range(pieces)),
             Line(30.0))
    end_m = track_of(Composite(track)).end_m
    return Scene(track=Composite(track, start_m=end_m - 40), run=Run(0, 20))


def test_series_that_rounding_ends_a_little_early_have_a_table_that_keeps_the_promise():
    simulation = compile_scene(street(120, (30, 60), 2))
    chain, other = simulation.model.place(3.0), simulation.model.march(3.0)
    assert [type(part) for part in chain.parts] == [MarchedLink, TabulatedLinks]
    np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=0.1 * simulation.promise_m)
    np.testing.assert_allclose(chain.velocities(1.0), other.velocities(1.0), rtol=0, atol=0.1 * simulation.promise_m)


def test_series_that_rounding_ends_far_too_early_have_no_table():
    model = compile_scene(street(40, (50, 80), 1)).model
    shift = ShiftMap(model.track, 1.65, 222, model.direction)
    assert shift._tile(shift._number(model.leader.place(3.0)), 0) is None


@pytest.mark.parametrize('pieces', [
    (Line(30.0), *(Arc(2.0 + 0.1 * (k % 3), (-1) ** k * 17.0) for k in range(30)), Line(20.0)),
    (Line(30.0), *(piece for k in range(8) for piece in (SpiralArc(0.9, 2.0 + k, 2.5 + k), Line(0.7))), Arc(2.0, 9.0))],
    ids=['arcs', 'spirals'])
def test_joints_that_are_moved_ahead_together_are_where_each_alone_is(pieces, monkeypatch):
    track, link_m = track_of(Composite(pieces)), 1.65
    back_m = track.end_m - 5.0
    joints = [Place(k, track.segments[k].first) for k in range(1, len(track.segments) - 1)]
    monkeypatch.setattr(build, '_MANY_JOINTS', 1)
    together = build._nearly_pulled(track, link_m, joints, back_m)
    assert sum(one != joint for one, joint in zip(together, joints, strict=True)) > len(joints) // 2
    for one, joint in zip(together, joints, strict=True):
        off_m = np.subtract(*(track.distance_of(build._pulled(track, link_m, place, back_m)) for place in (one, joint)))
        assert abs(off_m) < 1e-12


# Each of these has so many joints within reach of the dragon that its tiles are divided into groups of parts. The last
# track begins where the dragon's tail is.
STREETS = {
    'head': replace(street(120, (30, 60), 2), dragon=Dragon(60)),
    'even links': replace(street(80, (30, 60), 2), dragon=Dragon(40, 2.2)),
    'tail': replace(street(120, (30, 60), 2), dragon=Dragon(60, 2.2), head=Head(-1.0, 'tail')),
    'begins': Scene(Dragon(60), Composite((SpiralArc(1.0, 2.0, 4.0), *(Arc(2.0, (-1) ** k * 40.0) for k in range(100)),
                                           Line(30.0)), start_m=130.0), Head(-1.0), run=Run(0, 5))}


def laid_out(scene):
    """Return the model of a scene, a placement without tables, and its shift map with a layout at the leader."""
    model = compile_scene(scene).model
    place = replace(model.placement, maps={link_m: ShiftMap(model.track, link_m, links, model.direction)
                                           for link_m, links in lengths_with_maps(model.links_m).items()})
    shift, = place.maps.values()
    return model, place, shift


def travelled(scene, times_s):
    """Return the positions of the leader."""
    model = compile_scene(scene).model
    return [model.leader.place(scene.head.travelled_m(t_s)) for t_s in times_s]


@pytest.mark.parametrize('name', thinned(STREETS, 'head'.__eq__))
def test_on_a_street_of_many_pieces_chains_are_where_the_march_puts_them(name):
    (_, place, shift), promise_m = laid_out(STREETS[name]), compile_scene(STREETS[name]).promise_m
    solvers = set()
    for leader in travelled(STREETS[name], np.linspace(0.5, 4.5, 31).tolist()):
        chain, other = place.place(leader), marched(place.track, place.links_m, leader, place.direction)
        solvers |= {type(part) for part in chain.parts if part.links > 1}
        np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=0.1 * promise_m)
        np.testing.assert_allclose(chain.velocities(1.0), other.velocities(1.0), rtol=0, atol=0.1 * promise_m)
    assert solvers == {TabulatedLinks}
    assert len({tile.group for tile in shift.tiles}) >= 2


def test_the_first_place_on_a_street_of_many_pieces_builds_the_table_of_one_group():
    _, place, shift = laid_out(STREETS['even links'])
    leader, = travelled(STREETS['even links'], [1.0])
    place.place(leader)
    tile, = shift.tiles
    groups = tile.span.groups
    assert len(groups) >= 2
    assert sum(map(len, groups)) > len(groups[tile.group])
    place.build_near(leader)
    assert sorted(one.group for one in shift.tiles) == [*range(len(groups))]


@pytest.mark.parametrize('name', thinned(STREETS, 'head'.__eq__))
def test_on_a_street_places_have_the_same_bits_whatever_tables_exist(name, monkeypatch):
    leaders = travelled(STREETS[name], np.random.default_rng(4).uniform(0.5, 4.5, 3).tolist())
    _, place, _ = laid_out(STREETS[name])
    expected = [(chain.p.tobytes(), chain.velocities(1.0).tobytes()) for chain in map(place.place, leaders)]
    _, other, shift = laid_out(STREETS[name])
    monkeypatch.setattr('dragon_ros.core.shift_map.table._MOST_BYTES', 1)       # only the latest tile is kept
    monkeypatch.setattr('dragon_ros.core.shift_map.table._MOST_SPANS', 1)       # and only the latest span
    for leader, bits in reversed([*zip(leaders, expected, strict=True)]):
        chain = other.place(leader)
        assert (chain.p.tobytes(), chain.velocities(1.0).tobytes()) == bits
        assert len(shift.tiles) == 1


def test_on_a_street_places_have_the_same_bits_while_another_thread_builds_tables():
    leaders = travelled(STREETS['head'], np.linspace(0.5, 4.5, 40).tolist())
    _, place, _ = laid_out(STREETS['head'])
    expected = [place.place(leader).p.tobytes() for leader in leaders]
    _, other, _ = laid_out(STREETS['head'])
    thread = Thread(target=other.build_near, args=(leaders[0],))
    thread.start()
    found = [other.place(leader).p.tobytes() for leader in reversed(leaders)]
    thread.join()
    assert found[::-1] == expected


@pytest.mark.parametrize('name', thinned(STREETS, 'head'.__eq__))
def test_next_to_the_beginning_of_a_group_a_leader_is_in_one_group_and_chains_are_where_the_march_puts_them(name):
    model, place, shift = laid_out(STREETS[name])
    leader, = travelled(STREETS[name], [2.0])
    place.place(leader)
    span = shift.tiles[0].span
    groups, promise_m = span.lookup, compile_scene(STREETS[name]).promise_m
    begins = span.begins()
    here_m, compared = model.track.distance_of(leader), 0
    for begin, group in begins:
        if abs(model.track.distance_of(begin) - here_m) > 2.0:
            continue
        for past_m in (-1e-6, 1e-6):
            one = model.track.place_at(model.track.distance_of(begin) + past_m)
            assert groups.of(one) == (group if past_m < 0 else (group - 1) % len(span.groups))
        for past_m in (-1e-12, -1e-13, 0.0, 1e-13, 1e-12):
            one = model.track.place_at(model.track.distance_of(begin) + past_m)
            chain, other = place.place(one), marched(model.track, model.links_m, one, model.direction)
            np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=0.1 * promise_m)
            compared += 1
    assert compared >= 10
    many = [model.track.place_at(metres) for metres in np.linspace(here_m - 3, here_m + 3, 300).tolist()]
    some = tuple(np.array(values) for values in zip(*many, strict=True))
    assert groups.of_many(some).tolist() == [groups.of(one) for one in many]


@pytest.mark.parametrize('name', thinned(STREETS, 'even links'.__eq__))
def test_many_places_on_a_street_agree_closely_with_each(name):
    _, place, _ = laid_out(STREETS[name])
    leaders = travelled(STREETS[name], np.linspace(0.5, 4.5, 25).tolist())
    chain = place.place_many(tuple(np.array(values) for values in zip(*leaders, strict=True)))
    assert any(isinstance(part, TabulatedStates) for part in chain.parts)
    for p, leader in zip(chain.p, leaders, strict=True):
        np.testing.assert_allclose(p, place.place(leader).p, rtol=0, atol=1e-12)
