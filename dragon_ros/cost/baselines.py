"""Newton's method for a chain on a single spiral, as in common public code."""
from collections.abc import Callable
from functools import partial
from math import cos, inf, sin, sqrt

import numpy as np

from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spiral import points

Solver = Callable[[Scene, float], Floats]


def chain_by(next_angle: Callable[[float, float], float], scene: Scene, t_s: float) -> Floats:
    """Return handles (m, shape (N+1, 2)) placed by ``next_angle(theta, chord)``, with the chord in units of b."""
    b = scene.spiral.b_m
    theta = [compile_scene(scene).model.leader.place(scene.head.travelled_m(t_s)).u]
    for link in scene.dragon.link_lengths_m.tolist():
        theta.append(float(next_angle(theta[-1], link / b)))
    angle = np.array(theta)
    return points(b, angle)


def cosine_rule(theta: float, outer: float, chord: float) -> float:
    """Return r1^2 + r2^2 - 2 r1 r2 cos(delta) - l^2 in units of b^2, as in the paper and most public code."""
    return theta * theta + outer * outer - 2 * theta * outer * cos(outer - theta) - chord * chord


def by_newton(tolerance: float, theta: float, chord: float) -> float:
    """Return the next angle, found with Newton's method on the cosine rule until a step is below ``tolerance`` rad."""
    outer = theta + chord / sqrt(1 + theta * theta)
    for _ in range(100):
        slope = 2 * outer - 2 * theta * cos(outer - theta) + 2 * theta * outer * sin(outer - theta)
        change = cosine_rule(theta, outer, chord) / slope
        outer -= change
        if abs(change) < tolerance:
            return outer
    return inf


NEWTON: dict[str, Solver] = {f'plain Newton {name} rad': partial(chain_by, partial(by_newton, float(name)))
                             for name in ('1e-3', '1e-4', '1e-6')}
