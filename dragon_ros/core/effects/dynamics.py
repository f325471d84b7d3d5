"""Accelerations of the handles, and the resulting tensions in the links."""
import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.chain.kinematics import RigidLinks, carried, entered_curvatures
from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import Floats, dot, read_only


def accelerations(simulation: Simulation, t_s: float, chain: Chain) -> Floats:
    """Return the accelerations (m/s^2, shape (N+1, 2)) of all handles, which follow from the leader's law.

    At a jump (a knot of the law, or a handle that passes a joint of the track), the values just after the jump are
    returned.
    """
    law, links = simulation.scene.head, _links(chain)
    speeds = links.speeds(law.speed_at_m_s(t_s))
    segment, u = chain.places
    curvature = entered_curvatures(chain.track, segment, u, speeds, simulation.promise_m)
    return links.accelerations(speeds, curvature, law.acceleration_at_m_s2(t_s))


def tensions(chain: Chain, a: Floats) -> Floats:
    """Return the tension (N,) of each link, in newtons per kilogram of mass at each handle, positive if it pulls.

    ``a`` (N+1, 2) holds the accelerations of the handles in m/s^2.

    The model has equal masses at the handles, massless links, and a frictionless track that acts only along its normal;
    the leader is driven externally. Along the track, only the two adjacent links act on a handle:

        a[i] . t[i] = T[i-1] e[i-1] . t[i] - T[i] e[i] . t[i].

    This determines all tensions, starting at the free end: at the tail if the head leads, or at the head if the tail
    leads. There is no link beyond the free end.
    """
    links = _links(chain)
    front, rear = links.cosines
    along = dot(a, links.forward)
    none = np.zeros(())
    if links.leader == 0:    # link i - 1 follows from link i: divide by the component of link i - 1 along the track
        ratio = np.append(front[1:], 0.0) / rear
        return read_only(carried(none, ratio[::-1], (along[1:] / rear)[::-1])[:0:-1].copy())
    ratio = np.append(0.0, rear[:-1]) / front
    return read_only(carried(none, ratio, -along[:-1] / front)[1:].copy())


def _links(chain: Chain) -> RigidLinks:
    return RigidLinks(chain.p, chain.links_m, chain.headings, chain.leader)
