"""In every row of docs/errata.md, the printed form fails, and the corrected form holds."""
from math import cos, hypot, pi, sin, sqrt

import numpy as np
import pytest
from apart import adjacent_layer_windows

from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spiral import arc_between

SCENE = Scene(solver='march')
B, P, V, THETA0 = SCENE.spiral.b_m, 0.55, 1.0, 32 * pi
RHO0 = B * THETA0


def true_theta(t_s):
    return float(state(SCENE, t_s).u[0])


def test_equation_5_arc_length():
    steps = np.linspace(0, THETA0, 400_001)
    integrand = B * np.sqrt(1 + steps**2)
    integral = float(np.sum((integrand[1:] + integrand[:-1]) / 2 * np.diff(steps)))
    assert B * arc_between(THETA0, THETA0) == pytest.approx(integral, rel=1e-9)
    assert pytest.approx(2 * integral, rel=1e-3) == RHO0 * THETA0


@pytest.mark.parametrize('t_s', [60.0, 300.0])
def test_equations_6_and_7_angle_turned(t_s):
    phi = THETA0 - true_theta(t_s)
    assert P / (4 * pi) * phi**2 - RHO0 * phi + V * t_s == pytest.approx(0, abs=0.2)
    printed = P / (2 * pi) * phi**2 + RHO0 * phi - V * t_s
    assert abs(printed) > 4


def printed_speed(t_s):
    """The speed of the point that moves by the printed equation 7, at radius rho0 + p theta / 2 pi."""
    theta = (-RHO0 + sqrt(RHO0**2 + 2 * P / pi * V * t_s)) / (P / pi)
    turning = V / (P / pi * theta + RHO0)
    return hypot(RHO0 + P * theta / (2 * pi), B) * turning


def test_equations_6_and_7_slow_the_head_down_from_v_towards_half_of_it():
    assert printed_speed(0.0) == pytest.approx(V, abs=1e-4)
    assert printed_speed(412.0) == pytest.approx(0.80 * V, abs=0.005)
    assert printed_speed(1e9) == pytest.approx(V / 2, abs=1e-3)


@pytest.mark.parametrize('t_s', [60.0, 220.0, 300.0])
def test_equations_8_and_9_root(t_s):
    phi = 2 * pi / P * (RHO0 - sqrt(RHO0**2 - P * V * t_s / pi))
    assert phi == pytest.approx(THETA0 - true_theta(t_s), abs=0.05)
    under_the_root = -RHO0**2 + 2 * P / pi * V * t_s
    assert (under_the_root < 0) == (t_s < 221)
    if under_the_root > 0:
        assert abs((-RHO0 + sqrt(under_the_root)) / (P / pi) - phi) > 10


@pytest.mark.parametrize('t_s', [60.0, 300.0])
def test_equation_10_radius(t_s):
    phi = THETA0 - true_theta(t_s)
    radius = hypot(*state(SCENE, t_s).p[0])
    assert RHO0 - P * phi / (2 * pi) == pytest.approx(radius, abs=1e-12)
    assert RHO0 + P * phi / (2 * pi) > radius + 1


@pytest.mark.parametrize('t_s', [0.0, 100.0, 400.0])
def test_equations_12_to_14_velocity_of_the_head(t_s):
    theta = true_theta(t_s)
    w = sqrt(1 + theta**2)
    tangential, radial = V * theta / w, -V / w
    corrected = (tangential * sin(theta) + radial * cos(theta), -tangential * cos(theta) + radial * sin(theta))
    assert state(SCENE, t_s).velocities(V)[0] == pytest.approx(corrected, abs=1e-12)
    printed = (V * sin(theta) + radial * cos(theta), V * cos(theta) + radial * sin(theta))
    assert hypot(*corrected) == pytest.approx(V, abs=1e-14)
    assert hypot(printed[0] - corrected[0], printed[1] - corrected[1]) > 0.5


