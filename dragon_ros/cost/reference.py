"""True positions and velocities of handles, with 40 digits of mpmath.

The track is laid out anew from the scene's floats, which are exact numbers. The package's solution only selects the
piece of track and the root; Newton's method polishes each place until its last digits. A test compares the result with
independent references of all hard cases.
"""
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
from mpmath import mp, mpc, mpf

from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import DragonError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Arc, Line, Spiral, SpiralArc, STurn

_DIGITS = 40
_BACK, _AHEAD = -1, 1
Number = Any                    # mpmath creates its types at run time
Place = tuple[int, Number]      # the number of a piece, and the coordinate on it


@dataclass(frozen=True)
class Reference:
    """Handles (m), from the head backwards, as ``high`` + ``low``, and velocities (m/s), all of shape (N+1, 2)."""

    high: Floats
    low: Floats
    velocity_m_s: Floats

    def error_m(self, handles_m: Floats) -> float:
        """Return the largest distance (m) between handles (N+1 or more, 2) and the reference."""
        return float(np.max(np.hypot(*((handles_m[:len(self.high)] - self.high) - self.low).T)))

    def speed_error_m_s(self, velocity_m_s: Floats) -> float:
        """Return the largest difference (m/s) between velocities (N+1 or more, 2) and the reference."""
        return float(np.max(np.hypot(*(velocity_m_s[:len(self.high)] - self.velocity_m_s).T)))


@dataclass(frozen=True)
class _Piece:
    """A piece of a track: the point at a coordinate u, its derivative, and the distance from the anchor.

    u is the distance on a line, the angle turned on an arc, and the polar angle on a spiral, on which it increases
    (``way`` 1) or decreases (-1) in the head's direction.
    """

    at: Callable[[Number], Number]
    slope: Callable[[Number], Number]
    metres: Callable[[Number], Number]
    last: Number
    way: int = 1

    def heading(self, u: Number) -> Number:
        """Return the unit tangent in the head's direction."""
        return self.way * mpmath.sign(self.slope(u))


def _line(start: Number, direction: Number, length: Number) -> _Piece:
    return _Piece(lambda u: start + direction * u, lambda u: direction, lambda u: u, length)


def _arc(start: Number, direction: Number, radius: Number, side: int, angle: Number) -> _Piece:
    return _Piece(lambda u: start + side * mpc(0, 1) * radius * direction * (1 - mp.expj(side * u)),
                  lambda u: radius * direction * mp.expj(side * u), lambda u: radius * u, angle)


def _spiral(b: Number, start: Number, last: Number, way: int, side: int = 1, rotation: Number = 1,
            centre: Number = 0) -> _Piece:
    return _Piece(lambda u: centre + rotation * b * u * mp.expj(side * u),
                  lambda u: rotation * b * mp.expj(side * u) * mpc(1, side * u),
                  lambda u: way * b * (_length(u) - _length(start)), last, way)


def _length(u: Number) -> Number:
    """Return the length of a spiral from its centre, in units of b."""
    return (u * mp.sqrt(1 + u * u) + mp.asinh(u)) / 2


def _track_of(scene: Scene) -> tuple[list[_Piece], list[Number], Number]:
    """Return the pieces, the distances of their anchors along the track, and the head's distance at t = 0."""
    spec = scene.track
    if isinstance(spec, Spiral):
        b, start = mpf(spec.pitch_m) / (2 * mp.pi), 2 * mp.pi * mpf(spec.start_turns)
        return [_spiral(b, start, mpf(0), _BACK)], [mpf(0)], mpf(0)
    if isinstance(spec, STurn):
        return *_turn(spec), -mpf(spec.before_m)
    at_m, heading_deg = spec.pieces[0].at_m or (0.0, 0.0), spec.pieces[0].heading_deg or 0.0
    point, heading = mpc(*at_m), mp.expj(mp.radians(mpf(heading_deg)))
    pieces, origins = list[_Piece](), [mpf(0)]
    for one in spec.pieces:
        pieces.append(_joined(one, point, heading))
        origins.append(origins[-1] + pieces[-1].metres(pieces[-1].last))
        point, heading = pieces[-1].at(pieces[-1].last), pieces[-1].heading(pieces[-1].last)
    return pieces, origins[:-1], mpf(spec.start_m)


def _joined(spec: Line | Arc | SpiralArc, point: Number, heading: Number) -> _Piece:
    """Return a piece that starts at a point with a heading."""
    if isinstance(spec, Line):
        return _line(point, heading, mpf(spec.length_m))
    if isinstance(spec, Arc):
        return _arc(point, heading, mpf(spec.radius_m), 1 if spec.angle_deg > 0 else -1,
                    mp.radians(abs(mpf(spec.angle_deg))))
    b, start, last = mpf(spec.pitch_m) / (2 * mp.pi), *(2 * mp.pi * mpf(n) for n in (spec.from_turns, spec.to_turns))
    way = _AHEAD if last > start else _BACK
    side = 1 if (spec.side == 'left') == (way == _AHEAD) else -1
    bare = _spiral(b, start, last, way, side)
    rotation = heading / bare.heading(start)
    return _spiral(b, start, last, way, side, rotation, point - rotation * bare.at(start))


