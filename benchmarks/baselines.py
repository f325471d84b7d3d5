"""Alternative solvers for comparison: scipy's solvers, the package's simple solvers, and integration."""
from collections.abc import Callable
from functools import partial
from math import pi

import numpy as np
from scipy.optimize import brentq, fsolve

from dragon_ros.core.chain.chain import Chain, chain_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.cost.baselines import SIMPLE, Solver, chain_by, cosine_rule


def by_fsolve(theta: float, chord: float) -> float:
    """Return the polar angle of the next handle, found by scipy's fsolve, starting one chord length along the track."""
    def excess(outer: Floats) -> float:
        return cosine_rule(theta, float(outer[0]), chord)
    return float(fsolve(excess, theta + chord / max(theta, 1e-9))[0])


def by_brentq(theta: float, chord: float) -> float:
    """Return the polar angle of the next handle, found by scipy's brentq within half a turn."""
    return float(brentq(lambda outer: cosine_rule(theta, outer, chord), theta, theta + pi))


def euler_steps(scene: Scene, step_s: float) -> tuple[Chain, Callable[[Chain], Chain]]:
    """Return the exact chain at 0 s and a function that advances all handles by one explicit Euler step."""
    start = compile_scene(scene).model.march((0.0, 0.0))
    b = scene.spiral.b_m

    def advance(chain: Chain) -> Chain:
        v = np.hypot(*chain.velocities(scene.steady_m_s).T)
        theta = chain.u - step_s * v / (b * np.sqrt(1 + chain.u**2))
        return chain_of(chain.track, chain.links_m, chain.direction, (chain.segment, theta, np.zeros_like(theta)), 0)
    return start, advance


SOLVERS: dict[str, Solver] = {
    'scipy fsolve': partial(chain_by, by_fsolve),
    'scipy brentq': partial(chain_by, by_brentq),
    **SIMPLE}
