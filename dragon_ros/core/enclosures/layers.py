"""A lower bound on the gap between a bench and all benches behind it on a spiral whose layers are provably apart.

A bench lies in a band along the spiral: at each polar angle phi, the radii of its points are between b phi - inner and
b phi + outer. Adjacent layers of the spiral are one pitch apart at each angle. If the pitch exceeds the outer half band
of one layer plus the inner half band of the next layer, benches of different layers cannot touch, wherever they are on
their layers. Benches of the same layer are apart because a link lies between them.

The bound depends only on the smallest distance of the bench's front handle from the centre, and it increases with this
distance. A single evaluation therefore clears everything further out, and no handles need to be placed
(docs/contact-lemmas.md, lemma 8).

The bound is rounded down: ``ABOVE`` covers the rounding errors of its formulas.
"""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dragon_ros.core.chain.dragon import AnyDragon
from dragon_ros.core.enclosures.ball_arithmetic import ABOVE
from dragon_ros.core.numerics.types import Floats, Ints


@dataclass(frozen=True)
class Layers:
    """The benches of a dragon on the spiral r = b theta."""

    b_m: float
    dragon: AnyDragon

    @property
    def pitch_m(self) -> float:
        """The distance between adjacent layers."""
        return 2 * np.pi * self.b_m

    @property
    def _half_width_m(self) -> float:
        return 0.5 * self.dragon.width_m

    @cached_property
    def _longest_m(self) -> Floats:
        """For each bench (N,), the longest of its own link and all links behind it."""
        return np.maximum.accumulate(self.dragon.link_lengths_m[::-1])[::-1]

    def gaps_m(self, theta: Floats, bench: Ints) -> Floats:
        """Return bounds (M,) on the gaps between benches (M,) and all benches behind them except the next ones.

        The bounds hold while the front handles of the benches have polar angles of ``theta`` (M,) or more. A bound that
        is not positive proves nothing. At least two benches must be behind each bench.
        """
        radius_m = self.b_m * theta
        link_m, longest_m = self.dragon.link_lengths_m, self._longest_m[bench + 2]
        own_m, between_m = link_m[bench], link_m[bench + 1]
        with np.errstate(all='ignore'):
            out = np.minimum(self._other_layers(radius_m, own_m, longest_m),
                             self._same_layer(radius_m, own_m, between_m, longest_m))
            low_m = out - (ABOVE - 1) * (self.pitch_m + own_m + between_m + longest_m + self.dragon.width_m)
        return np.where(np.isfinite(low_m), low_m, -np.inf)

    def _other_layers(self, radius_m: Floats, own_m: Floats, longest_m: Floats) -> Floats:
        """Return bounds on the gaps to benches in the layers further out.

        Along a path of length s from a bench to a bench in an outer layer, r - b phi grows by at least a pitch minus
        both half bands. It grows by at most s |grad (r - b phi)| = s sqrt(1 + (b / r)^2).
        """
        outer_m = radius_m + self._further_m(radius_m, own_m, longest_m)
        facing_m = self._band(radius_m, own_m)[1] + self._band(outer_m, longest_m)[0]
        least_m = self._nearest(radius_m, np.maximum(own_m, longest_m)) - self._half_width_m - 0.5 * self.pitch_m
        out: Floats = (self.pitch_m - facing_m) / np.hypot(1.0, self.b_m / least_m)
        return out

    def _further_m(self, radius_m: Floats, own_m: Floats, longest_m: Floats) -> Floats:
        """Return how much further out the front handles of outer benches are if these are less than a pitch away.

        The nearest points of two benches are one turn apart along the spiral, less the angle that a pitch subtends at
        the centre. In angles about the centre, no point of a bench is further behind its front handle than the span of
        its link plus the angle of a corner, or further ahead of it than the angle of a corner. The result is NaN at
        positions less than half a pitch from the centre.
        """
        nearest_m = self._nearest(radius_m, np.maximum(own_m, longest_m))
        seen = np.arcsin(0.5 * self.pitch_m / (nearest_m - self._half_width_m))
        less = 2 * self._corner(nearest_m) + 2 * seen + 0.5 * np.pi * longest_m / radius_m
        out: Floats = self.b_m * np.maximum(2 * np.pi - less, 0.0)
        return out

    def _corner(self, nearest_m: Floats) -> Floats:
        """Return the largest angle, seen from the centre, by which a bench extends beyond its link."""
        out: Floats = np.arcsin(np.hypot(self.dragon.hole_inset_m, self._half_width_m) / nearest_m)
        return out

    def _band(self, radius_m: Floats, link_m: Floats) -> tuple[Floats, Floats]:
        """Return how far benches extend inwards and outwards from the spiral, measured along the radius.

        Along the line through a link, r - b phi vanishes at both handles, and its second derivative is between -c^2 /
        r and (1 + c^2) / r, with c = b / r.
        """
        nearest_m, overhang_m = self._nearest(radius_m, link_m), self.dragon.hole_inset_m
        square = (self.b_m / (nearest_m - self._half_width_m)) ** 2
        sagitta_m, beyond_m = link_m * link_m / (8 * nearest_m), overhang_m * (link_m + overhang_m) / (2 * nearest_m)
        side_m = self._half_width_m * np.sqrt(1 + square)
        return (side_m + np.maximum((1 + square) * sagitta_m, square * beyond_m),
                side_m + np.maximum((1 + square) * beyond_m, square * sagitta_m))

    def _nearest(self, radius_m: Floats, link_m: Floats) -> Floats:
        """Return lower bounds on the distances of benches' middle lines, including overhangs, from the centre."""
        off_m = np.maximum(0.5 * link_m, 0.25 * self.pitch_m)
        out: Floats = np.sqrt((radius_m - off_m) * (radius_m + off_m))
        return out

    def _same_layer(self, radius_m: Floats, own_m: Floats, between_m: Floats, longest_m: Floats) -> Floats:
        """Return bounds on the gaps to benches in the same layer.

        The link directly behind the bench spans at least its length over sqrt(b^2 + r^2), where r is the radius of its
        rear handle; at most a quarter turn is used.
        """
        nearest_m = self._nearest(radius_m, np.maximum(own_m, longest_m))
        least_m = nearest_m - self._half_width_m
        rear_m, most = radius_m + 0.25 * self.pitch_m * (own_m + between_m) / radius_m, between_m / radius_m
        apart_m = between_m * least_m / np.hypot(self.b_m, rear_m) - 2 * nearest_m * self._corner(nearest_m)
        return np.where(most <= 0.5 * np.pi, np.sinc(most / np.pi) * apart_m, -np.inf)
