"""Other methods for comparison: scipy's solvers, simple solvers, numpy over all times, numba, and integration."""
from collections.abc import Callable
from functools import partial
from importlib import import_module
from math import asinh, hypot, pi
from typing import Any

import numpy as np
from scipy.optimize import brentq, fsolve

from dragon_ros.core.chain.chain import Chain, chain_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.cost.accuracy import NEWTON, Place, chain_by, cosine_rule


def by_bisection(tolerance: float, theta: float, chord: float) -> float:
    """Return the next angle, found by bisecting half a turn until the bracket is at most ``tolerance`` rad wide."""
    low, high = theta, theta + pi
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cosine_rule(theta, middle, chord) < 0 else (low, middle)
    return 0.5 * (low + high)


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
    start = compile_scene(scene).model.march(0.0)
    b = scene.spiral.b_m

    def advance(chain: Chain) -> Chain:
        v = np.hypot(*chain.velocities(scene.steady_m_s).T)
        theta = chain.u - step_s * v / (b * np.sqrt(1 + chain.u**2))
        return chain_of(chain.track, chain.links_m, chain.direction, (chain.segment, theta), 0)
    return start, advance


def _arc(scene: Scene) -> float:
    """Return the length of the spiral from its centre to the head's start, in units of b."""
    start = 2 * pi * scene.spiral.start_turns
    return 0.5 * (start * hypot(1, start) + asinh(start))


def heads(scene: Scene, times_s: list[float]) -> Floats:
    """Return the polar angles of the head at many times, by Newton's method on the arc length."""
    left = _arc(scene) - scene.steady_m_s * np.asarray(times_s) / scene.spiral.b_m
    theta = np.sqrt(2 * left)
    for _ in range(6):
        theta -= (0.5 * (theta * np.hypot(1, theta) + np.arcsinh(theta)) - left) / np.hypot(1, theta)
    return theta


def newton_over_times(scene: Scene, times_s: list[float]) -> Floats:
    """Return handles (m, shape (T, N+1, 2)): link by link, Newton's method on the half-angle chord at all times."""
    b, theta = scene.spiral.b_m, heads(scene, times_s)
    rows = [theta]
    for chord in (scene.dragon.link_lengths_m / b).tolist():
        delta = chord / np.hypot(1, theta)
        for _ in range(4):
            half, outer = np.sin(0.5 * delta), theta + delta
            excess = delta * delta + 4 * theta * outer * half * half - chord * chord
            delta -= excess / (2 * delta + 4 * theta * half * half + 2 * theta * outer * np.sin(delta))
        theta = theta + delta
        rows.append(theta)
    angle = np.stack(rows, axis=1)
    out: Floats = b * angle[..., None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    return out


def compiled_newton() -> Place | None:
    """Return the same method for one time, compiled by numba, or None if numba is not installed."""
    try:
        njit: Any = import_module('numba').njit
    except ImportError:
        return None

    def place(b: float, left: float, chords: Floats, out: Floats) -> None:
        theta = np.sqrt(2 * left)
        for _ in range(6):
            root = np.sqrt(1 + theta * theta)
            theta -= (0.5 * (theta * root + np.arcsinh(theta)) - left) / root
        for n in range(chords.size + 1):
            out[n, 0], out[n, 1] = b * theta * np.cos(theta), b * theta * np.sin(theta)
            if n < chords.size:
                delta = chords[n] / np.sqrt(1 + theta * theta)
                for _ in range(4):
                    half, outer = np.sin(0.5 * delta), theta + delta
                    excess = delta * delta + 4 * theta * outer * half * half - chords[n] * chords[n]
                    delta -= excess / (2 * delta + 4 * theta * half * half + 2 * theta * outer * np.sin(delta))
                theta += delta

    compiled = njit(place)

    def solve(scene: Scene, t_s: float) -> Floats:
        out, b = np.empty((scene.dragon.benches + 1, 2)), scene.spiral.b_m
        compiled(b, _arc(scene) - scene.steady_m_s * t_s / b, scene.dragon.link_lengths_m / b, out)
        return out
    return solve


SOLVERS: dict[str, Place] = {
    'scipy fsolve': partial(chain_by, by_fsolve),
    'scipy brentq': partial(chain_by, by_brentq),
    'bisection 1e-6 rad': partial(chain_by, partial(by_bisection, 1e-6)),
    **NEWTON}
