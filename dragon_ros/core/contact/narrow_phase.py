"""A bench and those behind it, sampled at many places at once: how far apart.

What follows a bench with its front handle at polar angle theta of a spiral that winds in from afar is the same whenever
it is there. Places are those angles.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

import numpy as np

from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.dragon import AnyDragon, is_even
from dragon_ros.core.chain.rectangles import Benches, axes_of
from dragon_ros.core.contact.signed_distance import rounding_m
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.numerics.vectors import dot, left
from dragon_ros.core.tracks.composite import Track
from dragon_ros.core.tracks.segments import BEHIND, Effort

_AT_ONCE = 512  # places, so that what is between fits the cache
_FEW = 64       # followers tried first: more than two layers of the classic dragon near the centre


@dataclass(frozen=True)
class BenchSamples:
    """Samples at M places of the leading bench, of the K - 2 benches from the second behind it on.

    ``theta`` (M, K+1) are polar angles of all handles from the leading one on, ``delta`` (M, K) what the links span.
    ``offset`` and ``extent`` (M, K-2, 4): distance of the centres and half sum of the widths along the two axes of the
    leading bench and the two of the other; the pair is apart where |offset| > extent along any.
    """

    theta: Floats
    delta: Floats
    offset: Floats
    extent: Floats

    @property
    def apart(self) -> Floats:
        """Largest separation along the four axes, shape (M, K-2): positive where the pair is apart."""
        out: Floats = np.max(np.abs(self.offset) - self.extent, axis=-1)
        return out

    @property
    def places(self) -> Floats:
        """Polar angles (M,) of the leading handle."""
        return self.theta[:, 0]

    def rows(self, index: Ints) -> 'BenchSamples':
        """Return some of the samples."""
        return BenchSamples(*(getattr(self, name)[index] for name in _FIELDS))


_FIELDS = ('theta', 'delta', 'offset', 'extent')


def joined(samples: list[BenchSamples]) -> BenchSamples:
    """Return several samples as one."""
    return BenchSamples(*(np.concatenate([getattr(each, name) for each in samples]) for name in _FIELDS))


@dataclass(frozen=True)
class Sizes:
    """The sampled benches: links, half lengths (K,) and half width in metres; ``error_m`` is what handles may err by.

    ``longest_m`` is the longest link of these or behind; None where all behind the first are equal.
    """

    b_m: float
    error_m: float
    links_m: Floats
    half_length_m: Floats
    half_width_m: float
    longest_m: float | None

    def angle_errors(self, theta: Floats) -> Floats:
        """Return what polar angles (...) may err by: a handle at theta goes b sqrt(1 + theta^2) a radian.

        Twice what positions may, which leaves as much for how positions follow from angles.
        """
        out: Floats = (2 * self.error_m / self.b_m) / np.maximum(theta, 1.0)
        return out

    def rounding_m(self, theta: Floats) -> Floats:
        """Return what separations are off by for rounding, with the last handle at angles (M,)."""
        out = rounding_m(self.b_m * theta, float(np.max(self.half_length_m)) + self.half_width_m)
        assert isinstance(out, np.ndarray)
        return out


@dataclass(frozen=True)
class BenchSampler:
    """Samples bench ``first`` (0 is the head) and the ``follow`` benches from it on, on a track's first spiral.

    ``error_m`` is what positions may err by.
    """

    track: Track
    dragon: AnyDragon
    first: int
    follow: int
    effort: Effort
    progress: Callable[[int], object]
    error_m: float

    def sample(self, theta: Floats) -> BenchSamples:
        """Return the samples at places (M,)."""
        return joined([self._sample(part) for part in np.array_split(theta, max(1, ceil(theta.size / _AT_ONCE)))])

    def _sample(self, theta: Floats) -> BenchSamples:
        self.progress(theta.size)
        size, leaders = self.sizes, (np.zeros(theta.size, dtype=np.int64), theta, np.zeros_like(theta))
        chain = marched_many(self.track, size.links_m, leaders, BEHIND, self.effort)
        # Far out an angle has too few digits for what a link spans: with its low part it has.
        delta = np.diff(chain.u) + np.diff(chain.u_lo)
        centre = 0.5 * (chain.p[:, :-1] + chain.p[:, 1:])
        benches = Benches(centre, axes_of(chain), size.half_length_m, np.full(size.links_m.size, size.half_width_m))
        return BenchSamples(chain.u, delta, *_seen(benches))

    @property
    def b_m(self) -> float:
        """Radius that the spiral gains for each radian."""
        assert self.track.from_afar
        return self.track.from_afar.curve.b_m

    @cached_property
    def sizes(self) -> Sizes:
        """Of the sampled benches."""
        d, sampled = self.dragon, slice(self.first, self.first + self.follow)
        links, lengths = d.link_lengths_m[sampled], d.bench_lengths_m[sampled]
        rest = d.link_lengths_m[self.first:]
        return Sizes(self.b_m, self.error_m, links, 0.5 * lengths, 0.5 * d.width_m,
                     None if is_even(rest) else float(np.max(rest)))

    def reaching(self, theta: Floats) -> 'BenchSampler':
        """Return a sampler with no more followers than can come within reach at any of some places, if it is so few."""
        follow = _FEW
        while follow < self.follow:
            fewer = replace(self, follow=follow)
            samples = fewer.sample(theta)
            circle = beyond(samples, samples, fewer.sizes)
            clear = np.all(further(samples, samples, fewer.sizes, circle) > 0, axis=0)
            if clear[-1]:
                return replace(self, follow=5 + int(1.1 * np.argmax(clear)))
            follow *= 2
        return self


def beyond(a: BenchSamples, b: BenchSamples, sizes: Sizes) -> Floats:
    """Return how far benches (M, K-2) stay outside the leading one's circle about the centre, between two places.

    The leading bench goes no further out than its rear handle and a corner's distance from that. A link's line is
    H = b (c^2 - delta^2) cot(delta / 2) / 2c from the centre, which falls as delta grows and so rises with theta.
    """
    span, outer = np.maximum(a.delta, b.delta)[:, 2:], np.maximum(a.theta[:, 1], b.theta[:, 1])
    inner, chord = np.minimum(a.theta, b.theta)[:, 2:-1], sizes.links_m[2:] / sizes.b_m
    linked = chord > 0
    across = line_distance(np.where(linked, chord, 1), np.where(linked, span, 1), 2 * sizes.angle_errors(inner))
    along = inner * inner / np.sqrt(1 + inner * inner)      # of a link of no length: a tangent
    overhang = sizes.half_length_m[0] - 0.5 * sizes.links_m[0]
    reach = sizes.b_m * outer + 2 * sizes.error_m + np.hypot(overhang, sizes.half_width_m)
    off = sizes.rounding_m(np.maximum(a.theta[:, -1], b.theta[:, -1]))
    out: Floats = sizes.b_m * np.where(linked, across, along) - sizes.half_width_m - (reach + off)[:, None]
    return out


def line_distance(chord: Floats, delta: Floats, error: Floats) -> Floats:
    """Return no more than how far the lines of links are from the centre, in units of b.

    Links are ``chord`` long and span ``delta`` to within an error e. For delta < pi the distance
    (c^2 - delta^2) cot(delta / 2) / 2c changes by no more than e (2 / c + 2.5 c / delta^2), since delta cot(delta / 2)
    <= 2 and sin(delta / 2) >= delta / pi; from pi on it is not positive. Rounding adds 2^-49 of c / delta.
    """
    distance = (chord - delta) * (chord + delta) / (2 * chord * np.tan(0.5 * delta))
    out: Floats = distance - error * (2 / chord + 2.5 * chord / (delta * delta)) - 2.0**-49 * chord / delta
    return out


def further(a: BenchSamples, b: BenchSamples, sizes: Sizes, circle: Floats) -> Floats:
    """Return how far each bench (M, K-2) and all behind it stay outside that circle; ``circle`` is from ``beyond``.

    Where links are equal that is each bench's own, which grows from bench to bench. Else a link of length l comes no
    nearer to the centre than sqrt(r^2 - l^2 / 4), r the distance of its front handle, which grows from bench to bench:
    no nearer handle is more than half of it from the foot of the perpendicular. No point of a bench is further from its
    link than the overhang at the hole and half the width.
    """
    if sizes.longest_m is None:
        return circle
    overhang = np.hypot(sizes.half_length_m[0] - 0.5 * sizes.links_m[0], sizes.half_width_m)
    inner, outer = np.minimum(a.theta, b.theta)[:, 2:-1], np.maximum(a.theta[:, 1], b.theta[:, 1])
    nearest = np.maximum(sizes.b_m * inner - 2 * sizes.error_m, 0.0)
    away = np.sqrt(np.maximum((nearest - 0.5 * sizes.longest_m) * (nearest + 0.5 * sizes.longest_m), 0.0))
    off = sizes.rounding_m(np.maximum(a.theta[:, -1], b.theta[:, -1])) + 2 * sizes.error_m
    out: Floats = away - 2 * overhang - (sizes.b_m * outer + off)[:, None]
    return out


def _seen(benches: Benches) -> tuple[Floats, Floats]:
    """Return offset and extent of the pairs."""
    a, b = benches.half_length, benches.half_width
    u = benches.axis
    lead, other = u[:, :1], u[:, 2:]
    d = benches.centre[:, 2:] - benches.centre[:, :1]
    offset = np.stack((dot(d, lead), dot(d, left(lead)), dot(d, other), dot(d, left(other))), axis=-1)
    c, s = np.abs(dot(lead, other)), np.abs(dot(left(lead), other))
    extent = np.stack((a[0] + a[2:] * c + b[2:] * s, b[0] + a[2:] * s + b[2:] * c,
                       a[2:] + a[0] * c + b[0] * s, b[2:] + a[0] * s + b[0] * c), axis=-1)
    return offset, extent
