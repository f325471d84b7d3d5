"""The leading handle: where it is, which way it goes, and how fast."""
from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.frame import LeaderMotion
from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import read_only


def leader_motion(simulation: Simulation, t_s: float, chain: Chain) -> LeaderMotion:
    """Return the place of the leading handle, the direction of its way, and its speed and turn on it.

    The way of a tail that leads is outwards, against that of a head.
    """
    model, at, speed = simulation.model, chain.leader, simulation.scene.head.speed_at_m_s(t_s)
    segment, u, _ = chain.places
    curvature = float(chain.track.curvatures(segment[[at]], u[[at]])[0])
    return LeaderMotion(read_only(chain.p[at].copy()), read_only(-model.direction * chain.headings[at]), speed,
                        -model.direction * curvature * speed)
