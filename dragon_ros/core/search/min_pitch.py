"""Bounds on the smallest pitch at which the head winds in to a circle without a contact.

A contact at one pitch does not imply a contact at smaller pitches, because benches can also slip past each other. The
search therefore looks for the largest pitch with a contact before the circle is reached, by branch and bound in the
plane of head radius and pitch, from the largest pitch downwards. Any pair that touches gives a lower bound on the
pitch. A cell of the plane is clear, for every pitch and radius in it, if each pair has an edge that separates the two
benches at all four corners of the cell by more than the benches' corners can sag in between. This sag is at most B1
h1^2 / 8 + B2 h2^2 / 8, which bounds the difference between a function and its bilinear interpolation. B1 and B2 are
proved bounds on the second derivatives with respect to radius and scale over the whole cell (``on_spiral``,
``by_scale``).

Everything is computed in units of b = pitch / 2 pi. In these units all spirals have the equation r = theta, and the
dragon is ``scale`` = 1 / b times as large: a smaller pitch means a larger dragon. A state consists of a scale and a
position (the radius of the leading handle in metres); a *winding* is a little more than one turn of the chain behind
this handle.

The head is searched first. All pitches above its largest pitch with a contact must then be cleared for the body
benches. If the layers of the spiral are provably apart at these pitches (``layers``), this takes no states. Otherwise,
equal body benches are searched like the head. Mixed body benches are searched only at the upper end of the bracket
(``first_contact``), so nothing is proved for larger pitches.

The search of the head requires links that are short compared with the circle. It also requires that the head touches a
bench before body benches touch each other. For other mixed dragons, a bracket of two given pitches is bisected. A
contact is then proved at the lower end of the bracket, and the absence of a contact at its upper end.

Bounds are rounded outwards as for the first contact: balls by their arithmetic, separations by
``signed_distance.rounding_m``, polar angles by the position error.
"""
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import asin, ceil, hypot, isclose, log, pi, sqrt

import numpy as np

from dragon_ros.core.chain.dragon import AnyDragon, Dragon, is_even
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.checks import number
from dragon_ros.core.enclosures.ball_arithmetic import Ball, between
from dragon_ros.core.enclosures.by_scale import bend_by_scale
from dragon_ros.core.enclosures.layers import Layers
from dragon_ros.core.enclosures.on_spiral import ABOVE, BenchSamples, bend, samples_of
from dragon_ros.core.errors import DragonError, FieldError
from dragon_ros.core.geometry.rectangles import corner_levers
from dragon_ros.core.geometry.signed_distance import rounding_m, seen_from
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact
from dragon_ros.core.search.driver import Boxes, run
from dragon_ros.core.search.first_contact import first_contact, head_passes
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import SpiralCurve

# The size of the first cells: the angle of the leading handle about the centre, and a fraction of the pitch, which is
# also the size of the ranges of pitch in which layers are compared.
_WAY_RAD, _STEP = 0.8, 0.1
_AT_ONCE, _MOST = 256, 100_000      # maximum numbers of cells judged together and in total
_PAIRS = 2**16          # maximum number of pairs of benches in the cells that are judged together, to save memory
_TINY = 1e-2            # side of the smallest boxes, relative to ``within_m``
_BRACKET = 5            # smallest difference between the bounds on the pitch, as a multiple of the error of a gap
_OUTWARDS = 1 + 2.0**-50    # rounding factor for a pitch, which is the quotient of a rounded number and a scale
_SAME = 1e-15               # relative rounding error of a pitch that is computed from a scale
_ALIKE = 1e-6               # relative difference below which two pitches are the same in six digits
_UNIT = track_of(Spiral(2 * pi, 1.0), BEHIND)   # the spiral in units of b
_BENT = 1.09               # the curvature of any spiral is at most 1.09 / r: (u^3 + 4 u^2 + 4 u) / (1 + u)^3 <= 32 / 27


@dataclass(frozen=True)
class MinPitch:
    """A pitch ``low_m`` with a contact, and a range of pitches without a contact, from ``high_m`` to ``largest_m``.

    At ``low_m`` the ``benches`` touch when the head's front handle is at ``radius_m``; ``states`` is the number of
    windings placed and of states evaluated. If ``proved`` is False (only for mixed benches), ``high_m`` has no contact,
    but nothing is proved for larger pitches.
    """

    low_m: float
    high_m: float
    benches: tuple[int, int]
    radius_m: float
    largest_m: float
    states: int
    proved: bool = True


