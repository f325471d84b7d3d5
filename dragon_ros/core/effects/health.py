"""How well a tick was solved."""
from dragon_ros.core.frame import Frame, Health
from dragon_ros.core.model import Simulation


def health(simulation: Simulation, frame: Frame) -> Health:
    """Return how well the frame's chain keeps its links."""
    chain = frame.chain
    off_m, link = chain.worst
    return Health(chain.solver, chain.evaluations, link, off_m, 2 * simulation.promise_m)
