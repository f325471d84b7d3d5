"""Diagnose why a result is wrong: check units, order and axes, and reproduce mistakes with fitted parameters.

Three stages are examined one by one: the head's position, the rule by which each handle follows the previous one, and
the speeds. The mistakes found in all stages are combined and reproduced, and are reported only if they explain the
result. The measure of an explanation is the share of the squared error that vanishes when the result is compared with
the reproduced mistakes instead of the truth.
"""
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from math import ceil, floor, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import dragon_ros as dr
from dragon_contest import mistakes
from dragon_contest.grade.layout import HANDLES
from dragon_contest.grade.truth import (
    TrueStates,
    contact_s,
    handles_at,
    state_at,
    truth_at,
    turned_scene,
    wound_scene,
)
from dragon_contest.mistakes import (
    BODY_LINK_M,
    HEAD_LINK_M,
    PITCH_M,
    START,
    Rule,
    arc_length,
    chord,
    links_of,
    placed_angles,
    points,
    solved,
)
from dragon_ros.cli.inputs import Floats, Ints

Booleans = NDArray[np.bool_]
EXPLAINED = 0.99        # smallest share of the squared error that a reported mistake must explain
CAUSES = ('enters_at_a', 'loose_root')      # causes that are recognised without reproducing the values
RIGHT = 2e-6            # largest error (m or m/s) of correct values; allows six decimals, rounded or truncated
_B_M = PITCH_M / 2 / pi
_ON_TRACK_M = 0.02      # largest rms distance (m) from the spiral at which handles count as on it
_MOST_OFF_M = 1.0       # largest difference (m) between chord and link for handles placed by steps
_SETTLED_M = 1e-10      # a shorter step (m) towards the nearest point of the track is the last one
_UNITS = {100.0: 'centimetres', 1000.0: 'millimetres', 0.001: 'kilometres'}
_FIRST_S = {'result1': 0.0, 'result4': -100.0}      # time (s) at which a result starts
_BEYOND_M = 0.05        # a handle outside the head's start by this much (m) has not entered
_NEAR_START_M = 0.2     # distance (m) from the start's circle within which mistakes may delay an entry
_LEAST_WAITING = 8      # smallest number of cells on each side of the start
_LEAST_TIMES = 4        # smallest number of times whose positions are subtracted
_MOST_LOOSE_M, _MOST_DRIFT_M = 6e-4, 0.2      # largest error (m) of a chord and of a handle due to a loose root
_ROUNDED_M = 9e-7       # usual largest difference (m) between two values with six decimals due to rounding
_SLIPS = 4              # so many wrong cells are slips in any table
_SLOW = 1e-4            # a difference (m/s) that true speeds do not have from each other
_OF_TABLES = ('rounded', 'unknown', 'few_cells', 'rest', 'enters_at_a', *_UNITS.values())      # not about speeds
_FRONT = 20             # number of handles near the head, on which link errors have little effect
_BETTER = 0.2           # fraction to which another order or other axes must reduce the error
_NICE = tuple(m * 10.0 ** -e for e in range(5) for m in (1.0, 0.5, 0.25, 0.2))
_GRIDS = tuple(sorted((*(m * 10.0 ** -e for e in range(1, 5) for m in (1.0, 0.5, 0.2)), pi / 180, pi / 360, pi / 1800),
                      reverse=True))
_DIFFERENCES_S = (2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.001)
_LEAST_STEP_S, _MOST_STEP_S = 0.0004, 30.0      # smallest and largest Euler step considered
_CIRCLES_M = 1.0, 100.0     # smallest and largest diameter of a turning circle considered
_AXES = {'': (1, 0, 0, 1), 'mirrored_x': (1, 0, 0, -1), 'mirrored_y': (-1, 0, 0, 1), 'rotated_180': (-1, 0, 0, -1),
         'swapped': (0, 1, 1, 0), 'rotated_90': (0, -1, 1, 0), 'rotated_270': (0, 1, -1, 0),
         'swapped_minus': (0, -1, -1, 0)}


class Finding(NamedTuple):
    """One finding: its key in ``words``, its sentence's parameters, and the share of the error that it explains."""

    key: str
    parameters: dict[str, object]
    explains: float | None = None


@dataclass
class Diagnosis:
    """The findings about one quantity of a result, and the result with corrected units, order and axes.

    ``explains`` is the share of the squared error that all findings together explain, or None if nothing is wrong or
    nothing is claimed to be explained. ``speeds`` contains the speeds (m/s, shape (T, 224)) of reproduced positions.
    """

    findings: list[Finding] = field(default_factory=list)
    explains: float | None = None
    undone: Floats | None = None
    speeds: Floats | None = None


def share(given: Floats, remade: Floats, truth: Floats) -> float:
    """Return the share of the squared error that reproduced values explain.

    The share is negative if the reproduced values increase the error.
    """
    there = np.isfinite(given) & np.isfinite(truth)
    if not np.isfinite(remade[there]).all():
        return 0.0
    error = float(np.sum(np.square(given[there] - truth[there])))
    return 1.0 - float(np.sum(np.square(given[there] - remade[there]))) / error if error > 0 else 0.0


def rounded_to(values: Floats) -> int | None:
    """Return the number of decimals to which values are rounded, or None if it is six or more."""
    some = values[np.isfinite(values)]
    for digits in range(6):
        scaled = some * 10.0 ** digits
        if some.size and np.all(np.abs(scaled - np.round(scaled)) < 1e-7 * np.maximum(1.0, np.abs(scaled) * 1e-3)):
            return digits
    return None


def _rounded_in_metres(values: Floats, unit: float) -> int | None:
    """Return the number of decimals of values in ``unit`` per metre, if it is less than six in metres."""
    digits = rounded_to(values)
    return None if digits is None or digits + np.log10(unit) > 5.5 else digits


def _tolerance(digits: int | None, unit: float = 1.0) -> float:
    """Return the largest error (m or m/s) of right values in ``unit`` per metre that are rounded to some decimals."""
    return RIGHT if digits is None else RIGHT + 10.0 ** -digits / unit


def nice(value: float, within: float = 0.03) -> float:
    """Return the round number near a fitted value, or the value itself if there is none."""
    near = min(_NICE, key=lambda one: abs(one - value))
    return near if abs(near - value) <= within * near else value


# The body outside the start of the head.
class _Waiting(NamedTuple):
    """How handles wait outside the start until they enter: their mask (T, 224), and a model of their positions."""

    finding: Finding
    mask: Booleans
    remade: Floats | None       # (T, 224, 2); None if no model fits


@cache
def _start_radius_m(result: str) -> float:
    """Return the radius (m) at which the head starts."""
    return float(np.hypot(*truth_at(result, np.array([_FIRST_S[result]])).handles_m[0, 0]))


def _outside(result: str, right: Floats) -> tuple[Booleans, Booleans]:
    """Return which handles (T, 224) should be outside the start of the head, certainly and perhaps."""
    beyond_m = np.hypot(right[..., 0], right[..., 1]) - _start_radius_m(result)
    return beyond_m > _BEYOND_M, beyond_m > -0.2 * _BEYOND_M


def _near_start(result: str, right: Floats) -> Booleans:
    """Return which handles (T, 224) a mistake elsewhere may have kept outside the start."""
    near: Booleans = np.hypot(right[..., 0], right[..., 1]) > _start_radius_m(result) - _NEAR_START_M
    return near