@dataclass(frozen=True)
class _PitchTask:
    """A dragon that winds in from ``turns`` turns to the radius ``radius_m``, for pitches up to ``largest_m``."""

    dragon: AnyDragon
    radius_m: float
    turns: float
    largest_m: float
    within_m: float

    @property
    def smallest_m(self) -> float:
        """The pitch at which the head starts on the circle."""
        return self.radius_m / self.turns

    def widest_m(self, pitch_m: float, first: int) -> float:
        """Return an upper bound on the radius of the front handle of the head (``first`` 0) or of any body bench (1).

        An arc with a curvature of at most k is at most 2 asin(k chord / 2) / k long, and r^2 grows by at most 2 b per
        metre of arc.
        """
        bend = 0.5 * _BENT / self.radius_m
        arc = sum(asin(bend * link) / bend for link in self.dragon.link_lengths_m.tolist()) if first else 0.0
        return sqrt((self.turns * pitch_m) ** 2 + pitch_m / pi * arc)

    def innermost_m(self, pitch_m: float, first: int) -> float:
        """Return a lower bound on the radius at this and larger pitches, since no arc is shorter than its chord."""
        b_m, radius_m = pitch_m / (2 * pi), self.radius_m
        inward = 2 * b_m * float(self.dragon.link_lengths_m[0]) / sqrt(1 + (b_m / radius_m) ** 2)
        return sqrt(radius_m**2 + inward * first)


def min_pitch(dragon: AnyDragon | None = None, diameter_m: float = 9.0, start_turns: float = 16.0,
              largest_m: float = 1.0, within_m: float = 4e-11,
              progress: Callable[[int], object] = lambda states: None, smallest_m: float | None = None) -> MinPitch:
    """Return the smallest pitch above which, up to ``largest_m``, the head reaches the circle without a contact.

    The head starts ``start_turns`` turns from the centre of the spiral, which is also the centre of the circle of
    diameter ``diameter_m``. ``low_m`` and ``high_m`` differ by at most ``within_m`` or, if that is more, five times
    the error of a gap. Mixed benches require ``smallest_m``, a pitch at which benches touch; for equal benches it
    is ignored. ``progress(states)`` is called with the number of states computed since the last call. Raises FieldError
    if no pitch has a contact or if benches touch at ``largest_m`` or just below it, DragonError if no bounds can be
    proved, and ChainLockError if a link is longer than the circle's diameter.
    """
    if dragon and not is_even(dragon.link_lengths_m):
        number('within_m', within_m, low=2e-11, high=1.0)
        return _of_mixed(_Runs(dragon, diameter_m, start_turns, progress), smallest_m, largest_m, within_m)
    task = _task(dragon or Dragon(), diameter_m, start_turns, largest_m, within_m)
    head = _Descending(task, 0, task.smallest_m, progress)
    low_m, high_m = head.run()
    if not head.touch:
        if not isclose(low_m, high_m, rel_tol=_ALIKE):
            raise FieldError('within_m', within_m, f'no contact was found, but pitches between {low_m:.6g} m and '
                             f'{high_m:.6g} m may have one', 'ask for a narrower bracket')
        raise FieldError('start_turns', start_turns, f'no pitch of {high_m:.6g} m or more has a contact; at this pitch '
                         'the head starts on the circle', 'start further out, or give a smaller circle')
    radius_m, pitch_m, bench = head.touch
    if isclose(pitch_m, largest_m, rel_tol=_SAME):
        raise FieldError('largest_m', largest_m, f'benches 0 and {bench} touch at this pitch, with the head at radius '
                         f'{radius_m:.6g} m', 'give a larger pitch')
    if high_m >= largest_m:
        raise FieldError('largest_m', largest_m, f'it is less than {within_m:g} m above a pitch of {pitch_m:.6g} m, at '
                         f'which benches 0 and {bench} touch', 'give a larger pitch, or ask for a narrower bracket')
    body = _Descending(task, 1, high_m, progress)
    if not _body_is_apart(task, high_m):
        body.run()
    if body.touch:
        radius_m, pitch_m, bench = body.touch
        raise DragonError(f'min-pitch: at a pitch of {pitch_m:.9g} m, two body benches {bench} places apart may touch '
                          f'at radius {radius_m:.6g} m, although the head touches no bench; such dragons are not '
                          'supported')
    radius_m, low_m, bench = head.touch
    return MinPitch(low_m, high_m, (0, bench), radius_m, largest_m, head.states + body.states)


