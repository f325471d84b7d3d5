"""Track specs, which describe the track of a scene using plain, validated values.

``composite`` converts specs to segments. A spiral is a track of one segment; the S-turn and a composite track are
sequences of lines, arcs and spirals.
"""
from dataclasses import dataclass
from math import atan, pi, sin, sqrt

from dragon_ros.core import domain
from dragon_ros.core.checks import number, settle
from dragon_ros.core.domain import COORDINATE, PITCH, RADIUS, TRACK
from dragon_ros.core.errors import FieldError

SIDES = ('left', 'right')


@dataclass(frozen=True)
class Spiral:
    """A spiral r = pitch_m theta / 2 pi about the origin (the paper's eq. 1); the head starts at 2 pi start_turns."""

    pitch_m: float = 0.55
    start_turns: float = 16.0

    def __post_init__(self) -> None:
        """Reject an invalid spiral."""
        settle(self, pitch_m=PITCH.checked('track.pitch_m', self.pitch_m),
               start_turns=number('track.start_turns', self.start_turns, low=0.0))
        if pi * self.pitch_m * self.start_turns * self.start_turns > TRACK.high:
            raise FieldError('track.start_turns', self.start_turns, f'the spiral would be longer than {TRACK.high:g} m',
                             f'give at most {sqrt(TRACK.high / (pi * self.pitch_m)):.6g} turns, or a smaller pitch')

    @property
    def b_m(self) -> float:
        """Increase of the radius per radian of polar angle, in metres."""
        return self.pitch_m / (2 * pi)

    @property
    def start(self) -> float:
        """Polar angle of the head's front handle at t = 0, in radians."""
        return 2 * pi * self.start_turns

    @property
    def start_m(self) -> float:
        """Distance of the head along the track at t = 0; this is 0 because distances are measured from there."""
        return 0.0


