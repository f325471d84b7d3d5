"""One bench that goes along a track: where its corners are, and how far they can be between two of its places.

A bench lies as the place of its front handle says, whoever leads and whenever. Let s and t be the ways of its front and
its rear handle, q and r their places, h and l the ways that they go between two looks. A corner, at the complex lever a
from the bench's middle (a real: along the link), is A q + B r with A = 1/2 + a / link, B = 1/2 - a / link: a coordinate
of it has the derivative by s

    g' = (A q') + (B r') cos alpha / cos beta,

alpha and beta the link's angles with the track's tangents. What goes from x0 to x1 and by X at most on its way is never
further than X / 2 from their mean. With k the largest curvature between the rear handle's first place and the front
handle's last, tangents turn by k h and k l at most, and the link by (h + l) min(k / 2, 1 / link): its rate is
(v_rear sin beta - v_front sin alpha) / link, and where k link < 2 neither sine exceeds k link / 2 (Schur). All factors
of g' therefore lie in balls, and so does g': |g'| <= G. So the coordinate goes by V = min(G h, |A| h + |B| l) at most,
and is nowhere above the mean of its values at the two looks plus V / 2. As looks get closer that comes down with the
square of their distance, and where a handle passes a joint, so that a curvature jumps, with it. The rear handle must
go one way between two looks: always where k link < 2; elsewhere ``lock.turns`` tells where it turns.

A link of no length lies along the track: the corner is q + a q', and g' = q' + i a kappa q'.
"""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dragon_ros.core.numerics.ball_arithmetic import Ball
from dragon_ros.core.numerics.types import Array, Floats, Index, Ints
from dragon_ros.core.placed import BACK
from dragon_ros.core.rising import bends
from dragon_ros.core.walk import Walk

SIDES = ('x', '-x', 'y', '-y')
_TOWARDS = np.array([1, -1, 1j, -1j])
_TOLERANCE = 1e-9       # of Newton's last step: its square is below what floats keep


@dataclass(frozen=True)
class Looks:
    """A bench at M places: ways (2, M), pieces and curvatures of its front and rear handle, and its corners' values.

    ``value`` (M, 4, 4) are the coordinates of the corners towards SIDES, ``front`` and ``rear`` the two parts of their
    derivative but for the ratio cos alpha / cos beta, ``cos`` (2, M).
    """

    way_m: Floats
    piece: Ints
    bend: Floats
    cos: Floats
    value: Floats
    front: Floats
    rear: Floats

    def rows(self, index: Index) -> 'Looks':
        """Return some of the looks."""
        return Looks(self.way_m[:, index], self.piece[:, index], self.bend[:, index], self.cos[:, index],
                     self.value[index], self.front[index], self.rear[index])


@dataclass(frozen=True)
class Sweep:
    """A bench with a link on a walk."""

    walk: Walk
    link_m: float
    half_length_m: float
    half_width_m: float

    @cached_property
    def _lever(self) -> Array:
        """From the middle to the corners, in their order."""
        along, aside = self.half_length_m, 1j * self.half_width_m
        return np.array([along + aside, -along + aside, -along - aside, along - aside])

    @cached_property
    def _shares(self) -> tuple[Array, Array]:
        """A and B of the corners; for a link of no length what the tangent counts is B."""
        if not self.link_m:
            return np.ones(4, dtype=np.complex128), self._lever
        return 0.5 + self._lever / self.link_m, 0.5 - self._lever / self.link_m

    @cached_property
    def reach_m(self) -> float:
        """How far from the front handle the farthest corner is."""
        return float(np.max(np.abs(self._lever - 0.5 * self.link_m)))

    def look(self, along_m: Floats) -> Looks:
        """Return looks at the bench with its front handle at distances along the walk."""
        walk, link = self.walk, self.link_m
        fronts = [walk.place_at(place) for place in along_m.tolist()]
        rears = [walk.next(place, link, BACK, _TOLERANCE)[0] for place in fronts] if link else fronts
        piece = np.array([[place.piece for place in places] for places in (fronts, rears)])
        u = np.array([[place.u for place in places] for places in (fronts, rears)])
        (q, r), (to, to_rear) = (_complex(part) for part in walk.points(piece, u[..., 0], u[..., 1]))
        axis = (q - r) / link if link else to
        cos = np.stack([(axis.conj() * heading).real for heading in (to, to_rear)])
        one, two = self._shares
        value = (0.5 * (q + r))[:, None] + self._lever * axis[:, None]
        return Looks(walk.distances(piece, u[..., 0]), piece, walk.curvatures(piece, u[..., 0]), cos, _sides(value),
                     _sides(one * to[:, None]), _sides(two * (to_rear if link else 1j * to)[:, None]))

    def tops(self, a: Looks, b: Looks) -> Floats:
        """Return bounds (M, 4, 4) of the corners' coordinates between looks a and the next ones b, further along."""
        front_m, rear_m = np.abs(b.way_m - a.way_m)
        most = bends(self.walk, a.piece[1], b.piece[0], a.bend[1], b.bend[0]).most
        turned, other = most * front_m, most * rear_m
        with np.errstate(all='ignore'):
            ratio = self._ratio(a, b, turned, other) if self.link_m else bends(
                self.walk, a.piece[0], b.piece[0], a.bend[0], b.bend[0])
            one, two = (np.abs(share)[:, None] for share in self._shares)
            front = _mean(a.front, b.front, one * _each(turned))
            rear = _mean(a.rear, b.rear, two * _each(other))
            slope = front + rear * Ball(_each(ratio.mid), _each(ratio.rad))
            crude = one * _each(front_m) + two * _each(rear_m if self.link_m else turned)
            goes = np.fmin(crude, slope.most * _each(front_m))
        out: Floats = 0.5 * (a.value + b.value + goes)
        return out

    def _ratio(self, a: Looks, b: Looks, turned: Floats, other: Floats) -> Ball:
        """Return cos alpha / cos beta between looks at which the tangents turn so far."""
        most = bends(self.walk, a.piece[1], b.piece[0], a.bend[1], b.bend[0]).most
        swing = np.minimum(0.5 * most, 1 / self.link_m) * np.sum(np.abs(b.way_m - a.way_m), axis=0)
        alpha, beta = (_mean(a.cos[n], b.cos[n], swing + own) for n, own in enumerate((turned, other)))
        return alpha * beta.inverse()

    def cap_m(self, low_m: float, high_m: float) -> float:
        """Return a bound on all coordinates while the front handle is between two distances along the walk."""
        return max(piece.far_m(a, b) for piece, a, b in self.walk.between(low_m, high_m)) + self.reach_m


def _complex(points: Floats) -> Array:
    out: Array = points[..., 0] + 1j * points[..., 1]
    return out


def _sides(z: Array) -> Floats:
    """Return the coordinates of complex numbers (M, 4) towards SIDES."""
    out: Floats = (z[..., None] * _TOWARDS.conj()).real
    return out


def _each(value: Floats) -> Floats:
    """Return a value for each look, for all corners and sides."""
    return value[:, None, None]


def _mean(a: Floats, b: Floats, gone: Floats) -> Ball:
    """Return the ball of what is a, then b, and in between has gone so far at most."""
    return Ball(0.5 * (a + b), 0.5 * gone)
