"""The design questions about the turn: figures to 9 digits and more, and the claims beside them."""
import json
from dataclasses import replace
from math import degrees
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.design.max_speed import fastest
from dragon_ros.core.errors import FieldError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import states, velocity_of
from dragon_ros.core.tracks.s_turn import shortest_bent
from dragon_ros.core.tracks.spec import Arc, Composite, Line, STurn

FIGURES = json.loads((Path(__file__).parents[1] / 'data' / 'dances.json').read_text())['figures']
TURNING = Scene(track=STurn(before_m=100.0), run=Run(0, 200))


def test_the_turn_is_13_6212449068_m_long():
    assert FIGURES['turn_length_m'].startswith('13.6212449068')
    assert STurn().length_m == pytest.approx(float(FIGURES['turn_length_m']), rel=1e-15)


@given(st.floats(0.1, 10))
def test_no_ratio_changes_the_length(ratio):
    assert STurn(ratio=ratio).length_m == pytest.approx(STurn().length_m, rel=1e-15)
    assert STurn(ratio=ratio).walk.end_of_first_m == 0


def test_the_smallest_circle_has_both_arcs_of_the_least_radius():
    small = STurn(diameter_m=STurn().smallest_diameter_m(1.43), ratio=1.0)
    assert small.radii_m == pytest.approx((1.43, 1.43), rel=1e-14)
    assert small.length_m < STurn().length_m
    assert STurn(ratio=STurn().largest_ratio(1.43)).radii_m[1] == pytest.approx(1.43, rel=1e-14)


@given(st.floats(0.2, 2.25))
def test_the_way_with_a_line_leads_from_entry_to_exit_and_is_shorter(radius_m):
    turn = STurn()
    bent = shortest_bent(turn, radius_m)
    walk = turn.walk
    start, heading = complex(walk.pieces[1].at(0.0)), complex(walk.pieces[1].heading(0.0))
    way = Composite((Arc(radius_m, -degrees(bent.angle_rad), (start.real, start.imag), degrees(np.angle(heading))),
                  Line(bent.line_m), Arc(radius_m, degrees(bent.angle_rad)))).walk
    last = way.pieces[-1]
    assert abs(complex(last.at(last.last)) + start) < 1e-12
    assert abs(complex(last.heading(last.last)) - heading) < 1e-12
    assert bent.length_m < turn.length_m


def test_two_equal_arcs_are_the_way_without_a_line():
    bent = shortest_bent(STurn(), 0.5 * sum(STurn().radii_m))
    assert bent.length_m == pytest.approx(STurn().length_m, rel=1e-12)
    assert shortest_bent(STurn(), 2.3) is None


def test_the_head_may_go_1_2462663582_m_s_under_a_cap_of_2():
    assert FIGURES['max_speed_m_s'].startswith('1.246266358')
    found = fastest(TURNING)
    assert 2 / found.ratio == pytest.approx(float(FIGURES['max_speed_m_s']), abs=1e-12)
    assert 2 / found.bound == pytest.approx(2 / found.ratio, abs=1e-11)
    assert found.bound >= float(FIGURES['max_speed_ratio'])
    assert (found.handle, round(found.along_m, 5)) == (3, 14.47997)
    assert found.along_m - STurn().length_m == pytest.approx(0.859, abs=5e-4)


@pytest.mark.parametrize('track', [STurn(ratio=1.0), STurn(ratio=0.6), STurn(pitch_m=1.2, ratio=2.1), Composite((
    Line(5.0), Arc(2.0, 170.0), Line(1.0), Arc(1.5, -100.0), Line(60.0)))])
def test_no_look_at_any_time_finds_a_faster_handle_than_the_bound(track):
    scene = Scene(track=track, run=Run(0, 55))
    found = fastest(scene)
    times = np.random.default_rng(1).uniform(0, 55, 400).tolist()
    v = velocity_of(scene, states(scene, times), times)
    assert np.max(np.hypot(v[..., 0], v[..., 1])) <= found.bound * (1 + 1e-12)
    assert found.bound / found.ratio - 1 < 1e-11


def test_on_a_spiral_no_handle_is_faster_than_the_one_before_it():
    v = velocity_of(TURNING, states(TURNING, [20.0, 99.0]), [20.0, 99.0])
    assert np.all(np.diff(np.hypot(v[..., 0], v[..., 1]), axis=-1) < 0)


def test_led_by_the_tail_the_fastest_handle_is_numbered_from_the_head():
    found = fastest(Scene(track=replace(TURNING.track, before_m=-30.0), head=Head(1.0, 'tail'), run=Run(0, 10)))
    v = velocity_of(scene := Scene(track=replace(TURNING.track, before_m=-30.0), head=Head(1.0, 'tail'),
                                   run=Run(0, 10)), states(scene, [found.gone_m]), [found.gone_m])[0]
    assert np.argmax(np.hypot(v[:, 0], v[:, 1])) == pytest.approx(found.handle, abs=1)


def test_a_single_spiral_has_no_largest_speed():
    with pytest.raises(FieldError, match='near the lock speeds have no bound'):
        fastest(Scene())
