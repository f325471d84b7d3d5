"""The recent positions of the head."""
import numpy as np

from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.tracks.segments import BEHIND


def trail(simulation: Simulation, t_s: float) -> Floats:
    """Return evenly spaced positions of the head (m, shape (points, 2)) over ``trails.seconds``, oldest first."""
    trails = simulation.scene.trails
    times = np.linspace(max(0.0, t_s - trails.seconds), t_s, trails.points)
    return read_only(np.ascontiguousarray(_head_at(simulation, times)))


def _head_at(simulation: Simulation, times_s: Floats) -> Floats:
    """Return the head's positions (S, 2) at many times; if the tail leads, the head is the far end of the chain."""
    model, travel_m = simulation.model, simulation.scene.head.travelled_m(times_s)
    if model.direction == BEHIND:
        return model.track.points(*model.leader.places(travel_m))
    head: Floats = model.place_many(travel_m).p[:, 0]
    return head
