"""Accelerations of the handles, and what they say about the pull in the links."""
import numpy as np

from dragon_ros.core.chain import SpiralChain
from dragon_ros.core.motion import dot, handle_motion
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame
from dragon_ros.core.types import Floats, read_only


def accelerations(scene: Scene, frame: Frame) -> Floats:
    """Return the accelerations (N+1, 2) of all handles in m/s^2, from the rigid links and the head's steady speed."""
    assert isinstance(frame.chain, SpiralChain)
    per_way = handle_motion(scene.spiral.b_m, frame.chain, frame.axis)[1]
    return read_only(per_way * scene.steady_m_s**2)


def tensions(_: Scene, frame: Frame) -> Floats:
    """Return the tensions (N,) of all links in newtons for each kilogram at a handle, positive where a link pulls.

    The model: equal masses at the handles, massless links, a track without friction that pushes only across itself;
    whoever leads moves the head. Along the track handle i feels its own two links alone, which gives, from the tail on,
    T[i-1] axis[i-1] . t[i] = a[i] . t[i] + T[i] axis[i] . t[i].
    """
    chain, a = frame.chain, frame.acceleration_m_s2
    assert a is not None
    t = chain.tangents
    along = dot(a, t).tolist()
    front, rear = dot(frame.axis, t[1:]).tolist(), dot(frame.axis, t[:-1]).tolist()
    out = np.empty(len(front))
    pull = 0.0
    for i in range(len(front) - 1, -1, -1):
        out[i] = pull = (along[i + 1] + pull) / front[i]
        pull *= rear[i]
    return read_only(out)
