"""The track as a line to draw: the stretch of it that the dragon of a scene walks."""
from math import sqrt

import numpy as np

from dragon_ros.core.led import Led
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.path import points
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import state

_MOST = 100_000


def outline(scene: Scene, sag_m: float = 0.002) -> Floats:
    """Return points (n, 2) in metres along the track, from one end to the other of where any handle is in the run.

    A spiral's begin with the innermost. The line between them strays ``sag_m`` from the track at most
    (s = R phi^2 / 8), unless that takes over 100,000.
    """
    if scene.led:
        return _of_pieces(scene.led, scene.head.extent_m(scene.end.t_s), sag_m)
    run, b_m = scene.run, scene.spiral.b_m
    ends = np.stack([state(scene, run.time_ns(k) / NS).p for k in (0, scene.last_tick)])
    radius = np.hypot(ends[..., 0], ends[..., 1])
    inner, outer = radius.min() / b_m, radius.max() / b_m
    step = sqrt(8 * sag_m / radius.max())
    theta = np.linspace(inner, outer, min(_MOST, 2 + int((outer - inner) / step)))
    return points(b_m, theta, np.zeros_like(theta))


def _of_pieces(led: Led, extent_m: tuple[float, float], sag_m: float) -> Floats:
    """Return points along the pieces on which handles are; each piece's are as close as its tightest bend asks for."""
    parts = []
    for piece, first, last in led.walk.between(*led.span_m(extent_m)):
        count = abs(piece.metres(last) - piece.metres(first)) * sqrt(piece.bend / (8 * sag_m))
        places = piece.at(np.linspace(first, last, min(_MOST, 2 + int(count))))
        parts.append(np.stack((places.real, places.imag), axis=1))
    out: Floats = np.concatenate(parts)
    return out
