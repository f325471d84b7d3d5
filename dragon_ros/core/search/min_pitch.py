"""The smallest pitch at which the head winds in to a circle without a contact, between two proved runs.

The search goes down from the largest pitch, by one per cent at a time, until a run cannot be cleared; each run above is
proved to have no contact. The last step is then bisected. A contact at one pitch does not imply a contact at smaller
pitches, because benches can also slip past each other, and a contact at a pitch between two runs remains unseen: the
pitches above the result are sampled at the stated ones.

To need fewer runs, the last digits are solved for: the pitch at which the smallest gap of the touching pair vanishes.
"""
from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, pi

import numpy as np

from dragon_ros.core.chain.dragon import AnyDragon, Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.checks import number
from dragon_ros.core.domain import PITCH
from dragon_ros.core.errors import FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.driver import Bracket
from dragon_ros.core.search.first_contact import ContactSearch, gap_at, touch_in
from dragon_ros.core.search.near_misses import lowest
from dragon_ros.core.search.search_domain import Pair, RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import BENT, SpiralCurve

_STEP = 0.01            # ratio of adjacent pitches, less 1, on the way down
_COARSE_M = 1e-5        # width of the bracket in which the gap of the touching pair is solved for
_AROUND = 1.0           # leader travel searched for the smallest gap to either side, relative to the longest bench
_LEAST = 3              # smallest width of the bracket, relative to the error of a bound
_SURE = 1.25            # how far above the solution a run is expected to be clear, relative to the error of a bound
_SAME = 1e-15           # relative rounding error of a pitch


@dataclass(frozen=True)
class MinPitch:
    """A pitch ``low_m`` with a contact and a larger one, ``high_m``, at which a run is proved to have none.

    At ``low_m`` the ``benches`` overlap when the head's front handle is at ``radius_m``. ``clear_m`` lists the larger
    pitches at which runs are proved to have no contact, up to ``largest_m``; nothing is proved between them.
    ``states`` is the number of states evaluated.
    """

    low_m: float
    high_m: float
    benches: tuple[int, int]
    radius_m: float
    largest_m: float
    states: int
    clear_m: tuple[float, ...] = ()


def min_pitch(dragon: AnyDragon | None = None, diameter_m: float = 9.0, start_turns: float = 16.0,
              largest_m: float = 1.0, within_m: float = 4e-11,
              progress: Callable[[int], object] = lambda states: None, smallest_m: float | None = None) -> MinPitch:
    """Return the smallest pitch above which, up to ``largest_m``, no sampled run to the circle has a contact.

    The head starts ``start_turns`` turns from the centre of the spiral, which is also the centre of the circle of
    diameter ``diameter_m``. ``low_m`` and ``high_m`` differ by at most ``within_m``, and more if the gap grows so
    slowly with the pitch that its error exceeds its growth over this width. The search ends at ``smallest_m``, by
    default where the head starts on the circle. ``progress(states)`` is called with the number of states computed since
    the last call. Raises FieldError if no pitch has a contact, if benches touch at ``largest_m``, or if a link is too
    long for the circle.
    """
    runs = _Runs(dragon or Dragon(), diameter_m, start_turns, progress)
    number('within_m', within_m, low=2e-11, high=1.0)
    if smallest_m is not None:
        PITCH.checked('smallest_m', smallest_m)
        runs.scene(smallest_m)
    number('largest_m', largest_m, above=smallest_m or runs.least_m, high=PITCH.high)
    low_m, clear_m = _stepped(runs, smallest_m, largest_m)
    low_m, high_m = _bisected(runs, low_m, clear_m[-1], max(within_m, _COARSE_M))
    low_m, touch = _overlapping(runs, low_m, within_m)
    within_m = max(within_m, _LEAST * runs.domain(low_m).tolerance_m)
    if high_m - low_m > within_m:
        low_m, high_m, touch = _solved(runs, (low_m, high_m), touch)
    if high_m - low_m > within_m:
        below_m, high_m = _bisected(runs, low_m, high_m, within_m)
        low_m, touch = _overlapping(runs, below_m, within_m) if below_m > low_m else (low_m, touch)
    return MinPitch(low_m, high_m, touch.pair, touch.radius_m, largest_m, runs.states, clear_m[::-1])


@dataclass(frozen=True)
class _Closest:
    """The smallest gap of a pair near a leader position, with the radius of the head's front handle there."""

    pair: Pair
    gap_m: float
    radius_m: float


