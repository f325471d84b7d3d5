"""Find where a chain locks: the innermost position of the head at which every link can still be placed.

As the chain moves in, the first maximum of the chord (``spiral.first_peak``) decreases. When this maximum reaches the
length of the link, the smallest root vanishes and the speed of the follower becomes infinite.
"""
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import accumulate, pairwise
from math import cos, inf, pi, sin, sqrt

from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.tracks.spiral import chord_of, first_guess, first_peak, step

# If the angle of its front handle exceeds its chord by more than this, a link spans less than 60 degrees, so its rear
# handle never turns back.
_NO_TURN = 4.0


@lru_cache(maxsize=256)
def lock_angle(chord: float) -> float:
    """Return the polar angle below which a link (``chord`` in units of b) cannot be placed; 0 if it never locks."""
    low, high = 0.5 * (chord - 1.5 * pi), 0.5 * (chord - pi)
    if chord <= chord_of(_first_with_peak(), first_peak(_first_with_peak(), pi)[0]):
        return 0.0
    return _zero_of(lambda theta: chord_of(theta, first_peak(theta, pi)[0]) - chord,
                             max(low, _first_with_peak()), high)


def head_lock_angle(chords: Sequence[float]) -> tuple[float, int]:
    """Return the head's polar angle at which a chain winding in first locks, and the link; (0, 0) if it never locks.

    A link locks when its front handle reaches ``lock_angle``. For each link, starting at the head, the front handle is
    tracked over the positions of the head at which the preceding links can be placed. Between consecutive ``places``,
    this handle moves in one direction. Because handles lie at increasing radii, the search ends when even the longest
    link can no longer lock.
    """
    angle, link, top = lock_angle(chords[0]), 0, lock_angle(max(chords[1:], default=0.0))
    places = sorted({angle, *(turn for turn in turns(chords[0]) if angle < turn < top), max(angle, top)}) if top else []
    here = [follower(place, chords[0]) for place in places]
    for k, chord in enumerate(chords[1:], 1):
        if not here or min(here) >= top:
            break
        below = [n for n, theta in enumerate(here) if theta < lock_angle(chord)]
        if below:
            last = below[-1]
            angle, link = _meets(chords[:k], lock_angle(chord), places[last], places[last + 1]), k
            places, here = [angle, *places[last + 1:]], [lock_angle(chord), *here[last + 1:]]
        _, places, here = _one_link_on(chords[:k], chord, places, here)
    return angle, link


def _meets(chords: Sequence[float], theta: float, low: float, high: float) -> float:
    """Return the smallest head angle in (low, high] at which the handle behind these links is at theta or beyond."""
    return _bisect(lambda place: _handle(place, chords) >= theta, low, high)


def _one_link_on(chords: Sequence[float], chord: float, places: list[float],
                 here: list[float]) -> tuple[list[float], list[float], list[float]]:
    """Return the head angles at which the rear handle of the next link turns back, and new ``places`` and ``here``.

    At the head angles ``places``, the front handle of the link (behind ``chords``) has the polar angles ``here``;
    between these head angles, it moves in one direction. The returned ``places`` are the head angles, in ascending
    order, between which the rear handle moves in one direction; the returned ``here`` are its angles there.
    """
    turning = [illinois(lambda x, turn=turn: _handle(x, chords) - turn,  # type: ignore[misc]
                        places[n], places[n + 1], here[n] - turn, here[n + 1] - turn)
               for turn in turns(chord) for n in range(len(places) - 1)
               if (here[n] - turn) * (here[n + 1] - turn) < 0] if min(here) < chord + _NO_TURN else []
    here = [_rear(theta, chord) for theta in here] + [_handle(turn, [*chords, chord]) for turn in turning]
    places, here = map(list, zip(*sorted(zip(places + turning, here, strict=True)), strict=True))
    return turning, places, here


def _handle(theta: float, chords: Sequence[float]) -> float:
    """Return the polar angle of the handle behind these links; infinite if a link cannot be placed."""
    for chord in chords:
        theta = follower(theta, chord)
    return theta


def follower(theta: float, chord: float) -> float:
    """Return the polar angle of the next handle; infinite if the link cannot be placed."""
    return theta + step(theta, chord, first_guess(theta, chord))[0] if theta < inf else inf


def _rear(theta: float, chord: float) -> float:
    """Return ``follower`` or, exactly at a lock, if rounding has removed the root, the angle of the longest chord."""
    rear = follower(theta, chord)
    return rear if rear < inf else theta + first_peak(theta, pi)[0]


@lru_cache(maxsize=1)
def _first_with_peak() -> float:
    """Return the polar angle (about 0.9, a pure number) above which the chord has a first peak."""
    return _bisect(lambda theta: first_peak(theta, pi)[0] < inf, 0.5, 2.0)


def _zero_of(value: Callable[[float], float], low: float, high: float) -> float:
    """Return where an increasing function reaches 0 in (low, high]; there, it is at least 0."""
    at_low, at_high = value(low), value(high)
    if -inf < at_low < 0 < at_high:
        return illinois(value, low, high, at_low, at_high)
    return _bisect(lambda x: value(x) >= 0, low, high)


def _bisect(holds, low: float, high: float) -> float:  # type: ignore[no-untyped-def]
    """Return the smallest float in (low, high] at which a monotone condition holds; it must hold at ``high``."""
    while low < (middle := low + 0.5 * (high - low)) < high:
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def turning_places(chords: Sequence[float], low: float, high: float) -> list[float]:
    """Return the head angles in (low, high), in ascending order, at which the rear handle of any link turns back.

    Between consecutive angles, every handle moves in one direction. The links are examined in order from the head until
    no later link can turn back. If all links behind the head's link are equal, the links behind the third handle merely
    follow it (docs/contact-lemmas.md, lemma 2), so two links suffice.
    """
    longest = [*accumulate(reversed(chords), max)][::-1]
    places, here, found = [low, high], [low, high], list[float]()
    for k, chord in enumerate(chords):
        if min(here) >= longest[k] + _NO_TURN:
            break
        turning, places, here = _one_link_on(chords[:k], chord, places, here)
        found += turning
    return sorted(found)


@lru_cache(maxsize=256)
def turns(chord: float) -> list[float]:
    """Return the angles at which the rear handle of a link turns back.

    There is at most one such angle with a span below 3/4 turn, and at most one with a larger span.
    """
    far = 1.5 * pi
    apart = 0.5 * (sqrt(2 * chord * chord - far * far) - far) if chord > far else 0.0
    ends = sorted({lock_angle(chord), max(apart, lock_angle(chord)), chord + _NO_TURN})
    out = []
    for low, high in pairwise(ends):
        sign = -1.0 if _inwards(low, chord) > 0 else 1.0
        if (_inwards(high, chord) > 0) == (sign > 0):
            out.append(_zero_of(
                lambda theta, sign=sign: sign * _inwards(theta, chord), low, high))     # type: ignore[misc]
    return out


def _inwards(theta: float, chord: float) -> float:
    """Return a number that is positive if the rear handle of a link follows the front handle inwards."""
    delta = step(theta, chord, first_guess(theta, chord))[0]
    if delta == inf:
        return -inf
    s = sin(0.5 * delta)
    return delta * cos(delta) + 2 * theta * s * ((theta + delta) * cos(0.5 * delta) - s)
