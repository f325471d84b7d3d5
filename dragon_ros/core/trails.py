"""The way that the head has come lately."""
import numpy as np

from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.path import points
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import Frame, states


def trail(scene: Scene, frame: Frame) -> Floats:
    """Return where the head was in the last ``trails.seconds`` at equal times, oldest first, (points, 2) in metres."""
    now = frame.t_ns / NS
    times = np.linspace(max(0.0, now - scene.trails.seconds), now, scene.trails.points)
    return read_only(np.ascontiguousarray(_head_at(scene, times)))


def _head_at(scene: Scene, times_s: Floats) -> Floats:
    """Return where the head is at many times, (S, 2): where a tail leads, at the end of all others."""
    if scene.head.lead == 'tail':
        return states(scene, times_s.tolist()).p[:, 0]
    gone = scene.head.travelled_m(times_s)
    if scene.led:
        return scene.led.walk.points(*scene.led.leaders(gone))[0]
    return points(scene.spiral.b_m, *scene.spiral.inward_many(*gone))
