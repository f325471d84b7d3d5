"""Reproduce common mistakes in the contest problem CUMCM 2024 A; each recipe contains one mistake.

``docs/examples/common_mistakes.py`` prints the results of the recipes as the tables of the contest page, and ``grade``
compares answers with them. Times are arrays (T,) in seconds, angles are polar angles of the spiral r = pitch / (2 pi)
theta in radians, and handles are in metres.
"""
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from math import asinh, atan, ceil, inf, log, pi, sin
from typing import NamedTuple

import numpy as np

import dragon_ros as dr
from dragon_ros.cli.inputs import Floats

PITCH_M, START, SPEED_M_S, HANDLES = 0.55, 32 * pi, 1.0, 224
HEAD_LINK_M, BODY_LINK_M, INSET_M = 2.86, 1.65, 0.275
FOLLOWING = 25          # number of handles of the benches that the head can touch
RADIUS_M = 4.5                                      # radius of the turning circle
_LATEST_S = 420.0       # last time (s) for which Euler steps are computed
_NARROW = 1e-13         # a root in a narrower bracket is found
_MOST_NEWTON, _SETTLED = 60, 1e-9     # each step of Newton's method squares the error
Head = Callable[[Floats], Floats]                   # seconds (T,) -> polar angles (T,)
Rule = Callable[[Floats, float], Floats]            # polar angles (T,) and a link in metres -> the next handle's angles
Gap = Callable[[Floats, float], Floats]             # handles (T, N+1, 2) and a width (both in m) -> gaps (m, (T,))
GapAt = Callable[[Floats], Floats]                  # seconds (T,) -> gaps (m, (T,))


class MistakenAnswer(NamedTuple):
    """The result of a mistake: its key in ``grade.words``, the parameters of its sentence, and the wrong answer."""

    key: str
    parameters: dict[str, float]
    value: float


# Question 1: the position of the head and the next handle.
def arc_length(theta: Floats) -> Floats:
    """Return the arc length of r = theta, measured from its centre."""
    length: Floats = 0.5 * (theta * np.sqrt(1 + theta * theta) + np.arcsinh(theta))
    return length


def without_radial(theta: Floats) -> Floats:
    """Return the arc length of r = theta without the radial part."""
    length: Floats = 0.5 * theta * theta
    return length


def solved(length: Callable[[Floats], Floats], late: float = 0.0, start: float = START, speed_m_s: float = SPEED_M_S,
           pitch_m: float = PITCH_M) -> Head:
    """Return the head's motion, found by inverting an arc length; ``late`` is an error in the start value."""
    def head(times_s: Floats) -> Floats:
        wanted = length(np.array(start)) + late - speed_m_s * times_s * 2 * pi / pitch_m
        return inverted(length, wanted)
    return head


def inverted(length: Callable[[Floats], Floats], wanted: Floats) -> Floats:
    """Return the angles (T,) at which an increasing arc length, which is about theta^2 / 2, has the desired values.

    Bisection needs no derivative, so it can invert the arc length of any recipe.
    """
    high: Floats = np.sqrt(2 * np.maximum(wanted, 0.0)) + 1.0
    low: Floats = np.maximum(high - 4.0 - np.log1p(high), 0.0)
    for _ in range(_MOST_NEWTON):
        middle = 0.5 * (low + high)
        below = length(middle) < wanted
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high


def bracket_slip() -> Head:
    """Return the head's motion if only the arc length at the start is wrong: it uses ln(theta + sqrt(theta^2) + 1)."""
    return solved(arc_length, 0.5 * (log(2 * START + 1) - asinh(START)))


def euler(step_s: float, radial: bool = True) -> Head:
    """Return the head's motion computed by explicit Euler steps, with or without the radial part of its speed."""
    def head(times_s: Floats) -> Floats:
        angles = _steps(step_s, radial)
        theta: Floats = np.interp(times_s / step_s, np.arange(angles.size), angles)
        return theta
    return head


