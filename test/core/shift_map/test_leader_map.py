"""A leader map yields the whole chain in one product where no shift map covers it: mixed benches, and tight joints."""
import gc
import weakref
from threading import Thread

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples, thinned
from test_blocks import placement, tracks

from dragon_ros.core.chain.chain import conditioning, marched
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.forward import blocks_of, forward
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import FieldError, ModelEnd, TrackEndError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.promise import speed_promise_m_s
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.shift_map import leader_map
from dragon_ros.core.shift_map.leader_map import LeaderMap, MappedLinks
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from hard_cases import hard_cases

CASES = {problem.name: problem.scene for problem in hard_cases()}
MIXED = Mixed((Group(3.41), Group(2.2, 12), Group(2.55), Group(1.8, 10), Group(2.2, 4)))
# Floats cannot resolve the distances travelled along these tracks, or the dragon starts so close to its lock.
UNCOVERED = {'link-is-diameter'}
FEW = {'far-joined'}        # coordinates of 16 km are rounded too coarsely for the series of most cells
HARDEST = {'mixed-by-the-tail', 'tight', 'spirals', 'a-year-of-rounds'}
MAPPED = [name for name, scene in CASES.items() if compile_scene(scene).model.placement.leader_map]


def mapped_of(model, gone_m):
    """Return a model's links from its leader map, whether a shift map covers them or not, or None."""
    return model.placement.leader_map.links_of(model.leader.place((gone_m, 0.0)))


@pytest.mark.parametrize('name', thinned([name for name in MAPPED if name not in UNCOVERED], HARDEST.__contains__))
def test_chains_from_a_leader_map_are_those_of_the_march_to_a_tenth_of_the_promise(name):
    """The map is also compared on cases that a shift map covers, where it is not used."""
    simulation = compile_scene(CASES[name])
    model, covered = simulation.model, 0
    for gone_m in np.random.default_rng(7).uniform(*simulation.extent_m, 40).tolist():
        mapped = mapped_of(model, gone_m)
        if mapped is None:
            continue
        covered += 1
        chain, flat = model.march((gone_m, 0.0)), np.empty(2 * model.links_m.size + 2)
        condition = conditioning(chain)
        promise_m = simulation.promise_m * condition
        mapped.fill(flat)
        np.testing.assert_allclose(flat.reshape(-1, 2), chain.p, rtol=0, atol=0.1 * promise_m)
        mapped.velocities(chain, -float(model.direction), flat)
        mean_m = model.length_m / model.links_m.size
        speed_m_s = speed_promise_m_s(simulation.promise_m, mean_m, condition, 1.0)
        np.testing.assert_allclose(flat.reshape(-1, 2), chain.velocities(1.0), rtol=0, atol=0.1 * speed_m_s)
        mapped.headings(chain, flat)
        np.testing.assert_allclose(flat.reshape(-1, 2), chain.headings, rtol=0, atol=0.1 * promise_m / mean_m)
        places = tuple(values[::-model.direction] for values in mapped.places())
        np.testing.assert_allclose(model.track.points(*places), chain.p, rtol=0, atol=0.1 * promise_m)
    assert covered > (5 if name in FEW else 20)


@pytest.mark.parametrize(('name', 'every'), thinned([
    ('mixed-by-the-tail', 1.0), ('turn-by-the-tail', 1.0), ('mixed', 0.9), ('unwinding', 1.0), ('tight', 0.03),
    ('wiggle', 0.01), ('hairpin', 0.1)], lambda case: case[0] not in ('mixed', 'unwinding')))
def test_one_product_yields_mixed_benches_and_leaders_at_tight_joints(name, every):
    simulation = compile_scene(CASES[name])
    chains = [simulation.model.place((gone_m, 0.0)) for gone_m in np.linspace(*simulation.extent_m, 201).tolist()]
    mapped = [isinstance(chain.parts[0], MappedLinks) for chain in chains]
    assert np.mean(mapped) >= every
    assert all(len(chain.parts) == 1 for chain, one in zip(chains, mapped, strict=True) if one)
    assert all(len(chain.parts) == 1 for chain in chains) or name == 'mixed'     # this case is marched next to its lock


@pytest.mark.parametrize('track', [Spiral(), STurn(before_m=20.0)], ids=['spiral', 'turn'])
def test_a_dragon_whose_benches_all_differ_is_in_one_product(track):
    scene = Scene(Mixed(tuple(Group(2.2 + 0.001 * (n * 7 % 40)) for n in range(40))), track, run=Run(0, 60))
    model = compile_scene(scene).model
    assert model.placement.maps == {}
    for gone_m in np.linspace(5.0, 55.0, 21).tolist():
        chain, other = model.place((gone_m, 0.0)), model.march((gone_m, 0.0))
        assert [type(part) for part in chain.parts] == [MappedLinks]
        np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=2e-13)
        np.testing.assert_allclose(chain.velocities(1.0), other.velocities(1.0), rtol=0, atol=5e-13)


