"""The leading handle: its position, direction and speed."""
from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.frame import LeaderMotion
from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import read_only


def leader_motion(simulation: Simulation, t_s: float, chain: Chain) -> LeaderMotion:
    """Return the position of the leading handle, the direction of its motion, its speed and its turning rate.

    A leading tail moves outwards, opposite to the direction of a leading head.
    """
    model, at, speed = simulation.model, chain.leader, simulation.scene.head.speed_at_m_s(t_s)
    segment, u = chain.places
    curvature = float(chain.track.curvatures(segment[[at]], u[[at]])[0])
    return LeaderMotion(read_only(chain.p[at].copy()), read_only(-model.direction * chain.headings[at]), speed,
                        -model.direction * curvature * speed)