@lru_cache(maxsize=32)
def _steps(step_s: float, radial: bool) -> Floats:
    """Return the angles of all Euler steps up to ``_LATEST_S``, or to the centre."""
    angles, theta, way = [START], START, step_s * SPEED_M_S * 2 * pi / PITCH_M
    for _ in range(ceil(_LATEST_S / step_s)):
        turned = way / ((1 + theta * theta) ** 0.5 if radial else theta)
        if turned >= theta:
            break
        theta -= turned
        angles.append(theta)
    return np.array(angles)


def chord(short_m: float = 0.0, pitch_m: float = PITCH_M) -> Rule:
    """Return the rule that places the next handle where its chord is shorter than the link by ``short_m``."""
    def following(theta: Floats, link_m: float) -> Floats:
        wanted = (link_m - short_m) * 2 * pi / pitch_m
        delta: Floats = wanted / np.maximum(theta, 1.0)
        for _ in range(_MOST_NEWTON):       # Newton's method; before the first contact, a link spans less than pi
            half = np.sin(0.5 * delta)
            excess = delta * delta + 4 * theta * (theta + delta) * half * half - wanted * wanted
            change = excess / (2 * delta + 4 * theta * half * (half + (theta + delta) * np.cos(0.5 * delta)))
            delta = delta - change
            if np.max(np.abs(change)) < _SETTLED:
                break
        return theta + delta
    return following


def along(theta: Floats, link_m: float) -> Floats:
    """Return the angle of the next handle, placed one link length along the spiral instead of one chord away."""
    return inverted(arc_length, arc_length(theta) + link_m * 2 * pi / PITCH_M)


def grid(step_rad: float, within_m: float) -> Rule:
    """Return the rule that increases the angle by steps until the chord is within a tolerance of the link.

    With a tolerance of 0, the steps end when the chord is at least as long as the link.
    """
    def following(theta: Floats, link_m: float) -> Floats:
        short = chord(within_m)(theta, link_m)
        steps: Floats = np.ceil((short - theta) / step_rad - 1e-9)
        return theta + steps * step_rad
    return following


def links_of(head_m: float = HEAD_LINK_M, body_m: float = BODY_LINK_M, last_m: float | None = None,
             handles: int = HANDLES) -> list[float]:
    """Return the link lengths (m) of a dragon; the last link is a body link unless ``last_m`` is given."""
    return [head_m, *[body_m] * (handles - 3), body_m if last_m is None else last_m][:handles - 1]


def points(theta: Floats, pitch_m: float = PITCH_M) -> Floats:
    """Return the points (m, shape (..., 2)) at polar angles (...)."""
    p: Floats = pitch_m / 2 / pi * theta[..., None] * np.stack((np.cos(theta), np.sin(theta)), axis=-1)
    return p


def placed_angles(first: Floats, rule: Rule, links_m: list[float]) -> Floats:
    """Return the polar angles (T, handles) of all handles, given the angles (T,) of the head."""
    theta = [first]
    for link_m in links_m:
        theta.append(rule(theta[-1], link_m))
    return np.stack(theta, axis=-1)


def placed(head: Head, rule: Rule, times_s: Floats, handles: int = HANDLES) -> Floats:
    """Return the handles (m, shape (T, handles, 2)) placed by a rule behind the head."""
    return points(placed_angles(head(times_s), rule, links_of(handles=handles)))


@cache
def winding() -> dr.Scene:
    """Return the scene of questions 1 and 2."""
    return dr.scene('winding')


@cache
def turning() -> dr.Scene:
    """Return the scene of questions 4 and 5."""
    return dr.scene('turning')


def true_handles_m(times_s: Floats) -> Floats:
    """Return the true positions (m, shape (T, 224, 2)) of all handles in question 1."""
    return dr.compile(winding()).handles_m(times_s)


def worst_m(p: Floats) -> float:
    """Return the largest position error (m) of the handles (224, 2) at 300 s."""
    return float(np.max(np.hypot(*(p - true_handles_m(np.array([300.0]))[0]).T)))


def head_mistakes() -> dict[tuple[str, tuple[tuple[str, float], ...]], Head]:
    """Return the wrong head motions listed in the contest page's table, by key and parameters."""
    return {('radial_arc', ()): solved(without_radial), ('bracket_slip', ()): bracket_slip(),
            ('euler', (('step', 1.0),)): euler(1.0), ('euler', (('step', 0.01),)): euler(0.01),
            ('euler_radial', (('step', 0.01),)): euler(0.01, radial=False)}