@examples(30)
@given(tracks, st.lists(st.tuples(st.sampled_from([0.05, 0.6, 1.1, 1.65]), st.integers(1, 12)), min_size=2, max_size=4),
       st.sampled_from([BEHIND, AHEAD]), st.floats(0, 1))
def test_on_any_track_any_mix_is_where_the_march_puts_it(pieces, mix, direction, part):
    links = np.array([1.65] * 8 + [length for length, count in mix for _ in range(count)])
    try:
        track = track_of(Composite((Line(60.0), *pieces, Line(60.0))))
        track.check_links(links)
    except FieldError:
        assume(False)
    low_m, high_m = track.joints_m[0] - 5, track.joints_m[-1] + 30
    leader = track.place_at(low_m + part * (high_m - low_m))
    try:
        other = marched(track, links, leader, direction)
    except TrackEndError:
        assume(False)
    place = placement(track, links, direction)
    one = place.place(leader)
    assert np.max(np.abs(one.p - other.p)) < 5e-13
    np.testing.assert_allclose(one.velocities(1.5), other.velocities(1.5), rtol=0, atol=5e-12)


@examples(20)
@given(st.integers(0, 28), st.integers(1, 3), st.sampled_from([0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-9, -1e-9, 1e-4]))
def test_next_to_a_cut_between_cells_chains_are_where_the_march_puts_them(handle, joint, past_m):
    """A handle at a joint is the end of a cell for the leader; a cut in the wrong place would bend a series there."""
    model = compile_scene(Scene(MIXED, STurn(before_m=60.0), run=Run(0, 100))).model
    track = model.track
    at_joint = Place(joint, DoubleDouble(track.segments[joint].first, 0.0))
    leader = forward(track, blocks_of(model.links_m[:handle], AHEAD), at_joint, AHEAD).place(-1)
    leader = track.place_at(track.distance_of(leader)[0] + past_m)
    one, other = model.placement.place(leader), marched(track, model.links_m, leader, BEHIND)
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=2e-13)
    np.testing.assert_allclose(one.velocities(1.0), other.velocities(1.0), rtol=0, atol=1e-12)


def fresh(scene):
    """Return a placement and a leader of a scene; the placement has its own tables."""
    model = compile_scene(scene).model
    return placement(model.track, model.links_m, model.direction), model.leader


@pytest.mark.parametrize('name', thinned(
    ['mixed-by-the-tail', 'turn-by-the-tail', 'tight'], lambda name: name == 'turn-by-the-tail'))
def test_places_have_the_same_bits_in_any_order_and_after_their_cells_were_dropped(name, monkeypatch):
    distances = np.random.default_rng(3).uniform(*compile_scene(CASES[name]).extent_m, 40).tolist()
    place, leader = fresh(CASES[name])
    first = [place.place(leader.place((gone_m, 0.0))) for gone_m in distances]
    monkeypatch.setattr(leader_map, '_MOST_BYTES', 1)       # only the latest stretch is kept
    other, leader = fresh(CASES[name])
    for gone_m, chain in reversed([*zip(distances, first, strict=True)]):
        again = other.place(leader.place((gone_m, 0.0)))
        assert again.p.tobytes() == chain.p.tobytes()
        assert again.velocities(1.0).tobytes() == chain.velocities(1.0).tobytes()
        assert len(other.leader_map._stretches.values) == 1 or name == 'tight'


def test_places_have_the_same_bits_while_another_thread_builds_cells():
    place, leader = fresh(CASES['mixed-by-the-tail'])
    other, _ = fresh(CASES['mixed-by-the-tail'])
    leaders = [leader.place((gone_m, 0.0)) for gone_m in np.linspace(0, 45, 60).tolist()]
    expected = [place.place(one).p.tobytes() for one in leaders]
    thread = Thread(target=lambda: [other.place(one) for one in leaders])
    thread.start()
    found = [other.place(one).p.tobytes() for one in reversed(leaders)]
    thread.join()
    assert found[::-1] == expected


def test_cells_are_built_only_where_leaders_are_and_once():
    place, leader = fresh(CASES['mixed-by-the-tail'])
    place.place(leader.place((10.0, 0.0)))
    cells = place.leader_map.cells
    assert 2 <= len(cells) < 30
    for gone_m in np.linspace(9.9, 10.1, 9):
        place.place(leader.place((gone_m, 0.0)))
    assert [id(one) for one in place.leader_map.cells] == [id(one) for one in cells]
    assert place.memory_bytes == place.leader_map.memory_bytes == sum(cell.memory_bytes for cell in cells) > 0