def test_equations_12_to_14_give_a_speed_on_both_sides_of_v():
    theta = np.array([true_theta(t_s) for t_s in np.linspace(0.0, 400.0, 401)])
    radial = -V / np.sqrt(1 + theta**2)
    speed = np.hypot(V * np.sin(theta) + radial * np.cos(theta), V * np.cos(theta) + radial * np.sin(theta))
    assert 0.45 < np.mean(speed < V) < 0.55
    assert speed.min() == pytest.approx(0.969 * V, abs=0.002)
    assert speed.max() == pytest.approx(1.030 * V, abs=0.002)


def test_equation_17_next_handle():
    chain = state(SCENE, 300.0)
    delta = float(chain.u[1] - chain.u[0])
    for sign, right in ((1, True), (-1, False)):
        theta = float(chain.u[0]) + sign * delta
        place = B * theta * cos(theta), B * theta * sin(theta)
        assert (hypot(*(chain.p[0] - place)) == pytest.approx(2.86, abs=1e-9)) == right


def edge_line(front, rear, offset):
    """Return the slope and the intercept of a bench's middle line, moved by ``offset`` along y."""
    k = (front[1] - rear[1]) / (front[0] - rear[0])
    return k, front[1] - k * front[0] + offset


def test_equations_20_to_22_edges():
    chain = state(SCENE, 300.0)
    benches = benches_of(chain, SCENE.dragon, axes_of(chain))
    front, rear = chain.p[5], chain.p[6]
    k, middle = edge_line(front, rear, 0.0)
    corners = benches.corners[5]
    distances = sorted(corners[:, 1] - k * corners[:, 0] - middle)
    assert distances[-1] == pytest.approx(0.15 * sqrt(1 + k * k), abs=1e-12)
    assert distances[-1] != pytest.approx(0.15, abs=1e-3)
    printed = k * (front[0] - front[0])         # equation 20 omits + y1
    assert abs(printed - front[1]) > 1


def test_equation_23_edges_not_lines():
    chain = state(SCENE, 300.0)
    benches = benches_of(chain, SCENE.dragon, axes_of(chain))
    k1, c1 = edge_line(chain.p[0], chain.p[1], 0.15)
    k2, c2 = edge_line(chain.p[40], chain.p[41], -0.15)
    assert k1 != k2, 'so the two infinite lines meet somewhere'
    x = (c2 - c1) / (k1 - k2)
    assert np.isfinite(x)
    assert gaps(benches, np.array([0]), np.array([40]))[0] > 0.1, 'and yet the benches are far apart'


def test_equation_24_range_of_an_edge():
    chain = state(SCENE, 300.0)
    benches = benches_of(chain, SCENE.dragon, axes_of(chain))
    corners, axis, middle = benches.corners[5], benches.axis[5], benches.centre[5]
    half_x, k = abs(1.1 * axis[0]), axis[1] / axis[0]
    normal = np.array([-axis[1], axis[0]])
    a = abs(0.15 * normal[1])
    assert a == pytest.approx(0.15 / sqrt(1 + k * k), abs=1e-15), 'half the width, projected on y'
    left = sorted(corners[:2, 0]) if axis[0] > 0 else sorted(corners[2:, 0])
    corrected = (middle[0] - half_x - k * a, middle[0] + half_x - k * a)
    assert left == pytest.approx(corrected, abs=1e-12)
    printed = (middle[0] - k * half_x + a, middle[1] + k * half_x + a)
    assert left != pytest.approx(printed, abs=1e-2)


def test_section_3_4_next_layer_is_outside():
    angle = state(SCENE, 412.473837682).u
    first, last = adjacent_layer_windows(angle)
    assert first[0] <= 8 <= last[0]
    inwards = np.searchsorted(angle, angle[:2] - 2 * pi)
    assert not inwards.any(), 'no bench is one layer further in than the head'


@pytest.mark.parametrize(('handle', 'x', 'y'), [(1, 1.726441, 1.677928), (151, 6.862909, -0.504428)])
def test_table_3_lost_a_minus_sign_of_x_twice(handle, x, y):
    def off_the_spiral_m(x):
        turns = (hypot(x, y) / B - np.arctan2(y, x)) / (2 * pi)
        return abs(turns - round(turns)) * P
    assert off_the_spiral_m(-x) < 2e-6 < 0.01 < off_the_spiral_m(x)
