"""The track as a line to draw: the stretch of it that the dragon of a scene walks."""
from math import sqrt

import numpy as np

from dragon_ros.core.path import points
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import state
from dragon_ros.core.types import Floats

_MOST = 100_000


def outline(scene: Scene, sag_m: float = 0.002) -> Floats:
    """Return points (n, 2) in metres along the track, from the innermost to the outermost place of any handle.

    The line between them strays ``sag_m`` from the track at most (s = R phi^2 / 8), unless that takes over 100,000.
    """
    run = scene.run
    ends = np.stack([state(scene, run.time_ns(k) / NS).p for k in (0, scene.last_tick)])
    radius = np.hypot(ends[..., 0], ends[..., 1])
    inner, outer = radius.min() / scene.track.b_m, radius.max() / scene.track.b_m
    step = sqrt(8 * sag_m / radius.max())
    theta = np.linspace(inner, outer, min(_MOST, 2 + int((outer - inner) / step)))
    return points(scene.track.b_m, theta, np.zeros_like(theta))
