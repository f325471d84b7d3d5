"""The chain on a walk: coordinates and velocities of handles that lie on pieces of track."""
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.chain import Chain
from dragon_ros.core.march import Effort
from dragon_ros.core.march_many import place_many
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.placed import AHEAD, BACK
from dragon_ros.core.walk import Place, Walk
from dragon_ros.core.walk_many import Places, next_places


@dataclass(frozen=True)
class WalkChain(Chain):
    """A chain on a walk: ``u + u_lo`` (..., N+1) are coordinates on the pieces with the numbers ``piece``.

    ``leader`` is 0 where the head leads, -1 where the tail does: its speed is the head law's.
    """

    walk: Walk
    piece: Ints
    u: Floats
    u_lo: Floats
    forward: Floats
    leader: int
    solver = 'walk'

    @property
    def tangents(self) -> Floats:
        """Unit tangents against the head's way, towards the tail."""
        return -self.forward

    def velocities(self, head_speed_m_s: float | Floats) -> Floats:
        """Return velocity vectors in m/s; the leader's speed is positive in its own way (outwards for the tail)."""
        axis = self.p[..., :-1, :] - self.p[..., 1:, :]
        along_front = np.sum(axis * self.forward[..., :-1, :], axis=-1)
        along_rear = np.sum(axis * self.forward[..., 1:, :], axis=-1)
        joined = self.links_m == 0
        front, rear = np.where(joined, 1.0, along_front), np.where(joined, 1.0, along_rear)
        speed = np.empty(self.u.shape)
        leading = np.asarray(head_speed_m_s, dtype=np.float64)
        if self.leader == 0:
            speed[..., 0] = leading
            np.multiply(np.cumprod(front / rear, axis=-1), leading[..., None], out=speed[..., 1:])
        else:
            speed[..., -1] = -leading
            back = np.cumprod((rear / front)[..., ::-1], axis=-1)[..., ::-1]
            np.multiply(back, -leading[..., None], out=speed[..., :-1])
        return read_only(speed[..., None] * self.forward)


def chain_on(walk: Walk, links_m: Floats, leader: Place, way: int, effort: Effort) -> WalkChain:
    """Return the chain behind a leader: the head (``way`` BACK: followers lie back along the way), or the tail."""
    places, spent = walk.follow(links_m if way == BACK else links_m[::-1], leader, way, effort)
    if way == AHEAD:
        places.reverse()
    piece = np.array([place.piece for place in places])
    u = np.array([place.u for place in places], dtype=np.float64)
    p, forward = walk.points(piece, u[:, 0], u[:, 1])
    return WalkChain(p, links_m, spent, walk, piece, u[:, 0], u[:, 1], forward, 0 if way == BACK else -1)


def chains_on(walk: Walk, links_m: Floats, leaders: Places, way: int, effort: Effort) -> WalkChain:
    """Return the chains of many leaders in one, as ``chain_on`` does for one, marched together."""
    if way == BACK and walk.afar and not np.any(leaders[0]):
        along = place_many(walk.afar, links_m, leaders[1], leaders[2], effort)
        piece, u, u_lo, spent = np.zeros(along.theta.shape, dtype=np.int64), along.theta, along.theta_lo, along.evaluations
    else:
        order, spent = (links_m if way == BACK else links_m[::-1]), 0
        places = [leaders]
        for chord_m in order.tolist():
            following, more = next_places(walk, places[-1], chord_m, way, effort.newton)
            places.append(following)
            spent += more
        piece, u, u_lo = (np.stack(values, axis=1)[:, ::-way] for values in zip(*places, strict=True))
    p, forward = walk.points(piece, u, u_lo)
    return WalkChain(p, links_m, spent, walk, piece, u, u_lo, forward, 0 if way == BACK else -1)


def stacked(chains: Sequence[WalkChain]) -> WalkChain:
    """Return chains of one dragon as one, with a leading axis."""
    first = chains[0]
    p, piece, u, u_lo, forward = (np.stack([getattr(chain, name) for chain in chains])
                                  for name in ('p', 'piece', 'u', 'u_lo', 'forward'))
    return WalkChain(read_only(p), first.links_m, sum(chain.evaluations for chain in chains), first.walk, piece, u,
                     u_lo, read_only(forward), first.leader)