class _Runs:
    """The runs of a dragon that winds in to a circle, one for each pitch."""

    def __init__(self, dragon: AnyDragon, diameter_m: float, start_turns: float,
                 progress: Callable[[int], object]) -> None:
        if dragon.benches < 3:
            raise FieldError('dragon.benches', dragon.benches, 'only benches that are not neighbours can touch',
                             'give at least 3')
        number('diameter_m', diameter_m, above=0.0, high=1e6)
        number('start_turns', start_turns, above=0.0, high=1e4)
        longest_m = float(np.max(dragon.link_lengths_m))
        if BENT * longest_m >= diameter_m:
            raise FieldError('diameter_m', diameter_m, f'a link is {longest_m:.6g} m long', 'give a larger circle')
        self.given, self._tell, self.states = (dragon, diameter_m, start_turns), progress, 0
        self.least_m = 0.5 * diameter_m / start_turns     # the pitch at which the head starts on the circle

    def domain(self, pitch_m: float) -> SearchDomain:
        """Return the chains of a run."""
        simulation = compile_scene(self.scene(pitch_m))
        return SearchDomain(simulation, RangeOfTravel.of(simulation), 1, self._count)

    def bracket(self, domain: SearchDomain) -> Bracket | None:
        """Return the first part of a run that cannot be cleared; None proves that the run has no contact."""
        return ContactSearch(domain).bracket()

    def closest(self, domain: SearchDomain, pair: Pair, travel_m: float) -> _Closest:
        """Return the smallest gap of a pair within a bench's length of a leader position."""
        reach_m = _AROUND * float(np.max(domain.dragon.bench_lengths_m))
        ends = (np.clip([end], domain.start_m, domain.stop_m) for end in (travel_m - reach_m, travel_m + reach_m))

        def gaps(places: Floats) -> Floats:
            return np.array([gap_at(domain, pair, place) for place in places.tolist()])

        place, gap_m = lowest(gaps, *ends)
        return _Closest(pair, float(gap_m[0]), hypot(*domain.chain(float(place[0])).p[0]))

    def scene(self, pitch_m: float) -> Scene:
        """Return the scene of a run. Raises FieldError for a pitch at which the head starts inside the circle."""
        dragon, diameter_m, start_turns = self.given
        return coming_in(dragon, pitch_m, start_turns, diameter_m)

    def _count(self, states: int) -> None:
        self.states += states
        self._tell(states)


def coming_in(dragon: AnyDragon, pitch_m: float, start_turns: float, diameter_m: float) -> Scene:
    """Return a scene in which the head winds in from its start to a circle at 1 m/s."""
    track, turns = Spiral(pitch_m, start_turns), 0.5 * diameter_m / pitch_m
    if turns >= start_turns:
        raise FieldError('start_turns', start_turns, f'at a pitch of {pitch_m:g} m the head starts inside the circle',
                         'start further out, or give a smaller circle')
    return Scene(dragon, track, Head(), Run(0.0, SpiralCurve.of(track).distance_to(2 * pi * turns)))


def _stepped(runs: _Runs, smallest_m: float | None, largest_m: float) -> tuple[float, tuple[float, ...]]:
    """Return the first pitch from the largest down whose run is not clear, and those above, whose runs are."""
    clear_m, pitch_m = list[float](), largest_m
    least_m = smallest_m or runs.least_m * (1 + 2 * _SAME)
    while not runs.bracket(runs.domain(pitch_m)):
        clear_m.append(pitch_m)
        if pitch_m <= least_m:
            if smallest_m is not None:
                raise FieldError('smallest_m', smallest_m, 'no benches touch at this pitch', 'give a smaller pitch')
            raise FieldError('start_turns', runs.given[2], f'no run at a pitch of {pitch_m:.6g} m or more has a '
                             'contact; at this pitch the head starts on the circle',
                             'start further out, or give a smaller circle')
        pitch_m = max(pitch_m / (1 + _STEP), least_m)
    if not clear_m:
        raise FieldError('largest_m', largest_m, 'benches touch at this pitch', 'give a larger pitch')
    return pitch_m, tuple(clear_m)


def _bisected(runs: _Runs, low_m: float, high_m: float, within_m: float) -> tuple[float, float]:
    """Bisect a bracket whose run is clear at the upper end only."""
    while high_m - low_m > within_m:
        middle_m = 0.5 * (low_m + high_m)
        low_m, high_m = (middle_m, high_m) if runs.bracket(runs.domain(middle_m)) else (low_m, middle_m)
    return low_m, high_m


def _solved(runs: _Runs, bracket_m: tuple[float, float], touch: _Closest) -> tuple[float, float, _Closest]:
    """Narrow a bracket around the pitch at which the smallest gap of the pair that touches at its lower end vanishes.

    An end of the result is either a given one, or beyond the errors of gaps: there the pair overlaps, or the run is
    proved to be clear.
    """
    def gap_m(pitch_m: float) -> float:
        return _near(runs, pitch_m, touch).gap_m

    low_m, high_m = bracket_m
    at_low, at_high, error_m = gap_m(low_m), gap_m(high_m), runs.domain(low_m).tolerance_m
    if not at_low < 0 < at_high:
        return low_m, high_m, touch
    root_m, slope = illinois(gap_m, low_m, high_m, at_low, at_high), (at_high - at_low) / (high_m - low_m)
    above_m, below_m = root_m + _SURE * error_m / slope, root_m - error_m / slope
    if above_m < high_m and not runs.bracket(runs.domain(above_m)):
        high_m = above_m
    closest = _near(runs, below_m, touch)
    return (below_m, high_m, closest) if low_m < below_m and closest.gap_m < -0.5 * error_m else (low_m, high_m, touch)


def _near(runs: _Runs, pitch_m: float, touch: _Closest) -> _Closest:
    """Return the smallest gap of a pair at another pitch, while the head is near the same radius."""
    domain = runs.domain(pitch_m)
    curve = SpiralCurve.of(domain.scene.spiral)
    return runs.closest(domain, touch.pair, curve.distance_to(touch.radius_m / curve.b_m))


def _overlapping(runs: _Runs, low_m: float, within_m: float) -> tuple[float, _Closest]:
    """Return a pitch, at most a little smaller, at which two benches overlap by more than the error of their gap."""
    step_m = within_m
    while True:
        domain = runs.domain(low_m)
        bracket = runs.bracket(domain)
        if bracket:
            touch = touch_in(domain, bracket)
            closest = runs.closest(domain, touch.pair, touch.travel_m)
            if closest.gap_m < -domain.gap_error_m:
                return low_m, closest
        low_m, step_m = low_m - step_m, 2 * step_m
