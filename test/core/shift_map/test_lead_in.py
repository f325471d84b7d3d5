"""A leader one link before a block has its own series, so that one product yields the whole chain on any track."""
import numpy as np
import pytest
from properties import thinned
from test_blocks import TURNING, placement

from dragon_ros.core.chain.chain import marched
from dragon_ros.core.chain.dragon import Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.shift_map.leader_map import MappedLinks
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import Place, spiral_track
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral
from hard_cases import hard_cases

LINKS_M = np.array([2.86] + [1.65] * 222)


def hold(model, gone_m):
    """Compare a model's chain with the march, and return the chain's parts."""
    chain, other = model.place((gone_m, 0.0)), model.march((gone_m, 0.0))
    np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=1e-13)
    np.testing.assert_allclose(chain.velocities(1.0), other.velocities(1.0), rtol=0, atol=2e-13)
    for one, two in zip(chain.places, other.places, strict=True):
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-13)
    return chain.parts


@pytest.mark.parametrize('t_s', [0.0, 100.0, 300.0, 412.4])
def test_a_classic_chain_is_one_product_from_head_to_tail(t_s):
    part, = hold(compile_scene(Scene()).model, t_s)
    assert (part.start, part.links, part.solver) == (0, 223, 'table')


def test_close_to_a_lock_the_head_link_is_marched_and_the_block_is_not():
    chain = state(Scene(), 425.0)
    assert [part.solver for part in chain.parts] == ['', 'table']


def test_a_tail_before_a_block_is_in_its_product_too():
    mix = Mixed((Group(2.2, 40), Group(3.41)))
    part, = hold(compile_scene(Scene(mix, Spiral(0.55, 10.0), Head(1.0, 'tail'), Run(0, 60))).model, 31.0)
    assert (part.start, part.links) == (0, 41)


CASES = {problem.name: problem.scene for problem in hard_cases()}
BACK = Scene(Mixed((Group(2.2, 20), Group(3.41))), Composite((Line(40.0), Arc(4.0, 100.0), Arc(3.0, -80.0), Line(30.0)),
                                                             start_m=70.0), Head(1.0, 'tail'), Run(0, 25))


NEXT_TO_A_JOINT = {'arcs': (CASES['equal-arcs'], 0), 'handles': (CASES['joint-at-handles'], 0),
                   'circle': (CASES['circle'], 0), 'tail': (BACK, 0), 'turn': (TURNING, 0.01),
                   'wiggle': (CASES['wiggle'], 0.06)}


@pytest.mark.parametrize('name', thinned(NEXT_TO_A_JOINT, lambda name: name == 'tail'))
def test_leaders_next_to_a_joint_are_in_the_product_of_their_block_too(name):
    scene, alone = NEXT_TO_A_JOINT[name]
    simulation = compile_scene(scene)
    chains = [hold(simulation.model, gone_m) for gone_m in np.linspace(*simulation.extent_m, 201)]
    assert sum(parts[0].links == 1 for parts in chains) <= alone * len(chains)


def test_leaders_whose_series_beyond_a_joint_would_not_converge_are_in_the_leader_map():
    simulation = compile_scene(CASES['hairpin'])        # the head link is almost as long as its arc allows
    chains = [hold(simulation.model, gone_m) for gone_m in np.linspace(5.2, 8.0, 57)]
    assert all(len(parts) == 1 for parts in chains)
    assert 0 < sum(isinstance(parts[0], MappedLinks) for parts in chains) < len(chains)


@pytest.mark.parametrize('tile', thinned([0, -1], lambda tile: tile < 0))
def test_at_the_edge_of_a_tile_a_place_has_the_same_bits_from_either_side(tile):
    track = spiral_track(Spiral(), 0.0, may_lock=True)
    shift = placement(track, LINKS_M, BEHIND).maps[1.65]
    edge = shift._leader_at(tile, 2.86)
    near = [Place(0, DoubleDouble(edge.u.hi + ulps * np.spacing(edge.u.hi), 0.0)) for ulps in range(-3, 4)]
    behind, ahead = (Place(0, DoubleDouble(edge.u.hi + turn, 0.0)) for turn in (0.5, -0.5))
    for place in near:
        seen = set()
        for first in (behind, ahead, place):
            place_of = placement(track, LINKS_M, BEHIND)
            place_of.place(first)
            seen.add(place_of.place(place).p.tobytes())
        assert len(seen) == 1
        np.testing.assert_allclose(place_of.place(place).p, marched(track, LINKS_M, place, BEHIND).p,
                                   rtol=0, atol=1e-13)


@pytest.mark.parametrize(('scene', 'most'), [(Scene(), 65), (TURNING, 4 * 34)], ids=['spiral', 'turn'])
def test_leaders_have_series_only_on_the_stretch_that_was_asked_for(scene, most):
    """A stretch has 64 links on a spiral, or 32 with four parts each on a turn, and may cover part of one more row."""
    model = compile_scene(scene).model
    shift, = model.placement.maps.values()
    model.place((20.0, 0.0))
    assert most - 12 <= len(shift._last_before.lead_in.places) <= most
