"""A reconstruction of the paper's method that reproduces every printed digit and every error.

The head moves in explicit Euler steps of 0.01 s, without the radial term; the printed point combines the radius before
the last step with the angle after it. For each link, the angle grows in steps of 0.01 rad until the chord is within 0.1
m of the link's length; the last link has the length of the head link. Speeds are v[i+1] = v[i] (rho[i] /
rho[i+1])^0.02. This method is not correct: position errors reach 14 m.
"""
from math import cos, pi, sqrt

import numpy as np

from dragon_ros.core.chain.chain import Chain, MarchedLinks
from dragon_ros.core.errors import ChainLockError, FieldError, TrackEndError
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.tracks.composite import Track
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spiral import SpiralCurve, SpiralSegment

STEP_S, STEP_RAD, WITHIN_M, EXPONENT = 0.01, 0.01, 0.1, 0.02


class PaperChain(Chain):
    """A chain with the paper's positions and speeds."""

    @property
    def solver(self) -> str:
        """The paper's method."""
        return 'paper'

    def velocities(self, leader_speed_m_s: float | Floats, out: Floats | None = None) -> Floats:
        """Return velocities (m/s, shape (..., N+1, 2)) with the paper's speeds, along the tangents of the track."""
        rho = np.hypot(self.p[..., 0], self.p[..., 1])
        speed = np.asarray(leader_speed_m_s)[..., None] * (rho[..., :1] / rho) ** EXPONENT
        return read_only(np.multiply(speed[..., None], self.headings, out=out).view())


def steps_of(t_s: float) -> int:
    """Return the number of Euler steps up to ``t_s``. Raises FieldError for a time between two steps."""
    steps = round(t_s / STEP_S)
    if abs(steps * STEP_S - t_s) > 1e-9 * max(1.0, abs(t_s)):
        raise FieldError('t_s', t_s, f'the paper computes only whole steps of {STEP_S:g} s',
                         f'give {steps * STEP_S:.2f} s, or choose another accuracy')
    return steps


def place(track: Track, links_m: Floats, speed_m_s: float, t_s: float) -> PaperChain:
    """Return the paper's chain. Raises ChainLockError or TrackEndError if the method cannot place a handle."""
    segment = track.segments[0]
    assert isinstance(segment, SpiralSegment)
    spiral = segment.curve
    theta, rho = _head(spiral, speed_m_s, steps_of(t_s))
    thetas, radii, evaluations = [theta], [rho], 0
    for link, length_m in enumerate(_links(links_m)):
        turned = _turn(spiral.b_m, thetas[-1], radii[-1], length_m)
        if turned is None:
            raise ChainLockError(f"the paper's recipe cannot place link {link} within {WITHIN_M} m at radius "
                                 f'{radii[-1]:.6f} m; choose an earlier time', link=link, t_s=t_s)
        evaluations += turned
        thetas.append(thetas[-1] + turned * STEP_RAD)
        radii.append(spiral.b_m * thetas[-1])
    angle, radius = np.array(thetas), np.array(radii)
    p = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    places = np.zeros(angle.shape, dtype=np.int64), angle
    return PaperChain(read_only(p), links_m, evaluations, track, BEHIND, (MarchedLinks(0, places),))


def _head(spiral: SpiralCurve, speed_m_s: float, steps: int) -> tuple[float, float]:
    """Return the angle of the head after a number of Euler steps, and its radius before the last of these steps."""
    theta = spiral.start
    rho = spiral.b_m * theta
    for _ in range(steps):
        rho = spiral.b_m * theta
        if rho <= abs(speed_m_s) * STEP_S:
            raise TrackEndError("the paper's head steps over the centre; choose an earlier time")
        theta -= speed_m_s * STEP_S / rho
    return theta, rho


def _links(links_m: Floats) -> list[float]:
    """Return the link lengths with the paper's mistake: the last link has the length of the head's link."""
    links: list[float] = links_m.tolist()
    return [*links[:-1], links[0]]


def _turn(b_m: float, theta: float, rho: float, length_m: float) -> int | None:
    """Return the smallest number of steps that brings the chord (equation 15) close to the link's length, or None."""
    for k in range(1, int(2 * pi / STEP_RAD)):
        delta = k * STEP_RAD
        outer = b_m * (theta + delta)
        squared = rho * rho + outer * outer - 2 * rho * outer * cos(delta)
        if abs(sqrt(max(squared, 0.0)) - length_m) < WITHIN_M:
            return k
    return None
