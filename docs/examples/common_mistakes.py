"""What common mistakes give on the contest problem CUMCM 2024 A: remakes the tables of docs/cumcm-2024-a.md.

Each row is a recipe with one mistake in it. ``common_mistakes.py 1 2`` prints the tables of questions 1 and 2 alone.
"""
import sys
from collections.abc import Callable, Iterator
from functools import cache
from math import asinh, atan, ceil, cos, inf, log, pi, sin, sqrt

import numpy as np

import dragon_ros as dr
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import gaps

PITCH_M, START, SPEED_M_S, HANDLES = 0.55, 32 * pi, 1.0, 224
FOLLOWING = 25          # handles that the head can touch the benches of
RADIUS_M = 4.5                                      # of the turning circle
Head = Callable[[float], float]                     # seconds -> polar angle
Rule = Callable[[float, float], float]              # polar angle and link in metres -> polar angle of the next handle
Gap = Callable[..., float]                          # handles (N+1, 2) and a width -> metres
Rows = Iterator[tuple[str, ...]]


# Question 1: where the head is, and the next handle.
def arc_length(theta: float) -> float:
    """Return the arc length of r = theta from its centre."""
    return 0.5 * (theta * sqrt(1 + theta * theta) + asinh(theta))


def solved(length: Callable[[float], float]) -> Head:
    """Return the head by an arc length that is inverted to the last digit."""
    def head(t_s: float) -> float:
        wanted, low, high = length(START) - SPEED_M_S * t_s * 2 * pi / PITCH_M, 0.0, START
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if length(middle) < wanted else (low, middle)
        return high
    return head


def euler(step_s: float, radial: bool = True) -> Head:
    """Return the head by explicit Euler steps, with or without the radial part of its speed."""
    @cache
    def until(whole: int) -> list[float]:
        angles = [START]
        for _ in range(whole):
            theta = angles[-1]
            turned = 2 * pi / PITCH_M / (sqrt(1 + theta * theta) if radial else theta)
            angles.append(theta - step_s * SPEED_M_S * turned)
        return angles

    def head(t_s: float) -> float:
        angles, steps = until(ceil(420 / step_s)), t_s / step_s
        return float(np.interp(steps, range(len(angles)), angles))
    return head


def chord(short_m: float = 0.0) -> Rule:
    """Return the next handle at a chord that is too short: what a tolerance of the chord lets through first."""
    def following(theta: float, link_m: float) -> float:
        wanted, delta = (link_m - short_m) * 2 * pi / PITCH_M, 0.0
        change = wanted / theta
        while abs(change) > 1e-15:          # Newton; links span less than pi on the way to the first contact
            delta += change
            half = sin(0.5 * delta)
            excess = delta * delta + 4 * theta * (theta + delta) * half * half - wanted * wanted
            change = -excess / (2 * delta + 4 * theta * half * (half + (theta + delta) * cos(0.5 * delta)))
        return theta + delta
    return following


def along(theta: float, link_m: float) -> float:
    """Return the next handle at the link's length along the spiral, not at its chord."""
    wanted, low, high = arc_length(theta) + link_m * 2 * pi / PITCH_M, theta, theta + 4
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if arc_length(middle) < wanted else (low, middle)
    return high


def bracket_slip() -> Head:
    """Return the head where the start's arc length has ln(theta + sqrt(theta^2) + 1), and all else is right."""
    late = 0.5 * (log(2 * START + 1) - asinh(START))
    return solved(lambda theta: arc_length(theta) + (late if theta == START else 0.0))


