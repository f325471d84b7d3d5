"""The segments of a track in balls: lines, arcs and spirals.

The coordinate u along a segment is the distance in metres on a line, the angle turned in radians on an arc, and the
polar angle on a spiral. ``sense`` is 1 if u increases in the head's direction of travel and -1 if u decreases. The
head enters at ``first`` and leaves at ``last``; None means that a segment has no end there. Points and unit tangents
(in the head's direction) are complex balls.
"""
from cmath import exp
from dataclasses import dataclass
from functools import cached_property
from math import asin, asinh, pi, sin, sqrt
from typing import NamedTuple

from flint import acb, arb

from dragon_ros.verify.balls import PI, above, certainly, direction
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.roots import bracketed, certified

ONE, TWO, HALF, ZERO = arb(1), arb(2), arb(0.5), arb(0)
EYE = acb(0, 1)
_HALVINGS = 40      # maximum number of halvings of spans in the proof that the chord grows even close to its peak


@dataclass(frozen=True, eq=False)
class Link:
    """The distance between the two handles of a bench, in balls, with its square and its inverse."""

    length: arb
    near: float

    @cached_property
    def square(self) -> arb:
        """Square of the length."""
        return self.length * self.length

    @cached_property
    def inverse(self) -> arb:
        """1 / length."""
        return ONE / self.length


class LineSegment:
    """A straight line from a point in a direction; the point is the anchor."""

    sense = 1
    bend = 0.0

    def __init__(self, start: acb, heading: acb, first: arb | None, last: arb | None) -> None:
        """Store the point and the direction."""
        self.start, self._heading, self.first, self.last = start, heading, first, last
        self._near = complex(start), complex(heading)

    def point(self, u: arb) -> acb:
        """Return the point."""
        return self.start + self._heading * u

    def heading(self, u: arb) -> acb:
        """Return the unit tangent."""
        return self._heading

    def speed(self, u: arb) -> arb:
        """Return 1."""
        return ONE

    def metres(self, u: arb) -> arb:
        """Return the distance from the start."""
        return u

    def after(self, metres: arb) -> arb:
        """Return the coordinate u at a distance from the start."""
        return metres

    def curvature(self, u: arb) -> arb:
        """Return 0."""
        return ZERO

    def next(self, u: arb, link: Link, way: int) -> arb:
        """Return the position one link away."""
        return u + link.length if way > 0 else u - link.length

    def near(self, u: float) -> complex:
        """Return the approximate point."""
        return self._near[0] + self._near[1] * u


class ArcSegment:
    """An arc that leaves its anchor point in a direction and turns left (``side`` 1) or right (-1)."""

    sense = 1

    def __init__(self, start: acb, heading: acb, radius: arb, side: int, first: arb | None, last: arb | None) -> None:
        """Store the point, the direction and the radius."""
        self.radius, self.side, self.first, self.last = radius, side, first, last
        self._spoke = heading * EYE * radius * -side
        self.centre = start - self._spoke
        self.bend = above(ONE / radius)
        self._near = complex(self.centre), complex(self._spoke)
        self._turned: dict[Link, arb] = {}

    def point(self, u: arb) -> acb:
        """Return the point."""
        return self.centre + self._spoke * direction(u * self.side)

    def heading(self, u: arb) -> acb:
        """Return the unit tangent."""
        return self._spoke * direction(u * self.side) * EYE * (self.side / self.radius)

    def speed(self, u: arb) -> arb:
        """Return the radius."""
        return self.radius

    def metres(self, u: arb) -> arb:
        """Return the distance from the start."""
        return self.radius * u

    def after(self, metres: arb) -> arb:
        """Return the coordinate u at a distance from the start."""
        return metres / self.radius

    def curvature(self, u: arb) -> arb:
        """Return the signed curvature."""
        return self.side / self.radius

    def next(self, u: arb, link: Link, way: int) -> arb:
        """Return the position one link away."""
        if link not in self._turned:
            self._turned[link] = TWO * (link.length / (TWO * self.radius)).asin()
        turned = self._turned[link]
        return u + turned if way > 0 else u - turned

    def near(self, u: float) -> complex:
        """Return the approximate point."""
        return self._near[0] + self._near[1] * exp(1j * self.side * u)


