"""The largest and smallest inputs are accepted; the next value beyond each is rejected with the name of its field."""
from contextlib import nullcontext
from math import inf, nextafter

import pytest

from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import FieldError
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.verify.reading import _LEAST_LINK


def piece(kind, **values):
    return lambda name: lambda value: Composite((kind(**{**values, name: value}),))


LINE, ARC = piece(Line, length_m=1.0), piece(Arc, radius_m=9.0, angle_deg=90.0)
SPIRAL = piece(SpiralArc, pitch_m=1.0, from_turns=5.0, to_turns=2.0)
NUMBERS = {
    'spiral pitch_m': (Spiral, 1e-12, 1e12), 'spiral start_turns': (lambda turns: Spiral(0.55, turns), 0.0, 1e9),
    'turn pitch_m': (STurn, 1e-9, 1e9), 'turn diameter_m': (lambda size: STurn(diameter_m=size), 1e-9, 1e9),
    'turn ratio': (lambda ratio: STurn(ratio=ratio), 1e-6, 1e6),
    'turn before_m': (lambda metres: STurn(before_m=metres), -1e9, 1e9),
    'line length_m': (LINE('length_m'), 5e-324, 1e9), 'line heading_deg': (LINE('heading_deg'), -1e6, 1e6),
    'line at_m': (lambda x: LINE('at_m')((0.0, x)), -1e9, 1e9),
    'arc radius_m': (ARC('radius_m'), 5e-324, 1e9), 'arc angle_deg': (ARC('angle_deg'), -1e6, 1e6),
    'piece pitch_m': (SPIRAL('pitch_m'), 1e-9, 1e9), 'piece from_turns': (SPIRAL('from_turns'), 1e-3, 1e6),
    'piece to_turns': (SPIRAL('to_turns'), 1e-3, 1e6),
    'bench body_length_m': (lambda size: Dragon(1, 3.41, size, hole_inset_m=0.0), 1e-12, 1e12),
    'bench width_m': (lambda size: Dragon(width_m=size), 5e-324, 1e12),
    'bench hole_inset_m': (lambda size: Dragon(1, 1e12, 1e12, hole_inset_m=size), 0.0, 0.5e12),
    'head speed_m_s': (Head, -1e9, 1e9), 'profile knots': (lambda speed: Profile(((0.0, speed),)), -1e9, 1e9),
    'later knots': (lambda t_s: Profile(((0.0, 1.0), (t_s, 1.0))), 0.0, 1e10),
    'commanded timeout_s': (lambda seconds: Commanded(timeout_s=seconds), 5e-324, 3600.0),
    'commanded max_speed_m_s': (lambda speed: Commanded(max_speed_m_s=speed), 5e-324, 1e3),
    'commanded max_acceleration_m_s2': (lambda rate: Commanded(max_acceleration_m_s2=rate), 5e-324, 1e6)}


@pytest.mark.parametrize('name', NUMBERS)
def test_a_number_at_its_limit_is_accepted_and_the_next_one_beyond_is_refused(name):
    make, low, high = NUMBERS[name]
    for value, beyond in ((low, nextafter(low, -inf)), (high, nextafter(high, inf))):
        make(value)
        with pytest.raises(FieldError):
            make(beyond)


COUNTS = {
    'benches': (lambda count: Dragon(count), 1, 1_000_000),
    'groups': (lambda count: Mixed((Group(2.2),) * count), 1, 10_000),
    'benches of groups': (lambda count: Mixed((Group(2.2, count - 1), Group(3.0))), 2, 1_000_000),
    'benches of a group': (lambda count: Mixed((Group(2.2, count),)), 1, 1_000_000),
    'knots': (lambda count: Profile(tuple((float(n), 1.0) for n in range(count))), 1, 10_000),
    'pieces': (lambda count: Composite((Line(1.0),) * count), 1, 1000)}


@pytest.mark.parametrize('name', COUNTS)
def test_as_many_as_the_limit_are_accepted_and_one_more_or_none_is_refused(name):
    make, low, high = COUNTS[name]
    for count, beyond in ((low, low - 1), (high, high + 1)):
        make(count)
        with pytest.raises(FieldError):
            make(beyond)


@pytest.mark.parametrize(('share', 'refused'), [(0.0, False), (0.1, True), (0.9, True), (1.1, False)])
def test_the_shortest_link_is_that_of_the_checker_and_holes_may_coincide(share, refused):
    inset_m = 0.5 - 0.5 * share * _LEAST_LINK
    with pytest.raises(FieldError, match='too short') if refused else nullcontext():
        assert Dragon(3, 1.0, 1.0, 0.1, inset_m).link_lengths_m == pytest.approx(share * _LEAST_LINK, rel=1e-5)


def test_the_default_dragon_is_that_of_the_problem():
    assert Dragon() == Dragon(benches=223, head_length_m=3.41, body_length_m=2.20, width_m=0.30, hole_inset_m=0.275)
