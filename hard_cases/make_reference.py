"""Make ``reference.json``: 50-digit positions and speeds for every case of ``hard_cases.problems``.

    ./dragon python -m hard_cases.make_reference

The script needs mpmath (gmpy2 makes it faster, with the same result) and runs for up to a few minutes. It shares no
numerical code with the package, and reads the scene's floats as exact binary numbers. Lengths are in units of b = pitch
/ 2 pi, angles in rad. A chord between theta and theta + delta obeys the law of cosines, and velocities are projected
from the link and the tangents as vectors; guard digits compensate for cancellation. Everything is computed twice, the
second time with more digits, and compared.
"""
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import mpmath
from mpmath import iv, mp

from dragon_ros.core.scene import Scene
from hard_cases.problems import Problem, problems

DIGITS = 50                     # digits of every result, relative to the distance from the centre
GUARD = 40                      # additional digits for the computation, since the law of cosines loses up to 20
AGREED = 40                     # digits to which the two computations must agree
MORE = 20                       # further digits for the second computation
WRITTEN = 25                    # significant digits in the file
TARGET = Path(__file__).with_name('reference.json')
Number = Any                    # mpmath creates its types at run time
Function = Callable[[Number], tuple[Number, Number]]


class Link(NamedTuple):
    """One solved link: the angle that it spans, and the ratio of its rear handle's speed to its front handle's."""

    delta: Number
    ratio: Number


class Handle(NamedTuple):
    """One handle: coordinates in metres and signed speed along the track in m/s, positive inwards."""

    x: Number
    y: Number
    speed: Number


def main() -> None:
    """Compute, check and write the reference."""
    found = {problem.name: reference(problem) for problem in problems()}
    check_known_values(found)
    TARGET.write_text(text_of(found), encoding='ascii')
    note(f'{TARGET}: {TARGET.stat().st_size} bytes')


def reference(problem: Problem) -> list[list[Handle]]:
    """Return the requested handles of a problem at each of its times, checked against a finer computation."""
    states = []
    for t_s in problem.times_s:
        note(f'{problem.name} at {t_s!r} s')
        coarse, fine = (handles_at(problem, t_s, DIGITS + GUARD + more) for more in (0, MORE))
        check_agreement(coarse, fine)
        states.append(coarse)
    return states


def handles_at(problem: Problem, t_s: float, digits: int) -> list[Handle]:
    """Return the requested handles at one time, computed with ``digits`` digits."""
    mp.dps = digits
    wanted = set(problem.handles)
    scene = problem.scene
    b = mp.mpf(scene.track.pitch_m) / (2 * mp.pi)
    chain = march(head_angle(scene, b, t_s), [mp.mpf(link) / b for link in scene.dragon.link_lengths_m.tolist()])
    head_speed = mp.mpf(scene.head.speed_m_s)
    found = {number: place(b, theta, head_speed * ratio) for number, (theta, ratio) in enumerate(chain)
             if number in wanted}
    assert found.keys() == wanted, f'{problem.name} has no handles {sorted(wanted - found.keys())}'
    return [found[number] for number in problem.handles]


def place(b: Number, theta: Number, speed: Number) -> Handle:
    """Return the handle at a polar angle; coordinates that are only rounding errors become 0."""
    cos, sin = mp.cos_sin(theta)
    x, y = (value if abs(value) > mp.mpf(10) ** -DIGITS else mp.zero for value in (cos, sin))
    return Handle(b * theta * x, b * theta * y, speed)


def head_angle(scene: Scene, b: Number, t_s: float) -> Number:
    """Solve S(theta) = S(theta0) - v t by Newton's method, which converges monotonically from outside (convexity)."""
    start = 2 * mp.pi * mp.mpf(scene.track.start_turns)
    arc = arc_length(start) - mp.mpf(scene.head.speed_m_s) * mp.mpf(t_s) / b
    assert arc >= 0, f'{t_s!r} s is after the head reaches the centre'
    outside = mp.sqrt(2 * arc)
    return root(lambda theta: (arc_length(theta) - arc, mp.sqrt(1 + theta * theta)), mp.zero, outside, outside)


