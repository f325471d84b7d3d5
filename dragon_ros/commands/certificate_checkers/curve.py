"""Composite tracks for the checker of certificates, from the scene's plain numbers, with none of the solver's code.

Every piece is a curve by its length l: lines and arcs are start + direction (e^(i k l) - 1) / (i k), k their signed
curvature; spirals are b theta e^(i side theta), with theta by Newton from the length.
"""
from dataclasses import dataclass
from math import atan, cos, hypot, inf, pi, radians, sin
from typing import Any

import numpy as np

from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.scene import Scene

_NEWTON = 60


@dataclass(frozen=True)
class Bow:
    """A line (``bend`` 0) or an arc from a point in a direction; lengths before 0 continue it backwards."""

    start: complex
    direction: complex
    bend: float
    length: float

    @property
    def most(self) -> float:
        """Largest curvature in 1/m."""
        return abs(self.bend)

    @property
    def before(self) -> float:
        """How far it goes on backwards."""
        return inf

    def at(self, length: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents."""
        tangent = self.direction * np.exp(1j * self.bend * length)
        if not self.bend:
            return self.start + self.direction * length, tangent
        return self.start + (tangent - self.direction) / (1j * self.bend), tangent


@dataclass(frozen=True)
class Coil:
    """A part of a spiral of b a radian: from ``theta`` outwards (``way`` 1) or inwards, turning by ``side``."""

    start: complex
    direction: complex
    b: float
    theta: float
    last: float
    way: int
    side: int

    @property
    def length(self) -> float:
        """Length of the piece."""
        ends = _arc(np.array([self.theta, self.last]))
        return float(abs(ends[1] - ends[0]) * self.b) if self.last < inf else inf

    @property
    def most(self) -> float:
        """Largest curvature in 1/m: at the inner end."""
        least = min(self.theta, self.last)
        return float((2 + least * least) / (self.b * (1 + least * least) ** 1.5))

    @property
    def before(self) -> float:
        """How far it goes on backwards: one that winds in comes from afar."""
        return inf if self.way < 0 else 0.0

    def at(self, length: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents."""
        theta = _theta(np.maximum(_arc(np.array(self.theta)) + self.way * length / self.b, 0.0))
        first, turned = self._bare(np.array(self.theta)), self._bare(theta)
        turn = self.direction / first[1]
        return self.start + turn * (turned[0] - first[0]), turn * turned[1]

    def _bare(self, theta: Floats) -> tuple[Array, Array]:
        round_it = np.exp(1j * self.side * theta)
        return self.b * theta * round_it, self.way * round_it * (1 + 1j * self.side * theta) / np.hypot(1, theta)


def _arc(theta: Floats) -> Floats:
    """Return the length of a spiral from its centre, in units of b."""
    out: Floats = 0.5 * (theta * np.hypot(1, theta) + np.arcsinh(theta))
    return out


def _theta(arc: Floats) -> Floats:
    """Return the polar angle at a length: Newton from above on a function that bends up goes down to its root."""
    theta: Floats = np.minimum(arc, np.sqrt(2 * arc))
    for _ in range(_NEWTON):
        step = (_arc(theta) - arc) / np.hypot(1, theta)
        theta = theta - step
        if np.all(np.abs(step) <= 4e-16 * (1 + theta)):
            break
    return theta


class Curve:
    """The whole track: points by the distance along it. Before its first piece that is continued."""

    def __init__(self, scene: Scene) -> None:
        """Take plain numbers from the scene."""
        track: Any = scene.track
        self.pieces, self.first = _pieces_of(track) if hasattr(track, 'pieces') else _turn_of(track)
        self.ends = self.first + np.cumsum([piece.length for piece in self.pieces])
        self.starts: Floats = np.concatenate(([self.first], self.ends[:-1]))
        self.bend = max(piece.most for piece in self.pieces)
        self.begin = float(self.first - self.pieces[0].before)

    def at(self, along: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents (complex) at distances."""
        points, tangents = np.empty(along.shape, dtype=complex), np.empty(along.shape, dtype=complex)
        which = np.searchsorted(self.starts[1:], along, side='right')
        for number in np.unique(which).tolist():
            here = which == number
            points[here], tangents[here] = self.pieces[number].at(along[here] - self.starts[number])
        return points, tangents


def _turn_of(track: Any) -> tuple[list[Bow | Coil], float]:
    """Return the pieces of an S-turn and the distance at which the first begins; distances count from its entry."""
    b, radius = track.pitch_m / (2 * pi), 0.5 * track.diameter_m
    theta = radius / b
    gamma = atan(theta)
    small = radius / sin(gamma) / (1 + track.ratio)
    entry = radius * complex(cos(theta), sin(theta))
    inwards = -complex(cos(theta), sin(theta)) * complex(cos(gamma), sin(gamma))
    pieces: list[Bow | Coil] = [Coil(entry, inwards, b, theta, theta, -1, 1)]
    point, direction = entry, inwards
    for bend in (-1 / (track.ratio * small), 1 / small):
        pieces.append(Bow(point, direction, bend, 2 * gamma / abs(bend)))
        end = pieces[-1].at(np.array([pieces[-1].length]))
        point, direction = complex(end[0][0]), complex(end[1][0])
    pieces.append(Coil(point, direction, b, theta, inf, 1, 1))
    return pieces, 0.0


def _pieces_of(track: Any) -> tuple[list[Bow | Coil], float]:
    """Return the pieces of a joined track, each from where the one before ends."""
    first = track.pieces[0]
    angle = radians(first.heading_deg or 0.0)
    point, direction = complex(*(first.at_m or (0.0, 0.0))), complex(cos(angle), sin(angle))
    pieces: list[Bow | Coil] = []
    for piece in track.pieces:
        pieces.append(_piece_of(piece, point, direction))
        end = pieces[-1].at(np.array([pieces[-1].length]))
        point, direction = complex(end[0][0]), complex(end[1][0] / hypot(end[1][0].real, end[1][0].imag))
    return pieces, 0.0


def _piece_of(piece: Any, point: complex, direction: complex) -> Bow | Coil:
    if hasattr(piece, 'length_m'):
        return Bow(point, direction, 0.0, piece.length_m)
    if hasattr(piece, 'radius_m'):
        turned = radians(piece.angle_deg)
        return Bow(point, direction, (1 if turned > 0 else -1) / piece.radius_m, abs(turned) * piece.radius_m)
    way = 1 if piece.to_turns > piece.from_turns else -1
    side = way if piece.side == 'left' else -way
    theta, last = 2 * pi * piece.from_turns, 2 * pi * piece.to_turns
    return Coil(point, direction, piece.pitch_m / (2 * pi), theta, last, way, side)
