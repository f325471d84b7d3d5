"""Clear whole stretches of track of contact, with the bound that clears each.

On a stretch of length h (in the polar angle of the leading handle) the corners of a bench, seen in the frame of
another, leave the straight lines between their places at its ends by at most B h^2 / 8, B a bound on their second
derivative there (``bending``). Along straight lines the separation from a fixed edge is concave, so it is nowhere less
than the smaller of its values at the two ends. Hence a pair is apart on the whole stretch if, for one edge and one side
of it, that smaller value exceeds B h^2 / 8.

Close to a lock, where no such B exists, what counts is how far the handles of both benches go at all. Benches further
out are cleared by the circle about the centre that parts them. All this takes handles that move one way on a stretch:
it must not contain the place where one turns back. docs/contact.md has the proofs.
"""
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.contact.narrow_phase import Sizes, View, beyond, further, joined
from dragon_ros.core.contact.second_order_bounds import bend
from dragon_ros.core.numerics.ball_arithmetic import between
from dragon_ros.core.numerics.types import Array, Floats, Ints

Look = Callable[[Floats], View]
_STILL = 1e-9       # of a turn of the follower: nearer to it nothing moves


@dataclass(frozen=True)
class Stretch:
    """A cleared stretch: polar angles of the leading handle, and a lower bound in metres of its gaps.

    They are the gaps of bench ``lead`` to the next ``behind`` benches, but the one just behind; and those of every
    bench behind which the dragon goes on as it does behind ``lead``.
    """

    start_rad: float
    stop_rad: float
    bound_m: float
    behind: int
    lead: int = 0


@dataclass(frozen=True)
class Window:
    """Places (monotone) that bench ``lead``, with so many benches ``behind`` it, goes through."""

    places: Floats
    behind: int
    lead: int


@dataclass(frozen=True)
class Cleared:
    """What was cleared from the start on; ``hit`` brackets the first place that is not (clear end, other end)."""

    stretches: list[Stretch]
    hit: tuple[float, float] | None
    touching: bool


def bounds(a: View, b: View, sizes: Sizes, behind: Ints) -> Floats:
    """Return lower bounds (M,) of the gaps on stretches between the places of two views; not positive: not cleared.

    Only the next ``behind`` (M,) benches count.
    """
    sides = [np.minimum(side * a.offset - a.extent, side * b.offset - b.extent) for side in (1, -1)]
    separation, sag = np.maximum(*sides), _sag(a, b, sizes)
    low = np.maximum(np.max(separation[..., :2], axis=-1) - sag[..., 0],
                     np.max(separation[..., 2:], axis=-1) - sag[..., 1])
    way = _way(a, b, sizes)
    low = np.maximum(low, np.maximum(a.apart, b.apart) - way[:, :1] - way[:, 2:])
    circle = beyond(a, b, sizes)
    out: Floats = np.min(np.where(_there(circle, behind), np.maximum(low, circle), np.inf), axis=1)
    unseen = (behind > circle.shape[1] + 1) & (further(a, b, sizes, circle)[:, -1] <= 0)
    return np.where(unseen | _turns_back(a, b), -np.inf, out)


def _there(gap: Floats, behind: Ints) -> Array:
    """Return which of the benches (M, K-2) are there at all."""
    out: Array = np.arange(2, gap.shape[1] + 2) <= behind[:, None]
    return out


def _sag(a: View, b: View, sizes: Sizes) -> Floats:
    """Return how far corners leave straight lines, (M, K-2, 2) in metres: in the leading bench's frame, and others'."""
    arm = np.hypot(sizes.half_length_m, sizes.half_width_m)[None] / sizes.b_m
    chord = sizes.links_m[None] / sizes.b_m
    length = (a.lead - b.lead)[:, None, None]
    most = bend(between(a.theta, b.theta), between(a.delta, b.delta), between(chord, chord), arm)
    out: Floats = most * (sizes.b_m * length * length / 8)
    return out


def _way(a: View, b: View, sizes: Sizes) -> Floats:
    """Return how far corners go at most (M, K) in metres: as far as a handle, times the bench's lever."""
    outer = np.maximum(a.theta, b.theta)
    handle = sizes.b_m * np.abs(a.theta - b.theta) * np.sqrt(1 + outer * outer)
    overhang = sizes.half_length_m - 0.5 * sizes.links_m + sizes.half_width_m
    lever = 1 + 2 * overhang / np.maximum(sizes.links_m, 1e-12)
    out: Floats = lever * np.maximum(handle[:, :-1], handle[:, 1:])
    return out


def _turns_back(a: View, b: View) -> Array:
    """Return where the second or third handle comes in at one end of a stretch and goes out at the other."""
    one, two = (comes_in(view.theta[:, :3], view.delta[:, :2]) for view in (a, b))
    out: Array = np.any((np.minimum(one, two) < -_STILL) & (np.maximum(one, two) > _STILL), axis=1)
    return out


