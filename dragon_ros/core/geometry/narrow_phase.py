"""Benches and those behind each of them, sampled at many places at once: how far apart.

What follows a bench with its front handle at polar angle theta of a spiral that winds in from afar is the same whenever
it is there. Places are those angles. Leading benches with different benches behind are sampled together: handle after
handle is placed behind all of them at once, each with its own link.
"""
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, reduce

import numpy as np

from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.dragon import AnyDragon, is_even
from dragon_ros.core.geometry.rectangles import axes_of
from dragon_ros.core.geometry.signed_distance import rounding_m, seen_from
from dragon_ros.core.numerics.types import Complexes, Floats, Ints
from dragon_ros.core.tracks.composite import Track
from dragon_ros.core.tracks.segments import BEHIND

_COMPLEX = np.array([1, 1j])
_AT_ONCE = 512  # places, so that what is between fits the cache
_FEW = 64       # followers tried first: more than two layers of the classic dragon near the centre


@dataclass(frozen=True)
class BenchSamples:
    """Samples at M places of leading benches, of the K - 2 benches from the second behind each on.

    ``lead`` (M,) are the numbers of the leading benches among those of the sampler.
    ``theta`` (M, K+1) are polar angles of all handles from the leading one on, ``delta`` (M, K) what the links span,
    ``centre`` and ``axis`` (M, K) the benches' middles and axes as complex numbers. ``apart`` (M, K-2) is the largest
    separation along the axes of both benches: positive where the pair is apart.
    """

    lead: Ints
    theta: Floats
    delta: Floats
    centre: Complexes
    axis: Complexes
    apart: Floats

    @property
    def places(self) -> Floats:
        """Polar angles (M,) of the leading handle."""
        return self.theta[:, 0]

    def rows(self, index: Ints | slice) -> 'BenchSamples':
        """Return some of the samples."""
        return BenchSamples(*(getattr(self, name)[index] for name in _FIELDS))


_FIELDS = tuple(each.name for each in fields(BenchSamples))


def joined(samples: list[BenchSamples]) -> BenchSamples:
    """Return several samples as one."""
    return BenchSamples(*(np.concatenate([getattr(each, name) for each in samples]) for name in _FIELDS))


def samples_of(track: Track, links_m: Floats, half_m: tuple[Floats, float | Floats], theta: Floats,
               lead: Ints) -> BenchSamples:
    """Return the samples of leading benches at places (M,), of links for all (K,) or for each (M, K).

    ``half_m`` are half lengths (M or 1, K) and half widths (M, 1), or one for all.
    """
    leaders = np.zeros(theta.size, dtype=np.int64), theta, np.zeros_like(theta)
    chain = marched_many(track, links_m, leaders, BEHIND)
    z, axis = chain.p @ _COMPLEX, axes_of(chain) @ _COMPLEX
    # Far out an angle has too few digits for what a link spans: with its low part it has.
    delta, centre = np.diff(chain.u) + np.diff(chain.u_lo), 0.5 * (z[:, :-1] + z[:, 1:])
    half_length_m, half_width_m = half_m
    pairs = seen_from((centre[:, :1], centre[:, 2:]), (axis[:, :1], axis[:, 2:]),
                      (half_length_m[:, :1], half_width_m), (half_length_m[:, 2:], half_width_m))
    return BenchSamples(lead, chain.u, delta, centre, axis, reduce(np.maximum, pairs.along_axes()))