@dataclass(frozen=True)
class STurn:
    """An inward spiral, two arcs in a turning circle of diameter ``diameter_m``, and an outward spiral.

    The spirals are r = pitch_m / (2 pi) theta about the origin and the same curve rotated by half a turn. The radius
    of the first arc is ``ratio`` times the radius of the second. At t = 0, the head is ``before_m`` before the entry
    of the turn. If ``before_m`` is 100 and the head speed is 1 m/s, the contest's -100 s corresponds to 0 s here,
    because timestamps in ROS and in bags cannot be negative.

    The spiral enters the turning circle of radius R at the polar angle theta = R / b. There, the angle gamma between
    the tangent and the radius is given by tan gamma = theta. The entry and the exit are diametrically opposite and
    have the same heading. They are joined by two tangent arcs that turn by the same angle, first to the right and
    then to the left. The chords of both arcs lie on the line from entry to exit, so each arc turns by 2 gamma, and

        r1 + r2 = R / sin gamma,     length = 2 gamma R / sin gamma.

    The length therefore depends only on the circle, not on the ratio of the radii.
    """

    pitch_m: float = 1.7
    diameter_m: float = 9.0
    ratio: float = 2.0
    before_m: float = 0.0

    def __post_init__(self) -> None:
        """Reject an invalid turn."""
        settle(self, pitch_m=PITCH.checked('track.pitch_m', self.pitch_m),
               diameter_m=number('track.diameter_m', self.diameter_m, low=RADIUS.low, high=2 * COORDINATE.high),
               ratio=number('track.ratio', self.ratio, low=1e-3, high=1e3),
               before_m=number('track.before_m', self.before_m, low=-TRACK.high, high=TRACK.high))
        if pi * self.radius_m * self.radius_m / self.pitch_m > TRACK.high:
            raise FieldError('track.diameter_m', self.diameter_m, 'from its centre to the turn, the spiral would be '
                             f'longer than {TRACK.high:g} m', f'give at most '
                             f'{2 * sqrt(TRACK.high * self.pitch_m / pi):.6g} m, or a larger pitch')

    @property
    def radius_m(self) -> float:
        """Radius of the turning circle."""
        return 0.5 * self.diameter_m

    @property
    def entry_turns(self) -> float:
        """Number of turns of the spiral from its centre to the entry."""
        return self.radius_m / self.pitch_m

    @property
    def gamma_rad(self) -> float:
        """Angle between the track's tangent and the radius at the entry."""
        return atan(2 * pi * self.entry_turns)

    @property
    def radii_m(self) -> tuple[float, float]:
        """Radii of the two arcs, in the order in which the head traverses them."""
        second = self.radius_m / sin(self.gamma_rad) / (1 + self.ratio)
        return self.ratio * second, second

    @property
    def angle_rad(self) -> float:
        """Angle by which each arc turns."""
        return 2 * self.gamma_rad

    @property
    def length_m(self) -> float:
        """Total length of both arcs."""
        return self.angle_rad * sum(self.radii_m)

    @property
    def start_m(self) -> float:
        """Distance of the head along the track at t = 0, measured from the entry."""
        return -self.before_m

    def largest_ratio(self, least_radius_m: float) -> float:
        """Return the largest ratio at which both radii are at least ``least_radius_m``; below 1, no ratio is valid."""
        return sum(self.radii_m) / least_radius_m - 1

    def check_arcs(self, least_radius_m: float) -> None:
        """Check that both radii are at least ``least_radius_m``. Raises FieldError for one of the fields otherwise."""
        if min(self.radii_m) >= least_radius_m:
            return
        limit = (f'an arc of radius {min(self.radii_m):.6g} m bends tighter than {least_radius_m:.6g} m, 1.01 times '
                 'half the longest link, and the chain could lock there')
        largest, smallest_m = self.largest_ratio(least_radius_m), self.smallest_diameter_m(least_radius_m)
        if largest >= 1:
            raise FieldError('track.ratio', self.ratio, limit, f'give a ratio from {1 / largest:.6g} to {largest:.6g}, '
                             'a larger track.diameter_m, or shorter benches')
        raise FieldError('track.diameter_m', self.diameter_m, limit, f'give more than {smallest_m:.6g} m with '
                         'track.ratio 1, or shorter benches')

    def smallest_diameter_m(self, least_radius_m: float) -> float:
        """Return the diameter of the smallest turning circle, in which both arcs have the radius ``least_radius_m``.

        In units of b, the radius R of the circle is theta, and r1 + r2 is sqrt(1 + theta^2).
        """
        b_m = self.pitch_m / (2 * pi)
        return 2 * sqrt(max(4 * least_radius_m * least_radius_m - b_m * b_m, 0.0))


@dataclass(frozen=True)
class Line:
    """A straight line."""

    length_m: float
    at_m: tuple[float, float] | None = None
    heading_deg: float | None = None

    def checked(self, name: str) -> 'Line':
        """Return the line with its values normalised. Raises FieldError for an invalid line."""
        return Line(number(f'{name}.length_m', self.length_m, above=0.0, high=TRACK.high), *_checked_place(name, self))


@dataclass(frozen=True)
class Arc:
    """A circular arc; ``angle_deg`` is positive if the arc turns left."""

    radius_m: float
    angle_deg: float
    at_m: tuple[float, float] | None = None
    heading_deg: float | None = None

    def checked(self, name: str) -> 'Arc':
        """Return the arc with its values normalised. Raises FieldError for an invalid arc."""
        radius_m = RADIUS.checked(f'{name}.radius_m', self.radius_m)
        angle_deg = number(f'{name}.angle_deg', self.angle_deg, low=-1e6, high=1e6)
        if angle_deg == 0:
            raise FieldError(f'{name}.angle_deg', self.angle_deg, 'an arc must turn',
                             'give an angle in degrees, positive to the left')
        return Arc(radius_m, angle_deg, *_checked_place(name, self))