def arc_length(theta: Number) -> Number:
    """Return the arc length from the centre, in units of b."""
    return (theta * mp.sqrt(1 + theta * theta) + mp.asinh(theta)) / 2


def march(theta: Number, chords: list[Number]) -> Iterator[tuple[Number, Number]]:
    """Yield (polar angle, speed divided by the head's speed) for every handle."""
    speed, before, last = mp.one, [], None
    yield theta, speed
    for chord in chords:
        before = before if chord == last else []
        link = next_handle(theta, chord, extrapolated(before))
        theta, speed, last = theta + link.delta, speed * link.ratio, chord
        before = [link.delta, *before[:3]]
        yield theta, speed


def extrapolated(before: list[Number]) -> Number:
    """Return a first guess from the angles of the preceding equal links, newest first; 0 if there are none."""
    if len(before) < 4:
        return before[0] if before else mp.zero
    return 4 * (before[0] + before[2]) - 6 * before[1] - before[3]


def next_handle(theta: Number, chord: Number, guess: Number) -> Link:
    """Return the link to the smallest root of the chord equation; a link of zero length leaves the speed unchanged."""
    if chord == 0:
        return Link(mp.zero, mp.one)
    excess = excess_of(theta, chord)
    high = +mp.pi if excess(+mp.pi)[0] >= 0 else first_rise(theta, excess)
    guess = guess or 2 * mp.asin(min(1, chord / (2 * theta + 1)))
    delta = root(excess, mp.zero if high == mp.pi else +mp.pi, high, guess)
    if delta > mp.pi:
        prove_smallest(theta, delta)
    return Link(delta, projected(theta, delta, chord))


def excess_of(theta: Number, chord: Number) -> Function:
    """Return the function from delta to half of (squared chord - wanted squared chord), and its slope.

    The slope, delta + 2 theta sin^2(delta/2) + theta (theta + delta) sin(delta), has only positive terms up to delta =
    pi, so a root there is unique and the smallest one.
    """
    fixed = (theta * theta - chord * chord) / 2

    def excess(delta: Number) -> tuple[Number, Number]:
        cos, sin = mp.cos_sin(delta)
        outer = theta + delta
        across = theta * outer
        return fixed + outer * outer / 2 - across * cos, outer - theta * cos + across * sin

    return excess


def first_rise(theta: Number, excess: Function) -> Number:
    """Return an angle beyond pi, on the chord's first rise, at which the chord is too long."""
    def falling(delta: Number) -> tuple[Number, Number]:
        cos, sin = mp.cos_sin(delta)
        return -excess(delta)[1], -(1 + 2 * theta * sin + theta * (theta + delta) * cos)

    low, high = +mp.pi, mp.pi + mp.mpf(1) / 16
    while excess(high)[0] < 0 < excess(high)[1]:
        low, high = high, high + mp.mpf(1) / 16
    if excess(high)[1] < 0:
        high = root(falling, low, high, high)
    assert excess(high)[0] >= 0, f'a link cannot be placed on the first rise: it locks at theta = {mp.nstr(theta, 20)}'
    return high


def prove_smallest(theta: Number, delta: Number) -> None:
    """Prove with interval arithmetic that the chord grows everywhere from pi to delta."""
    iv.dps = mp.dps
    inner, pieces = iv.mpf(theta), [(+mp.pi, delta)]
    for _ in range(100_000):
        low, high = pieces.pop()
        d = iv.mpf([low, high])
        if not (d + inner * (1 - iv.cos(d)) + inner * (inner + d) * iv.sin(d)).a > 0:
            pieces += [(low, (low + high) / 2), ((low + high) / 2, high)]
        if not pieces:
            return
    raise AssertionError(f'the chord does not grow up to delta = {mp.nstr(delta, 20)}')