def errors_at_300_s() -> Iterator[MistakenAnswer]:
    """Yield the mistakes, each with the largest position error of the 224 handles at 300 s."""
    at, exact = np.array([300.0]), solved(arc_length)
    for (key, parameters), head in head_mistakes().items():
        yield MistakenAnswer(key, dict(parameters), worst_m(placed(head, chord(), at)[0]))
    yield MistakenAnswer('along', {}, worst_m(placed(exact, along, at)[0]))
    for short_m in (1e-2, 1e-3, 1e-4, 1e-6):
        yield MistakenAnswer('chord_short', {'short': short_m}, worst_m(placed(exact, chord(short_m), at)[0]))
    paper = dr.compile(dr.scene('winding', accuracy='paper')).state(300.0)
    yield MistakenAnswer('paper_grid', {}, worst_m(paper.handles_m))


# Question 1: speeds.
def differences(scene: dr.Scene, times_s: Floats, step_s: float, kind: str) -> Floats:
    """Return speeds (m/s, shape (T, N+1)) from 'forward', 'backward' or 'central' differences of positions."""
    before, after = {'forward': (0.0, 1.0), 'backward': (1.0, 0.0), 'central': (1.0, 1.0)}[kind]
    run = dr.compile(scene)
    moved = run.handles_m(times_s + after * step_s) - run.handles_m(times_s - before * step_s)
    speed: Floats = np.hypot(moved[..., 0], moved[..., 1]) / ((before + after) * step_s)
    return speed


def projected(theta: Floats, leader_m_s: float = SPEED_M_S, swapped: bool = False) -> Floats:
    """Return speeds (..., N+1) of rigid links at angles (..., N+1); ``swapped`` inverts the ratio of cosines."""
    p, slope = points(theta), np.sqrt(1 + theta * theta)
    tangent = np.stack((np.cos(theta) - theta * np.sin(theta), np.sin(theta) + theta * np.cos(theta)), axis=-1)
    along_m = p[..., 1:, :] - p[..., :-1, :]
    front = np.sum(along_m * tangent[..., :-1, :], axis=-1) / slope[..., :-1]
    rear = np.sum(along_m * tangent[..., 1:, :], axis=-1) / slope[..., 1:]
    ratio = rear / front if swapped else front / rear
    ones: Floats = np.ones((*theta.shape[:-1], 1))
    return leader_m_s * np.concatenate((ones, np.cumprod(ratio, axis=-1)), axis=-1)


# Question 2: the time at which benches touch.
def head_gaps(p: Floats, width_m: float = 0.3) -> Floats:
    """Return the smallest gaps (m, shape (T,)) between the head and the benches behind it, except its neighbour."""
    behind = range(2, p.shape[1] - 1)
    least: Floats = np.min(dr.gaps(p, [0] * len(behind), behind, width_m=width_m), axis=-1)
    return least


def front_gaps(p: Floats, width_m: float = 0.3) -> Floats:
    """Return the smallest gaps (m, shape (T,)) from the head's front corners to other benches; negative inside one."""
    along_m, centre = p[:, :-1] - p[:, 1:], 0.5 * (p[:, :-1] + p[:, 1:])
    length_m = np.hypot(along_m[..., 0], along_m[..., 1])
    axis, half_m = along_m / length_m[..., None], 0.5 * length_m + INSET_M
    end = centre[:, 0] + axis[:, 0] * half_m[:, :1]
    side = 0.5 * width_m * np.stack((-axis[:, 0, 1], axis[:, 0, 0]), axis=-1)
    front = np.stack((end + side, end - side), axis=1)[:, :, None]
    seen, axis = (front - centre[:, None])[:, :, 2:], axis[:, None, 2:]
    ahead = np.abs(np.sum(seen * axis, axis=-1)) - half_m[:, None, 2:]
    aside = np.abs(axis[..., 0] * seen[..., 1] - axis[..., 1] * seen[..., 0]) - 0.5 * width_m
    least: Floats = np.min(np.maximum(ahead, aside), axis=(1, 2))
    return least