def _task(dragon: AnyDragon, diameter_m: float, start_turns: float, largest_m: float, within_m: float) -> _PitchTask:
    if dragon.benches < 3:
        raise FieldError('dragon.benches', dragon.benches, 'only benches that are not neighbours can touch',
                         'give at least 3')
    radius_m = 0.5 * number('diameter_m', diameter_m, above=0.0, high=1e6)
    number('start_turns', start_turns, above=0.0, high=1e4)
    number('largest_m', largest_m, above=radius_m / start_turns, high=1e6)
    number('within_m', within_m, low=2e-11, high=1.0)
    longest = float(np.max(dragon.link_lengths_m))
    if not np.all(dragon.link_lengths_m):
        raise FieldError('dragon.hole_inset_m', dragon.hole_inset_m, 'links of zero length are not supported',
                         'give a smaller inset')
    if _BENT * longest >= 2 * radius_m:
        raise FieldError('diameter_m', diameter_m, f'a link is {longest:.6g} m long', 'give a larger circle')
    return _PitchTask(dragon, radius_m, start_turns, largest_m, within_m)


def _body_is_apart(task: _PitchTask, high_m: float) -> bool:
    """Return whether the layers of body benches are apart at all pitches from ``high_m`` to the largest pitch.

    The radius of the front handle of a body bench is smallest at the smallest pitch.
    """
    b_m = np.geomspace(high_m, task.largest_m, 1 + ceil(log(task.largest_m / high_m) / _STEP)) / (2 * pi)
    benches = np.arange(1, task.dragon.benches - 2)
    radii_m = np.full(benches.size, task.innermost_m(high_m, 1))
    error_m = 2 * EXACT.promise_for_m(task.widest_m(task.largest_m, 1))
    layers = [Layers(_OUTWARDS * large, task.dragon, small / _OUTWARDS) for small, large in pairwise(b_m.tolist())]
    return all(np.all(each.gaps_from_m(radii_m, benches) > error_m) for each in layers)


class _Runs:
    """The runs of a dragon that winds in to a circle, one for each pitch."""

    def __init__(self, dragon: AnyDragon, diameter_m: float, start_turns: float,
                 progress: Callable[[int], object]) -> None:
        number('diameter_m', diameter_m, above=0.0, high=1e6)
        number('start_turns', start_turns, above=0.0, high=1e4)
        self.given, self._tell, self.states = (dragon, diameter_m, start_turns), progress, 0

    def count(self, states: int) -> None:
        """Count evaluated states."""
        self.states += states
        self._tell(states)

    def _scene(self, pitch_m: float) -> Scene:
        dragon, diameter_m, start_turns = self.given
        return coming_in(dragon, pitch_m, start_turns, diameter_m)

    def check(self, pitch_m: float) -> None:
        """Reject a pitch at which the head starts inside the circle. Raises FieldError."""
        self._scene(pitch_m)

    def contact(self, pitch_m: float) -> Contact | None:
        """Return the first contact while the head winds in."""
        found = first_contact(self._scene(pitch_m), self.count)
        return found if isinstance(found, Contact) else None

    def head_touches(self, pitch_m: float) -> bool:
        """Return whether the head may touch a bench while it winds in."""
        return not head_passes(self._scene(pitch_m), self.count)

    def radius_m(self, pitch_m: float, t_s: float) -> float:
        """Return the distance of the head's front handle from the centre."""
        return hypot(*compile_scene(self._scene(pitch_m)).chain(t_s).p[0])


def coming_in(dragon: AnyDragon, pitch_m: float, start_turns: float, diameter_m: float) -> Scene:
    """Return a scene in which the head winds in from its start to a circle at 1 m/s."""
    track, turns = Spiral(pitch_m, start_turns), 0.5 * diameter_m / pitch_m
    if turns >= start_turns:
        raise FieldError('start_turns', start_turns, f'at a pitch of {pitch_m:g} m the head starts inside the circle',
                         'start further out, or give a smaller circle')
    return Scene(dragon, track, Head(), Run(0.0, SpiralCurve.of(track).distance_to(2 * pi * turns)))