class Chord(NamedTuple):
    """A link in units of b: approximate length, half square, inverse square, and the u beyond which it cannot lock."""

    near: float
    half_square: arb
    inverse_square: arb
    wide: arb

    @classmethod
    def of(cls, chord: arb, segment: 'SpiralSegment') -> 'Chord':
        """Return a chord. The curvature decreases outwards, and beyond ``wide`` it is below 2 / chord."""
        certainly(chord.is_finite(), 'scene.dragon: a link is too long for its spiral')
        square, wide = chord * chord, ZERO
        while not abs(segment.curvature(wide)) * segment.b * chord < 2:
            wide = wide * 1.125 + 0.25
        return cls(float(chord), HALF * square, ONE / square, wide)


class SpiralSegment:
    """A spiral r = b u about ``centre``, rotated by ``rotation``; with ``side`` 1, it winds out to the left."""

    def __init__(self, b: arb, centre: acb, rotation: acb, side: int, sense: int, anchor: arb, first: arb | None,
                 last: arb | None) -> None:
        """Store the numbers; ``sense`` is 1 if the head winds out, and distances are measured from ``anchor``."""
        self.b, self.centre, self.side, self.sense, self.first, self.last = b, centre, side, sense, first, last
        self._rotation, self._anchored = rotation, arc(anchor)
        inner = last if sense < 0 else first
        assert inner is not None
        self.inner = inner
        self.bend = above(abs(self.curvature(inner)))
        self._near = complex(centre), complex(rotation * b)
        self._chords: dict[Link, Chord] = {}

    def chord(self, link: Link) -> 'Chord':
        """Return a link's length in units of b."""
        if link not in self._chords:
            self._chords[link] = Chord.of(link.length / self.b, self)
        return self._chords[link]

    def is_wide(self, u: arb, link: Link) -> bool:
        """Return whether the curvature from u outwards is so small that links can neither lock nor turn back."""
        return u > self.chord(link).wide

    def point(self, u: arb) -> acb:
        """Return the point."""
        return self.centre + self._rotation * direction(u * self.side) * (self.b * u)

    def heading(self, u: arb) -> acb:
        """Return the unit tangent."""
        return self._rotation * direction(u * self.side) * acb(ONE, u * self.side) * (self.sense / root_of(u))

    def speed(self, u: arb) -> arb:
        """Return the distance in metres per radian."""
        return self.b * root_of(u)

    def metres(self, u: arb) -> arb:
        """Return the distance from the anchor."""
        return self.b * (arc(u) - self._anchored) * self.sense

    def after(self, metres: arb) -> arb:
        """Return the coordinate u at a distance from the anchor. Raises Refused beyond the centre."""
        wanted = self._anchored + metres / self.b * self.sense
        if not wanted > 0:
            if wanted < -1e-9:
                raise Refused('a position on the track lies beyond its end, the centre of a spiral')
            return ZERO.union(abs(wanted))
        return certified(lambda u: arc(u) - wanted, root_of, _about_after(float(wanted)))

    def curvature(self, u: arb) -> arb:
        """Return the signed curvature."""
        square = ONE + u * u
        return (ONE + ONE / square) / (self.b * square.sqrt()) * (self.side * self.sense)

    def next(self, u: arb, link: Link, way: int) -> arb:
        """Return the nearest position one link away, either further out or further in."""
        return u + self.span(u, link) if way == self.sense else u - self._span_in(u, link)

    def span(self, u: arb, link: Link) -> arb:
        """Return the smallest delta > 0 at which handles at u and at u + delta are one link apart.

        This also proves that the chord grows up to this delta. Raises Refused if the link cannot be placed.
        """
        half_square, near = self.chord(link).half_square, self.chord(link).near
        guess = about_span(float(u), near)
        if guess is None:
            raise Refused('a link cannot be placed behind its front handle: the chain locks')
        twice = TWO * u

        def value(delta: arb) -> arb:
            sine = (HALF * delta).sin()
            return HALF * delta * delta + twice * (u + delta) * (sine * sine) - half_square

        def slope(delta: arb) -> arb:
            sine, cosine = (HALF * delta).sin_cos()
            return delta + twice * sine * (sine + (u + delta) * cosine)

        found = certified(value, slope, guess)
        if not found > 0 or (not found < PI and not rises(u, PI.lower(), found.upper())):
            raise Refused('a link can be placed only beyond the first peak of its chord, if at all: the chain locks')
        return found

    def _span_in(self, u: arb, link: Link) -> arb:
        """Return a delta > 0 at which handles at u - delta and at u are one link apart (see ``track``)."""
        half_square, near = self.chord(link).half_square, self.chord(link).near
        theta, twice = float(u), TWO * u

        def about(delta: float) -> tuple[float, float]:
            s, inner = sin(0.5 * delta), theta - delta
            return (0.5 * (delta * delta - near * near) + 2 * theta * inner * s * s,
                    delta - 2 * theta * s * s + theta * inner * sin(delta))

        def value(delta: arb) -> arb:
            sine = (HALF * delta).sin()
            return HALF * delta * delta + twice * (u - delta) * (sine * sine) - half_square

        def slope(delta: arb) -> arb:
            sine, cosine = (HALF * delta).sin_cos()
            return delta + twice * sine * ((u - delta) * cosine - sine)

        least = _about_arc(theta) - furthest_m(self.bend, link.near) / float(self.b)
        most = theta - max(_about_after(max(least, 0.0)), float(self.inner))
        found = certified(value, slope, bracketed(about, 0.0, most, most))
        if not found > 0:
            raise Refused('a position on the track could not be proved: it may be on the wrong side of a handle')
        return found

    def near(self, u: float) -> complex:
        """Return the approximate point."""
        return self._near[0] + self._near[1] * u * exp(1j * self.side * u)