def _waiting(result: str, given: Floats, right: Floats) -> _Waiting | None:
    """Return how the body waits outside the start, or None if it is wound on the spiral as it should be."""
    if result == 'result2':
        return None
    out, mask = _outside(result, right)
    there: Booleans = np.all(np.isfinite(given), axis=-1)
    asked = np.array(there.any(axis=1))[:, None] & there.any(axis=0)
    inside, outside = there[asked & ~mask], there[asked & out]
    if min(inside.size, outside.size) < _LEAST_WAITING or inside.mean() < 0.98:
        return None
    if outside.mean() < 0.02:
        return _Waiting(Finding('enters_at_a', {'body': 'left_empty'}), mask, None)
    waits, near_m = given[out & there], 1e-3 + _tolerance(rounded_to(given))
    point = np.median(waits, axis=0)
    entered = given[there & ~mask]
    if np.max(np.abs(waits - point)) < near_m:
        if np.mean(np.abs(entered - point).max(axis=1) < near_m) > 0.02:        # all handles are there
            return None
        still = (np.abs(given - point).max(axis=-1) < near_m) & _near_start(result, right)
        return _Waiting(Finding('enters_at_a', {'body': 'at_a_point', 'x': float(point[0]), 'y': float(point[1])}),
                        mask | still, np.broadcast_to(point, given.shape))
    centre = waits.mean(axis=0)
    _, _, axes = np.linalg.svd(waits - centre, full_matrices=False)
    if np.max(np.abs((waits - centre) @ axes[1])) < near_m and np.mean(
            np.abs((entered - centre) @ axes[1]) < near_m) < 0.5:
        still = (np.abs((given - centre) @ axes[1]) < near_m) & _near_start(result, right)
        return _Waiting(Finding('enters_at_a', {'body': 'on_a_line'}), mask | still,
                        centre + ((given - centre) @ axes[0])[..., None] * axes[0])
    error = np.abs(given - right).max(axis=-1)
    if np.quantile(error[there & ~mask], 0.98) < near_m < 0.05 < np.quantile(error[there & out], 0.1):
        return _Waiting(Finding('enters_at_a', {'body': 'elsewhere'}), mask, None)
    return None


def _with_waiting(waiting: _Waiting, rest: Diagnosis, given: Floats, right: Floats) -> Diagnosis:
    """Return a diagnosis of the handles that have entered, together with how the others wait."""
    there = np.isfinite(given) & np.isfinite(right)
    error = np.square(np.where(there & ~(np.abs(given - right) <= RIGHT), given - right, 0.0))
    waits = waiting.mask[..., None]
    whole, outside = float(error.sum()), float(np.sum(error * waits))
    if outside == 0:
        return Diagnosis([waiting.finding, *rest.findings], rest.explains, None, rest.speeds)
    left = outside if waiting.remade is None else float(np.sum(np.minimum(
        error, np.square(np.where(there, given - waiting.remade, 0.0))) * waits))
    left += (whole - outside) * (1 - (1.0 if rest.explains is None else rest.explains))
    return Diagnosis([waiting.finding._replace(explains=(outside - left) / whole if outside else None), *rest.findings],
                     1 - left / whole, None, rest.speeds)


# Positions.
def diagnose_positions(result: str, times_s: Floats, given: Floats, truth: TrueStates) -> Diagnosis:
    """Diagnose the positions (T, 224, 2) in a result."""
    waiting = _waiting(result, given, truth.handles_m)
    if waiting is None:
        return _positions(result, times_s, given, truth)
    rest = _positions(result, times_s, np.where(waiting.mask[..., None], np.nan, given), truth)
    return _with_waiting(waiting, rest, given, truth.handles_m)


def _positions(result: str, times_s: Floats, given: Floats, truth: TrueStates) -> Diagnosis:
    found = Diagnosis(undone=given)
    right = truth.handles_m
    unit = _unit_of(given, right)
    digits = _rounded_in_metres(given, unit)
    if digits is not None:
        found.findings.append(Finding('rounded', {'digits': digits}))
    if _few_differ(found, given, right, digits, times_s):
        return found
    raw = given
    if unit != 1.0:
        found.findings.append(Finding(_UNITS[unit], {}))
        given = given / unit
    if result != 'result4' and _polar(found, given, right):
        return found
    given = _in_order(found, given, right)
    found.undone = given
    undone = len(found.findings) > (digits is not None)
    if undone and _worst(given, right) <= RIGHT + _tolerance(digits, unit):
        found.explains = 1.0
        return found
    rest = (_turned if result == 'result4' else _wound)(result, times_s, given, right, digits)
    of_raw = share(raw, raw - given + right, right)
    if undone and rest.findings[-1:] == [Finding('unknown', {})] and of_raw >= EXPLAINED:
        rest = Diagnosis([*rest.findings[:-1], Finding('rest', {'worst': _worst(given, right)})], of_raw)
    found.findings += rest.findings
    found.explains, found.speeds = rest.explains, rest.speeds
    _note_few(found, given, right, times_s)
    return found


def _worst(given: Floats, right: Floats) -> float:
    there = np.isfinite(given) & np.isfinite(right)
    return float(np.max(np.abs(given[there] - right[there]), initial=0.0))


def _few_differ(found: Diagnosis, given: Floats, right: Floats, digits: int | None, times_s: Floats) -> bool:
    """Return whether all cells, or all but a few cells, are correct; if so, complete the diagnosis."""
    there = np.isfinite(given) & np.isfinite(right)
    wrong = there & ~(np.abs(given - right) <= (RIGHT if digits is None else RIGHT + 0.501 * 10.0 ** -digits))
    count = int(wrong.sum())
    if count == 0:
        found.explains = 1.0 if found.findings else None
        return True
    if count > max(_SLIPS, 0.001 * there.sum()):
        return False
    found.findings.append(_few_cells(wrong, times_s))
    return True


def _few_cells(wrong: Booleans, times_s: Floats) -> Finding:
    row, handle = np.argwhere(wrong)[0][:2].tolist()
    return Finding('few_cells', {'count': int(wrong.sum()), 'handle': handle, 't': float(times_s[row])})


def _note_few(found: Diagnosis, given: Floats, right: Floats, times_s: Floats) -> None:
    """If the cause is unknown and few cells are wrong, add how many."""
    there = np.isfinite(given) & np.isfinite(right)
    wrong = there & ~(np.abs(given - right) <= RIGHT)
    if found.findings[-1:] == [Finding('unknown', {})] and wrong.sum() <= 0.03 * there.sum():
        found.findings.insert(-1, _few_cells(wrong, times_s))


def _unit_of(given: Floats, right: Floats) -> float:
    """Return the unit of given positions, per metre."""
    there = np.isfinite(given) & np.isfinite(right)
    ratio = float(np.sqrt(np.sum(np.square(given[there])) / np.sum(np.square(right[there]))))
    return next((factor for factor in _UNITS if abs(np.log(max(ratio, 1e-300) / factor)) < 0.3), 1.0)