def _root(f: Callable[[float], float], low: float, high: float, f_low: float, f_high: float) -> float:
    """Return where a function changes sign, by regula falsi in the Illinois form, which halves a value that stays."""
    kept = 0
    for _ in range(_MOST_NEWTON):
        if f_low == f_high or abs(high - low) < _NARROW:
            break
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        f_middle = f(middle)
        if f_middle == 0:
            return middle
        if (f_middle < 0) == (f_low < 0):
            low, f_low, f_high, kept = middle, f_middle, f_high * (0.5 if kept < 0 else 1.0), -1
        else:
            high, f_high, f_low, kept = middle, f_middle, f_low * (0.5 if kept > 0 else 1.0), 1
    return low if abs(f_low) < abs(f_high) else high


def first_touch_s(gap: GapAt, from_s: float = 405.0, to_s: float = 413.5) -> float:
    """Return the first time (s) at which a gap vanishes, found by steps of 0.05 s and regula falsi, or inf."""
    times: Floats = np.concatenate(([from_s - 0.05], np.arange(from_s, to_s, 0.05)))
    apart = gap(times)
    ends = np.flatnonzero((apart[1:] <= 0) & (apart[:-1] > 0))
    if not ends.size:
        return inf
    around = slice(int(ends[0]), int(ends[0]) + 2)
    return _root(lambda t_s: float(gap(np.array([t_s]))[0]), *times[around].tolist(), *apart[around].tolist())


def touch_s(head: Head, rule: Rule, links_m: list[float] | None = None) -> float:
    """Return the time (s) of the head's first contact according to a recipe, or inf if there is none."""
    links = links_of(handles=FOLLOWING) if links_m is None else links_m
    return first_touch_s(lambda times_s: head_gaps(points(placed_angles(head(times_s), rule, links))))


def gap_of(dragon: dict[str, float], gap: Gap = head_gaps) -> GapAt:
    """Return the gap as a function of time, for the correct handles of a dragon with the given dimensions."""
    scene = dr.scene('winding', dragon={'benches': FOLLOWING, **dragon})
    return lambda times_s: gap(dr.compile(scene).handles_m(times_s), dragon.get('width_m', 0.3))


def stepped_touch_s(gap: GapAt, step_s: float) -> float:
    """Return the first multiple of a time step, from 405 s on, at which a gap is not positive."""
    times: Floats = np.arange(ceil(405 / step_s), ceil(414 / step_s), dtype=np.float64) * step_s
    return float(times[gap(times) <= 0][0])


def contact_times_s() -> Iterator[MistakenAnswer]:
    """Yield the mistakes, each with the resulting time of the first contact."""
    exact, right = solved(arc_length), gap_of({})
    yield MistakenAnswer('none', {}, touch_s(exact, chord()))
    for step_s in (1.0, 0.1, 0.01):
        yield MistakenAnswer('looked', {'step': step_s}, stepped_touch_s(right, step_s))
    yield MistakenAnswer('bracket_slip_short', {}, touch_s(bracket_slip(), chord()))
    for step_s in (1.0, 0.01):
        yield MistakenAnswer('euler', {'step': step_s}, touch_s(euler(step_s), chord()))
    for short_m in (1e-3, 1e-4, 1e-6):
        yield MistakenAnswer('chord_short', {'short': short_m}, touch_s(exact, chord(short_m)))
    for near_m in (3e-3, 1e-3, 1e-4):
        yield MistakenAnswer('near_counts', {'near': near_m}, first_touch_s(_less(right, near_m)))


def _less(gap: GapAt, near_m: float) -> GapAt:
    """Return a gap function whose values are smaller by a given distance."""
    return lambda times_s: gap(times_s) - near_m


# Question 3: the smallest pitch.
def gaps_at(pitch_m: float, head_m: Floats, gap: Gap = head_gaps) -> Floats:
    """Return the gaps (m, shape (T,)) when the head is at given radii (m, shape (T,)) on a spiral with a pitch."""
    theta = placed_angles(head_m * 2 * pi / pitch_m, chord(pitch_m=pitch_m), links_of(handles=28))
    return gap(points(theta, pitch_m), 0.3)


