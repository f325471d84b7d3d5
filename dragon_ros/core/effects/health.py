"""The accuracy with which a tick was solved."""
from dataclasses import dataclass

from dragon_ros.core.chain.chain import Chain


@dataclass(frozen=True)
class Health:
    """The solver that placed the handles, its evaluation count, and the link with the largest error.

    ``off_m`` is the error of this link, and ``allowed_m`` is the error that is allowed.
    """

    solver: str
    evaluations: int
    link: int
    off_m: float
    allowed_m: float

    @property
    def good(self) -> bool:
        """Whether the error of the worst link is within the allowed errors of both its handles."""
        return self.off_m <= self.allowed_m


def chain_health(chain: Chain, promise_m: float) -> Health:
    """Return how accurately a chain preserves its link lengths; each handle may have an error of ``promise_m``."""
    off_m, link = chain.worst
    return Health(chain.solver, chain.evaluations, link, off_m, 2 * promise_m)
