"""Make ``reference.json``: 50-digit positions and velocities for every hard case, and design figures.

    ./dragon python -m hard_cases.make_reference [NAME ...]

The script needs mpmath and runs for half an hour; with names, it computes only these cases and keeps the others. It
shares no numerical code with the package: it reads the scene's floats as exact numbers and constructs the track
independently. It finds the next handle in steps that cannot overshoot: if a position is g metres short of the chord,
there is no root within the next g metres of track. Everything is computed twice, the second time with more digits, and
compared.
"""
import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import mpmath
from mpmath import mp, mpc, mpf

from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from hard_cases.cases import Problem, hard_cases

DIGITS = 50                     # digits of every result
GUARD, MORE = 15, 15            # additional digits in the first and in the second computation
AGREED = 40                     # digits to which the two computations must agree
WRITTEN = 25                    # significant digits in the file
TARGET = Path(__file__).with_name('reference.json')
Number = Any                    # mpmath creates its types at run time
BACK, AHEAD = -1, 1


class Handle(NamedTuple):
    """One handle: its coordinates in metres, and its velocity in m/s as a complex number."""

    x: Number
    y: Number
    velocity: Number


@dataclass
class Straight:
    """A line; u is the distance (m) from its start."""

    start: Number
    direction: Number
    first: Number
    last: Number

    def at(self, u: Number) -> Number:
        return self.start + self.direction * u

    def tangent(self, u: Number) -> Number:
        return self.direction

    def metres(self, u: Number) -> Number:
        return u

    def after(self, metres: Number) -> Number:
        return metres

    def fastest(self, u: Number, gap: Number) -> Number:
        """Return an upper bound on the track length (m) per unit of u, up to ``gap`` metres from u."""
        return mp.one


@dataclass
class Round:
    """An arc, which turns left if ``side`` is 1; u is the distance (m) from its start."""

    start: Number
    direction: Number
    radius: Number
    side: int
    first: Number
    last: Number

    def at(self, u: Number) -> Number:
        return self.start + self.side * 1j * self.radius * self.direction * (1 - mp.expj(self.side * u / self.radius))

    def tangent(self, u: Number) -> Number:
        return self.direction * mp.expj(self.side * u / self.radius)

    metres, after, fastest = Straight.metres, Straight.after, Straight.fastest


@dataclass
class Winding:
    """A rotated spiral about ``centre``; u is the polar angle, ``side`` 1 is anticlockwise, ``way`` 1 is outwards."""

    b: Number
    centre: Number
    rotation: Number
    side: int
    way: int
    anchor: Number
    first: Number
    last: Number

    def at(self, u: Number) -> Number:
        return self.centre + self.rotation * self.b * u * mp.expj(self.side * u)

    def tangent(self, u: Number) -> Number:
        return self.way * self.rotation * mp.expj(self.side * u) * mpc(1, self.side * u) / mp.sqrt(1 + u * u)

    def metres(self, u: Number) -> Number:
        return self.way * self.b * (arc(u) - arc(self.anchor))

    def after(self, metres: Number) -> Number:
        wanted = arc(self.anchor) + self.way * metres / self.b
        u = mp.sqrt(2 * wanted)
        for _ in range(200):
            step = (arc(u) - wanted) / mp.sqrt(1 + u * u)
            u -= step
            if abs(step) < mpf(10) ** (8 - mp.dps):
                return u
        raise AssertionError('no such position on the spiral')

    def fastest(self, u: Number, gap: Number) -> Number:
        return self.b * mp.sqrt(1 + (u + gap / self.b) ** 2)


def arc(u: Number) -> Number:
    """Return the arc length from a spiral's centre, in units of b."""
    return (u * mp.sqrt(1 + u * u) + mp.asinh(u)) / 2