def radii_m(pitch_m: float, step_s: float) -> Floats:
    """Return the head's radius at each time step in the last 6 s before it reaches the circle."""
    b = pitch_m / 2 / pi
    theta = np.linspace(RADIUS_M / b, RADIUS_M / b + 2, 20_000)
    gone = b * (arc_length(np.array(START)) - arc_length(theta))
    times = np.arange(ceil((gone[0] - 6) / step_s), gone[0] / step_s) * step_s
    return b * np.interp(times, gone[::-1], theta[::-1])


def sampled_pitch_m(step_s: float) -> float:
    """Return the smallest pitch, in steps of 10 um, above which no sample in time shows a contact."""
    pitches = (0.45035 - 1e-5 * n for n in range(100))
    return next(p for p in pitches if np.min(gaps_at(p, radii_m(p, step_s))) <= 0) + 1e-5


def least_pitch_m(gap: Callable[[float], float], low_m: float, high_m: float) -> float:
    """Return the pitch (m) at which a gap changes sign."""
    return _root(gap, low_m, high_m, gap(low_m), gap(high_m))


def pitches_m() -> Iterator[MistakenAnswer]:
    """Yield the mistakes, each with the resulting smallest pitch."""
    on_circle_m = least_pitch_m(lambda p: float(gaps_at(p, np.array([RADIUS_M]))[0]), 0.40, 0.44)
    yield MistakenAnswer('on_circle', {}, on_circle_m)
    way_m = np.linspace(4.621, 4.627, 20)       # the time of the smallest gap, within half a turn before the circle
    front_m = least_pitch_m(lambda p: float(np.min(gaps_at(p, way_m, front_gaps))), 0.4495, 0.4503)
    yield MistakenAnswer('front_corners', {}, front_m)
    for step_s in (1.0, 0.1):
        yield MistakenAnswer('pitch_looked', {'step': step_s}, sampled_pitch_m(step_s))


# Questions 4 and 5: the turn, and the speeds on it.
def turn_length_m(gamma: float) -> float:
    """Return the length (m) of two tangent arcs in the circle that meet the spirals at a given angle to the radius."""
    return 2 * RADIUS_M * gamma / sin(gamma)


def turn_lengths_m() -> Iterator[MistakenAnswer]:
    """Yield the mistakes, each with the resulting length of the turn."""
    theta = RADIUS_M * 2 * pi / 1.7
    slip = atan(atan(theta) + theta + pi)
    yield MistakenAnswer('half_turns', {}, pi * RADIUS_M)
    yield MistakenAnswer('angle_for_slope', {}, turn_length_m(slip))
    yield MistakenAnswer('angle_and_radii', {}, 2 * RADIUS_M * slip)


def euler_on_turn_m(times_s: Floats, step_s: float) -> Floats:
    """Return the head's distance (m) from the entry, found by Euler steps from the circle outwards on both spirals."""
    track = turning().track
    assert isinstance(track, dr.STurn)
    b_m = track.pitch_m / 2 / pi
    entry = track.radius_m / b_m
    after_s = np.where(times_s < 0, -times_s, np.maximum(times_s - track.length_m, 0.0))
    angles = [entry]
    for _ in range(ceil(float(np.max(after_s)) / step_s)):
        angles.append(angles[-1] + step_s / b_m / (1 + angles[-1] ** 2) ** 0.5)
    theta = np.interp(after_s / step_s, np.arange(len(angles)), angles)
    wrong_m = b_m * (arc_length(theta) - arc_length(np.array(entry))) - after_s
    metres: Floats = times_s + np.where(times_s < 0, -wrong_m, wrong_m)
    return metres


def along_turn(head_m: Floats, links_m: list[float], turn: dr.STurn) -> Floats:
    """Return handles (T, handles, 2) spaced by link lengths along the curve.

    ``head_m`` (T,) is the head's distance from the entry.
    """
    metres = head_m[:, None] - np.concatenate(([0.0], np.cumsum(links_m)))
    return turn_points(metres, turn)


