"""Accelerations of the handles, and what they say about the pull in the links."""
import numpy as np

from dragon_ros.core.chain import Chain, SpiralChain
from dragon_ros.core.motion import carried, dot, handle_motion
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.path import Spiral
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame


def accelerations(scene: Scene, frame: Frame) -> Floats:
    """Return the accelerations (N+1, 2) of all handles in m/s^2, from the rigid links and the head's steady speed."""
    per_way = handle_motion(scene.spiral.b_m, _on_spiral(scene.spiral, frame.chain), frame.axis)[1]
    return read_only(per_way * scene.steady_m_s**2)


def _on_spiral(spiral: Spiral, chain: Chain) -> SpiralChain:
    """Return a chain of any solver with its polar angles; they grow from head to tail as the distances do."""
    if isinstance(chain, SpiralChain):
        return chain
    theta = np.hypot(chain.p[:, 0], chain.p[:, 1]) / spiral.b_m
    return SpiralChain(chain.p, chain.links_m, chain.evaluations, theta, np.zeros_like(theta), np.diff(theta))


def tensions(_: Scene, frame: Frame) -> Floats:
    """Return the tensions (N,) of all links in newtons for each kilogram at a handle, positive where a link pulls.

    The model: equal masses at the handles, massless links, a track without friction that pushes only across itself;
    whoever leads moves the head. Along the track handle i feels its own two links alone, which gives, from the tail on,
    T[i-1] axis[i-1] . t[i] = a[i] . t[i] + T[i] axis[i] . t[i].
    """
    chain, a = frame.chain, frame.acceleration_m_s2
    assert a is not None
    t = chain.tangents
    front, rear = dot(frame.axis, t[1:]), dot(frame.axis, t[:-1])
    # From the tail: the pull on handle i of its rear link is the one before it times that link's own part along t.
    ratio = np.append(rear[1:], 0.0) / front
    pulls = carried(np.zeros(()), ratio[::-1], (dot(a, t)[1:] / front)[::-1])
    return read_only(pulls[:0:-1].copy())
