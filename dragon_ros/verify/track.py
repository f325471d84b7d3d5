"""A track in balls: its segments in the plane, positions on the track, and the next handle, one link away.

A position consists of the index of a segment and a coordinate on that segment. If the curvature is at most K and K l <
2 for each link l, the chord from a handle grows along the track for at least pi / K, and reaches l before that (Schur).
The next handle is therefore at the only position one link away that is provably at most pi / K away along the track. On
a single spiral that the head follows to the centre, the smallest root is used instead (``SpiralSegment.span``).
"""
from bisect import bisect_left
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from flint import acb, arb

from dragon_ros.verify import reading
from dragon_ros.verify.balls import PI, UNIT, certainly, direction, exact, size, up
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.roots import bracketed, certified
from dragon_ros.verify.segments import (
    HALF,
    ONE,
    TWO,
    ZERO,
    ArcSegment,
    LineSegment,
    Link,
    SpiralSegment,
    furthest_m,
    root_of,
)

AnySegment = LineSegment | ArcSegment | SpiralSegment
_NEAR_M, _NEAR_RAD = 1e-6, 1e-6     # largest difference between a joint and the stated start of a piece
_MARGIN = 1e-12                     # metres by which a position may be beyond the track's end, in addition to rounding
_ULPS = 2.0**-50                    # rounding error of a position relative to its distance
_SHORTER = 1 - 1e-9                  # a chord below this in floats, relative to a link, is certainly shorter
_NARROW = 1e-15                     # largest uncertainty next to a joint, relative to 1 m or the tightest radius


def _margin_m(end: arb) -> float:
    return _MARGIN + _ULPS * abs(float(end))


class Place(NamedTuple):
    """The index of a segment and the coordinate on it; if ``loose`` > 0, a joint is at most ``loose`` metres away.

    In this case it is unknown on which side of the joint the position is, and the coordinate is on the continuation
    of the segment's curve. At a distance d beyond the joint, the track deviates from that curve by at most K d^2, and
    its direction by 2 K d (docs/contact-lemmas.md).
    """

    segment: int
    u: arb
    loose: float = 0.0


