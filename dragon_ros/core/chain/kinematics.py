"""Speeds and accelerations of the handles of rigid links, on any track, with the head or the tail as the leader.

Handle i moves along the track at the signed speed s_i, positive in the head's direction, so that q' = s T and

    q'' = s' T + s^2 kappa N,

where T is the unit tangent in the head's direction, N is its left normal and kappa is the signed curvature. A link
leads from its rear handle r to its front handle f in the unit direction e, and its length l is constant: |q_f -
q_r|^2 = l^2. Differentiating this once and twice gives

    s_f (e . T_f) = s_r (e . T_r),
    s_f' (e . T_f) + s_f^2 kappa_f (e . N_f) + |q_f' - q_r'|^2 / l = s_r' (e . T_r) + s_r^2 kappa_r (e . N_r).

These equations, one for s and one for s' per link, are solved link by link, starting at the leader. If e . T of a
follower vanishes, the chain locks.
"""
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np

from dragon_ros.core.numerics.types import Floats, Ints, dot, left, read_only
from dragon_ros.core.tracks.composite import Track

_ULP = 2.0**-52


@dataclass(frozen=True, eq=False)
class RigidLinks:
    """The links of a chain and the tangents at its handles, at one instant or at many (leading axes).

    ``p`` holds the handle positions (m, shape (..., N+1, 2)), ``links_m`` holds the link lengths (m, shape (N,)),
    ``forward`` (..., N+1, 2) holds the unit tangents in the head's direction, and ``leader`` is the index of the
    leading handle, 0 or -1. The leader's speed and tangential acceleration are positive in the leader's own direction:
    the head's direction if the head leads, and the opposite direction if the tail leads.
    """

    p: Floats
    links_m: Floats
    forward: Floats
    leader: int

    @cached_property
    def axis(self) -> Floats:
        """Unit vectors (..., N, 2) from handle i + 1 to handle i."""
        axis = self.p[..., :-1, :] - self.p[..., 1:, :]
        out: Floats = axis / np.hypot(axis[..., 0], axis[..., 1])[..., None]
        return out

    @cached_property
    def cosines(self) -> tuple[Floats, Floats]:
        """Scalar products e . T at the front handle and at the rear handle of each link, each of shape (..., N)."""
        return dot(self.axis, self.forward[..., :-1, :]), dot(self.axis, self.forward[..., 1:, :])

    def speeds(self, leader_m_s: float | Floats) -> Floats:
        """Return the handles' signed speeds (m/s, shape (..., N+1)), positive in the head's direction."""
        front, rear = self.cosines
        out = np.empty(self.p.shape[:-1])
        leading = self._forward(leader_m_s)
        out[..., self.leader] = leading
        if self.leader == 0:
            np.multiply(np.cumprod(front / rear, axis=-1), leading[..., None], out=out[..., 1:])
        else:
            ratio = np.cumprod((rear / front)[..., ::-1], axis=-1)[..., ::-1]
            np.multiply(ratio, leading[..., None], out=out[..., :-1])
        return out

    def accelerations(self, speeds: Floats, curvature: Floats, leader_m_s2: float | Floats) -> Floats:
        """Return the accelerations (m/s^2, shape (..., N+1, 2)).

        ``speeds`` (..., N+1) is the result of the method ``speeds``. ``curvature`` (..., N+1) is the signed curvature
        (1/m), positive if the head turns left (see ``entered_curvatures`` for joints). ``leader_m_s2`` (...) is the
        rate of change of the leader's speed.
        """
        side, bend = left(self.forward), speeds * speeds * curvature
        front, rear = self.cosines
        v = speeds[..., None] * self.forward
        spread = v[..., :-1, :] - v[..., 1:, :]
        pull = (bend[..., :-1] * dot(self.axis, side[..., :-1, :]) - bend[..., 1:] * dot(self.axis, side[..., 1:, :])
                + dot(spread, spread) / self.links_m)
        leading = self._forward(leader_m_s2)
        if self.leader == 0:
            tangential = carried(leading, front / rear, pull / rear)
        else:
            tangential = carried(leading, (rear / front)[..., ::-1], (-pull / front)[..., ::-1])[..., ::-1]
        return read_only(tangential[..., None] * self.forward + bend[..., None] * side)

    def _forward(self, leader: float | Floats) -> Floats:
        """Convert a speed or acceleration of the leader so that it is positive in the head's direction."""
        rate = np.asarray(leader, dtype=np.float64)
        return rate if self.leader == 0 else -rate


def carried(start: Floats, ratio: Floats, added: Floats) -> Floats:
    """Return y (..., N+1) with y[0] = ``start`` (...) and y[m+1] = ``ratio``[m] y[m] + ``added``[m], both (..., N)."""
    if ratio.ndim == 1:
        return np.array(list(_carried(float(start), zip(ratio.tolist(), added.tolist(), strict=True))))
    out = np.empty((*ratio.shape[:-1], ratio.shape[-1] + 1))
    out[..., 0] = start
    for m in range(ratio.shape[-1]):
        out[..., m + 1] = ratio[..., m] * out[..., m] + added[..., m]
    return out


def _carried(start: float, steps: Iterator[tuple[float, float]]) -> Iterator[float]:
    return accumulate(steps, lambda y, step: step[0] * y + step[1], initial=start)


def entered_curvatures(track: Track, segment: Ints, u: Floats, speeds: Floats, within_m: float) -> Floats:
    """Return the signed curvatures (1/m, shape (..., N+1)) at all handles just after this instant.

    ``within_m`` is the largest possible position error: a handle at most this far from a joint counts as being on the
    segment that it is entering. A handle at rest counts as being on its own segment; the curvature there has no effect,
    because it is multiplied by the squared speed.
    """
    if not track.joints_m:
        return track.curvatures(segment, u)
    along, joints = track.distances(segment, u), np.array(track.joints_m)
    near = within_m + 4 * _ULP * np.abs(along)      # the distance along the track is also rounded
    entered = np.where(speeds > 0, np.searchsorted(joints, along + near, side='right'),
                       np.where(speeds < 0, np.searchsorted(joints, along - near, side='left'), segment))
    ahead, behind = entered > segment, entered < segment
    if not np.any(ahead | behind):
        return track.curvatures(segment, u)
    first, last = (np.array([getattr(one, end) for one in track.segments]) for end in ('first', 'last'))
    return track.curvatures(entered, np.where(ahead, first[entered], np.where(behind, last[entered], u)))
