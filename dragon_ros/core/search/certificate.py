"""What is found of a first contact: when and between which benches, or that there is none, and what proves it."""
from dataclasses import dataclass

from dragon_ros.core.geometry.contacts import ObstacleTouch
from dragon_ros.core.geometry.signed_distance import Witness
from dragon_ros.core.model import End

ALL = -1        # the lead of an interval that speaks for every bench


@dataclass(frozen=True)
class Interval:
    """A cleared part of a run, and a lower bound in metres of the gaps on it.

    ``start_m`` and ``stop_m`` are distances along the track, in the order of the leader's motion, of the front handle
    of bench ``lead``. The gaps are those of that bench to the next ``behind`` benches but the one just behind it, and
    those of every bench behind which the remaining link sequence is the same, wherever its own front handle is there.

    Where ``lead`` is ``ALL`` the distances are those of the head, and the gaps those of all pairs of benches for whose
    inner bench no other interval speaks.
    """

    lead: int
    start_m: float
    stop_m: float
    behind: int
    bound_m: float


@dataclass(frozen=True)
class Certificate:
    """What proves that nothing touched: intervals that cover the run up to the contact, or up to its end.

    They speak of pairs of benches; what is cleared of obstacles is not kept.

    ``complete`` is False where they end short of the contact by more than a nanometre of the leader's way, and by more
    than positions may err, or where nobody can say that the benches overlap so far after it: they meet so slowly.
    """

    intervals: tuple[Interval, ...] = ()
    complete: bool = True

    def __repr__(self) -> str:
        """Say how much it proves; there are hundreds of intervals."""
        return f'Certificate({len(self.intervals)} intervals, complete={self.complete})'

    def led_by(self, lead: int) -> tuple[Interval, ...]:
        """Return the intervals of one leading bench."""
        return tuple(each for each in self.intervals if each.lead == lead)


@dataclass(frozen=True)
class Contact:
    """A first contact: when, between which benches (the inner first), which corner and edge, and how sure.

    Where a bench touches an obstacle, ``benches`` has that one alone and ``obstacle`` says what it touches.
    ``grazing_m`` are bounds on the smallest gap where it is zero to within what positions may err, so that nobody can
    say if they touch, else None. ``simultaneous`` has the other pairs, of benches or of a bench and an
    obstacle's name, that touch within the uncertainty, which is the position error of the exact tier over the approach
    speed. ``states`` counts the states evaluated.
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

    @property
    def between(self) -> str:
        """What touches, in words."""
        if self.obstacle:
            return f'bench {self.benches[0]} and obstacle {self.obstacle.name!r}'
        return f'benches {self.benches[0]} and {self.benches[1]}'

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

    def __bool__(self) -> bool:
        """Be false, as a Contact is true."""
        return False