class Track:
    """Segments in the order in which the head passes them; ``origins`` holds the distances of their anchors."""

    def __init__(self, segments: Sequence[AnySegment], origins: Sequence[arb], start: arb, to_centre: bool,
                 poles: Sequence[int]) -> None:
        """Store the segments; ``start`` is the head's distance at 0 s, and ``poles`` holds the indices of centres."""
        self.segments, self.origins, self.start, self.to_centre, self.poles = (
            tuple(segments), tuple(origins), start, to_centre, tuple(poles))
        self.bend = max(segment.bend for segment in segments)
        self.joints = [self.distance(Place(k, segment.first)) for k, segment in enumerate(segments)
                       if k and segment.first is not None]
        self._joints = [float(joint) for joint in self.joints]
        first, last = segments[0].first, segments[-1].last
        self.begin = None if first is None else self.distance(Place(0, first))
        self.end = None if last is None else self.distance(Place(len(segments) - 1, last))

    def distance(self, place: Place) -> arb:
        """Return the distance of a position along the track, measured in the head's direction."""
        return self.origins[place.segment] + self.segments[place.segment].metres(place.u)

    def place_at(self, metres: arb) -> Place:
        """Return the position at a distance along the track. Raises Refused beyond the ends of the track."""
        for end, sense in ((self.begin, -1), (self.end, 1)):
            if end is not None and (metres - end) * sense > _margin_m(end):
                raise Refused(f'{float(metres):.12g} m along the track is beyond its end at {float(end):.12g} m')
        k = bisect_left(self._joints, float(metres))
        while k < len(self.joints) and metres >= self.joints[k]:
            k += 1
        while k and metres < self.joints[k - 1]:
            k -= 1
        beyond = [size(metres - joint) for joint in self.joints[max(k - 1, 0):k + 1]
                  if not (metres < joint or metres >= joint)]
        return self._loosened(k, self.segments[k].after(metres - self.origins[k]), max(beyond, default=0.0))

    def _loosened(self, k: int, u: arb, beyond_m: float) -> Place:
        """Return a position that may be ``beyond_m`` metres beyond a joint."""
        if not beyond_m:
            return Place(k, u)
        certainly(beyond_m * max(self.bend, 1.0) < _NARROW, 'a handle next to a joint of the track could not be placed')
        return Place(k, u + UNIT * size(beyond_m / self.segments[k].speed(u)), beyond_m)

    def point(self, place: Place) -> acb:
        """Return the point of a position."""
        out = self.segments[place.segment].point(place.u)
        return out + acb(UNIT, UNIT) * up(self.bend * place.loose * place.loose) if place.loose else out

    def heading(self, place: Place) -> acb:
        """Return the unit tangent at a position."""
        out = self.segments[place.segment].heading(place.u)
        return out + acb(UNIT, UNIT) * up(2 * self.bend * place.loose) if place.loose else out

    def next(self, place: Place, link: Link, way: int) -> Place:
        """Return the position of the next handle ahead (``way`` 1) or behind (-1).

        Raises Refused if the handle does not fit on the track.
        """
        k, segment = place.segment, self.segments[place.segment]
        edge = segment.last if way > 0 else segment.first
        is_inwards = isinstance(segment, SpiralSegment) and way != segment.sense
        if is_inwards and edge is not None and self._is_beyond(place, edge, link) and 0 <= k + way < len(self.segments):
            return self._across(place, link, way)       # the next handle may be beyond the end of the spiral
        u = segment.next(place.u, link, way)
        if edge is None:
            return Place(k, u)
        inside = (edge - u) * (segment.sense * way)
        if inside < 0:
            end = self.end if way > 0 else self.begin       # rounding may put a position beyond this end of the track
            if 0 <= k + way < len(self.segments) or end is None or size(inside * segment.speed(u)) > _margin_m(end):
                return self._across(place, link, way)
            return Place(k, u)
        if is_inwards:
            self._within(abs(segment.metres(place.u) - segment.metres(u)))
        return self._loosened(k, u, 0.0 if inside >= 0 else size(inside * segment.speed(u)))

    def _within(self, gone: arb) -> None:
        certainly(gone * self.bend < PI, 'a link could have two positions; the track bends too tightly')

    def _is_beyond(self, place: Place, edge: arb, link: Link) -> bool:
        """Return whether the next handle seems to be beyond the inner end of a spiral."""
        segment = self.segments[place.segment]
        return (abs(segment.near(float(edge)) - segment.near(float(place.u))) < _SHORTER * link.near
                and abs(segment.metres(edge) - segment.metres(place.u)) < furthest_m(self.bend, link.near))

    def _across(self, place: Place, link: Link, way: int) -> Place:
        """Return the position of the next handle beyond one or more joints."""
        k, here = place.segment, self.point(place)
        segment = self.segments[k]
        edge = segment.last if way > 0 else segment.first
        assert edge is not None
        gone = abs(segment.metres(edge) - segment.metres(place.u))
        while 0 <= (k := k + way) < len(self.segments):
            segment = self.segments[k]
            near, far = (segment.first, segment.last) if way > 0 else (segment.last, segment.first)
            assert near is not None
            if far is None:
                return self._cut(k, here, link, way, gone)
            # A segment is skipped if the chord certainly grows along it and is too short at its end.
            past = gone + abs(segment.metres(far) - segment.metres(near))
            if not (past * self.bend < PI and abs(segment.point(far) - here) < link.length):
                return self._cut(k, here, link, way, gone)
            gone = past
        raise Refused('a handle leaves the track, which is too short for the dragon')

    def _cut(self, k: int, here: acb, link: Link, way: int, gone: arb) -> Place:
        """Return the position on a segment that is one link from a point; ``gone`` is the arc to the near end."""
        segment = self.segments[k]
        near, far = (segment.first, segment.last) if way > 0 else (segment.last, segment.first)
        assert near is not None
        sense = segment.sense * way
        begin, point, length = float(near), complex(here), link.near
        # The arc that a link spans is longest on a circle of the largest curvature.
        most_m = max(furthest_m(self.bend, length) - float(gone), 1e-9 * length)
        if far is not None:
            most_m = min(most_m, float(abs(segment.metres(far) - segment.metres(near))))
        most = abs(float(segment.after(segment.metres(near) + exact(way * most_m))) - begin)
        step = 1e-7 * most

        def about(x: float) -> tuple[float, float]:
            """Return half the excess of the squared chord, and the slope, at x beyond the near end."""
            away = segment.near(begin + sense * x) - point
            after = segment.near(begin + sense * (x + step)) - point
            value = 0.5 * (abs(away)**2 - length * length)
            return value, (0.5 * (abs(after)**2 - length * length) - value) / step

        guess = begin + sense * bracketed(about, 0.0, most, 0.5 * most)

        def value(u: arb) -> arb:
            away = segment.point(u) - here
            return HALF * ((away * away.conjugate()).real - link.square)

        def slope(u: arb) -> arb:
            away = segment.point(u) - here
            return (away.conjugate() * segment.heading(u)).real * segment.speed(u) * segment.sense

        u = certified(value, slope, guess)
        outside = [size(beyond * segment.speed(u)) for beyond in (
            (near - u) * sense, ZERO - ONE if far is None else (u - far) * sense) if not beyond <= 0]
        self._within(gone + abs(segment.metres(u) - segment.metres(near)))
        return self._loosened(k, u, max(outside, default=0.0))

    def curvatures(self, one: Place, two: Place) -> arb:
        """Return a ball of the curvatures between two positions; the curvature of a spiral is monotone."""
        first, last = (one, two) if one.segment < two.segment else (two, one)
        out = self.segments[first.segment].curvature(one.u if first.segment == last.segment else first.u)
        loose_m = max(one.loose, two.loose)
        spread = 1 if loose_m else 0
        for k in range(max(first.segment - spread, 0), min(last.segment + spread + 1, len(self.segments))):
            segment = self.segments[k]
            for u in (segment.last if k < last.segment else None, segment.first if k > first.segment else None):
                if u is not None:
                    out = out.union(segment.curvature(u + UNIT * up(size(loose_m / segment.speed(u)))))
            for place in (one, two):
                if place.segment == k:
                    out = out.union(segment.curvature(place.u))
        return out

    def apart_m(self, one: Place, two: Place) -> float:
        """Return a bound on the distance along the track between two positions."""
        if one.segment != two.segment:
            return size(self.distance(one) - self.distance(two))
        segment = self.segments[one.segment]
        if isinstance(segment, SpiralSegment):
            outer = one.u if float(one.u) > float(two.u) else two.u
            return up(size(segment.b * (one.u - two.u) * root_of(outer)))
        return size(segment.speed(one.u) * (one.u - two.u))