def comes_in(theta: Floats, delta: Floats) -> Floats:
    """Return numbers that are positive where a link's rear handle follows its front handle inwards."""
    inner, outer = theta[..., :-1], theta[..., 1:]
    out: Floats = delta * np.cos(delta) + inner * (outer * np.sin(delta) - 2 * np.sin(0.5 * delta) ** 2)
    return out


def clear(look: Look, sizes: Sizes, windows: list[Window], finest_m: float, tolerance_m: float) -> list[Cleared]:
    """Clear the stretches between consecutive places of windows, halving those that need it down to ``finest_m``.

    A stretch is clear if its bound exceeds ``tolerance_m``, what the positions may err. Each window is cleared up to
    the first touching place found, or the first stretch that cannot be cleared.
    """
    search = _Search(look, sizes, windows, tolerance_m)
    while search.pairs.size:
        search.halve(finest_m)
    return [search.result(number) for number in range(len(windows))]


class _Search:
    """Stretches of windows that are still to be cleared: ``pairs`` (2, M) are rows of the view."""

    def __init__(self, look: Look, sizes: Sizes, windows: list[Window], tolerance_m: float) -> None:
        self._look, self._sizes, self._tolerance_m = look, sizes, tolerance_m
        counts = np.array([window.places.size for window in windows])
        self._window = np.repeat(np.arange(counts.size), counts)
        self._behind = np.array([window.behind for window in windows])
        self._lead = [window.lead for window in windows]
        self._sign = np.array([1.0 if w.places[-1] >= w.places[0] else -1.0 for w in windows])
        self._hit: Floats = np.full(counts.size, np.inf)
        self._done: list[tuple[Floats, Ints]] = []
        self._stuck: list[tuple[Floats, Ints]] = []
        self._view = look(np.concatenate([window.places for window in windows]))
        first = np.flatnonzero(np.diff(self._window) == 0)
        self.pairs = np.stack((first, first + 1))
        self._note_touching()

    def _note_touching(self) -> None:
        """Note the first touching place of each window, and drop what lies beyond."""
        apart = self._view.apart
        touching = np.any((apart <= 0) & _there(apart, self._behind[self._window]), axis=1)
        progress = self._sign[self._window] * self._view.lead
        np.minimum.at(self._hit, self._window[touching], progress[touching])
        self.pairs = self.pairs[:, progress[self.pairs[0]] < self._hit[self._window[self.pairs[0]]]]

    def halve(self, finest_m: float) -> None:
        """Look which stretches are clear, and halve the others."""
        view, pairs, window = self._view, self.pairs, self._window[self.pairs[0]]
        low = bounds(view.rows(pairs[0]), view.rows(pairs[1]), self._sizes, self._behind[window])
        ends = view.lead[pairs]
        good = low > self._tolerance_m
        fine = ~good & (self._sizes.b_m * np.abs(ends[0] - ends[1]) * (1 + np.max(ends, axis=0)) <= finest_m)
        self._done.append((np.stack((*ends[:, good], low[good]), axis=1), window[good]))
        self._stuck.append((ends[:, fine].T, window[fine]))
        self._add_middles(pairs[:, ~good & ~fine])

    def _add_middles(self, pairs: Ints) -> None:
        """Keep what the stretches need of the view, with their middles."""
        used, where = np.unique(pairs, return_inverse=True)
        pairs, view = where.reshape(2, -1), self._view.rows(used)
        new = used.size + np.arange(pairs.shape[1])
        self.pairs = np.concatenate((np.stack((pairs[0], new)), np.stack((new, pairs[1]))), axis=1)
        if new.size:
            middles = self._look(0.5 * (view.lead[pairs[0]] + view.lead[pairs[1]]))
            self._window = np.concatenate((self._window[used], self._window[used][pairs[0]]))
            self._view = joined([view, middles])
            self._note_touching()

    def result(self, number: int) -> Cleared:
        """Return what of a window is cleared up to the first stretch that is not."""
        sign, hit = self._sign[number], self._hit[number]
        stuck = [row for row in self._rows(self._stuck, number) if sign * row[0] < hit]
        end = sign * stuck[0][0] if stuck else hit
        kept = [Stretch(start, stop, bound, int(self._behind[number]), self._lead[number])
                for start, stop, bound in self._rows(self._done, number) if sign * start < end]
        if end == np.inf:
            return Cleared(kept, None, False)
        bracket = (stuck[0][0], stuck[0][1]) if stuck else (float(sign * hit), float(sign * hit))
        return Cleared(kept, bracket, bool(sign * bracket[1] >= hit))

    def _rows(self, parts: list[tuple[Floats, Ints]], number: int) -> list[list[float]]:
        """Return a window's rows in order."""
        rows = [row for values, window in parts for row in values[window == number].tolist()]
        return sorted(rows, key=lambda row: float(self._sign[number] * row[0]))
