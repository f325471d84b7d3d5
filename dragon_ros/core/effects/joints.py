"""The angles between consecutive benches, which are the joint angles of the dragon as a robot."""
import numpy as np

from dragon_ros.core.numerics.types import Floats, read_only


def joint_angles(axis: Floats) -> Floats:
    """Return the angle from each bench to the next (rad, shape (N - 1,)), in (-pi, pi] and positive to the left.

    ``axis`` (N, 2) holds the unit directions of the benches, from the rear to the front.
    """
    ahead, behind = axis[:-1], axis[1:]
    across = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    return read_only(np.arctan2(across, np.sum(ahead * behind, axis=1)))
