"""Inputs at the edge of the world are accepted; the next beyond it are rejected with the name of their field."""
from math import pi, sqrt

import pytest

from dragon_ros.core import domain
from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.core.venue import LineObstacle, Venue
from dragon_ros.verify import reading


def piece(kind, **values):
    return lambda name: lambda value: Composite((kind(**{**values, name: value}),))


LINE, ARC = piece(Line, length_m=1.0), piece(Arc, radius_m=9.0, angle_deg=90.0)
SPIRAL = piece(SpiralArc, pitch_m=1.0, from_turns=5.0, to_turns=2.0)
NUMBERS = {
    'spiral pitch_m': (Spiral, 0.01, 100.0), 'turn pitch_m': (STurn, 0.01, 100.0),
    'spiral start_turns': (lambda turns: Spiral(0.55, turns), 0.0, sqrt(1e6 / (pi * 0.55))),
    'turn diameter_m': (lambda size: STurn(diameter_m=size), 0.01, 2 * sqrt(1e6 * 1.7 / pi)),
    'turn ratio': (lambda ratio: STurn(ratio=ratio), 1e-3, 1e3),
    'turn before_m': (lambda metres: STurn(before_m=metres), -1e6, 1e6),
    'line length_m': (LINE('length_m'), 5e-324, 1e6), 'line heading_deg': (LINE('heading_deg'), -1e6, 1e6),
    'line at_m': (lambda x: LINE('at_m')((0.0, x)), -1e4, 1e4),
    'arc radius_m': (lambda size: Composite((Arc(size, 1e-6),)), 0.01, 1e9),
    'arc angle_deg': (ARC('angle_deg'), -1e6, 1e6),
    'piece pitch_m': (SPIRAL('pitch_m'), 0.01, 100.0),
    'bench link': (lambda size: Dragon(1, 3.41, size, hole_inset_m=0.0), 0.05, 50.0),
    'bench in links': (lambda size: Dragon(1, size, size, hole_inset_m=0.5 * (size - 0.5)), 0.5, 10.0),
    'bench width_m': (lambda size: Dragon(width_m=size), 0.001, 100.0),
    'head speed_m_s': (Head, -100.0, 100.0), 'profile knots': (lambda speed: Profile(((0.0, speed),)), -100.0, 100.0),
    'later knots': (lambda t_s: Profile(((0.0, 1.0), (t_s, 1.0))), 0.0, 1e6),
    'run start_s': (Run, 0.0, 1e6), 'run stop_s': (lambda stop_s: Run(0.0, stop_s), 0.0, 1e6),
    'run rate_hz': (lambda rate_hz: Run(0.0, 1.0, rate_hz), 1e-3, 1e4),
    'commanded timeout_s': (lambda seconds: Commanded(timeout_s=seconds), 5e-324, 3600.0),
    'commanded max_speed_m_s': (lambda speed: Commanded(max_speed_m_s=speed), 5e-324, 100.0),
    'commanded max_acceleration_m_s2': (lambda rate: Commanded(max_acceleration_m_s2=rate), 5e-324, 1e6),
    'venue': (lambda x: Venue((LineObstacle('wall', ((0.0, 0.0), (x, 1.0))),)), -1e5, 1e5)}


@pytest.mark.parametrize('name', NUMBERS)
def test_a_number_at_its_limit_is_accepted_and_the_next_beyond_it_is_refused(name):
    make, low, high = NUMBERS[name]
    for value, beyond in ((low, low - 1e-9 * abs(low) - 5e-324), (high, high * (1 + 1e-9))):
        make(value)
        with pytest.raises(FieldError):
            make(beyond)


COUNTS = {
    'benches': (lambda count: Dragon(count), 1, 20_000),
    'groups': (lambda count: Mixed((Group(2.2),) * count), 1, 20_000),
    'benches of groups': (lambda count: Mixed((Group(2.2, count - 1), Group(3.0))), 2, 20_000),
    'benches of a group': (lambda count: Mixed((Group(2.2, count),)), 1, 20_000),
    'knots': (lambda count: Profile(tuple((float(n), 1.0) for n in range(count))), 1, 10_000),
    'pieces': (lambda count: Composite((Line(1.0),) * count), 1, 1000)}


@pytest.mark.parametrize('name', COUNTS)
def test_as_many_as_the_limit_are_accepted_and_one_more_or_none_is_refused(name):
    make, low, high = COUNTS[name]
    for count, beyond in ((low, low - 1), (high, high + 1)):
        make(count)
        with pytest.raises(FieldError):
            make(beyond)


def test_the_checker_has_a_copy_of_the_world():
    declared = {name: (one.low, one.high) for name, one in vars(domain).items() if isinstance(one, domain.Quantity)}
    assert declared == reading.WORLD
    assert len(domain.WORLD) == len(declared)


def test_a_place_in_map_metres_is_refused_with_the_cure():
    with pytest.raises(FieldError, match='relative to an origin near the track'):
        LINE('at_m')((500_000.0, 3_400_000.0))


@pytest.mark.parametrize(('scene', 'says'), [
    (lambda: Scene(track=Composite((Line(100.0, (9950.0, 0.0)),))), 'the world ends at 10000 m'),
    (lambda: Scene(track=Composite((Line(100.0),)), head=Head(-1.0), run=Run(0, 1e5)), 'stop the run earlier'),
    (lambda: Scene(head=Head(-100.0), track=Spiral(100.0, 3.0), run=Run(0, 1e6)), 'the world ends at 10000 m')])
def test_a_run_that_leaves_the_world_is_refused_when_it_is_compiled(scene, says):
    with pytest.raises(FieldError, match=says):
        compile_scene(scene())


def test_the_default_dragon_is_that_of_the_problem():
    assert Dragon() == Dragon(benches=223, head_length_m=3.41, body_length_m=2.20, width_m=0.30, hole_inset_m=0.275)
