"""The ways to place a chain, by name, for the pages that compare them."""
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, sin
from typing import Any

import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.paper import place
from dragon_ros.core.scene import Scene
from dragon_ros.cost.baselines import by_newton

ChainSolver = Callable[[Scene, DoubleDouble], Chain]
_TOLERANCE_RAD = 1e-9       # of plain Newton


def _plain(scene: Scene, head: DoubleDouble) -> Chain:
    """Place the chain as usual Python code does: Newton on the cosine rule, point by point."""
    b = scene.spiral.b_m
    theta = [head.hi]
    for link in scene.dragon.link_lengths_m.tolist():
        theta.append(by_newton(_TOLERANCE_RAD, theta[-1], link / b))
    return PlainChain(np.array([(b * t * cos(t), b * t * sin(t)) for t in theta]), scene.dragon.link_lengths_m, 0,
                      tuple(theta))


@dataclass(frozen=True)
class PlainChain(Chain):
    """A chain of plain floats."""

    theta: tuple[float, ...]
    solver = 'plain'

    def velocities(self, head_speed_m_s: Any) -> Floats:
        """Return the velocities as usual code does: link by link, from the angles with both tangents."""
        speed, rows, points, before = float(head_speed_m_s), [], self.p.tolist(), (0.0, 0.0)
        for k, t in enumerate(self.theta):
            x, y = cos(t) - t * sin(t), sin(t) + t * cos(t)
            tangent = x / hypot(x, y), y / hypot(x, y)
            if k:
                link = points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]
                speed *= (before[0] * link[0] + before[1] * link[1]) / (tangent[0] * link[0] + tangent[1] * link[1])
            before = tangent
            rows.append((-speed * tangent[0], -speed * tangent[1]))
        return np.array(rows)


def _march(scene: Scene, head: DoubleDouble) -> Chain:
    """Place one handle after the other."""
    return place(scene.spiral, scene.dragon.link_lengths_m, head, compile_scene(scene).model.effort)


def _table(scene: Scene, head: DoubleDouble) -> Chain:
    """Place all handles at once."""
    chain = scene.table.place(head) if scene.table else None
    return chain or _march(scene, head)


CHAIN_SOLVERS: dict[str, ChainSolver] = {'plain': _plain, 'march': _march, 'table': _table}