def projected(theta: Number, delta: Number, chord: Number) -> Number:
    """Return v[i+1] / v[i] = cos alpha / cos beta, computed from vectors with the front handle on the x axis.

    The link vector also checks the root: it must be as long as the chord.
    """
    cos, sin = mp.cos_sin(delta)
    outer = theta + delta
    along, across = outer * cos - theta, outer * sin
    assert abs((along * along + across * across) / (chord * chord) - 1) < mp.mpf(10) ** -DIGITS
    front = (along + theta * across) / mp.sqrt(1 + theta * theta)
    back = (along * (cos - outer * sin) + across * (sin + outer * cos)) / mp.sqrt(1 + outer * outer)
    return front / back


def root(function: Function, low: Number, high: Number, start: Number) -> Number:
    """Return the root of an increasing function in [low, high]: Newton's method, or bisection if a step is too long.

    The remaining error is the square of the last step times half the curvature over the slope; 10 digits are allowed
    for it.
    """
    x, small = min(max(start, low), high), mp.mpf(10) ** -(mp.dps // 2 + 5)
    for _ in range(500):
        value, slope = function(x)
        low, high = (low, x) if value > 0 else (x, high)
        change = value / slope if slope > 0 else mp.inf
        if abs(change) <= small * abs(x):
            return x - change
        x = x - change if low < x - change < high else (low + high) / 2
    raise AssertionError(f'no root found in [{low}, {high}]')


def check_agreement(coarse: list[Handle], fine: list[Handle]) -> None:
    """Assert that two computations agree to AGREED digits, relative to the radius and to the speed."""
    assert len(coarse) == len(fine)
    for a, b in zip(coarse, fine, strict=True):
        small = mp.mpf(10) ** -AGREED
        assert mp.hypot(a.x - b.x, a.y - b.y) <= small * mp.hypot(b.x, b.y), (a, b)
        assert abs(a.speed - b.speed) <= small * abs(b.speed), (a, b)


def check_known_values(found: dict[str, list[list[Handle]]]) -> None:
    """Assert that known values are reproduced to half a unit in their last digit."""
    (start, *_), late = found['classic'], found['classic'][5]
    known = [(start[1].x, '8.363823851'), (start[1].y, '2.826543891'), (start[1].speed, '0.999971038'),
             (late[0].x, '4.420274'), (late[0].y, '2.320429'), (late[223].x, '1.785033'), (late[223].y, '9.301164')]
    for value, text in known:
        unit = mp.mpf(10) ** -len(text.partition('.')[2])
        assert abs(value - mp.mpf(text)) <= unit / 2, (value, text)


def text_of(found: dict[str, list[list[Handle]]]) -> str:
    """Return the file content: JSON with sorted keys, one line per problem and time."""
    header = {'script': Path(__file__).name, 'mpmath': mpmath.__version__, 'digits': DIGITS, 'written_digits': WRITTEN}
    blocks = [f'"{problem.name}": {{"handles": {json.dumps(problem.handles)},\n'
              f'"states": [\n{joined(state_of(state) for state in found[problem.name])}],\n'
              f'"times_s": {json.dumps(problem.times_s)}}}' for problem in sorted(problems(), key=lambda p: p.name)]
    return f'{{"header": {json.dumps(header, sort_keys=True)},\n"problems": {{\n{joined(blocks)}}}}}\n'


def state_of(handles: list[Handle]) -> str:
    """Return the state at one time as JSON: decimal strings in three arrays."""
    arrays = {name: [mp.nstr(getattr(handle, name), WRITTEN) for handle in handles] for name in Handle._fields}
    return json.dumps(arrays, sort_keys=True)


def joined(blocks: Iterator[str] | list[str]) -> str:
    """Return JSON values as lines of a list."""
    return ',\n'.join(blocks)


def note(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr, flush=True)


if __name__ == '__main__':
    main()