def test_on_a_track_of_very_many_pieces_stretches_have_no_cells_and_chains_are_placed_all_the_same(monkeypatch):
    pieces = tuple(Arc(3.0, (-1) ** k * 6.0) for k in range(60))
    scene = Scene(MIXED, Composite((Line(70.0), *pieces, Line(9.0)), start_m=95.0), run=Run(0, 4))
    place, leader = fresh(scene)
    chain, other = (solver(leader.place((2.0, 0.0))) for solver in (
        place.place, lambda one: marched(place.track, place.links_m, one, BEHIND)))
    assert place.leader_map.cells == []
    assert not isinstance(chain.parts[0], MappedLinks)
    np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=5e-13)
    monkeypatch.setattr(leader_map, '_MOST_CELLS', 10_000)
    place, leader = fresh(scene)
    assert isinstance(place.place(leader.place((2.0, 0.0))).parts[0], MappedLinks)
    np.testing.assert_allclose(place.place(leader.place((2.0, 0.0))).p, other.p, rtol=0, atol=5e-13)


@pytest.mark.parametrize('benches', [100, 400])
def test_more_columns_than_one_product_takes_join_without_a_seam(benches):
    scene = Scene(Mixed((Group(3.41), Group(2.2, benches), Group(2.5, 20))), STurn(before_m=20.0), run=Run(0, 60))
    model = compile_scene(scene).model
    chain, other = model.place((25.0, 0.0)), model.march((25.0, 0.0))
    part, = chain.parts
    assert (len(part.products) > 1) is (benches == 400)
    np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=1e-12)
    np.testing.assert_allclose(chain.velocities(1.0), other.velocities(1.0), rtol=0, atol=1e-12)


def test_chains_that_are_too_long_or_too_short_have_no_leader_map():
    for dragon in (Dragon(600), Dragon(7)):
        model = compile_scene(Scene(dragon, STurn(before_m=20.0), run=Run(0, 9))).model
        assert model.placement.leader_map is None
    assert compile_scene(Scene(MIXED, solver='march')).model.placement.leader_map is None


def test_beyond_both_ends_of_a_track_leaders_have_no_cell_and_the_march_says_why():
    track = Composite((Arc(9.0, 200.0), Line(20.0), Arc(5.0, 90.0)), start_m=55.0)
    place, _ = fresh(Scene(MIXED, track, run=Run(0, 1)))
    low_m, high_m = place.leader_map._range_m
    assert (low_m, high_m) == (-np.inf, place.track.end_m)
    place, _ = fresh(Scene(MIXED, track, Head(1.0, 'tail'), run=Run(0, 1)))
    low_m, high_m = place.leader_map._range_m
    assert low_m == -np.inf
    assert isinstance(place.place(place.track.place_at(high_m - 1e-9)).parts[0], MappedLinks)
    with pytest.raises(TrackEndError):
        place.place(place.track.place_at(high_m + 0.1))


@pytest.mark.parametrize(('back_m', 'covered'), [(2.0**34.5, True), (2.0**35.5, False)])
def test_so_far_along_a_track_that_floats_resolve_stretches_too_coarsely_leaders_have_no_cells(back_m, covered):
    """At these distances, floats are 3.8e-6 and 7.6e-6 m apart, and a millionth of a stretch is 5.7e-6 m long."""
    model = compile_scene(Scene(MIXED, Composite((Arc(9.0, 200.0), Line(20.0)), start_m=50.0), run=Run(0, 1))).model
    place, leader = placement(model.track, model.links_m, model.direction), model.track.place_at(-back_m)
    chain, other = place.place(leader), marched(model.track, model.links_m, leader, BEHIND)
    assert bool(place.leader_map.cells) is covered
    assert isinstance(chain.parts[0], MappedLinks) is covered
    np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=5e-13)


def test_leaders_next_to_a_lock_have_no_cell():
    scene = Scene(MIXED, Spiral(0.55, 6.0))
    simulation = compile_scene(scene)
    last_m = simulation.limit.t_s
    assert isinstance(simulation.model.place((1.0, 0.0)).parts[0], MappedLinks)
    assert not isinstance(simulation.model.place((last_m - 1e-6, 0.0)).parts[0], MappedLinks)
    with pytest.raises(ModelEnd):
        simulation.model.place((last_m + 1.0, 0.0))


@pytest.mark.parametrize('error', [IndexError, KeyError, AttributeError])
def test_a_mistake_in_building_cells_is_not_taken_for_a_leader_without_a_cell(error, monkeypatch):
    def mistaken(self, parts):
        raise error('planted')
    monkeypatch.setattr(LeaderMap, '_fitted', mistaken)
    place, leader = fresh(CASES['mixed-by-the-tail'])
    with pytest.raises(error, match='planted'):
        place.place(leader.place((10.0, 0.0)))


def test_a_placement_goes_with_its_leader_map_when_nobody_holds_it():
    place, leader = fresh(CASES['turn-by-the-tail'])
    place.place(leader.place((10.0, 0.0)))
    held = weakref.ref(place), weakref.ref(place.leader_map)
    gc.disable()
    try:
        del place
        assert [one() for one in held] == [None, None]
    finally:
        gc.enable()
