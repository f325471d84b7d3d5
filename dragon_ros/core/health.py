"""How well a tick was solved."""
from dataclasses import dataclass

from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame


@dataclass(frozen=True)
class Health:
    """Who placed the handles, at how many evaluations; the worst link, by how much it is off, and what is allowed."""

    solver: str
    evaluations: int
    link: int
    off_m: float
    allowed_m: float

    @property
    def good(self) -> bool:
        """Whether the worst link is right to within what both its handles may be off."""
        return self.off_m <= self.allowed_m


def health(scene: Scene, frame: Frame) -> Health:
    """Return how well the frame's chain keeps its links."""
    chain = frame.chain
    off_m, link = chain.worst
    return Health(chain.solver, chain.evaluations, link, off_m, 2 * scene.promise_m)