class TurnAngle:
    """The angle along the turn, measured from the entry: the polar angle on spirals, and the arc's angle on arcs."""

    def __init__(self, turn: dr.STurn) -> None:
        """Compute the angles at which the pieces of a turn meet."""
        self._b_m, self._entry = turn.pitch_m / 2 / pi, turn.radius_m / (turn.pitch_m / 2 / pi)
        self._joints_m = np.array((0.0, turn.radii_m[0] * turn.angle_rad, turn.length_m))
        self._radii_m = turn.radii_m
        self.joints = np.concatenate(([0.0], np.cumsum(np.diff(self._joints_m) / self._radii_m)))

    def of(self, metres: Floats) -> Floats:
        """Return the angles (rad) at distances (m, shape (T,)) from the entry."""
        before, after = np.maximum(-metres, 0.0), np.maximum(metres - self._joints_m[-1], 0.0)
        start = arc_length(np.array(self._entry))
        angle: Floats = (np.interp(metres, self._joints_m, self.joints)
                         + self._spiral(start + after / self._b_m) - self._spiral(start + before / self._b_m))
        return angle

    def _spiral(self, length: Floats) -> Floats:
        theta = np.sqrt(2 * length)
        for _ in range(6):      # Newton's method, which converges to the last digit from this start
            theta = theta - (arc_length(theta) - length) / np.sqrt(1 + theta * theta)
        return theta

    def metres(self, angle: Floats) -> Floats:
        """Return the distances (m) from the entry at angles (rad, shape (T,))."""
        before, after = np.maximum(-angle, 0.0), np.maximum(angle - self.joints[-1], 0.0)
        metres: Floats = (np.interp(angle, self.joints, self._joints_m)
                          + self._b_m * (arc_length(self._entry + after) - arc_length(self._entry + before)))
        return metres


def turn_points(metres: Floats, turn: dr.STurn) -> Floats:
    """Return the points (m, shape (..., 2)) on a turn at distances (m, shape (...)) from its entry."""
    return dr.design.turn_poses(turn, metres)[0]


def grid_on_turn(head_m: Floats, links_m: list[float], turn: dr.STurn, step: float, within_m: float,
                 of_angle: bool) -> Floats:
    """Return handles (T, handles, 2) on the turn, each found by steps until its chord is within a tolerance.

    The steps are metres along the curve, or radians of a piece's angle; angular steps restart at the ends of a piece.
    """
    angle = TurnAngle(turn)
    metres = [head_m]
    for link_m in links_m:
        short_m = _chord_behind(metres[-1], link_m - within_m, turn)
        if of_angle:
            at, short = angle.of(metres[-1]), angle.of(short_m)
            joints = angle.joints
            for joint in joints[::-1]:
                at = np.where((short < joint) & (joint < at), joint, at)
            stepped = at - np.ceil((at - short) / step - 1e-9) * step
            for joint in joints:        # a step beyond the end of a piece is cut off at the end, which is far enough
                stepped = np.where((stepped < joint) & (joint <= short), joint, stepped)
            metres.append(angle.metres(stepped))
        else:
            metres.append(metres[-1] - np.ceil((metres[-1] - short_m) / step - 1e-9) * step)
    return turn_points(np.stack(metres, axis=-1), turn)


def _chord_behind(metres: Floats, chord_m: float, turn: dr.STurn) -> Floats:
    """Return the distances (m, shape (T,)) along the turn of the points one chord behind, found by Newton's method."""
    here, behind = turn_points(metres, turn), metres - chord_m
    for _ in range(_MOST_NEWTON):
        point, heading = dr.design.turn_poses(turn, behind)
        link = here - point
        length = np.hypot(*link.T)
        change = (length - chord_m) * length / np.sum(link * heading, axis=-1)
        behind = behind + change
        if np.max(np.abs(change)) < 1e-13:
            break
    return behind


def sampled_speed_m_s(step_s: float) -> float:
    """Return the largest head speed (m/s) at which no sampled speed on the turn exceeds 2 m/s."""
    times = np.arange(0, 200 + step_s / 2, step_s).tolist()
    return 2 / float(np.max(dr.compile(turning()).states(times).speed_m_s))


def head_speeds_m_s() -> Iterator[MistakenAnswer]:
    """Yield the mistakes, each with the resulting largest head speed."""
    for step_s in (1.0, 0.5, 0.1):
        yield MistakenAnswer('speed_looked', {'step': step_s}, sampled_speed_m_s(step_s))