@dataclass
class Track:
    """The pieces of a track, and the distance along the track of each piece's origin (u = anchor for a spiral)."""

    pieces: list[Any]
    origins: list[Number]

    def place(self, metres: Number) -> tuple[int, Number]:
        """Return the piece and u at a distance along the track."""
        k = max([k for k in range(1, len(self.pieces)) if self.origins[k] <= metres], default=0)
        return k, self.pieces[k].after(metres - self.origins[k])

    def next(self, k: int, u: Number, chord: Number, way: int) -> tuple[int, Number]:
        """Return the first position behind or ahead, as ``way`` selects, that is one chord away."""
        if chord == 0:
            return k, u
        here, start = self.pieces[k].at(u), u
        while True:
            found = self._on(self.pieces[k], here, start, chord, way)
            if found is not None:
                return k, found
            k += way
            start = self.pieces[k].last if way == BACK else self.pieces[k].first

    @staticmethod
    def _on(piece: Any, here: Number, u: Number, chord: Number, way: int) -> Number | None:
        """Return the first u on a piece that is one chord away from ``here``; None if the piece ends first."""
        end = piece.first if way == BACK else piece.last
        sense = way * (getattr(piece, 'way', 1))
        for _ in range(1_000_000):
            gap = chord - abs(piece.at(u) - here)
            if gap < mpf(10) ** -13 * chord:
                return polished(piece, here, u, chord)
            step = gap / piece.fastest(u, gap)
            u += sense * step
            if end is not None and sense * (u - end) > 0:
                return None
        raise AssertionError('no position at the length of the chord was found in a million steps')


def polished(piece: Any, here: Number, u: Number, chord: Number) -> Number:
    """Return the root near u, using Newton's method."""
    for _ in range(100):
        link = piece.at(u) - here
        slope = piece.tangent(u) * (mp.sqrt(1 + u * u) * piece.b * piece.way if isinstance(piece, Winding) else 1)
        step = (abs(link) ** 2 - chord * chord) / (2 * (mp.conj(link) * slope).real)
        u -= step
        assert abs(step) < mpf(10) ** -6 * chord / abs(slope), 'the root is not near its estimate'
        if abs(step) <= mpf(10) ** (6 - mp.dps) * (chord + abs(u)):
            return u
    raise AssertionError('no root')


def track_of(scene: Scene) -> tuple[Track, Number]:
    """Return the track, and the position of the head on it at t = 0."""
    if isinstance(scene.track, STurn):
        return turn_of(scene.track), -mpf(scene.track.before_m)
    if isinstance(scene.track, Spiral):
        start = 2 * mp.pi * mpf(scene.track.start_turns)
        spiral = Winding(mpf(scene.track.pitch_m) / (2 * mp.pi), mpc(0), mpc(1), 1, BACK, start, None, mpf(0))
        return Track([spiral], [mp.zero]), mp.zero
    assert isinstance(scene.track, Composite)
    return laid(scene.track), mpf(scene.track.start_m)


def turn_of(turn: STurn) -> Track:
    """Return the S-turn: the arcs turn by 2 gamma; their radii have the given ratio and the sum R / sin gamma."""
    b, radius = mpf(turn.pitch_m) / (2 * mp.pi), mpf(turn.diameter_m) / 2
    theta = radius / b
    gamma = mp.atan(theta)
    second = radius / mp.sin(gamma) / (1 + mpf(turn.ratio))
    first = mpf(turn.ratio) * second
    into = Winding(b, mpc(0), mpc(1), 1, BACK, theta, None, theta)
    out = Winding(b, mpc(0), mpc(-1), 1, AHEAD, theta, theta, None)
    one = Round(into.at(theta), into.tangent(theta), first, -1, mp.zero, 2 * gamma * first)
    two = Round(one.at(one.last), one.tangent(one.last), second, 1, mp.zero, 2 * gamma * second)
    assert abs(two.at(two.last) - out.at(theta)) < radius * mpf(10) ** (5 - mp.dps)
    assert abs(two.tangent(two.last) - out.tangent(theta)) < mpf(10) ** (5 - mp.dps)
    return Track([into, one, two, out], [mp.zero, mp.zero, one.last, one.last + two.last])


