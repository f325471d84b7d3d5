"""The solvers that place a chain, by name, for the pages that compare solvers."""
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, sin
from typing import Any

import numpy as np

from dragon_ros.core.chain.chain import Chain, marched
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.composite import Place
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.cost.accuracy import by_newton

ChainSolver = Callable[[Scene, Place], Chain]
_TOLERANCE_RAD = 1e-9       # tolerance of the plain Newton method


def _plain(scene: Scene, head: Place) -> Chain:
    """Place the chain as typical Python code does: by Newton's method on the cosine rule, point by point."""
    b = scene.spiral.b_m
    theta = [head.u]
    for link in scene.dragon.link_lengths_m.tolist():
        theta.append(by_newton(_TOLERANCE_RAD, theta[-1], link / b))
    p = np.array([(b * t * cos(t), b * t * sin(t)) for t in theta])
    return PlainChain(p, scene.dragon.link_lengths_m, 0, compile_scene(scene).model.track, BEHIND, (), tuple(theta))


@dataclass(frozen=True, eq=False)
class PlainChain(Chain):
    """A chain whose numbers are plain floats."""

    theta: tuple[float, ...]

    @property
    def solver(self) -> str:
        """Typical Python code."""
        return 'plain'

    def velocities(self, head_speed_m_s: Any, out: Floats | None = None) -> Floats:
        """Return the velocities as typical code does: link by link, from the angles between link and tangents."""
        speed, rows, points, before = float(head_speed_m_s), [], self.p.tolist(), (0.0, 0.0)
        for k, t in enumerate(self.theta):
            x, y = cos(t) - t * sin(t), sin(t) + t * cos(t)
            tangent = x / hypot(x, y), y / hypot(x, y)
            if k:
                link = points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]
                speed *= (before[0] * link[0] + before[1] * link[1]) / (tangent[0] * link[0] + tangent[1] * link[1])
            before = tangent
            rows.append((-speed * tangent[0], -speed * tangent[1]))
        out = np.empty((len(rows), 2)) if out is None else out
        out[:] = rows
        return out


def _march(scene: Scene, head: Place) -> Chain:
    """Place the handles one by one."""
    model = compile_scene(scene).model
    return marched(model.track, model.links_m, head, model.direction)


def _table(scene: Scene, head: Place) -> Chain:
    """Place all handles at once, if a table covers them."""
    return compile_scene(scene).model.placement.place(head)


CHAIN_SOLVERS: dict[str, ChainSolver] = {'plain': _plain, 'march': _march, 'table': _table}