def track_of(scene: reading.Scene) -> Track:
    """Return the track of a scene."""
    kind = scene.track
    if isinstance(kind, reading.Spiral):
        return _single(kind, scene.tail_leads)
    return _turn(kind) if isinstance(kind, reading.Turn) else _joined(kind)


def _single(spiral: reading.Spiral, tail_leads: bool) -> Track:
    """Return a spiral as a track to its centre or, if the tail leads, to the head's start."""
    start = TWO * PI * exact(spiral.start_turns)
    last = start if tail_leads else ZERO
    segment = SpiralSegment(exact(spiral.pitch_m) / (TWO * PI), acb(0), acb(1), 1, -1, start, None, last)
    return Track([segment], [ZERO], ZERO, not tail_leads, [0])


def _turn(turn: reading.Turn) -> Track:
    """Return the S-turn. With tan gamma = R / b, both arcs turn by 2 gamma and their radii add up to R / sin gamma."""
    b, radius = exact(turn.pitch_m) / (TWO * PI), HALF * exact(turn.diameter_m)
    theta = radius / b
    gamma = theta.atan()
    second = radius / gamma.sin() / (ONE + exact(turn.ratio))
    inwards, outwards = (SpiralSegment(b, acb(0), acb(sign), 1, -sign, theta, *ends)
                         for sign, ends in ((1, (None, theta)), (-1, (theta, None))))
    turned, heading = TWO * gamma, theta + gamma + PI
    first = ArcSegment(inwards.point(theta), direction(heading), exact(turn.ratio) * second, -1, ZERO, turned)
    other = ArcSegment(first.point(turned), direction(heading - turned), second, 1, ZERO, turned)
    halfway = first.radius * turned
    return Track([inwards, first, other, outwards], [ZERO, ZERO, halfway, halfway + second * turned],
                 -exact(turn.before_m), False, [0, 1, 2, 0])


