"""What is found of a first contact: when and between which benches, or that there is none, and what proves it."""
from dataclasses import dataclass

from dragon_ros.core.contact.interval_clearing import Stretch
from dragon_ros.core.contact.signed_distance import Witness
from dragon_ros.core.model import End


@dataclass(frozen=True)
class Step:
    """A cleared part of the head's way on a joined track: distances along it, and a lower bound of all gaps there."""

    start_m: float
    stop_m: float
    bound_m: float


@dataclass(frozen=True)
class Certificate:
    """What proves that nothing touched: on one spiral stretches, on a joined track steps.

    Stretches are of the head's way and of the track under the body's front handles. ``start_gap_m`` is the smallest gap
    at the start, in as far as benches are near each other. ``complete`` is False where stretches end short of the
    contact by more than a nanometre of the head's way because benches come together so slowly.
    """

    head: tuple[Stretch, ...]
    body: tuple[Stretch, ...]
    start_gap_m: float
    complete: bool = True
    steps: tuple[Step, ...] = ()


def together(proofs: list[Certificate]) -> Certificate:
    """Return the certificates of the ways from one start as one."""
    head, body, steps = (tuple(one for proof in proofs for one in getattr(proof, name))
                         for name in ('head', 'body', 'steps'))
    return Certificate(head, body, proofs[0].start_gap_m, all(proof.complete for proof in proofs), steps)


@dataclass(frozen=True)
class Contact:
    """A first contact: when, between which benches (the inner first), which corner and edge, and how sure.

    ``grazing_m`` are bounds on the smallest gap where it is zero to within what positions may err, so that nobody can
    say if they touch, else None. ``simultaneous`` has the other pairs that touch within the uncertainty, which is the
    position error of the exact tier over the approach speed. ``states`` counts the looks.
    """

    t_s: float
    benches: tuple[int, int]
    witness: Witness
    grazing_m: tuple[float, float] | None
    simultaneous: tuple[tuple[int, int], ...]
    approach_m_s: float
    uncertainty_s: float
    states: int
    certificate: Certificate

    @property
    def point_m(self) -> tuple[float, float]:
        """Where they touch."""
        return self.witness.point_m


@dataclass(frozen=True)
class NoContact:
    """The run ended without one."""

    end: End
    states: int
    certificate: Certificate
