"""A bench and those behind it, seen at many places at once: how far apart, and how fast that can change.

Benches walk one track at equal spacing, so what follows a bench at polar angle theta is the same whenever it is there.
Places are polar angles of the leading bench's front handle; all rates are per metre of its way.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.chain import SpiralChain
from dragon_ros.core.dragon import Dragon
from dragon_ros.core.march import Effort
from dragon_ros.core.march_many import place_many
from dragon_ros.core.motion import Motion, dot, left, motion
from dragon_ros.core.path import Spiral
from dragon_ros.core.types import Floats

_CHUNK = 512


@dataclass(frozen=True)
class View:
    """What is seen from M places of the leading bench, of the K benches from the second behind it on.

    ``offset`` and ``extent`` (M, K, 4): distance of the centres and half sum of the widths along the two axes of the
    leading bench and the two of the other; the pair is apart where |offset| > extent along any. ``bend`` (M, K, 2):
    largest second derivative of a corner, in the frame of the leading bench and of the other. ``reach`` (M,) is the
    largest distance of the leading bench from the centre, ``clearance`` (M, K) the smallest of the others, in metres.
    ``moved`` (M, K+1, 2) is how far front and rear handle of the leading bench (first) and of the others have come
    along the track, times how much further a corner can go than the handles, in metres.
    """

    theta: Floats
    offset: Floats
    extent: Floats
    bend: Floats
    reach: Floats
    clearance: Floats
    moved: Floats

    @property
    def apart(self) -> Floats:
        """Largest separation along the four axes, shape (M, K): positive where the pair is apart."""
        out: Floats = np.max(np.abs(self.offset) - self.extent, axis=-1)
        return out

    def rows(self, index: Floats) -> 'View':
        """Return some of the places."""
        return View(*(getattr(self, name)[index] for name in _FIELDS))


_FIELDS = ('theta', 'offset', 'extent', 'bend', 'reach', 'clearance', 'moved')


def joined(views: list[View]) -> View:
    """Return the places of several views as one."""
    return View(*(np.concatenate([getattr(view, name) for view in views]) for name in _FIELDS))


@dataclass(frozen=True)
class Lookout:
    """Looks from the head (``first`` 0) or from any other bench (``first`` 1) at the ``follow`` benches behind it."""

    spiral: Spiral
    dragon: Dragon
    first: int
    follow: int
    effort: Effort
    progress: Callable[[int], object]

    def look(self, theta: Floats) -> View:
        """Return the view from places (M,)."""
        return joined([self._look(part) for part in np.array_split(theta, max(1, ceil(theta.size / _CHUNK)))])

    def _look(self, theta: Floats) -> View:
        self.progress(theta.size)
        links = self.dragon.link_lengths_m[self.first:self.first + self.follow]
        chain = place_many(self.spiral, links, theta, np.zeros_like(theta), self.effort)
        axis = axes_of(chain)
        benches = benches_of(chain, self.dragon if self.first == 0 else self._body, axis)
        return _view(theta, benches, motion(self.spiral.b_m, chain, axis), _moved(self.spiral.b_m, chain, benches))

    @property
    def _body(self) -> Dragon:
        d = self.dragon
        return Dragon(d.benches, d.body_length_m, d.body_length_m, d.width_m, d.hole_inset_m)

    def reaching(self, theta: Floats) -> 'Lookout':
        """Return a lookout with no more followers than can come within reach at any of some places."""
        for follow in (16, 32, 64, 128, 256, 512, 1024):
            fewer = replace(self, follow=follow)
            if follow >= self.follow:
                break
            view = fewer.look(theta)
            if np.all(view.clearance[:, -1] > view.reach):
                return fewer
        return self


def _moved(b_m: float, chain: SpiralChain, benches: Benches) -> Floats:
    """Return how far the handles have come, times each bench's lever: its corners move at most so much further."""
    q, length = chain.theta, np.maximum(chain.links_m, 1e-12)
    arc = 0.5 * b_m * (q * np.sqrt(1 + q * q) + np.arcsinh(q))
    overhang = benches.half_length - 0.5 * chain.links_m
    lever = 1 + 2 * (overhang + benches.half_width) / length
    both = np.stack((arc[:, :-1], arc[:, 1:]), axis=-1) * lever[:, None]
    return np.concatenate((both[:, :1], both[:, 2:]), axis=1)


def _view(theta: Floats, benches: Benches, moving: Motion, moved: Floats) -> View:
    a, b = benches.half_length, benches.half_width
    u = benches.axis
    lead, other = u[:, :1], u[:, 2:]
    d = benches.centre[:, 2:] - benches.centre[:, :1]
    offset = np.stack((dot(d, lead), dot(d, left(lead)), dot(d, other), dot(d, left(other))), axis=-1)
    c, s = np.abs(dot(lead, other)), np.abs(dot(left(lead), other))
    extent = np.stack((a[0] + a[2:] * c + b[2:] * s, b[0] + a[2:] * s + b[2:] * c,
                       a[2:] + a[0] * c + b[0] * s, b[2:] + a[0] * s + b[0] * c), axis=-1)
    corners = benches.corners
    reach = np.max(np.hypot(corners[:, 0, :, 0], corners[:, 0, :, 1]), axis=-1)
    middle = np.abs(dot(benches.centre[:, 2:], left(other)))
    return View(theta, offset, extent, _bend(d, benches, moving), reach, middle - b[2:], moved)


def _bend(d: Floats, benches: Benches, moving: Motion) -> Floats:
    """Return bounds (M, K, 2) on the second derivative of the corners of one bench in the frame of the other.

    In a frame that turns at w, a point at r with the velocity v and acceleration a of the other body relative to its
    origin has the acceleration a - w' x r - w^2 r - 2 w x v, and a corner's arm adds its length times
    |(change of w', square of the change of w)|.
    """
    dv = moving.velocity[:, 2:] - moving.velocity[:, :1]
    da = moving.acceleration[:, 2:] - moving.acceleration[:, :1]
    w, w_rate = moving.turning, moving.turning_rate
    arm = np.hypot(benches.half_length, benches.half_width)
    spin = np.hypot(w_rate[:, 2:] - w_rate[:, :1], (w[:, 2:] - w[:, :1]) ** 2)
    out = []
    for frame, rate, length in ((w[:, :1], w_rate[:, :1], arm[2:]), (w[:, 2:], w_rate[:, 2:], arm[:1])):
        base = da - rate[..., None] * left(d) - (frame**2)[..., None] * d - 2 * frame[..., None] * left(dv)
        out.append(np.hypot(base[..., 0], base[..., 1]) + length * spin)
    return np.stack(out, axis=-1)
