"""The positions of the head in the last seconds."""
import numpy as np

from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.tracks.segments import BEHIND


def trail(simulation: Simulation, t_s: float) -> Floats:
    """Return the head's positions in the last ``trails.seconds`` at equal times, oldest first, (points, 2) in m."""
    trails = simulation.scene.trails
    times = np.linspace(max(0.0, t_s - trails.seconds), t_s, trails.points)
    return read_only(np.ascontiguousarray(_head_at(simulation, times)))


def _head_at(simulation: Simulation, times_s: Floats) -> Floats:
    """Return the head's positions at many times, (S, 2): those of the leader, or of the far end if the tail leads."""
    model, gone_m = simulation.model, simulation.scene.head.travelled_m(times_s)
    if model.direction == BEHIND:
        return model.track.points(*model.leader.places(gone_m))
    head: Floats = model.place_many(gone_m).p[:, 0]
    return head