def placed(head: Head, rule: Rule, t_s: float = 300.0, handles: int = HANDLES) -> np.ndarray:
    """Return handles (handles, 2)."""
    theta = [head(t_s)]
    for link in range(handles - 1):
        theta.append(rule(theta[-1], 1.65 if link else 2.86))
    angle = np.array(theta)
    return PITCH_M / 2 / pi * angle[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def worst_m(p: np.ndarray) -> float:
    """Return how far the worst of the handles is off at 300 s."""
    true = dr.compile(dr.scene('winding')).state(300.0).handles_m
    return float(np.max(np.hypot(*(p - true).T)))


# Question 2: when benches touch.
def rectangles(p: np.ndarray, width_m: float) -> Benches:
    """Return the benches on handles (N+1, 2)."""
    along_m = p[:-1] - p[1:]
    length_m = np.hypot(*along_m.T)
    return Benches(0.5 * (p[:-1] + p[1:]), along_m / length_m[:, None], 0.5 * length_m + 0.275,
                   np.full(length_m.size, 0.5 * width_m))


def head_gap(p: np.ndarray, width_m: float = 0.3) -> float:
    """Return the smallest gap between the head and the benches behind it that are not its neighbour."""
    benches = rectangles(p, width_m)
    others = np.arange(2, len(benches.centre))
    return float(np.min(gaps(benches, np.zeros_like(others), others)))


def front_gap(p: np.ndarray, width_m: float = 0.3) -> float:
    """Return how far the head's front corners are outside of these benches; negative is inside."""
    benches = rectangles(p, width_m)
    seen, axis = benches.corners[0, (0, 3)][:, None] - benches.centre[2:], benches.axis[2:]
    ahead = np.abs(np.sum(seen * axis, axis=-1)) - benches.half_length[2:]
    aside = np.abs(axis[:, 0] * seen[..., 1] - axis[:, 1] * seen[..., 0]) - benches.half_width[2:]
    return float(np.min(np.maximum(ahead, aside)))


def first_touch_s(gap: Callable[[float], float], from_s: float = 405.0, to_s: float = 413.5) -> float:
    """Return the first time at which a gap is not positive, looked for in steps of 0.05 s and then halved."""
    high = next((t_s for t_s in np.arange(from_s, to_s, 0.05).tolist() if gap(t_s) <= 0), inf)
    low = high - 0.05
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (low, middle) if gap(middle) <= 0 else (middle, high)
    return high


def touch_s(head: Head, rule: Rule) -> float:
    """Return the first contact of the head as a recipe has it."""
    return first_touch_s(lambda t_s: head_gap(placed(head, rule, t_s, FOLLOWING)))


def gap_of(dragon: dict[str, float], gap: Gap = head_gap) -> Callable[[float], float]:
    """Return the gap by time where handles are right, of a dragon that differs from the classic one."""
    run = dr.compile(dr.scene('winding', dragon={'benches': FOLLOWING, **dragon}))
    return lambda t_s: gap(run.state(t_s).handles_m, dragon.get('width_m', 0.3))


def truth(dragon: dict[str, float]) -> str:
    """Return the first contact as ``contact`` has it."""
    found = dr.compile(dr.scene('winding', dragon=dragon)).contact()
    return f'{found.t_s:.6f} s, benches {found.benches[0]} and {found.benches[1]}'


# Question 3: the smallest pitch.
def gap_at(pitch_m: float, radius_m: float, gap: Gap = head_gap) -> float:
    """Return a gap with the head at a radius, on a spiral of a pitch."""
    scene = dr.scene('winding', dragon={'benches': 27}, track={'pitch_m': pitch_m, 'start_turns': radius_m / pitch_m},
                     solver='march')
    return gap(dr.compile(scene).state(0.0).handles_m)


def radii_m(pitch_m: float, step_s: float) -> np.ndarray:
    """Return where the head is at each step of time in the last 6 s before the circle."""
    b = pitch_m / 2 / pi
    theta = np.linspace(RADIUS_M / b, RADIUS_M / b + 2, 20_000)
    gone = b * (arc_length(START) - 0.5 * (theta * np.sqrt(1 + theta * theta) + np.arcsinh(theta)))
    times = np.arange(ceil((gone[0] - 6) / step_s), gone[0] / step_s) * step_s
    return b * np.interp(times, gone[::-1], theta[::-1])


def sampled_pitch_m(step_s: float) -> float:
    """Return the smallest pitch, in steps of 10 um, above which no sample in time shows a contact."""
    pitches = (0.45035 - 1e-5 * n for n in range(100))
    return next(p for p in pitches if min(gap_at(p, r) for r in radii_m(p, step_s)) <= 0) + 1e-5


def least_pitch_m(gap: Callable[[float], float], low_m: float, high_m: float) -> float:
    """Return the pitch at which a gap changes its sign."""
    while high_m - low_m > 2e-7:
        middle = 0.5 * (low_m + high_m)
        low_m, high_m = (middle, high_m) if gap(middle) <= 0 else (low_m, middle)
    return high_m


# Questions 4 and 5: the turn, and the speeds on it.
def turn_length_m(gamma: float) -> float:
    """Return the length of two tangent arcs in the circle, which meet the spirals at an angle with the radius."""
    return 2 * RADIUS_M * gamma / sin(gamma)


def sampled_speed_m_s(step_s: float) -> float:
    """Return the head's speed at which no sample of the turn exceeds 2 m/s."""
    times = np.arange(0, 200 + step_s / 2, step_s)
    return 2 / float(np.max(dr.compile(dr.scene('turning')).states(times).speed_m_s))


# The tables of the page.
def question_1() -> Rows:
    """Yield mistakes with the distance by which the worst of 224 handles is off at 300 s."""
    yield 'mistake', 'worst handle is off at 300 s by'
    exact, rule = solved(arc_length), chord()
    heads = {
        'S = rho theta / 2 for the arc length, without its radial part': solved(lambda theta: 0.5 * theta * theta),
        'ln(theta + sqrt(theta^2) + 1) for asinh(theta) at the start: a bracket in the wrong place': bracket_slip(),
        'Euler steps of 1 s for the head': euler(1.0),
        'Euler steps of 0.01 s for the head': euler(0.01),
        'Euler steps of 0.01 s without the radial part': euler(0.01, radial=False)}
    for what, head in heads.items():
        yield what, f'{worst_m(placed(head, rule)):.3g} m'
    yield 'links measured along the spiral, not as chords', f'{worst_m(placed(exact, along)):.3g} m'
    for short_m in (1e-2, 1e-3, 1e-4, 1e-6):
        yield f'the first angle whose chord is within {short_m:g} m of the link', (
            f'{worst_m(placed(exact, chord(short_m))):.3g} m')
    paper = dr.compile(dr.scene('winding', accuracy='paper')).state(300.0)
    yield "the paper's grid: steps of 0.01 rad until the chord is within 0.1 m", f'{worst_m(paper.handles_m):.3g} m'


def question_2() -> Rows:
    """Yield mistakes with the time of the first contact."""
    yield 'mistake', 'first contact'
    exact, rule, right = solved(arc_length), chord(), gap_of({})
    yield 'none', f'{touch_s(exact, rule):.6f} s'
    for step_s in (1.0, 0.1, 0.01):
        k = next(k for k in range(ceil(405 / step_s), ceil(414 / step_s)) if right(k * step_s) <= 0)
        yield f'positions are looked at every {step_s:g} s', f'{k * step_s:.6f} s'
    yield 'ln(theta + sqrt(theta^2) + 1) for asinh(theta) at the start', f'{touch_s(bracket_slip(), rule):.6f} s'
    for step_s in (1.0, 0.01):
        yield f'Euler steps of {step_s:g} s for the head', f'{touch_s(euler(step_s), rule):.6f} s'
    for short_m in (1e-3, 1e-4, 1e-6):
        yield f'the first angle whose chord is within {short_m:g} m of the link', (
            f'{touch_s(exact, chord(short_m)):.6f} s')
    for near_m in (3e-3, 1e-3, 1e-4):
        yield f'a gap below {1e3 * near_m:g} mm counts as contact', (
            f'{first_touch_s(lambda t_s, near_m=near_m: right(t_s) - near_m):.6f} s')


def question_2_elsewhere() -> Rows:
    """Yield checks that are right on the classic dragon by luck alone, and a dragon on which they are wrong."""
    yield 'check', 'dragon', 'gives', 'right'
    wide, short = {'width_m': 0.301}, {'head_length_m': 1.2}
    yield ("only the head's front corners", 'benches 0.301 m wide', f'{first_touch_s(gap_of(wide, front_gap)):.6f} s',
           truth(wide))
    yield 'only the head', 'a head of 1.2 m', f'{first_touch_s(gap_of(short), 420.0, 432.0):.6f} s', truth(short)


def question_3() -> Rows:
    """Yield mistakes with the smallest pitch."""
    yield 'mistake', 'smallest pitch'
    yield 'only the state on the circle is looked at', (
        f'{least_pitch_m(lambda p: gap_at(p, RADIUS_M), 0.40, 0.44):.6f} m')
    way_m = np.linspace(4.621, 4.627, 20)       # where they come nearest, within half a turn before the circle
    yield "only the head's front corners are looked at", (
        f'{least_pitch_m(lambda p: min(gap_at(p, r, front_gap) for r in way_m), 0.4495, 0.4503):.5f} m')
    for step_s in (1.0, 0.1):
        yield f'positions are looked at every {step_s:g} s, pitches every 0.00001 m', f'{sampled_pitch_m(step_s):.5f} m'


def question_4() -> Rows:
    """Yield mistakes with the length of the turn."""
    yield 'mistake', 'length of the turn'
    theta = RADIUS_M * 2 * pi / 1.7
    slip = atan(atan(theta) + theta + pi)
    yield 'arcs of half a turn, as if the spirals were tangent to the circle', f'{pi * RADIUS_M:.6f} m'
    yield "the tangent's angle is taken for its slope", f'{turn_length_m(slip):.6f} m'
    yield 'the same, and the radii are taken to add up to 4.5 m', f'{2 * RADIUS_M * slip:.6f} m'


def question_5() -> Rows:
    """Yield mistakes with the largest speed of the head."""
    yield 'mistake', "head's largest speed"
    for step_s in (1.0, 0.5, 0.1):
        yield f'speeds are looked at every {step_s:g} s', f'{sampled_speed_m_s(step_s):.6f} m/s'


QUESTIONS = {'1': question_1, '2': question_2, '2, elsewhere': question_2_elsewhere, '3': question_3,
             '4': question_4, '5': question_5}


def table(rows: Rows) -> str:
    """Return rows as a Markdown table; the first one is its head."""
    lines = [f'| {" | ".join(row)} |' for row in rows]
    return '\n'.join([lines[0], '|---' * lines[0].count(' | ') + '|---|', *lines[1:]])


if __name__ == '__main__':
    for number in sys.argv[1:] or QUESTIONS:
        print(f'Question {number}\n\n{table(QUESTIONS[number]())}\n')