def laid(track: Composite) -> Track:
    """Lay out joined pieces in the plane; the first piece extends backwards without limit."""
    pieces: list[Any] = []
    at_m, heading_deg = track.pieces[0].at_m or (0.0, 0.0), track.pieces[0].heading_deg or 0.0
    origins, point, direction = [mp.zero], mpc(*at_m), mp.expj(mpf(heading_deg) * mp.pi / 180)
    for spec in track.pieces:
        first = None if not pieces else mp.zero
        if isinstance(spec, Line):
            pieces.append(Straight(point, direction, first, mpf(spec.length_m)))
        elif isinstance(spec, Arc):
            radius = mpf(spec.radius_m)
            pieces.append(Round(point, direction, radius, 1 if spec.angle_deg > 0 else -1, first,
                                abs(mpf(spec.angle_deg)) * mp.pi / 180 * radius))
        else:
            pieces.append(wound(spec, point, direction))
        piece = pieces[-1]
        origins.append(origins[-1] + piece.metres(piece.last))
        point, direction = piece.at(piece.last), piece.tangent(piece.last)
    return Track(pieces, origins[:-1])


def wound(spec: Any, point: Number, direction: Number) -> Winding:
    """Return a spiral that starts at a point in a given direction."""
    start, last = 2 * mp.pi * mpf(spec.from_turns), 2 * mp.pi * mpf(spec.to_turns)
    way = AHEAD if last > start else BACK
    side = 1 if (spec.side == 'left') == (way == AHEAD) else -1
    bare = Winding(mpf(spec.pitch_m) / (2 * mp.pi), mpc(0), mpc(1), side, way, start, start, last)
    rotation = direction / bare.tangent(start)
    return replace(bare, rotation=rotation, centre=point - rotation * bare.at(start))


def gone(scene: Scene, t_s: float) -> tuple[Number, Number]:
    """Return the distance travelled by the leader and its speed, integrated ramp by ramp."""
    t, head = mpf(t_s), scene.head
    if isinstance(head, Head):
        return mpf(head.speed_m_s) * t, mpf(head.speed_m_s)
    far, knots = mp.zero, [(mpf(a), mpf(v)) for a, v in head.knots]
    for (t0, v0), (t1, v1) in pairwise(knots):
        if t1 <= t:
            far += (t1 - t0) * (v0 + v1) / 2
        elif t0 <= t:
            x, h, dv = (t - t0) / (t1 - t0), t1 - t0, v1 - v0
            if head.ramps == 'linear':
                return far + h * (v0 * x + dv * x * x / 2), v0 + dv * x
            return far + h * (v0 * x + dv * (x**3 - x**4 / 2)), v0 + dv * (3 * x * x - 2 * x**3)
    return far + (t - knots[-1][0]) * knots[-1][1], knots[-1][1]


def chain_at(scene: Scene, t_s: float) -> list[tuple[Number, Number]]:
    """Return (point, velocity) of all handles, from head to tail, as complex numbers."""
    track, start = track_of(scene)
    far, speed = gone(scene, t_s)
    links = [mpf(link) for link in scene.dragon.link_lengths_m.tolist()]
    if scene.head.lead == 'head':
        return list(followed(track, track.place(start + far), links, BACK, speed))
    *_, (k, u) = places(track, track.place(start), links, BACK)
    tail = track.origins[k] + track.pieces[k].metres(u)
    return list(followed(track, track.place(tail - far), links[::-1], AHEAD, -speed))[::-1]


def places(track: Track, place: tuple[int, Number], links: list[Number], way: int) -> Iterator[tuple[int, Number]]:
    """Yield the positions of the handles, starting with the leader."""
    yield place
    for chord in links:
        place = track.next(*place, chord, way)
        yield place


def followed(track: Track, leader: tuple[int, Number], links: list[Number], way: int,
             speed: Number) -> Iterator[tuple[Number, Number]]:
    """Yield the point and the velocity of each handle, starting with the leader."""
    before = None
    for k, u in places(track, leader, links, way):
        point, tangent = track.pieces[k].at(u), track.pieces[k].tangent(u)
        if before is not None and point != before[0]:
            link = point - before[0]
            speed *= (mp.conj(link) * before[1]).real / (mp.conj(link) * tangent).real
        before = point, tangent
        yield point, speed * tangent


def handles_at(problem: Problem, t_s: float, digits: int) -> list[Handle]:
    """Return the requested handles at one time, computed with ``digits`` digits."""
    mp.dps = digits
    chain = chain_at(problem.scene, t_s)
    return [Handle(chain[n][0].real, chain[n][0].imag, chain[n][1]) for n in problem.handles]


