"""What a user would otherwise use: public recipes for the same chain, as they are usually written."""
from collections.abc import Callable
from functools import partial
from math import cos, inf, pi, sin, sqrt

import numpy as np
from scipy.optimize import brentq, fsolve

from dragon_ros.core.chain.chain import Chain, chain_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.segments import Effort
from dragon_ros.core.tracks.spiral import points

Solver = Callable[[Scene, float], Floats]


def chain_by(next_angle: Callable[[float, float], float], scene: Scene, t_s: float) -> Floats:
    """Return handles (N+1, 2) by a recipe for the next angle from (theta, chord in units of b)."""
    b = scene.spiral.b_m
    theta = [compile_scene(scene).model.leader.place(scene.head.travelled_m(t_s)).u.hi]
    for link in scene.dragon.link_lengths_m.tolist():
        theta.append(float(next_angle(theta[-1], link / b)))
    angle = np.array(theta)
    return points(b, angle, np.zeros_like(angle))


def cosine_rule(theta: float, outer: float, chord: float) -> float:
    """Return r1^2 + r2^2 - 2 r1 r2 cos(delta) - l^2 in units of b^2, as the paper and most public code have it."""
    return theta * theta + outer * outer - 2 * theta * outer * cos(outer - theta) - chord * chord


def by_fsolve(theta: float, chord: float) -> float:
    """Return the next angle by scipy's fsolve, started from the arc."""
    def excess(outer: Floats) -> float:
        return cosine_rule(theta, float(outer[0]), chord)
    return float(fsolve(excess, theta + chord / max(theta, 1e-9))[0])


def by_brentq(theta: float, chord: float) -> float:
    """Return the next angle by scipy's brentq within half a turn."""
    return float(brentq(lambda outer: cosine_rule(theta, outer, chord), theta, theta + pi))


def by_newton(tolerance: float, theta: float, chord: float) -> float:
    """Return the next angle by plain Newton on the cosine rule, stopped at a step of ``tolerance`` rad."""
    outer = theta + chord / sqrt(1 + theta * theta)
    for _ in range(100):
        slope = 2 * outer - 2 * theta * cos(outer - theta) + 2 * theta * outer * sin(outer - theta)
        change = cosine_rule(theta, outer, chord) / slope
        outer -= change
        if abs(change) < tolerance:
            return outer
    return inf


def by_bisection(tolerance: float, theta: float, chord: float) -> float:
    """Return the next angle by bisection within half a turn, stopped at ``tolerance`` rad."""
    low, high = theta, theta + pi
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cosine_rule(theta, middle, chord) < 0 else (low, middle)
    return 0.5 * (low + high)


def euler_steps(scene: Scene, step_s: float) -> tuple[Chain, Callable[[Chain], Chain]]:
    """Return the exact chain at 0 s and a function that advances all handles by one explicit Euler step."""
    start = compile_scene(scene).model.march((0.0, 0.0), Effort())
    b = scene.spiral.b_m

    def advance(chain: Chain) -> Chain:
        v = np.hypot(*chain.velocities(scene.steady_m_s).T)
        theta = chain.u - step_s * v / (b * np.sqrt(1 + chain.u**2))
        return chain_of(chain.track, chain.links_m, chain.direction, (chain.segment, theta, np.zeros_like(theta)), 0)
    return start, advance


SOLVERS: dict[str, Solver] = {
    'scipy fsolve': partial(chain_by, by_fsolve),
    'scipy brentq': partial(chain_by, by_brentq),
    'bisection 1e-6 rad': partial(chain_by, partial(by_bisection, 1e-6)),
    'plain Newton 1e-3 rad': partial(chain_by, partial(by_newton, 1e-3)),
    'plain Newton 1e-4 rad': partial(chain_by, partial(by_newton, 1e-4)),
    'plain Newton 1e-6 rad': partial(chain_by, partial(by_newton, 1e-6)),
}
