"""The leading handle: where it is, which way it goes, and how fast."""
from dragon_ros.core.frame import Frame, Leading
from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import read_only
from dragon_ros.core.scene import NS


def leading(simulation: Simulation, frame: Frame) -> Leading:
    """Return the place of the leading handle, the direction of its way, and its speed and turn on it.

    The way of a tail that leads is outwards, against that of a head.
    """
    chain, model = frame.chain, simulation.model
    at, speed = chain.leader, simulation.scene.head.speed_at_m_s(frame.t_ns / NS)
    segment, u, _ = chain.places
    curvature = float(chain.track.curvatures(segment[[at]], u[[at]])[0])
    return Leading(read_only(chain.p[at].copy()), read_only(-model.direction * chain.headings[at]), speed,
                   -model.direction * curvature * speed)