def _of_mixed(runs: _Runs, smallest_m: float | None, largest_m: float, within_m: float) -> MinPitch:
    """Search the bracket for mixed benches. Raises FieldError if a bound of the bracket is missing or wrong."""
    if smallest_m is None:
        raise FieldError('smallest_m', None, 'the pitch of mixed benches is searched for between two bounds',
                         'give a pitch at which benches touch')
    number('smallest_m', smallest_m, above=0.0)
    number('largest_m', largest_m, above=smallest_m, high=1e6)
    runs.check(smallest_m)
    head = _head_of(runs, smallest_m, largest_m, within_m)
    if head is None:
        return _of_all(runs, *_bisected(runs.head_touches, smallest_m, largest_m, within_m), smallest_m, largest_m,
                       within_m)
    assert head.touch
    (radius_m, low_m, bench), high_m = head.touch, head.high_m
    proved = _body_is_apart(head.task, high_m)
    if not proved and runs.contact(high_m):
        return _of_all(runs, low_m, high_m, smallest_m, largest_m, within_m)
    return MinPitch(low_m, high_m, (0, bench), radius_m, largest_m, runs.states, proved)


def _head_of(runs: _Runs, smallest_m: float, largest_m: float, within_m: float) -> '_Descending | None':
    """Search for the head's contacts.

    Returns None if these contacts cannot be bounded, or if there is none in the bracket or one too close to
    ``largest_m``.
    """
    try:
        head = _Descending(_task(*runs.given, largest_m, within_m), 0, smallest_m, runs.count)
        head.run()
    except DragonError:
        return None
    return head if head.touch and head.high_m < largest_m else None


def _of_all(runs: _Runs, low_m: float, high_m: float, smallest_m: float, largest_m: float, within_m: float) -> MinPitch:
    """Check a bracket of the head for all benches; if they touch at its upper end, bisect the pitches above it.

    An end of the given bracket is therefore checked only if it is still an end after the bisection. Raises FieldError
    unless only the lower end has a contact.
    """
    if runs.contact(high_m):
        if high_m == largest_m or runs.contact(largest_m):
            raise FieldError('largest_m', largest_m, 'benches touch at this pitch', 'give a larger pitch')
        low_m, high_m = _bisected(runs.contact, high_m, largest_m, within_m)
    touch = runs.contact(low_m)
    if touch is None and low_m == smallest_m:
        raise FieldError('smallest_m', smallest_m, 'no benches touch at this pitch', 'give a smaller pitch')
    assert touch
    inner, outer = touch.benches
    return MinPitch(low_m, high_m, (inner, outer), runs.radius_m(low_m, touch.t_s), largest_m, runs.states, False)


def _bisected(touching: Callable[[float], object], low_m: float, high_m: float, within_m: float) -> tuple[float, float]:
    """Bisect a bracket of pitches that has a contact at its lower end and no contact at its upper end."""
    while high_m - low_m > within_m:
        middle_m = 0.5 * (low_m + high_m)
        low_m, high_m = (middle_m, high_m) if touching(middle_m) else (low_m, middle_m)
    return low_m, high_m


