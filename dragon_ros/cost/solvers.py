"""The ways to place a chain, by name, for the pages that compare them."""
from collections.abc import Callable

from dragon_ros.core.angle import Angle
from dragon_ros.core.chain import Chain
from dragon_ros.core.march import place
from dragon_ros.core.scene import Scene

ChainSolver = Callable[[Scene, Angle], Chain]


def march(scene: Scene, head: Angle) -> Chain:
    """Place handle after handle."""
    return place(scene.track, scene.dragon.link_lengths_m, head, scene.effort)


CHAIN_SOLVERS: dict[str, ChainSolver] = {'march': march}
