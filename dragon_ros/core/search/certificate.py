"""The result of a search for the first contact: a contact or none, with a certificate that proves it."""
from dataclasses import dataclass
from typing import Literal

from dragon_ros.core.geometry.contacts import ObstacleTouch
from dragon_ros.core.geometry.signed_distance import Witness
from dragon_ros.core.model import End
from dragon_ros.core.words import counted


@dataclass(frozen=True)
class Interval:
    """A cleared part of a run, with a lower bound (m) on the gaps that were examined there.

    ``start_m`` and ``stop_m`` are distances of the head along the track, in the order of the leader's motion. Pairs
    that stand exactly as another pair stood earlier in the search were not examined again.
    """

    start_m: float
    stop_m: float
    bound_m: float


@dataclass(frozen=True)
class Certificate:
    """Proof that nothing touches: cleared intervals that cover the run up to its first contact, or up to its end.

    The intervals cover pairs of benches; cleared intervals for obstacles are not stored.

    ``complete`` is False if the intervals end more than a slack of leader travel before the contact, or if the benches
    do not provably overlap one slack after it.
    """

    intervals: tuple[Interval, ...] = ()
    complete: bool = True

    def __repr__(self) -> str:
        """Summarise the proof without listing hundreds of intervals."""
        return f'Certificate({counted(len(self.intervals), "interval")}, complete={self.complete})'


@dataclass(frozen=True)
class Contact:
    """A first contact: its time, the benches (the inner one first), the corner and edge that meet, and its uncertainty.

    For a contact with an obstacle, ``benches`` has one element, and ``obstacle`` describes the obstacle's side. If the
    smallest gap is zero to within the position error, contact is undecided and ``grazing_m`` bounds this gap; otherwise
    ``grazing_m`` is None. ``simultaneous`` lists the other pairs that touch within the uncertainty; each pair consists
    of two benches, or of a bench and the name of an obstacle. The uncertainty is the promised error of a gap
    divided by the approach speed. ``states`` is the number of states evaluated.
    """

    t_s: float
    benches: tuple[int, ...]
    witness: Witness
    grazing_m: tuple[float, float] | None
    simultaneous: tuple[tuple[int, int | str], ...]
    approach_m_s: float
    uncertainty_s: float
    states: int
    certificate: Certificate
    obstacle: ObstacleTouch | None = None

    def __bool__(self) -> Literal[True]:
        """Return True, whereas a ``NoContact`` is false."""
        return True

    @property
    def between(self) -> str:
        """A description of the two benches, or of the bench and the obstacle, that touch."""
        if self.obstacle:
            return f'bench {self.benches[0]} and obstacle {self.obstacle.name!r}'
        return f'benches {self.benches[0]} and {self.benches[1]}'

    @property
    def point_m(self) -> tuple[float, float]:
        """The point of contact."""
        return self.witness.point_m


@dataclass(frozen=True)
class NoContact:
    """The run ended without a contact."""

    end: End
    states: int
    certificate: Certificate

    def __bool__(self) -> Literal[False]:
        """Return False, whereas a ``Contact`` is true."""
        return False