def reference(problem: Problem) -> list[list[Handle]]:
    """Return the requested handles at each time, checked against a finer computation."""
    states = []
    for t_s in problem.times_s:
        note(f'{problem.name} at {t_s!r} s')
        coarse, fine = (handles_at(problem, t_s, DIGITS + GUARD + more) for more in (0, MORE))
        small = mpf(10) ** -AGREED
        for a, b in zip(coarse, fine, strict=True):
            assert mp.hypot(a.x - b.x, a.y - b.y) <= small * (1 + mp.hypot(b.x, b.y)), (a, b)
            assert abs(a.velocity - b.velocity) <= small * (1 + abs(b.velocity)), (a, b)
        states.append(fine)
    return states


def figures() -> dict[str, str]:
    """Return the answers to the design questions about the contest's turn."""
    mp.dps = DIGITS + GUARD
    scene = next(problem.scene for problem in hard_cases() if problem.name == 'turning')
    track = turn_of(scene.track)
    length = track.origins[3]
    links = [mpf(link) for link in scene.dragon.link_lengths_m.tolist()][:3]

    def ratio(metres: Number) -> Number:
        *_, (_, velocity) = followed(track, track.place(metres), links, BACK, mp.one)
        return abs(velocity)

    mp.dps = 60
    where = mp.findroot(lambda x: mp.diff(ratio, x, h=mpf(10) ** -18), (mpf('14.4799'), mpf('14.4800')), tol=1e-30,
                        solver='secant')
    top = ratio(where)
    return {'turn_length_m': mp.nstr(length, WRITTEN), 'max_speed_ratio': mp.nstr(top, WRITTEN),
            'max_speed_m_s': mp.nstr(2 / top, WRITTEN), 'max_speed_along_m': mp.nstr(where, 15),
            'max_speed_past_exit_m': mp.nstr(where - length, 14)}


def rows_of(problem: Problem, states: list[list[Handle]]) -> dict[str, Any]:
    """Return the reference of a problem as JSON values."""
    return {'handles': problem.handles, 'times_s': problem.times_s, 'states': [vectors_of(state) for state in states]}


def vectors_of(handles: list[Handle]) -> dict[str, list[str]]:
    """Return the state at one time: positions and velocities as decimal strings."""
    arrays = {'x': [h.x for h in handles], 'y': [h.y for h in handles], 'vx': [h.velocity.real for h in handles],
              'vy': [h.velocity.imag for h in handles]}
    return {name: [mp.nstr(value, WRITTEN) for value in row] for name, row in arrays.items()}


def text_of(rows: dict[str, Any], told: dict[str, str]) -> str:
    """Return the file content: JSON with sorted keys, one line per problem and time."""
    header = {'script': Path(__file__).name, 'mpmath': mpmath.__version__, 'digits': DIGITS, 'written_digits': WRITTEN}
    blocks = [f'"{name}": {{"handles": {json.dumps(rows[name]["handles"])},\n'
              f'"states": [\n{joined(json.dumps(state, sort_keys=True) for state in rows[name]["states"])}],\n'
              f'"times_s": {json.dumps(rows[name]["times_s"])}}}' for name in sorted(rows)]
    return (f'{{"figures": {json.dumps(told, sort_keys=True)},\n"header": {json.dumps(header, sort_keys=True)},\n'
            f'"problems": {{\n{joined(blocks)}}}}}\n')


def joined(blocks: Iterable[str]) -> str:
    """Return JSON values as lines of a list."""
    return ',\n'.join(blocks)


def note(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr, flush=True)


def main(names: list[str]) -> None:
    """Compute, check and write the reference of all cases, or of the named ones."""
    told = figures()
    note(str(told))
    known = json.loads(TARGET.read_text(encoding='ascii'))['problems'] if names else {}
    found = {problem.name: rows_of(problem, reference(problem)) for problem in hard_cases()
             if problem.name in names or not names}
    rows = {problem.name: row for problem in hard_cases() if (row := {**known, **found}.get(problem.name))}
    TARGET.write_text(text_of(rows, told), encoding='ascii')
    note(f'{TARGET}: {TARGET.stat().st_size} bytes')


if __name__ == '__main__':
    main(sys.argv[1:])