@dataclass(frozen=True)
class Sizes:
    """The sampled benches: links, half lengths (L, K) and half width in metres; ``error_m`` is what handles may err by.

    There is a row for each leading bench, or after ``of`` for each sample. ``longest_m`` (L, 1) is the longest link of
    these or behind; 0 where all behind the first are equal. Fewer than K benches are followed by more like the last.
    """

    b_m: float
    error_m: float
    links_m: Floats
    half_length_m: Floats
    half_width_m: float
    longest_m: Floats

    def of(self, lead: Ints) -> 'Sizes':
        """Return the rows of samples; one row stands for all where there is no other."""
        if self.longest_m.size == 1:
            return self
        rows = (each[lead] for each in (self.links_m, self.half_length_m, self.longest_m))
        links_m, half_length_m, longest_m = rows
        return replace(self, links_m=links_m, half_length_m=half_length_m, longest_m=longest_m)

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
    """Samples benches ``leads`` (0 is the head), each with the ``follow`` benches from it on, on a first spiral.

    ``error_m`` is what positions may err by. Of several leads, no link may be of no length, or nearly so.
    """

    track: Track
    dragon: AnyDragon
    leads: tuple[int, ...]
    follow: int
    progress: Callable[[int], object]
    error_m: float

    def sample(self, theta: Floats, lead: Ints | None = None) -> BenchSamples:
        """Return the samples at places (M,) of leading benches (M,), given as numbers; the first where none are."""
        lead = np.zeros(theta.size, dtype=np.int64) if lead is None else lead
        return joined([self._sample(theta[at:at + _AT_ONCE], lead[at:at + _AT_ONCE])
                       for at in range(0, theta.size, _AT_ONCE)])

    def _sample(self, theta: Floats, lead: Ints) -> BenchSamples:
        self.progress(theta.size)
        size = self.sizes.of(lead)
        links_m = size.links_m[0] if len(self.leads) == 1 else size.links_m
        return samples_of(self.track, links_m, (size.half_length_m, size.half_width_m), theta, lead)

    @property
    def b_m(self) -> float:
        """Radius that the spiral gains for each radian."""
        assert self.track.from_afar
        return self.track.from_afar.curve.b_m

    @cached_property
    def sizes(self) -> Sizes:
        """Of the sampled benches."""
        d = self.dragon
        sampled = np.minimum(np.array(self.leads)[:, None] + np.arange(self.follow), d.benches - 1)
        rest = [d.link_lengths_m[lead:] for lead in self.leads]
        longest_m = [[0.0 if is_even(each) else float(np.max(each))] for each in rest]
        return Sizes(self.b_m, self.error_m, d.link_lengths_m[sampled], 0.5 * d.bench_lengths_m[sampled],
                     0.5 * d.width_m, np.array(longest_m))

    def reaching(self, theta: Floats, lead: Ints | None = None) -> 'BenchSampler':
        """Return a sampler with no more followers than can come within reach at any of some places, if it is so few."""
        follow, most = _FEW, self.dragon.benches - np.array(self.leads)
        while follow < self.follow:
            fewer = replace(self, follow=follow)
            samples = fewer.sample(theta, lead)
            sizes = fewer.sizes.of(samples.lead)
            away = further(samples, samples, sizes, beyond(samples, samples, sizes)) > 0
            clear = np.all(away | (np.arange(2, follow) >= most[samples.lead][:, None]), axis=0)
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
    inner, chord = np.minimum(a.theta, b.theta)[:, 2:-1], sizes.links_m[:, 2:] / sizes.b_m
    linked = chord > 0
    across = line_distance(np.where(linked, chord, 1), np.where(linked, span, 1), 2 * sizes.angle_errors(inner))
    along = inner * inner / np.sqrt(1 + inner * inner)      # of a link of no length: a tangent
    overhang = sizes.half_length_m[:, 0] - 0.5 * sizes.links_m[:, 0]
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
    if not np.any(sizes.longest_m):
        return circle
    overhang = np.hypot(sizes.half_length_m[:, :1] - 0.5 * sizes.links_m[:, :1], sizes.half_width_m)
    inner, outer = np.minimum(a.theta, b.theta)[:, 2:-1], np.maximum(a.theta[:, 1], b.theta[:, 1])
    nearest = np.maximum(sizes.b_m * inner - 2 * sizes.error_m, 0.0)
    away = np.sqrt(np.maximum((nearest - 0.5 * sizes.longest_m) * (nearest + 0.5 * sizes.longest_m), 0.0))
    off = sizes.rounding_m(np.maximum(a.theta[:, -1], b.theta[:, -1])) + 2 * sizes.error_m
    out: Floats = np.where(sizes.longest_m > 0, away - 2 * overhang - (sizes.b_m * outer + off)[:, None], circle)
    return out