def _radians(degrees: float) -> arb:
    return exact(Fraction(degrees) / 180) * PI


def _joined(track: reading.Pieces) -> Track:
    """Return the pieces joined end to end; the first piece is continued backwards if possible."""
    pose = track.poses[0]
    heading = _radians(pose.heading_deg or 0.0)
    point = acb(*map(exact, pose.at_m or (0.0, 0.0)))
    segments: list[AnySegment] = []
    origins = [ZERO]
    for k, (piece, said) in enumerate(zip(track.pieces, track.poses, strict=True)):
        _check_joint(f'scene.track.pieces[{k}]', said, point, heading)
        segment, turned = _segment(piece, point, direction(heading), k == 0)
        segments.append(segment)
        heading += turned
        last = segment.last
        assert last is not None
        point = segment.point(last)
        origins.append(origins[-1] + segment.metres(last))
    return Track(segments, origins[:-1], exact(track.start_m), False, range(len(segments)))


def _segment(piece: reading.Piece, point: acb, leaves: acb, is_open: bool) -> tuple[AnySegment, arb]:
    """Return the segment of a piece that begins at a point in a direction, and the angle by which it turns."""
    first = None if is_open else ZERO
    if isinstance(piece, reading.Line):
        return LineSegment(point, leaves, first, exact(piece.length_m)), ZERO
    if isinstance(piece, reading.Arc):
        angle, side = _radians(piece.angle_deg), 1 if piece.angle_deg > 0 else -1
        return ArcSegment(point, leaves, exact(piece.radius_m), side, first, angle * side), angle
    b = exact(piece.pitch_m) / (TWO * PI)
    begin, last = (TWO * PI * exact(turns) for turns in (piece.from_turns, piece.to_turns))
    sense = 1 if piece.to_turns > piece.from_turns else -1
    side = sense if piece.left else -sense
    # At polar angle u, the unrotated spiral has the heading side (u + atan u), or the opposite heading if the head
    # winds in.
    turned = begin + begin.atan()
    rotation = leaves * direction(-turned * side) * sense
    centre = point - rotation * direction(begin * side) * (b * begin)
    is_open = is_open and sense < 0
    segment = SpiralSegment(b, centre, rotation, side, sense, begin, None if is_open else begin, last)
    return segment, (last + last.atan() - turned) * side


def _check_joint(name: str, said: reading.Pose, point: acb, heading: arb) -> None:
    """Raise Refused if a piece's stated start or heading differs from the end of the preceding piece."""
    if said.at_m is not None:
        away = abs(acb(*map(exact, said.at_m)) - point)
        certainly(away < 2 * _NEAR_M, f'{name}.at_m: the preceding piece ends {float(away):.3g} m from there')
    if said.heading_deg is not None:
        turned = direction(heading - _radians(said.heading_deg))
        certainly(turned.real > 0 and abs(turned.imag) < 2 * _NEAR_RAD,
                  f'{name}.heading_deg: the preceding piece ends {float(turned.arg()):.3g} rad from there')