@dataclass(frozen=True)
class SpiralArc:
    """A part of a spiral r = pitch_m * turns that turns to ``side``, inwards if ``to_turns`` < ``from_turns``."""

    pitch_m: float
    from_turns: float
    to_turns: float
    side: str = 'right'
    at_m: tuple[float, float] | None = None
    heading_deg: float | None = None

    def checked(self, name: str) -> 'SpiralArc':
        """Return the spiral with its values normalised. Raises FieldError for an invalid spiral."""
        pitch_m = PITCH.checked(f'{name}.pitch_m', self.pitch_m)
        from_turns = number(f'{name}.from_turns', self.from_turns, low=1e-3, high=1e4)
        to_turns = number(f'{name}.to_turns', self.to_turns, low=1e-3, high=1e4)
        if from_turns == to_turns:
            raise FieldError(f'{name}.to_turns', self.to_turns, 'the spiral starts at this value', 'give another value')
        if pi * pitch_m * max(from_turns, to_turns)**2 > TRACK.high:
            raise FieldError(f'{name}.pitch_m', self.pitch_m, f'from its centre, the spiral would be longer than '
                             f'{TRACK.high:g} m', 'give a smaller pitch or fewer turns')
        if self.side not in SIDES:
            raise FieldError(f'{name}.side', self.side, 'a spiral turns left or right', 'give left or right')
        return SpiralArc(pitch_m, from_turns, to_turns, self.side, *_checked_place(name, self))


Piece = Line | Arc | SpiralArc
PIECES: dict[str, type[Piece]] = {'line': Line, 'arc': Arc, 'spiral': SpiralArc}


def _length_m(piece: Piece) -> float:
    """Return the length of a piece; that of a spiral is approximate."""
    if isinstance(piece, Line):
        return piece.length_m
    if isinstance(piece, Arc):
        return piece.radius_m * abs(piece.angle_deg) * pi / 180
    return pi * piece.pitch_m * abs(piece.to_turns**2 - piece.from_turns**2)


def _checked_place(name: str, piece: Piece) -> tuple[tuple[float, float] | None, float | None]:
    """Return the stated start and heading of a piece, normalised; ``composite`` checks them at the joint."""
    at_m, heading_deg = piece.at_m, piece.heading_deg
    if at_m is not None:
        x, y = (COORDINATE.checked(f'{name}.at_m', value) for value in at_m)
        at_m = x, y
    if heading_deg is not None:
        heading_deg = number(f'{name}.heading_deg', heading_deg, low=-1e6, high=1e6)
    return at_m, heading_deg


@dataclass(frozen=True)
class Composite:
    """A track of pieces in the head's direction; at t = 0, the head is ``start_m`` along the track.

    The first piece is extended backwards as a line, a circle or an inward spiral, so that the whole dragon fits on the
    track. ``at_m`` and ``heading_deg`` set the start of the first piece (default: the origin, along x). In later
    pieces, they are optional checks: if they differ from the end of the preceding piece, the error names the joint.
    """

    pieces: tuple[Piece, ...]
    start_m: float = 0.0

    def __post_init__(self) -> None:
        """Reject a track that has no pieces, too many pieces or an invalid piece."""
        if not domain.PIECES.low <= len(self.pieces) <= domain.PIECES.high:
            raise FieldError('track.pieces', len(self.pieces), f'a track has 1 to {domain.PIECES.high} pieces',
                             'list its pieces')
        settle(self, pieces=tuple(piece.checked(f'track.pieces.{k}') for k, piece in enumerate(self.pieces, 1)),
               start_m=number('track.start_m', self.start_m))
        length_m = sum(map(_length_m, self.pieces))
        if length_m > TRACK.high:
            raise FieldError('track.pieces', f'{length_m:.6g} m', f'the longest track has {TRACK.high:g} m',
                             'shorten the pieces')


TrackSpec = Spiral | STurn | Composite