class _Descending:
    """A search for one leading bench, from the largest pitch down to ``floor_m`` or to a contact.

    The dimensions of boxes are radius (m) and scale; a larger scale means a smaller pitch. ``touch`` holds the radius
    (m), the pitch (m) and the bench of the contact with the largest pitch found so far.
    """

    def __init__(self, task: _PitchTask, first: int, floor_m: float, progress: Callable[[int], object]) -> None:
        self.task, self.first, self.states, self._tell = task, first, 0, progress
        self.touch: tuple[float, float, int] | None = None
        self._best = self._limit = 2 * pi / floor_m     # scale of the contact found, and scale up to which all is clear
        self._done, self._follow = 0, task.dragon.benches - first
        self._error_m = EXACT.promise_for_m(task.widest_m(task.largest_m, 1))
        self._tolerance_m = 2 * self._error_m * float(np.max(corner_levers(task.dragon, 0.0)))      # the error of a gap
        self._within_m = max(task.within_m, _BRACKET * self._tolerance_m)

    def run(self) -> tuple[float, float]:
        """Return a pitch with a contact (or the floor), and the smallest pitch above which everything is clear."""
        cells = self._grid()
        run(self, Boxes(cells[[0, 2]], cells[[1, 3]]))
        return 2 * pi / self._best, self.high_m

    @property
    def high_m(self) -> float:
        """The smallest pitch above which everything is clear."""
        return _OUTWARDS * 2 * pi / self._limit

    @property
    def at_once(self) -> int:
        """The number of boxes judged together; it is reduced, to save memory, if the last windings were long."""
        return max(1, min(_AT_ONCE, _PAIRS // self._follow))

    def ahead(self, boxes: Boxes) -> Array:
        """Return whether each box begins at a larger pitch than the first box that is not clear."""
        out: Array = boxes.low[1] < self._limit
        return out

    def order(self, boxes: Boxes) -> Floats:
        """Return sort keys that put the boxes in order of decreasing pitch."""
        out: Floats = boxes.low[1]
        return out

    def judge(self, boxes: Boxes) -> Boxes:
        """Evaluate the corners of boxes; return the halves of boxes that are neither clear nor near the contact."""
        if self._done > _MOST:
            raise DragonError(f'min-pitch: nothing is proved below a pitch of {2 * pi / np.min(boxes.low[1]):.9g} m '
                              f'after {self._done} cells; some benches may almost touch at every pitch')
        self._done += boxes.size
        unclear, axis = self._unclear(np.stack((boxes.low[0], boxes.high[0], boxes.low[1], boxes.high[1])))
        near = (2 * pi / boxes.low[1] - 2 * pi / self._best <= self._within_m) | self._tiny(boxes)
        self._limit = min(self._limit, self._best, float(np.min(boxes.low[1, unclear & near], initial=np.inf)))
        left = unclear & ~near
        return boxes.some(left).cut(2, _divisible_axis(boxes, axis)[left])

    def _tiny(self, boxes: Boxes) -> Array:
        """Return whether each box is so small that cutting cannot clear it, because its gap is within the error bounds.

        A box that floats cannot divide along either axis also counts as tiny.
        """
        within_m = _TINY * self._within_m
        small = ((boxes.high[0] - boxes.low[0] <= within_m)
                 & (2 * pi / boxes.low[1] - 2 * pi / boxes.high[1] <= within_m))
        out: Array = small | ~np.any(_divisible(boxes), axis=0)
        return out

    def _grid(self) -> Floats:
        """Return the first cells, in strips of pitch; each strip is as long as the track for the larger of its pitches.

        The sag of corners grows with the square of the angle but hardly with the radius, and gaps do not shrink further
        out.
        """
        task, low = self.task, 2 * pi / self.task.largest_m
        scales = np.geomspace(low, self._best, max(1, ceil(log(self._best / low) / _STEP)) + 1)
        inner_m, strips = task.innermost_m(2 * pi / self._best, self.first), []
        for small, large in zip(scales[:-1].tolist(), scales[1:].tolist(), strict=True):
            outer_m = max(inner_m, task.widest_m(2 * pi / small, self.first))
            radii_m = np.linspace(inner_m, outer_m, 2 + int((outer_m - inner_m) * small / _WAY_RAD))
            strips.append(np.stack((radii_m[:-1], radii_m[1:], *(np.full(radii_m.size - 1, each)
                                                                 for each in (small, large)))))
        return np.concatenate(strips, axis=1)

    def _unclear(self, cells: Floats) -> tuple[Array, Ints]:
        """Evaluate the corners of cells (4, n), each given by two radii and two scales; return which are not clear.

        The second result is the axis along which to cut each cell, which is the one along which the separation varies
        more.
        """
        corners = np.concatenate([cells[[i, j]] for i in (0, 1) for j in (2, 3)], axis=1)
        places, where = np.unique(corners, axis=1, return_inverse=True)
        placed = self._windings(places[0], places[1])
        separation = separations(self.task.dragon, self.first, placed, places[1])
        self._note(places, separation)
        ends = where.reshape(4, -1)
        apart, sag = separation[ends], self._sags(cells, placed, ends)
        self._check_rest(cells, placed, ends)
        half = float(np.max(self.task.dragon.bench_lengths_m) + self.task.dragon.width_m) / 2
        off = rounding_m(np.max(placed.theta[ends, -1], axis=0) / cells[2], half) * cells[3]
        low = np.min(apart, axis=0) - np.sum(sag, axis=-1) - off[:, None, None]
        pair = np.argmin(np.max(low, axis=-1), axis=1)
        each = np.arange(pair.size)
        edge = np.argmax(low[each, pair], axis=1)
        corner, bent = apart[:, each, pair, edge], sag[each, pair, edge]
        place = 0.5 * np.abs(corner[2] + corner[3] - corner[0] - corner[1]) + bent[:, 0]
        scale = 0.5 * np.abs(corner[1] + corner[3] - corner[0] - corner[2]) + bent[:, 1]
        return low[each, pair, edge] <= self._tolerance_m * cells[3], (place < scale).astype(np.int64)

    def _windings(self, radius_m: Floats, scale: Floats) -> BenchSamples:
        """Return the winding behind each position: a little more than one turn, or more if benches are wide."""
        self.states += scale.size
        self._tell(scale.size)
        dragon = self.task.dragon
        around = 2 * pi * (float(np.max(radius_m)) + 2 * pi / float(np.min(scale)))
        behind_m = np.cumsum(np.maximum(dragon.link_lengths_m[self.first + 1:], 1e-3 * around))
        needed = 1 + int(np.searchsorted(behind_m, self._turns(radius_m, scale) * around))
        self._follow = min(dragon.benches - self.first, 8 + needed)
        return windings(dragon, self.first, self._follow, radius_m, scale)

    def _turns(self, radius_m: Floats, scale: Floats) -> float:
        """Estimate after how many turns benches are clear of the leading bench; ``_check_rest`` checks the estimate."""
        dragon, pitch_m = self.task.dragon, 2 * pi / float(np.max(scale))
        overhang_m = 0.5 * float(dragon.bench_lengths_m[self.first] - dragon.link_lengths_m[self.first])
        sag_m = float(np.max(dragon.link_lengths_m[self.first + 1:])) ** 2 / (8 * float(np.min(radius_m)))
        return max(1.2, 0.1 + (hypot(overhang_m, 0.5 * dragon.width_m) + 0.5 * dragon.width_m + sag_m) / pitch_m)

    def _sags(self, cells: Floats, placed: BenchSamples, ends: Ints) -> Floats:
        """Return bounds (n, K, 8, 2) on the sag of corners in cells, for eight edges, along radius and scale."""
        benches = slice(self.first, self.first + placed.delta.shape[1])
        dragon, scale = self.task.dragon, cells[2:, :, None]
        arm = scale[1] * 0.5 * np.hypot(dragon.bench_lengths_m[benches], dragon.width_m)
        link = dragon.link_lengths_m[benches]
        chord = between(scale[0] * link, scale[1] * link)
        theta, delta = self._angles(placed, ends, scale[1])
        by_radius = bend(theta, delta, chord, arm) * (scale[1] * (cells[1] - cells[0])[:, None])[..., None] ** 2
        by_scale = bend_by_scale(theta, delta, chord, arm) * ((scale[1] - scale[0]) / scale[0])[..., None] ** 2
        out: Floats = np.stack((by_radius, by_scale), axis=-1)[:, :, [0, 0, 0, 0, 1, 1, 1, 1]] * (ABOVE / 8)
        return out

    def _angles(self, placed: BenchSamples, ends: Ints, scale: Floats) -> tuple[Ball, Ball]:
        """Return the polar angles of handles and the spans of links in cells; ``scale`` (n, 1) is the larger scale."""
        off = self._angle_errors(placed.theta[ends[0]], scale)
        return (between(placed.theta[ends[0]], placed.theta[ends[3]], off),
                between(placed.delta[ends[1]], placed.delta[ends[2]], 2 * off[:, :-1]))

    def _angle_errors(self, theta: Floats, scale: Floats) -> Floats:
        """Return the error of polar angles: twice the position error, divided by a handle's travel per radian."""
        out: Floats = 2 * self._error_m * scale / np.maximum(theta, 1.0)
        return out

    def _check_rest(self, cells: Floats, placed: BenchSamples, ends: Ints) -> None:
        """Raise DragonError if, in a cell, a bench beyond the placed benches could come close to the leading bench.

        The leading bench lies within the radius of its rear handle plus its overhang; this sum, in metres, is largest
        at the larger radius and the larger pitch. The front handles of the benches that are not placed are at least as
        far out as the last handle placed, whose radius is smallest at the smaller radius and the smaller pitch
        (``by_scale``). The distance of these benches from the centre follows from the proof of lemma 11 in
        docs/contact.md.
        """
        dragon, rest = self.task.dragon, self.first + placed.delta.shape[1]
        if rest == dragon.benches:
            return
        overhang = 0.5 * (dragon.bench_lengths_m[self.first] - dragon.link_lengths_m[self.first])
        reach = placed.theta[ends[2], 1] / cells[2] + np.hypot(overhang, 0.5 * dragon.width_m)
        off = np.maximum(0.5 * float(np.max(dragon.link_lengths_m[rest:])), 0.5 * pi / cells[2])
        front = placed.theta[ends[1], -1] / cells[3] - 2 * self._error_m
        line = np.sqrt(np.maximum((front - off) * (front + off), 0.0)) - 0.5 * dragon.width_m
        if np.any(line <= reach + self._tolerance_m):
            raise DragonError('min-pitch: one turn of benches is not enough for a proof; such dragons are not '
                              'supported')

    def _note(self, places: Floats, separation: Floats) -> None:
        """Record the touching position with the largest pitch; the head is never further out than its start."""
        radius_m, scale = places
        outer = np.inf if self.first else 2 * pi * self.task.turns / scale
        gap = np.max(separation, axis=-1)
        touching = np.flatnonzero(np.any(gap <= -self._tolerance_m * scale[:, None], axis=1) & (radius_m <= outer))
        if touching.size:
            n = touching[np.argmin(scale[touching])]
            if scale[n] < self._best or self.touch is None:
                self._best = min(self._best, float(scale[n]))
                self.touch = float(radius_m[n]), 2 * pi / float(scale[n]), int(np.argmin(gap[n])) + 2


def _divisible(boxes: Boxes) -> Array:
    """Return whether there is a float between the ends of each box, along each axis (2, M)."""
    middle = boxes.low + 0.5 * (boxes.high - boxes.low)
    out: Array = (boxes.low < middle) & (middle < boxes.high)
    return out


def _divisible_axis(boxes: Boxes, axis: Ints) -> Ints:
    """Return the axis (M,) along which to cut each box: the other axis if floats cannot divide the given one."""
    out: Ints = np.where(_divisible(boxes)[axis, np.arange(axis.size)], axis, 1 - axis)
    return out


def windings(dragon: AnyDragon, first: int, follow: int, radius_m: Floats, scale: Floats) -> BenchSamples:
    """Place ``follow`` benches from ``first`` on, behind radii (M,) on spirals of given scales, in units of b.

    Raises ChainLockError if a link cannot be placed.
    """
    size, benches = scale[:, None], slice(first, first + follow)
    half = 0.5 * size * dragon.bench_lengths_m[benches], 0.5 * size * dragon.width_m
    return samples_of(_UNIT, size * dragon.link_lengths_m[benches], half, scale * radius_m,
                      np.zeros(scale.size, dtype=np.int64))


def separations(dragon: AnyDragon, first: int, winding: BenchSamples, scale: Floats) -> Floats:
    """Return separations (M, K, 8), in units of b, of the leading bench from the second and later benches behind it.

    Separations are measured from the four edges of the leading bench and from the four edges of the other bench; the
    two benches are apart if any of their separations is positive.
    """
    half = 0.5 * scale[:, None] * dragon.bench_lengths_m[first:first + winding.delta.shape[1]]
    side, (centre, axis) = 0.5 * scale[:, None] * dragon.width_m, (winding.centre, winding.axis)
    seen = seen_from((centre[:, :1], centre[:, 2:]), (axis[:, :1], axis[:, 2:]), (half[:, :1], side),
                     (half[:, 2:], side))
    return np.stack((*seen.from_edges(), *seen.mirrored().from_edges()), axis=-1)