def _turn(turn: STurn) -> tuple[list[_Piece], list[Number]]:
    """Return an S-turn; each arc turns by 2 gamma, where gamma = atan(theta) is the angle between track and radius."""
    b, radius = mpf(turn.pitch_m) / (2 * mp.pi), mpf(turn.diameter_m) / 2
    theta = radius / b
    gamma = mp.atan(theta)
    second = radius / mp.sin(gamma) / (1 + mpf(turn.ratio))
    radii = mpf(turn.ratio) * second, second
    into, out = _spiral(b, theta, theta, _BACK), _spiral(b, theta, mp.inf, _AHEAD, rotation=-1)
    one = _arc(into.at(theta), into.heading(theta), radii[0], -1, 2 * gamma)
    two = _arc(one.at(2 * gamma), one.heading(2 * gamma), radii[1], 1, 2 * gamma)
    return [into, one, two, out], [mpf(0), mpf(0), 2 * gamma * radii[0], 2 * gamma * (radii[0] + radii[1])]


def _travelled(scene: Scene, t: Number) -> tuple[Number, Number]:
    """Return the leader's distance travelled (m) and its speed (m/s); profiles are integrated ramp by ramp."""
    law = scene.head
    if isinstance(law, Head):
        return mpf(law.speed_m_s) * t, mpf(law.speed_m_s)
    assert isinstance(law, Profile)
    far, knots = mpf(0), [(mpf(at), mpf(v)) for at, v in law.knots]
    for (t0, v0), (t1, v1) in pairwise(knots):
        length, rise = t1 - t0, v1 - v0
        if t1 <= t:
            far += length * (v0 + v1) / 2
        elif t0 <= t:
            x = (t - t0) / length
            if law.ramps == 'linear':
                return far + length * (v0 * x + rise * x * x / 2), v0 + rise * x
            return far + length * (v0 * x + rise * (x**3 - x**4 / 2)), v0 + rise * (3 * x * x - 2 * x**3)
    return far + (t - knots[-1][0]) * knots[-1][1], knots[-1][1]


def _polished(excess: Callable[[Number], tuple[Number, Number]], u: Number) -> Number:
    """Return the root near u of a function that returns its value and its slope."""
    for _ in range(20):
        value, slope = excess(u)
        step = value / slope
        u -= step
        if abs(step) <= mpf(10) ** (8 - _DIGITS) * (1 + abs(u)):
            return u
    raise DragonError('the reference cannot place a link')


def _places(scene: Scene, t_s: float, way: int, distance: Number, most: int | None = None) -> list[Place]:
    """Return the true places of ``most`` handles, leader first, whose ``distance`` along the track is given (m)."""
    pieces, origins, _ = _track_of(scene)
    near = [(int(k), mpf(float(u))) for k, u in zip(*state(scene, t_s).places, strict=True)][::-way][:most]
    (k, u), *rest = near
    places = [(k, _polished(lambda u: (origins[k] + pieces[k].metres(u) - distance,
                                       pieces[k].way * abs(pieces[k].slope(u))), u))]
    links = [mpf(link) for link in scene.dragon.link_lengths_m.tolist()][::-way]
    for (number, guess), chord in zip(rest, links, strict=False):
        here, piece = pieces[places[-1][0]].at(places[-1][1]), pieces[number]

        def excess(u: Number, here: Number = here, piece: _Piece = piece, chord: Number = chord) -> Any:
            link = piece.at(u) - here
            return (abs(link) ** 2 - chord * chord) / 2, (mp.conj(link) * piece.slope(u)).real
        places.append((number, _polished(excess, guess)))
    return places


def reference(scene: Scene, t_s: float, most: int | None = None) -> Reference:
    """Return the true positions and velocities at a time (s): of ``most`` handles, counted from a head that leads."""
    scene = scene.exactly
    with mp.workdps(_DIGITS):
        pieces, origins, start = _track_of(scene)
        far, speed = _travelled(scene, mpf(t_s))
        if scene.head.lead == 'head':
            places = _places(scene, t_s, _BACK, start + far, most)
        else:
            k, u = _places(scene, 0.0, _BACK, start)[-1]
            places, speed = _places(scene, t_s, _AHEAD, origins[k] + pieces[k].metres(u) - far), -speed
        points = [pieces[k].at(u) for k, u in places]
        headings = [pieces[k].heading(u) for k, u in places]
        velocity = [speed * headings[0]]
        for (a, b), (ahead, behind) in zip(pairwise(points), pairwise(headings), strict=True):
            speed *= (mp.conj(b - a) * ahead).real / (mp.conj(b - a) * behind).real     # the same along the link
            velocity.append(speed * behind)
        order = -1 if scene.head.lead == 'tail' else 1
        exact = [(one.real, one.imag) for one in points[::order]]
        high = np.array(exact, dtype=np.float64)
        low = np.array([[x - mpf(h) for x, h in zip(*row, strict=True)] for row in zip(exact, high.tolist(),
                                                                                     strict=True)], dtype=np.float64)
        return Reference(high, low, np.array([(v.real, v.imag) for v in velocity[::order]], dtype=np.float64))