def _polar(found: Diagnosis, given: Floats, right: Floats) -> bool:
    """Report polar coordinates or angles in the wrong unit; return whether either was found."""
    radius = np.hypot(right[..., 0], right[..., 1])
    theta = radius / _B_M
    for key, angle in (('radians_as_degrees', np.radians(theta)), ('degrees_as_radians', np.degrees(theta))):
        remade = radius[..., None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
        if share(given, remade, right) >= EXPLAINED:
            return _said(found, key, given, remade, right)
    for key, second in (('polar', theta), ('polar', theta % (2 * pi)), ('polar_degrees', np.degrees(theta)),
                        ('polar_degrees', np.degrees(theta) % 360)):
        remade = np.stack((radius, second), axis=-1)
        if share(given, remade, right) >= EXPLAINED:
            return _said(found, key, given, remade, right)
    return False


def _said(found: Diagnosis, key: str, given: Floats, remade: Floats, right: Floats) -> bool:
    found.explains = share(given, remade, right)
    found.findings.append(Finding(key, {}, found.explains))
    return True


def _in_order(found: Diagnosis, given: Floats, right: Floats) -> Floats:
    """Return the handles in the correct order with the correct axes, and report a wrong order or wrong axes.

    Orders and axes are compared for the front handles, on which link errors have little effect.
    """
    some = np.unique(np.linspace(0, len(given) - 1, 24).astype(int))
    before = _misfit(given[some], right[some])
    front = {order: _ordered(given[some], order)[:, :_FRONT] for order in (0, 1, -1, 2, -2, None)}
    tried = {(axes, order): _misfit(handles @ _matrix(axes), right[some])
             for axes in _AXES for order, handles in front.items()}
    axes, order = min(tried, key=lambda one: tried[one])
    rigid = _rigid(given, right, before, tried[axes, order])
    if rigid is not None:
        found.findings.append(rigid[0])
        return rigid[1]
    if tried[axes, order] < _BETTER * before and (axes or order != 0):
        if axes:
            found.findings.append(Finding(axes, {}))
        if order != 0:
            found.findings.append(Finding('rows_reversed', {}) if order is None else
                                  Finding('handles_shifted', {'by': order}))
        return _ordered(given @ _matrix(axes), order)
    order_of = _matched(given[some], right[some])
    if order_of is not None:
        found.findings.append(Finding('rows_mixed', {}))
        return order_of(given)
    return given


def _matrix(axes: str) -> Floats:
    """Return the matrix that undoes a change of axes, for row vectors."""
    a, b, c, d = _AXES[axes]
    return np.array(((a, b), (c, d)), dtype=np.float64)


def _ordered(given: Floats, order: int | None) -> Floats:
    """Return handles shifted by ``order`` positions, with nan where handles are missing; None reverses the order."""
    if order is None:
        return given[:, ::-1]
    out = np.full_like(given, np.nan)
    if order >= 0:
        out[:, order:] = given[:, :given.shape[1] - order]
    else:
        out[:, :order] = given[:, -order:]
    return out


def _misfit(given: Floats, right: Floats) -> float:
    """Return the root mean square error of the front handles, or a huge value if too few handles are given."""
    error = np.square(given[:, :_FRONT] - right[:, :_FRONT])
    there = np.isfinite(error)
    return float(np.sqrt(error[there].mean())) if there.mean() > 0.3 else 1e9


def _matched(given: Floats, right: Floats) -> Callable[[Floats], Floats] | None:
    """Return a function that sorts permuted rows of x and y by matching each row with the nearest true row."""
    if len(given) < 4 or not np.isfinite(given).all():
        return None
    rows, wanted = (each.transpose(1, 2, 0).reshape(2 * HANDLES, -1) for each in (given, right))
    apart = (np.sum(rows * rows, axis=1)[:, None] + np.sum(wanted * wanted, axis=1) - 2 * rows @ wanted.T) / len(given)
    place: Ints = np.argmin(apart, axis=1)
    if np.unique(place).size < 2 * HANDLES or float(np.sqrt(np.maximum(apart.min(axis=1), 0).max())) > 0.3:
        return None
    if np.array_equal(place, np.arange(2 * HANDLES)):
        return None

    def sort(values: Floats) -> Floats:
        flat = values.reshape(len(values), -1)
        out = np.empty_like(flat)
        out[:, place] = flat
        return out.reshape(values.shape)
    return sort


def _rigid(given: Floats, right: Floats, before: float, otherwise: float) -> tuple[Finding, Floats] | None:
    """Return the best rigid motion of front handles, and the handles moved back, or None if a simpler change fits."""
    front, wanted = given[:, :_FRONT].reshape(-1, 2), right[:, :_FRONT].reshape(-1, 2)
    there = np.isfinite(front).all(axis=1) & np.isfinite(wanted).all(axis=1)
    if there.sum() < 8 or before < 10 * RIGHT:
        return None
    a, b = front[there] @ (1, 1j), wanted[there] @ (1, 1j)
    for mirrored, source in ((False, b), (True, b.conj())):
        turn = np.sum((a - a.mean()) * (source - source.mean()).conj())
        if not turn:        # all given points are the same
            continue
        turn /= abs(turn)
        shift = a.mean() - turn * source.mean()
        left = float(np.sqrt(np.mean(np.square(np.abs(a - turn * source - shift))) / 2))
        if left < 1e-3 * min(before, float(np.std(b))) and left < 0.1 * otherwise:
            back = (given @ np.array((1, 1j)) - shift) / turn
            back = back.conj() if mirrored else back
            return Finding('mirrored_rigid' if mirrored else 'rotated_rigid', {
                'angle': float(np.degrees(np.angle(turn))), 'dx': float(shift.real), 'dy': float(shift.imag),
            }), np.stack((back.real, back.imag), axis=-1)
    return None


# On the spiral: results 1 and 2.
class _HeadFit(NamedTuple):
    findings: list[Finding]
    angles: Floats | None       # reproduced angles; None if no mistake explains the given angles


def _angles_of(p: Floats) -> tuple[Floats, float]:
    """Return the polar angles (...) of handles on the spiral, and their rms distance (m) from the spiral."""
    radius, angle = np.hypot(p[..., 0], p[..., 1]), np.arctan2(p[..., 1], p[..., 0])
    theta = angle + 2 * pi * np.round((radius / _B_M - angle) / (2 * pi))
    off = (radius - _B_M * theta)[np.isfinite(radius)]
    return theta, float(np.sqrt(np.mean(np.square(off)))) if off.size else np.inf


def _wound(result: str, times_s: Floats, given: Floats, right: Floats, digits: int | None) -> Diagnosis:
    """Return the diagnosis of handles on the spiral."""
    theta, off_m = _angles_of(given)
    noise_m = max(8 * off_m, 2 * _tolerance(digits))
    if result == 'result2':
        head = _HeadFit(*_moment(theta[0, 0], noise_m))
    else:
        head = _head_of(times_s, given[:, 0], theta[:, 0], right[:, 0], noise_m)
    found = Diagnosis()
    pitch_m = next((float(str(one.parameters['pitch'])) for one in head.findings if one.key == 'pitch'), PITCH_M)
    if pitch_m != PITCH_M and head.angles is not None:
        return _on_other_spiral(head, pitch_m, given, right)
    if off_m > _ON_TRACK_M:
        paper = _as_paper(times_s, given, right) if result == 'result1' else None
        off = [Finding('off_track', {'off': off_m})] if np.isfinite(off_m) else []      # inf if no handle has x and y
        return paper or _unknown([*head.findings, *off])
    start = theta[:, 0] if head.angles is None else head.angles
    if head.angles is None and (loose := _loose_root(given, right, theta)) is not None:
        return loose
    if head.angles is None or not np.isfinite(start).all():
        return _as_paper(times_s, given, right) or _unknown([Finding('head_unknown', {}), *_links_seen(given, noise_m)])
    best: tuple[float, Rule, list[float], list[Finding]] = (-np.inf, chord(), links_of(), [])
    for rule, links, said in _link_candidates(theta, given, noise_m):
        remade = points(placed_angles(start, rule, links))
        explains = share(given, remade if digits is None else np.round(remade, digits), right)
        if 1 - explains < 0.5 * (1 - best[0]):
            best = explains, rule, links, said
        if explains > 1 - 1e-6:
            break
    explains, rule, links, said = best
    if explains < EXPLAINED or any(one.key == 'grid' for one in said):
        paper = _as_paper(times_s, given, right) if result == 'result1' else None
        if paper is not None or explains < EXPLAINED:
            loose = None if head.findings else _loose_root(given, right, theta)
            return paper or loose or _unknown([*head.findings, *_links_seen(given, noise_m)], explains)
    found.findings, found.explains = [*head.findings, *said], explains
    speed_m_s = next((float(str(one.parameters['speed'])) for one in head.findings if one.key == 'speed'), 1.0)
    found.speeds = mistakes.projected(placed_angles(start, rule, links), speed_m_s)
    if result == 'result2' and said:
        found.findings = [_contact_of(one, theta[0, 0], rule, links, noise_m) for one in found.findings]
    return found


def _loose_root(given: Floats, right: Floats, turned: Floats | None = None) -> Diagnosis | None:
    """Return the diagnosis of positions whose small errors along the track add up from handle to handle, or None.

    Rounding hides small errors of single links, so that means over several links count, too.
    """
    apart, along = given - right, right[:, :-1] - right[:, 1:]
    along = np.concatenate((along[:, :1], along), axis=1)
    along = along / np.hypot(*np.moveaxis(along, -1, 0))[..., None]
    drift = np.sum(apart * along, axis=-1)
    aside = apart[..., 0] * along[..., 1] - apart[..., 1] * along[..., 0]
    off = np.abs(np.hypot(*np.moveaxis(np.diff(given, axis=1), -1, 0)) - links_of())
    if not np.isfinite(drift).any() or not np.nanmax(off) <= _MOST_LOOSE_M or (
            np.nanmax(np.abs(drift)) > _MOST_DRIFT_M or np.nanmax(np.abs(aside)) > 0.2 * np.nanmax(np.abs(drift))):
        return None
    worst_m = max((float(np.nanmax(np.abs(drift[:, links:] - drift[:, :-links]))) - _ROUNDED_M) / links
                  for links in (1, 2, 5, 20))
    if not worst_m > 0:
        return None
    unit = 1.0 if turned is None else float(np.nanmean(turned)) * _B_M
    tolerance = 10.0 ** ceil(np.log10(worst_m / unit))
    return Diagnosis([Finding('loose_root', {'tolerance': tolerance, 'worst': worst_m})], None)


def _links_seen(given: Floats, noise_m: float) -> list[Finding]:
    """Return a finding with the range of differences between chords and links if these differences exceed the noise."""
    off = np.hypot(*np.moveaxis(np.diff(given, axis=1), -1, 0)) - links_of()
    low, high = np.nanpercentile(off, (0.5, 99.5)).tolist() if np.isfinite(off).any() else (0.0, 0.0)
    return [Finding('tolerance', {'low': low, 'high': high})] if max(-low, high) > noise_m else []


def _unknown(findings: list[Finding], explains: float = 0.0) -> Diagnosis:
    """Return a diagnosis that contains the observed facts and states that the rest is unexplained."""
    return Diagnosis([*findings, Finding('unknown', {})], max(explains, 0.0))


def _on_other_spiral(head: _HeadFit, pitch_m: float, given: Floats, right: Floats) -> Diagnosis:
    assert head.angles is not None
    remade = points(placed_angles(head.angles, chord(pitch_m=pitch_m), links_of()), pitch_m)
    explains = share(given, remade, right)
    speeds = mistakes.projected(placed_angles(head.angles, chord(pitch_m=pitch_m), links_of()))
    return Diagnosis(head.findings, explains, speeds=speeds) if explains >= EXPLAINED else (
        _unknown(head.findings, explains))


def _head_of(times_s: Floats, head: Floats, theta: Floats, right: Floats, noise_m: float) -> _HeadFit:
    """Return the mistake that explains the positions of the head (T, 2)."""
    if _worst(head, right) <= noise_m:
        return _HeadFit([], solved(arc_length)(times_s))
    tried = []
    for key, parameters, angles, pitch_m in _head_candidates(times_s, head, theta):
        tried.append((share(head, points(angles, pitch_m), right), key, parameters, angles))
    best = max((one[0] for one in tried), default=0.0)
    if best < EXPLAINED:
        return _HeadFit([], None)
    left = 1 - best
    explains, key, parameters, angles = next(one for one in tried if 1 - one[0] <= 2 * left + 1e-6)
    return _HeadFit([Finding(key, parameters, explains)], angles)


def _head_candidates(times_s: Floats, head: Floats, theta: Floats,
                     ) -> Iterator[tuple[str, dict[str, object], Floats, float]]:
    """Yield reproduced head motions as (key, parameters, angles, pitch), those with fewer parameters first."""
    exact = solved(arc_length)
    radial_arc = mistakes.solved(mistakes.without_radial)(times_s)
    yield 'radial_arc', {}, radial_arc, PITCH_M
    yield 'bracket_slip', {}, mistakes.bracket_slip()(times_s), PITCH_M
    late = (arc_length(np.array(START)) - arc_length(theta)) * _B_M - times_s       # in m or, at 1 m/s, in s
    there = np.isfinite(late)
    if not there.any():
        return
    for key, radial, base in (('euler', True, exact(times_s)), ('euler_radial', False, radial_arc)):
        step_s = _euler_step(theta[there], base[there], mistakes.euler(0.1, radial)(times_s)[there])
        if _LEAST_STEP_S < step_s < _MOST_STEP_S:
            yield key, {'step': step_s}, mistakes.euler(step_s, radial)(times_s), PITCH_M
    shift_s = float(np.median(late[there]))
    turns = START / (2 * pi)
    start = solved(arc_length)(np.array([shift_s]))[0] / (2 * pi)
    if abs(start - turns) > 0.2 and abs(2 * start - round(2 * start)) < 1e-4:
        yield 'start_turns', {'turns': round(2 * start) / 2}, exact(times_s + shift_s), PITCH_M
    if abs(shift_s) > RIGHT:
        yield 'time_shift', {'shift': shift_s}, exact(times_s + shift_s), PITCH_M
    if times_s.size > 2:
        gone = late[there] + times_s[there]
        speed = float(np.sum(gone * times_s[there]) / np.sum(np.square(times_s[there])))
        if abs(speed + 1) < 1e-3:
            yield 'outward', {}, exact(-times_s), PITCH_M
        if abs(speed - 1) > RIGHT:
            yield 'speed', {'speed': speed}, exact(speed * times_s), PITCH_M
        yield from _other_pitch(times_s, head)


def _euler_step(theta: Floats, base: Floats, at_a_tenth: Floats) -> float:
    """Return the Euler step whose error fits the head's error; errors are scaled from that of a step of 0.1 s."""
    per_step = (at_a_tenth - base) / 0.1
    return nice(float(np.sum((theta - base) * per_step) / np.sum(np.square(per_step))))


def _other_pitch(times_s: Floats, head: Floats) -> Iterator[tuple[str, dict[str, object], Floats, float]]:
    """Yield the motion of a head that starts at the same angle on a spiral with another pitch."""
    if np.max(np.diff(times_s), initial=0.0) > 2 or not np.isfinite(head).all():
        return
    turned = np.unwrap(np.arctan2(head[:, 1], head[:, 0]))
    radius = np.hypot(head[:, 0], head[:, 1])
    if np.ptp(turned) > 1:
        pitch_m = abs(2 * pi * float(np.polyfit(turned, radius, 1)[0]))
        pitch_m = round(pitch_m, 4) if abs(pitch_m - round(pitch_m, 4)) < 2e-6 else pitch_m
        if 0.1 < pitch_m < 5 and abs(pitch_m - PITCH_M) > 1e-6:
            yield 'pitch', {'pitch': pitch_m}, solved(arc_length, pitch_m=pitch_m)(times_s), pitch_m


def _link_candidates(theta: Floats, given: Floats, noise_m: float,
                     ) -> Iterator[tuple[Rule, list[float], list[Finding]]]:
    """Yield the rules for the next handle that fit the chords and angles, each as (function, links, findings)."""
    exact = links_of()
    off = np.hypot(*np.moveaxis(np.diff(given, axis=1), -1, 0)) - exact
    if not np.isfinite(off).any():
        return
    if np.nanmax(np.abs(np.nanmedian(off, axis=0))) <= noise_m and np.nanpercentile(np.abs(off), 99.5) <= noise_m:
        yield chord(), exact, []
    if (constant := constant_links(off, noise_m)) is not None:
        yield chord(), constant[0], constant[1]
    arcs = np.diff(arc_length(theta), axis=1) * _B_M - exact
    if np.nanpercentile(np.abs(arcs), 99) <= noise_m:
        yield mistakes.along, exact, [Finding('along', {})]
    if (found := _grid_of(theta, np.diff(theta, axis=1), off, noise_m)) is not None:
        yield found[0], exact, found[1]


def constant_links(off: Floats, noise_m: float) -> tuple[list[float], list[Finding]] | None:
    """Return link lengths and findings that explain link errors (T, 223), or None if the errors vary with time.

    Links without values have their right lengths, or that of the other body links.
    """
    head, body, last = (float(np.nanmedian(each)) for each in (off[:, 0], off[:, 1:-1], off[:, -1]))
    head, body = np.nan_to_num(head).item(), np.nan_to_num(body).item()
    last = body if np.isnan(last) else last
    middle = np.concatenate(([head], np.full(off.shape[1] - 2, body), [last]))
    if np.nanpercentile(np.abs(off - middle) - np.maximum(noise_m, 0.05 * np.abs(middle)), 98) > 0:
        return None
    lengths = HEAD_LINK_M + head, BODY_LINK_M + body, BODY_LINK_M + last
    return links_of(*lengths), [_named_links(*lengths, noise_m)]


def _named_links(head_m: float, body_m: float, last_m: float, noise_m: float) -> Finding:
    """Return the mistake that leads to these link lengths."""
    def are(*wanted: float) -> bool:
        near = max(noise_m, 1e-5)
        return all(abs(one - other) <= near for one, other in zip((head_m, body_m, last_m), wanted, strict=True))
    names = {'body_link_for_head': (1.65, 1.65, 1.65), 'head_link_for_body': (2.86, 2.86, 2.86),
             'whole_benches': (3.41, 2.2, 2.2), 'one_hole': (3.135, 1.925, 1.925), 'swapped_links': (1.65, 2.86, 2.86),
             'last_link': (2.86, 1.65, 2.86)}
    for key, lengths in names.items():
        if are(*lengths):
            return Finding(key, {})
    short = BODY_LINK_M - body_m
    if abs(HEAD_LINK_M - head_m - short) < max(noise_m, 0.05 * abs(short)):
        return Finding('chord_short', {'short': nice(short, 0.05)}) if short > 0 else Finding('chord_long', {
            'long': nice(-short, 0.05)})
    return Finding('links', {'head': head_m, 'body': body_m})


def _grid_of(theta: Floats, step: Floats, off: Floats, noise_m: float,
             ) -> tuple[Rule, list[Finding]] | None:
    """Return the rule for handles on a grid of angles that starts at the previous handle, or None if they are not."""
    inner_m = float(np.nanmin(theta)) * _B_M
    grid = _step_of(step, noise_m / inner_m) if inner_m > 0 else None
    if grid is None:
        return None
    before = np.hypot(*np.moveaxis(points(theta[:, 1:] - grid) - points(theta[:, :-1]), -1, 0)) - links_of()
    body = slice(0, -1)         # without the last link, which is different in the paper
    within = _within_of(off[:, body], before[:, body], noise_m)
    if within is None:
        return None
    return mistakes.grid(grid, within), [Finding('grid' if within else 'grid_past', {'step': grid, 'within': within})]


def _step_of(step: Floats, blur: float, percent: float = 95.0) -> float | None:
    """Return the largest step size that divides all steps to within ``blur``, or None if there is none."""
    for grid in _GRIDS:
        if blur > 0.2 * grid:
            return None
        count = np.round(step / grid)
        if np.nanpercentile(np.abs(step / grid - count), percent) < 0.08:
            return grid
    return None


def _within_of(off: Floats, before: Floats, noise_m: float) -> float | None:
    """Return a tolerance that all chords meet, but no chord meets one step earlier, or None if there is none."""
    lowest, highest = -float(np.nanmin(off)), -float(np.nanmax(before))
    return next((w for w in (0.0, *_NICE) if lowest - noise_m <= w <= highest + noise_m), None)


@cache
def _paper_at(times_s: tuple[float, ...]) -> Floats:
    scene = replace(mistakes.winding(), accuracy='paper')
    return np.stack([dr.compile(scene).state(t_s).handles_m for t_s in times_s])


def _as_paper(times_s: Floats, given: Floats, right: Floats) -> Diagnosis | None:
    """Return the diagnosis ``paper`` if the positions at sampled times match the paper's; otherwise, return None."""
    some = [n for n in np.unique(np.linspace(0, times_s.size - 1, 6).astype(int)).tolist()
            if 0 <= times_s[n] <= 412 and abs(times_s[n] * 100 - round(times_s[n] * 100)) < 1e-9]
    if not some:
        return None
    explains = share(given[some], _paper_at(tuple(times_s[some].tolist())), right[some])
    return Diagnosis([Finding('paper', {}, explains)], explains) if explains >= EXPLAINED else None


# The time of result 2.
def _moment(theta: float, noise_m: float) -> tuple[list[Finding], Floats | None]:
    """Return findings about the time at which the head has its position in result 2, and the head's angle."""
    if not np.isfinite(theta):
        return [], None
    t_s = float(arc_length(np.array(START)) - arc_length(np.array(theta))) * _B_M
    near_s = max(5e-6, noise_m)
    if np.isnan(truth_at('result1', np.array([t_s])).speed_m_s).any():     # there is no state at this time
        return [], None
    if abs(t_s - contact_s()) <= near_s:
        return [], np.array([theta])
    return [Finding('moment', {'t': t_s}), *contact_findings(t_s, near_s)], np.array([theta])


@cache
def _known_contacts() -> tuple[mistakes.MistakenAnswer, ...]:
    return tuple(mistakes.contact_times_s())


def contact_findings(t_s: float, near_s: float) -> list[Finding]:
    """Return the mistakes, with known or fitted parameters, whose contact time is within ``near_s`` of ``t_s``."""
    for answer in _known_contacts():
        if answer.key != 'none' and abs(answer.value - t_s) <= near_s:
            return [Finding(answer.key, dict(answer.parameters))]
    for step_s in _NICE[:12]:
        if abs(ceil(contact_s() / step_s) * step_s - t_s) <= near_s:
            return [Finding('looked', {'step': step_s})]
        if abs(floor(contact_s() / step_s) * step_s - t_s) <= near_s:
            return [Finding('looked_before', {'step': step_s})]
    if abs(t_s - 412.3) <= near_s:
        return [Finding('paper_contact', {})]
    if 405 < t_s < contact_s():
        gap = mistakes.gap_of({})
        near_m = float(gap(np.array([t_s]))[0])
        before: Floats = np.arange(405.0, t_s - 0.02, 0.02, dtype=np.float64)
        if near_m < 0.02 and np.all(gap(before) > near_m):
            return [Finding('near_counts', {'near': near_m})]
    return []


def _contact_of(finding: Finding, theta: float, rule: Rule, links: list[float], noise_m: float) -> Finding:
    """Return a finding; if wrong links alone explain a wrong contact time, return a finding that states this."""
    if finding.key != 'moment':
        return finding
    t_s = mistakes.touch_s(solved(arc_length), rule, links[:mistakes.FOLLOWING - 1])
    own_s = float(str(finding.parameters['t']))
    return Finding('moment_of_links', {'t': own_s}) if abs(t_s - own_s) <= max(2e-4, noise_m) else finding


# On the turn: result 4.
def _turned(result: str, times_s: Floats, given: Floats, right: Floats, digits: int | None) -> Diagnosis:
    """Return the diagnosis of handles on the turn."""
    noise_m = 2 * _tolerance(digits)
    findings, track, head_m = list[Finding](), None, times_s
    if _worst(given[:, 0], right[:, 0]) > noise_m:
        if (stepped := _turn_euler(times_s, given[:, 0], right[:, 0])) is not None:
            findings.append(stepped[0])
            head_m = stepped[1]
        elif (fitted := _turn_fit(times_s, given[:, 0], right[:, 0])) is not None:
            findings.append(fitted[0])
            track, head_m = fitted[1], fitted[3] * times_s + fitted[2]
        else:
            findings.append(_before_turn(times_s, given[:, 0], noise_m))
    off = np.hypot(*np.moveaxis(np.diff(given, axis=1), -1, 0)) - links_of()
    links = links_of()
    if np.nanpercentile(np.abs(off), 99.5) > noise_m:
        constant = constant_links(off, noise_m)
        if constant is None and not (findings and findings[0].key in ('head_unknown', 'circle_before')):
            for finding, laid in _turn_links(head_m, given, off, track or dr.STurn(), noise_m):
                explains = share(given, laid if digits is None else np.round(laid, digits), right)
                if explains >= EXPLAINED:
                    return Diagnosis([*findings, finding], explains)
        if constant is None and not findings and (loose := _loose_root(given, right)) is not None:
            return loose
        if constant is None:
            near = np.abs(off[np.isfinite(off)]) <= noise_m
            low, high = np.nanpercentile(off, (0.5, 99.5)).tolist()
            seen = {'low': low, 'high': high}
            return _unknown([*findings, Finding('links_in_part', {'share': float(near.mean()), **seen})
                             if near.mean() > 0.2 else Finding('tolerance', seen)])
        links, said = constant
        findings += said
    if findings and findings[0].key in ('head_unknown', 'circle_before'):
        return _unknown(findings)
    try:
        dragon = dr.Dragon(head_length_m=links[0] + 0.55, body_length_m=links[1] + 0.55)
        scene, offset_s = turned_scene(dragon, track)
        remade, speeds = state_at(scene, head_m + offset_s)
    except dr.DragonError:         # no dragon has such links, or the arcs are too tight for them
        return _unknown(findings)
    explains = share(given, remade if digits is None else np.round(remade, digits), right)
    if explains < EXPLAINED and not findings and (loose := _loose_root(given, right)) is not None:
        return loose
    pace = np.gradient(head_m, times_s) if times_s.size > 1 else np.ones_like(times_s)
    return Diagnosis(findings, explains, speeds=speeds * pace[:, None]) if explains >= EXPLAINED else (
        _unknown(findings, explains))


def _turn_links(head_m: Floats, given: Floats, off: Floats, turn: dr.STurn, noise_m: float,
                ) -> Iterator[tuple[Finding, Floats]]:
    """Yield the rules for the next handle on the turn: links along the curve, and grids of steps."""
    yield Finding('turn_along', {}), mistakes.along_turn(head_m, links_of(), turn)
    if not np.max(np.abs(off)) < _MOST_OFF_M:
        return
    metres, off_m = _along_track(given, head_m, turn)
    if off_m > _ON_TRACK_M:
        return
    angle = mistakes.TurnAngle(turn)
    joints_m = angle.metres(angle.joints)
    least_m = float(np.min(np.diff(joints_m) / np.diff(angle.joints)))
    piece = np.searchsorted(joints_m, metres)
    one = piece[:, 1:] == piece[:, :-1]
    for of_angle, at, per_unit_m in ((True, angle.of(metres), least_m), (False, metres, 1.0)):
        steps = -np.diff(at, axis=1)
        steps[~one & of_angle] = np.nan         # angular steps restart at each piece
        step = _step_of(steps, noise_m / per_unit_m, 99.9)
        if step is None:
            continue
        before_m = angle.metres(at[:, 1:] + step) if of_angle else at[:, 1:] + step
        last_but_one = np.hypot(*np.moveaxis(mistakes.turn_points(before_m, turn)
                                             - mistakes.turn_points(metres[:, :-1], turn), -1, 0)) - links_of()
        within = _within_of(off[one], last_but_one[one], noise_m)
        if within is not None:
            key = ('' if of_angle else 'turn_') + ('grid' if within else 'grid_past')
            yield Finding(key, {'step': step, 'within': within}), mistakes.grid_on_turn(
                head_m, links_of(), turn, step, within, of_angle)


def _along_track(given: Floats, head_m: Floats, turn: dr.STurn) -> tuple[Floats, float]:
    """Return distances (m, shape (T, N+1)) of handles along the turn from its entry, and their rms distance from it."""
    metres, aside = [head_m], [np.zeros_like(head_m)]
    for handle in range(1, given.shape[1]):
        at = metres[-1] - np.hypot(*(given[:, handle] - given[:, handle - 1]).T)
        for _ in range(8):
            point, heading = dr.design.turn_poses(turn, at)
            apart = given[:, handle] - point
            ahead_m = np.sum(apart * heading, axis=-1)
            at = at + ahead_m
            if np.max(np.abs(ahead_m)) < _SETTLED_M:
                break
        metres.append(at)
        aside.append(apart[:, 0] * heading[:, 1] - apart[:, 1] * heading[:, 0])
    return np.stack(metres, axis=-1), float(np.sqrt(np.mean(np.square(aside))))


def _turn_head(metres: Floats, track: dr.STurn | None) -> Floats:
    """Return the points (m, shape (T, 2)) of a head at distances (m, shape (T,)) from the entry of a turn."""
    return mistakes.turn_points(metres, track or dr.STurn())


def _turn_euler(times_s: Floats, head: Floats, right: Floats) -> tuple[Finding, Floats] | None:
    """Return the Euler step that explains the head's positions, and the head's distance from the entry."""
    per_step = (_turn_head(mistakes.euler_on_turn_m(times_s, 0.1), None) - right) / 0.1
    scale = float(np.nansum(np.square(per_step)))
    step_s = nice(float(np.nansum((head - right) * per_step)) / scale) if scale > 0 else 0.0
    if not _LEAST_STEP_S < step_s < _MOST_STEP_S:
        return None
    metres = mistakes.euler_on_turn_m(times_s, step_s)
    explains = share(head, _turn_head(metres, None), right)
    return (Finding('euler', {'step': step_s}, explains), metres) if explains >= EXPLAINED else None


_TURN_STARTS: dict[str, tuple[float, ...]] = {'shift': (0.0, 100.0, -100.0), 'speed': (1.0,), 'ratio': (2.0, 1.0, 3.0),
                                              'diameter': (9.0,), 'pitch': (1.7,)}
Turn = tuple[Finding, dr.STurn | None, float, float]


def _turn_fit(times_s: Floats, head: Floats, right: Floats) -> Turn | None:
    """Return the parameter of the turn (or the circle and the ratio) that best fits the head's positions."""
    some = np.unique(np.linspace(0, times_s.size - 1, 41).astype(int))
    times, wanted = times_s[some], head[some]
    circles_m = _circles_m(times, wanted)
    tries = [(name, value, 0.0) for name, starts in _TURN_STARTS.items() for value in starts]
    tries += [('diameter', circle, 0.0) for circle in circles_m]
    tries += [('both', ratio, circle) for circle in circles_m for ratio in (2.0, 1.0, 0.5)]
    best: tuple[float, str, float, float] = (0.0, '', 0.0, 0.0)
    for name, value, circle in tries:
        if best[0] > 1 - 1e-9:
            break
        try:
            explains, fitted = _fitted(name, value, circle, times, wanted, right[some])
        except dr.DragonError:     # such a turn is impossible
            continue
        if explains > best[0] + 1e-6:
            best = explains, name, fitted, circle
    explains, name, value, circle = best
    if explains < EXPLAINED:
        return None
    value, circle = (round(one, 4) if abs(one - round(one, 4)) < 2e-6 else one for one in (value, circle))
    return Finding(f'turn_{name}', {'ratio' if name == 'both' else name: value, 'diameter': circle} if name == 'both'
                   else {name: value}, explains), *_turn_of(name, value, circle)


def _before_turn(times_s: Floats, head: Floats, noise_m: float) -> Finding:
    """Return a finding about the circle that the head approaches, if its motion up to the entry is correct."""
    for circle_m in _circles_m(times_s, head):
        before = times_s < 0
        remade = _turn_head(times_s[before], dr.STurn(diameter_m=circle_m))
        if _worst(head[before], remade) <= max(noise_m, 1e-5):
            return Finding('circle_before', {'diameter': circle_m})
    return Finding('head_unknown', {})


def _turn_of(name: str, value: float, circle_m: float) -> tuple[dr.STurn | None, float, float]:
    """Return the track, the time shift (s) and the speed (m/s) for one value of a parameter."""
    if name in ('shift', 'speed'):
        return None, value if name == 'shift' else 0.0, value if name == 'speed' else 1.0
    if name == 'both':
        return dr.STurn(diameter_m=circle_m, ratio=value), 0.0, 1.0
    return dr.STurn(**{{'ratio': 'ratio', 'diameter': 'diameter_m', 'pitch': 'pitch_m'}[name]: value}), 0.0, 1.0


def _fitted(name: str, value: float, circle_m: float, times: Floats, wanted: Floats, right: Floats,
            ) -> tuple[float, float]:
    """Fit one parameter by the Gauss-Newton method; return the share of the error that it explains, and its value."""
    def at(one: float) -> Floats:
        track, shift_s, speed_m_s = _turn_of(name, one, circle_m)
        return _turn_head(speed_m_s * times + shift_s, track)
    here = at(value)
    for _ in range(8):
        slope = (at(value + 1e-5) - here) / 1e-5
        change = float(np.nansum((wanted - here) * slope) / np.nansum(np.square(slope)))
        value += float(np.clip(change, -0.5, 0.5))
        here = at(value)
        if abs(change) < 1e-8 or (abs(change) > 1e-3 and share(wanted, here, right) < -3):
            break
    return share(wanted, here, right), value


def _circles_m(times: Floats, head: Floats) -> tuple[float, ...]:
    """Return the diameter (m) of the circle that the head enters at 0 s, based on earlier positions on the spiral."""
    before = (times < 0) & np.isfinite(head).all(axis=1)
    if not before.any():
        return ()
    b_m = dr.STurn.pitch_m / 2 / pi
    theta = np.hypot(head[before, 0], head[before, 1]) / b_m
    left = arc_length(theta) + times[before] / b_m
    circle_m = 2 * b_m * float(np.median(mistakes.inverted(arc_length, left)))
    return (circle_m,) if _CIRCLES_M[0] < circle_m < _CIRCLES_M[1] else ()


# Speeds.
def diagnose_speeds(result: str, times_s: Floats, given: Floats, truth: TrueStates, positions: Diagnosis) -> Diagnosis:
    """Diagnose the speeds (T, 224) in a result; mistakes in the positions may explain them, too."""
    waiting = _waiting_speeds(result, given, truth, positions)
    if waiting is None:
        return _speeds(result, times_s, given, truth, positions)
    rest = _speeds(result, times_s, np.where(waiting.mask, np.nan, given), truth, positions)
    if rest.findings[-1:] == [Finding('unknown', {})]:
        return _speeds(result, times_s, given, truth, positions)
    return _with_waiting(waiting, rest, given[..., None], truth.speed_m_s[..., None])


def _waiting_speeds(result: str, given: Floats, truth: TrueStates, positions: Diagnosis) -> _Waiting | None:
    """Return the speeds of handles that wait outside the start, or None if they do not wait.

    While they wait, all handles have the same speed, or none is given.
    """
    if result == 'result2':
        return None
    out, mask = _outside(result, truth.handles_m)
    there = np.isfinite(given)
    asked = np.array(there.any(axis=1))[:, None] & there.any(axis=0)
    inside, outside = there[asked & ~mask], there[asked & out]
    if min(inside.size, outside.size) < _LEAST_WAITING or inside.mean() < 0.98:
        return None
    known = next((one for one in positions.findings if one.key == 'enters_at_a'), None)
    if outside.mean() < 0.02:
        return _Waiting(known or Finding('enters_at_a', {'body': 'left_empty'}), mask, None)
    waits = np.where(out & there, given, np.nan)
    filled = np.array(np.isfinite(waits).any(axis=1))
    level = np.ones((len(given), 1))
    level[filled, 0] = np.nanmedian(waits[filled], axis=1)
    spread = float(np.nanmax(np.abs(waits - level)))
    usual = np.abs(truth.speed_m_s - level)[out & there]
    if spread > RIGHT or (known is None and np.quantile(usual, 0.1) < _SLOW) or np.all(given[there] == given[there][0]):
        return None
    still = (np.abs(given - level) <= RIGHT) & _near_start(result, truth.handles_m)
    return _Waiting(known or Finding('enters_at_a', {'body': 'elsewhere'}), mask | still,
                    np.broadcast_to(level[..., None], (*given.shape, 1)))


def _speeds(result: str, times_s: Floats, given: Floats, truth: TrueStates, positions: Diagnosis) -> Diagnosis:
    found = Diagnosis(undone=given)
    right = truth.speed_m_s
    level, unit = float(np.nanmedian(given)), 1.0
    unit = next((factor for factor in (100.0, 1000.0, -1.0) if abs(level / factor - 1) < 0.2), 1.0)
    digits = None if np.all(given[np.isfinite(given)] == 1) else _rounded_in_metres(given, abs(unit))
    if digits is not None:
        found.findings.append(Finding('rounded', {'digits': digits}))
    if _few_differ(found, given[..., None], right[..., None], digits, times_s):
        return found
    if unit != 1.0:
        found.findings.append(Finding({100.0: 'centimetres', 1000.0: 'millimetres', -1.0: 'negative'}[unit], {}))
        given, unit = given / unit, abs(unit)
    found.undone = given
    if len(found.findings) > (digits is not None) and _worst(given, right) <= RIGHT + _tolerance(digits, unit):
        found.explains = 1.0
        return found
    blank = _blank_times(given)
    fitted = np.where(blank[:, None], np.nan, given)
    tried = []
    for findings, remade in _speed_candidates(result, times_s, fitted, truth, positions):
        remade = remade if digits is None else np.round(remade, digits)
        same = np.isfinite(remade[np.isfinite(fitted)]).all() and _worst(fitted, remade) <= RIGHT
        tried.append((1.0 if same else share(fitted, remade, right), findings))
    best = max((one[0] for one in tried), default=0.0)
    explains, findings = next((one for one in tried if 1 - one[0] <= 2 * (1 - best) + 1e-6), (0.0, []))
    if not findings or best < EXPLAINED:
        found.findings.append(Finding('unknown', {}))
        found.explains = max(best, 0.0)
        _note_few(found, given[..., None], right[..., None], times_s)
        return found
    found.findings += [*(one._replace(explains=explains) for one in findings),
                       *([Finding('zero_times', {'t': float(times_s[blank][0])})] if blank.any() else [])]
    found.explains = explains
    return found


def _blank_times(given: Floats) -> Booleans:
    """Return at which times (T,) a difference quotient was not computed: all speeds are zero at the first or last."""
    blank = np.zeros(len(given), dtype=bool)
    blank[[0, -1]] = np.nanmax(np.abs(np.nan_to_num(given[[0, -1]])), axis=1) == 0
    blank &= np.isfinite(given).any(axis=1)
    return blank if blank.sum() < len(given) - 1 else np.zeros_like(blank)


def _speed_candidates(result: str, times_s: Floats, given: Floats, truth: TrueStates, positions: Diagnosis,
                      ) -> Iterator[tuple[list[Finding], Floats]]:
    """Yield reproduced speeds (T, 224) with their findings, ordered by number of parameters."""
    right = truth.speed_m_s
    yield [Finding('all_one', {})], np.ones_like(right)
    for order in (1, -1, None):
        moved = _ordered(right, order)
        moved = np.where(np.isnan(moved), given, moved)
        yield [Finding('rows_reversed', {}) if order is None else Finding('handles_shifted', {'by': -order})], moved
    if positions.speeds is not None and (causes := [one for one in positions.findings if one.key not in _OF_TABLES]):
        yield causes, positions.speeds
    simple = [] if result == 'result4' else list(_wound_speeds(given, truth, positions))
    yield from (([finding], remade) for finding, remade in (
        *simple, *_by_differences(result, times_s, given, right), *_differences_of_given(times_s, positions)))


def _differences_of_given(times_s: Floats, positions: Diagnosis) -> Iterator[tuple[Finding, Floats]]:
    """Yield speeds from differences between given positions at successive times."""
    p = positions.undone
    if p is None or times_s.size < _LEAST_TIMES or np.ptp(np.diff(times_s)) > RIGHT:
        return
    step_s = float(times_s[1] - times_s[0])
    moved = np.hypot(*np.moveaxis(np.diff(p, axis=0), -1, 0)) / step_s
    central = np.hypot(*np.moveaxis(p[2:] - p[:-2], -1, 0)) / (2 * step_s)
    for kind, values in (('forward', (moved, moved[-1:])), ('backward', (moved[:1], moved)),
                         ('central', (moved[:1], central, moved[-1:]))):
        yield Finding('differences', {'kind': kind, 'step': step_s}), np.concatenate(values)


def _wound_speeds(given: Floats, truth: TrueStates, positions: Diagnosis) -> Iterator[tuple[Finding, Floats]]:
    """Yield speeds on the spiral from given positions, the inverted ratio, the paper's power law and a rigid turn."""
    places = [(truth.handles_m, '')]
    if positions.undone is not None and positions.findings and np.isfinite(positions.undone).all():
        places.append((positions.undone, '_given'))
    for p, suffix in places:
        theta, off_m = _angles_of(p)
        if off_m > _ON_TRACK_M:
            continue
        if suffix:
            yield Finding('speeds_of_given', {}), mistakes.projected(theta)
        yield Finding('inverted', {}), mistakes.projected(theta, swapped=True)
        yield Finding('power_law', {}), (theta[:, :1] / theta) ** 0.02
        yield Finding('rigid_turn', {}), theta / theta[:, :1]


def _by_differences(result: str, times_s: Floats, given: Floats, right: Floats) -> Iterator[tuple[Finding, Floats]]:
    """Yield speeds from differences of positions, with a fitted time step."""
    if result == 'result2':
        times_s = np.array([contact_s()])
    scene, offset_s = turned_scene() if result == 'result4' else wound_scene()
    some = np.unique(np.linspace(0, times_s.size - 1, 16).astype(int))
    steps_s = np.array(_DIFFERENCES_S)
    moved_s = np.concatenate(([0.0], steps_s, -steps_s))[:, None] + times_s[some] + offset_s
    p = handles_at(scene, moved_s.ravel()).reshape(*moved_s.shape, -1, 2)       # nan if a step reaches beyond the lock
    now, ahead, behind = p[0], p[1:1 + steps_s.size], p[1 + steps_s.size:]
    tried = []
    for kind, moved in (('forward', ahead - now), ('backward', now - behind), ('central', 0.5 * (ahead - behind))):
        remade = np.hypot(moved[..., 0], moved[..., 1]) / steps_s[:, None, None]
        tried += [(share(given[some], each, right[some]), kind, step_s)
                  for each, step_s in zip(remade, _DIFFERENCES_S, strict=True)]
    if (best := max(tried))[0] > 0.9:
        _, kind, step_s = best
        yield Finding('differences', {'kind': kind, 'step': step_s}), mistakes.differences(
            scene, times_s + offset_s, step_s, kind)


# Answers that are a single number.
def answer_findings(question: str, value: float) -> list[Finding]:
    """Return the mistakes that lead to an answer to questions 2 to 5, to the precision of the mistake tables."""
    if question == 't_s':
        return contact_findings(value, 1.5e-6)
    answers, near = _known_answers(question)
    for answer in answers:
        if abs(answer.value - value) <= near:
            return [Finding(answer.key, dict(answer.parameters))]
    return []


@cache
def _known_answers(question: str) -> tuple[tuple[mistakes.MistakenAnswer, ...], float]:
    make, near = {'pitch_m': (mistakes.pitches_m, 6e-6), 'turn_m': (mistakes.turn_lengths_m, 6e-5),
                  'speed_m_s': (mistakes.head_speeds_m_s, 6e-5)}[question]
    return tuple(make()), near
