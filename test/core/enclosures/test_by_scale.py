"""Derivatives with respect to a dragon's scale equal finite differences of marched chains, within their accuracy."""
import numpy as np
import pytest

from dragon_ros.core.chain.chain import marched
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.enclosures import by_scale, on_spiral
from dragon_ros.core.enclosures.ball_arithmetic import between
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral

UNIT = track_of(Spiral(2 * np.pi))
DRAGONS = [Dragon(12), Dragon(12, 6.0, 2.2), Mixed((Group(3.4), Group(1.2, 3), Group(2.2, 5)))]
STEP = 2e-3     # relative to the variable: errors of differences are STEP^4 (truncation) and 1e-13 / STEP (rounding)


def placed(links, theta):
    """Return the polar angles of the K+1 handles and the directions of the K links, both without jumps of 2 pi."""
    chain = marched(UNIT, links, Place(0, DoubleDouble(theta, 0.0)), BEHIND)
    z = chain.p @ [1, 1j]
    return chain.u, np.unwrap(np.angle(z[:-1] - z[1:]))


def differences(at, x, step):
    """Return first and second derivatives at x, to fourth order, of the angles and directions that ``at`` returns."""
    rows = [at(x + k * step) for k in (-2, -1, 0, 1, 2)]
    out = []
    for parts in zip(*rows, strict=True):
        a, b, c, d, e = (part - 2 * np.pi * np.round((part - parts[2]) / (2 * np.pi)) for part in parts)
        out += [(a - 8 * b + 8 * d - e) / (12 * step), (-a + 16 * b - 30 * c + 16 * d - e) / (12 * step**2)]
    return out


def balls(theta, links):
    ends = np.asarray(theta)[None]
    return between(ends, ends), between(np.diff(ends), np.diff(ends)), between(links[None], links[None])


@pytest.mark.parametrize('dragon', DRAGONS, ids=['classic', 'long head', 'mixed'])
@pytest.mark.parametrize(('radius_m', 'pitch_m'), [(4.6, 0.451), (9.0, 0.8), (3.5, 1.2)])
def test_by_scale_angles_and_directions_change_as_differences_say(dragon, radius_m, pitch_m):
    scale, links = 2 * np.pi / pitch_m, dragon.link_lengths_m
    theta, _ = placed(scale * links, scale * radius_m)
    moving = by_scale._motion(*balls(theta, scale * links))
    p, a, turned, rate = differences(lambda s: placed(s * links, s * radius_m), scale, STEP * scale)
    none = scale * radius_m         # the common rotation
    for found, true, atol in ((moving.p, scale * p, 1e-8), (moving.a, scale**2 * a, 1e-5),
                              (moving.turned, scale * p - none, 1e-8), (moving.w, scale * turned - none, 1e-8),
                              (moving.w_rate, scale**2 * rate, 1e-5)):
        np.testing.assert_allclose(found.mid[0], true, rtol=1e-8, atol=atol)


@pytest.mark.parametrize('dragon', DRAGONS, ids=['classic', 'long head', 'mixed'])
@pytest.mark.parametrize(('radius_m', 'pitch_m'), [(4.6, 0.451), (9.0, 0.8), (3.5, 1.2)])
def test_by_the_leaders_angle_they_change_as_differences_say(dragon, radius_m, pitch_m):
    scale = 2 * np.pi / pitch_m
    links, start = scale * dragon.link_lengths_m, scale * radius_m
    theta, delta, chord = balls(placed(links, start)[0], links)
    moving = on_spiral._motion(theta, on_spiral._slopes(theta, delta, chord))
    p, a, turned, rate = differences(lambda angle: placed(links, angle), start, STEP * start)
    for found, true, atol in ((moving.p, p, 1e-9), (moving.a, a, 1e-8), (moving.w, turned, 1e-9),
                              (moving.w_rate, rate, 1e-8)):
        np.testing.assert_allclose(found.mid[0], true, rtol=1e-7, atol=atol)
