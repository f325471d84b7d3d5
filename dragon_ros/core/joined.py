"""Tracks that a user joins from lines, arcs and spirals; every piece begins where the one before ends, as it heads."""
import cmath
from dataclasses import dataclass
from functools import cached_property
from math import degrees, hypot, inf, pi, radians, remainder

from dragon_ros.core.checks import number
from dragon_ros.core.errors import FieldError
from dragon_ros.core.path import Spiral
from dragon_ros.core.placed import Placed, PlacedArc, PlacedLine, PlacedSpiral, arc_from
from dragon_ros.core.walk import Walk

_NEAR_M, _NEAR_RAD = 1e-6, 1e-6     # how far a joint may be from where a piece says that it begins
_MOST = 1000


@dataclass(frozen=True)
class Line:
    """A straight line."""

    length_m: float
    at_m: tuple[float, float] | None = None
    heading_deg: float | None = None

    def check(self, name: str) -> None:
        """Refuse a line that is not one."""
        number(f'{name}.length_m', self.length_m, above=0.0, high=1e9)

    def placed(self, start: complex, direction: complex, open_ended: bool) -> Placed:
        """Return the line from a point; open-ended, it goes back without end."""
        return PlacedLine(start, direction, -inf if open_ended else 0.0, self.length_m)


@dataclass(frozen=True)
class Arc:
    """A part of a circle; ``angle_deg`` is positive to the left."""

    radius_m: float
    angle_deg: float
    at_m: tuple[float, float] | None = None
    heading_deg: float | None = None

    def check(self, name: str) -> None:
        """Refuse an arc that is not one."""
        number(f'{name}.radius_m', self.radius_m, above=0.0, high=1e9)
        if number(f'{name}.angle_deg', self.angle_deg, low=-1e6, high=1e6) == 0:
            raise FieldError(f'{name}.angle_deg', self.angle_deg, 'an arc turns', 'give degrees, positive to the left')

    def placed(self, start: complex, direction: complex, open_ended: bool) -> Placed:
        """Return the arc from a point; open-ended, its circle goes round and round before."""
        side = 1 if self.angle_deg > 0 else -1
        arc = arc_from(start, direction, self.radius_m, side, abs(radians(self.angle_deg)))
        return PlacedArc(arc.centre, arc.spoke, arc.radius_m, side, -inf, arc.last) if open_ended else arc


@dataclass(frozen=True)
class Wind:
    """A part of a spiral r = pitch_m * turns, inwards where ``to_turns`` is the smaller; ``side`` is where it turns."""

    pitch_m: float
    from_turns: float
    to_turns: float
    side: str = 'right'
    at_m: tuple[float, float] | None = None
    heading_deg: float | None = None

    def check(self, name: str) -> None:
        """Refuse a spiral that is not one."""
        number(f'{name}.pitch_m', self.pitch_m, low=1e-9, high=1e9)
        number(f'{name}.from_turns', self.from_turns, low=1e-3, high=1e6)
        number(f'{name}.to_turns', self.to_turns, low=1e-3, high=1e6)
        if self.from_turns == self.to_turns:
            raise FieldError(f'{name}.to_turns', self.to_turns, 'it begins there', 'give another')
        if self.side not in ('left', 'right'):
            raise FieldError(f'{name}.side', self.side, 'a spiral turns left or right', 'give left or right')

    def placed(self, start: complex, direction: complex, open_ended: bool) -> Placed:
        """Return the spiral from a point; open-ended, one that winds in comes from afar (one that winds out cannot)."""
        spiral = Spiral(self.pitch_m, self.from_turns)
        way = -1 if self.to_turns < self.from_turns else 1
        side = 1 if (self.side == 'left') == (way == 1) else -1
        theta, last = spiral.start.hi, 2 * pi * self.to_turns
        bare = PlacedSpiral(spiral, 0j, 1 + 0j, side, way, theta, last)
        rotation = direction / complex(bare.heading(theta))
        rotation /= abs(rotation)
        centre = start - rotation * complex(bare.at(*spiral.start))
        first = inf if open_ended and way == -1 else theta
        return PlacedSpiral(spiral, centre, rotation, side, way, first, last)


Piece = Line | Arc | Wind


@dataclass(frozen=True)
class Joined:
    """Pieces in the order of the head's way; at t = 0 the head is ``start_m`` along them.

    The first piece is continued backwards as far as the dragon is long: a line, a circle, a spiral that winds in.
    ``at_m`` and ``heading_deg`` place the first piece (the origin, along x, unless given). In a later piece they are
    checked against where the one before ends, so a dance that does not close is refused by its joint.
    """

    pieces: tuple[Piece, ...]
    start_m: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a track without pieces, bad pieces, and pieces that do not join."""
        if not 1 <= len(self.pieces) <= _MOST:
            raise FieldError('track.pieces', len(self.pieces), f'a track has 1 to {_MOST} pieces', 'list its pieces')
        for k, piece in enumerate(self.pieces):
            piece.check(f'track.pieces.{k + 1}')
        number('track.start_m', self.start_m, high=self.walk.end_m, low=max(self.walk.begin_m, -1e9))

    @cached_property
    def walk(self) -> Walk:
        """The track in the plane."""
        placed: list[Placed] = []
        origins = [0.0]
        first = self.pieces[0]
        point, direction = complex(*(first.at_m or (0.0, 0.0))), cmath.rect(1.0, radians(first.heading_deg or 0.0))
        for k, piece in enumerate(self.pieces):
            _check_joint(k, piece, point, direction)
            one = piece.placed(point, direction, open_ended=k == 0)
            placed.append(one)
            origins.append(origins[-1] + one.metres(one.last))
            point, direction = complex(one.at(one.last)), complex(one.heading(one.last))
        return Walk(tuple(placed), tuple(origins[:-1]))


def _check_joint(k: int, piece: Piece, point: complex, direction: complex) -> None:
    """Refuse a piece that says that it begins elsewhere than the one before ends, or heads elsewhere."""
    if piece.at_m is not None:
        x, y = (number(f'track.pieces.{k + 1}.at_m', value, low=-1e9, high=1e9) for value in piece.at_m)
        gap = hypot(x - point.real, y - point.imag)
        if gap > _NEAR_M:
            raise FieldError(f'track.pieces.{k + 1}.at_m', [x, y], f'joint {k}: piece {k} ends {gap:.6g} m from there, '
                             f'at [{point.real:.9g}, {point.imag:.9g}]', 'leave it out, or change the pieces before')
    if piece.heading_deg is not None:
        wanted = number(f'track.pieces.{k + 1}.heading_deg', piece.heading_deg, low=-1e6, high=1e6)
        off = remainder(radians(wanted) - cmath.phase(direction), 2 * pi)
        if abs(off) > _NEAR_RAD:
            raise FieldError(f'track.pieces.{k + 1}.heading_deg', wanted, f'joint {k}: piece {k} ends '
                             f'{degrees(-off):.6g} degrees from there, at {degrees(cmath.phase(direction)):.9g}',
                             'leave it out, or change the pieces before')


def wound(spiral: Spiral, last_rad: float) -> Walk:
    """Return a single spiral as a walk that winds in from afar to a polar angle; distances count from its start."""
    return Walk((PlacedSpiral(spiral, 0j, 1 + 0j, 1, -1, inf, last_rad),), (0.0,))


KINDS: dict[str, type[Piece]] = {'line': Line, 'arc': Arc, 'spiral': Wind}