def root_of(u: arb) -> arb:
    """Return sqrt(1 + u^2)."""
    return (ONE + u * u).sqrt()


def arc(u: arb) -> arb:
    """Return the length of a spiral from its centre, in units of b."""
    return HALF * (u * root_of(u) + u.asinh())


def furthest_m(bend: float, length_m: float) -> float:
    """Return an approximate upper bound on a link's arc: the arc on a circle of the largest curvature."""
    half_turned = 0.5 * bend * length_m
    return 2 * asin(min(half_turned, 1.0)) / bend if half_turned > 1e-8 else length_m


def _about_arc(u: float) -> float:
    return 0.5 * (u * sqrt(1 + u * u) + asinh(u))


def _about_after(wanted: float) -> float:
    """Return the approximate polar angle up to which a spiral has a given length (in units of b)."""
    guess = min(wanted, sqrt(2 * wanted))
    for _ in range(60):
        step = (_about_arc(guess) - wanted) / sqrt(1 + guess * guess)
        guess -= step
        if abs(step) <= 1e-15 * guess:
            break
    return guess


def rises(theta: arb, low: arb, high: arb) -> bool:
    """Return whether the chord from any handle at ``theta`` provably grows with delta from ``low`` to ``high``."""
    parts = [(low, high, _HALVINGS)]
    while parts:
        left, right, halvings = parts.pop()
        delta = left.union(right)
        sine, cosine = (HALF * delta).sin_cos()
        if delta + TWO * theta * sine * (sine + (theta + delta) * cosine) > 0:
            continue
        if not halvings:
            return False
        middle = (HALF * (left + right)).mid()
        parts += [(left, middle, halvings - 1), (middle, right, halvings - 1)]
    return True


def about_span(theta: float, chord: float) -> float | None:
    """Return the approximate smallest span of a chord (in units of b); None if there seems to be no such span."""
    if chord <= 2 * theta + pi:
        return bracketed(lambda delta: _excess(theta, chord, delta), 0.0, pi,
                         2 * asin(min(1.0, chord / (2 * theta + chord / (theta + 1)))))
    step = max(1 / 64, (chord - pi) / 4096)
    delta = pi
    while (after := _excess(theta, chord, delta + step))[0] < 0 < after[1]:
        delta += step
        if delta > chord:
            return None
    last = delta + step if after[0] >= 0 else _peak(theta, chord, delta, delta + step)
    if _excess(theta, chord, last)[0] < 0:
        return None
    return bracketed(lambda delta: _excess(theta, chord, delta), delta, last, delta)


def _peak(theta: float, chord: float, low: float, high: float) -> float:
    """Return the span, between two bounds, at which a chord stops growing."""
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if _excess(theta, chord, middle)[1] > 0 else (low, middle)
    return low


def _excess(theta: float, chord: float, delta: float) -> tuple[float, float]:
    s = sin(0.5 * delta)
    return (0.5 * (delta * delta - chord * chord) + 2 * theta * (theta + delta) * s * s,
            delta + 2 * theta * s * s + theta * (theta + delta) * sin(delta))
