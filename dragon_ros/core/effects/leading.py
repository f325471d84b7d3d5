"""The leading handle: its position, direction and speed."""
from dataclasses import dataclass

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import Floats, read_only


@dataclass(frozen=True)
class LeaderMotion:
    """The leading handle: its position (m) and the unit direction of its motion, each of shape (2,), and its speed.

    ``turn_rad_s`` is the rate at which this direction turns, positive to the left.
    """

    p: Floats
    direction: Floats
    speed_m_s: float
    turn_rad_s: float


def leader_motion(simulation: Simulation, t_s: float, chain: Chain) -> LeaderMotion:
    """Return the position of the leading handle, the direction of its motion, its speed and its turning rate.

    A leading tail moves outwards, opposite to the direction of a leading head.
    """
    model, at, speed = simulation.model, chain.leader, simulation.scene.head.speed_at_m_s(t_s)
    segment, u = chain.places
    curvature = float(chain.track.curvatures(segment[[at]], u[[at]])[0])
    return LeaderMotion(read_only(chain.p[at].copy()), read_only(-model.direction * chain.headings[at]), speed,
                        -model.direction * curvature * speed)
