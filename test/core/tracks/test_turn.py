"""The contest's design questions about the turn are answered to 9 digits or more, and related claims hold."""
from math import degrees

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.s_turn import shortest_bent
from dragon_ros.core.tracks.spec import Arc, Composite, Line, STurn
from hard_cases.truth import design_figures

FIGURES = design_figures()


def test_the_turn_is_13_6212449068_m_long():
    assert FIGURES['turn_length_m'].startswith('13.6212449068')
    assert STurn().length_m == pytest.approx(float(FIGURES['turn_length_m']), rel=1e-15)


@given(st.floats(0.1, 10))
def test_no_ratio_changes_the_length(ratio):
    assert STurn(ratio=ratio).length_m == pytest.approx(STurn().length_m, rel=1e-15)
    assert track_of(STurn(ratio=ratio)).end_of_first_m == 0


def test_the_smallest_circle_has_both_arcs_of_the_least_radius():
    small = STurn(diameter_m=STurn().smallest_diameter_m(1.43), ratio=1.0)
    assert small.radii_m == pytest.approx((1.43, 1.43), rel=1e-14)
    assert small.length_m < STurn().length_m
    assert STurn(ratio=STurn().largest_ratio(1.43)).radii_m[1] == pytest.approx(1.43, rel=1e-14)


@given(st.floats(0.2, 2.25))
def test_the_way_with_a_line_leads_from_entry_to_exit_and_is_shorter(radius_m):
    turn = STurn()
    bent = shortest_bent(turn, radius_m)
    track = track_of(turn)
    start, heading = complex(track.segments[1].at(0.0)), complex(track.segments[1].heading(0.0))
    begin = (start.real, start.imag), degrees(np.angle(heading))
    way = track_of(Composite((Arc(radius_m, -degrees(bent.angle_rad), *begin),
                  Line(bent.line_m), Arc(radius_m, degrees(bent.angle_rad)))))
    last = way.segments[-1]
    assert abs(complex(last.at(last.last)) + start) < 1e-12
    assert abs(complex(last.heading(last.last)) - heading) < 1e-12
    assert bent.length_m < turn.length_m


def test_two_equal_arcs_are_the_way_without_a_line():
    bent = shortest_bent(STurn(), 0.5 * sum(STurn().radii_m))
    assert bent.length_m == pytest.approx(STurn().length_m, rel=1e-12)
    assert shortest_bent(STurn(), 2.3) is None
