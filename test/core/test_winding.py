"""Windings of any pitch: placed as the march does, and their derivatives are those of the places."""
import numpy as np
import pytest

from dragon_ros.core.angle import Angle
from dragon_ros.core.dragon import Dragon
from dragon_ros.core.march import Effort, place
from dragon_ros.core.path import Spiral
from dragon_ros.core.winding import by_place, by_scale, sights, windings

EFFORT = Effort(1e-8)
X, SCALE = np.array([0.5 * 4.6**2, 0.5 * 9.0**2]), 2 * np.pi / np.array([0.451, 0.7])


def winding(x, scale, first=0, follow=40):
    return windings(Dragon(), first, follow, x, scale, EFFORT)


def test_a_winding_is_the_chain_that_the_march_places():
    for x, scale, p in zip(X, SCALE, winding(X, SCALE).p, strict=True):
        spiral = Spiral(2 * np.pi / scale)
        chain = place(spiral, Dragon().link_lengths_m[:40], Angle(scale * np.sqrt(2 * x), 0.0), EFFORT)
        assert p / scale == pytest.approx(chain.p, abs=1e-11)


@pytest.mark.parametrize(('change', 'dx', 'ds'), [(by_place, 1e-4, 0.0), (by_scale, 0.0, 1e-4)], ids=['x', 'scale'])
def test_derivatives_agree_with_differences(change, dx, ds):
    before, here, after = (winding(X + k * dx, SCALE + k * ds) for k in (-1, 0, 1))
    step, found = dx + ds, change(here)
    centre = [0.5 * (one.p[:, 1:] + one.p[:, :-1]) for one in (before, here, after)]
    assert found.velocity == pytest.approx((centre[2] - centre[0]) / (2 * step), rel=1e-6, abs=1e-3)
    assert found.acceleration == pytest.approx((centre[2] - 2 * centre[1] + centre[0]) / step**2, rel=1e-4, abs=0.05)
    turned = [np.angle(complex_(b.axis) / complex_(a.axis)) for a, b in ((before, here), (here, after))]
    assert found.turning == pytest.approx((turned[0] + turned[1]) / (2 * step), rel=1e-6, abs=1e-8)
    assert found.turning_rate == pytest.approx((turned[1] - turned[0]) / step**2, abs=1e-3)


def complex_(vectors):
    return vectors[..., 0] + 1j * vectors[..., 1]


@pytest.mark.parametrize('first', [0, 1])
def test_inside_a_cell_no_separation_sags_below_what_its_corners_say(first):
    rng = np.random.default_rng(6)
    for pitch, radius in zip(rng.uniform(0.3, 1.0, 40), rng.uniform(2.0, 12.0, 40), strict=True):
        scale, x = 2 * np.pi / pitch, 0.5 * radius**2
        dx, ds = 2.0 / scale, 0.05 * scale
        u, v = (np.append(row, rng.uniform(0, 1, 30)) for row in ([0.0, 0, 1, 1], [0.0, 1, 0, 1]))
        seen = sights(Dragon(), first, winding(x + u * dx, scale + v * ds, first))
        bend = 2 * np.max(seen.bend[:4], axis=0)
        sag = (bend[..., 0] * dx * dx + bend[..., 1] * ds * ds) / 8
        low = np.min(seen.apart[:4], axis=0) - sag[:, [0, 0, 1, 1, 0, 0, 1, 1]]
        assert np.min(seen.apart[4:] - low) > -1e-12
