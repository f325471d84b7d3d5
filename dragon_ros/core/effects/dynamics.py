"""Accelerations of the handles, and the tensions in the links that they say."""
import numpy as np

from dragon_ros.core.frame import Frame
from dragon_ros.core.kinematics import HEAD, TAIL, RigidLinks, carried, entered_curvatures
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.numerics.vectors import dot
from dragon_ros.core.old_chain import SpiralChain
from dragon_ros.core.placed import BACK
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.walk_chain import WalkChain


def accelerations(scene: Scene, frame: Frame) -> Floats:
    """Return the accelerations (N+1, 2) of all handles in m/s^2, from the rigid links and the leader's law.

    Where they jump, at a knot of the law and where a handle passes a joint of the track, they are those just after.
    """
    links, t_s = _links(scene, frame), frame.t_ns / NS
    speeds = links.speeds(scene.head.speed_at_m_s(t_s))
    piece, u = _places(scene, frame)
    curvature = entered_curvatures(scene.chained.walk, piece, u, speeds, scene.promise_m)
    return links.accelerations(speeds, curvature, scene.head.acceleration_at_m_s2(t_s))


def tensions(scene: Scene, frame: Frame) -> Floats:
    """Return the tensions (N,) of all links in newtons for each kilogram at a handle, positive where a link pulls.

    The model: equal masses at the handles, massless links, a track without friction that pushes only across itself;
    the leader is moved from outside. Along the track a handle feels its own two links alone,

        a[i] . t[i] = T[i-1] e[i-1] . t[i] - T[i] e[i] . t[i],

    which gives all tensions from the free end on, where there is no further link: from the tail on behind a head, from
    the head on behind a tail.
    """
    links, a = _links(scene, frame), frame.acceleration_m_s2
    assert a is not None
    front, rear = links.cosines
    along = dot(a, links.forward)
    none = np.zeros(())
    if links.leader == HEAD:    # link i - 1 from link i, divided by its own part along the track at handle i
        ratio = np.append(front[1:], 0.0) / rear
        return read_only(carried(none, ratio[::-1], (along[1:] / rear)[::-1])[:0:-1].copy())
    ratio = np.append(0.0, rear[:-1]) / front
    return read_only(carried(none, ratio, -along[:-1] / front)[1:].copy())


def _links(scene: Scene, frame: Frame) -> RigidLinks:
    chain = frame.chain
    return RigidLinks(chain.p, chain.links_m, -chain.tangents, HEAD if scene.chained.way == BACK else TAIL)


def _places(scene: Scene, frame: Frame) -> tuple[Ints, Floats]:
    """Return the segments (N+1,) of all handles and their coordinates there; marched for a chain that has none."""
    chain = frame.chain
    if isinstance(chain, SpiralChain):
        return np.zeros(chain.theta.shape, dtype=np.int64), chain.theta
    if not isinstance(chain, WalkChain):
        chain = scene.chained.chain(scene.head.travelled_m(frame.t_ns / NS), scene.effort)
    return chain.piece, chain.u
