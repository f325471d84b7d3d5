"""The cost of accuracy for a scene: errors and times of the paper's recipe, Newton's method, march and table.

Newton's method for a chain on a single spiral is that of common public code.
"""
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import cos, inf, nan, sin, sqrt
from typing import TYPE_CHECKING

import numpy as np

from dragon_ros.core.batches import velocity_of
from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.cost.measure import Timing, timed_in_turn

if TYPE_CHECKING:       # mpmath is an optional extra
    from dragon_ros.cost.reference import Reference

_PLACES = (1.0, 0.0, 0.5, 0.25, 0.75)       # times of the references as fractions of the run, the most important first
_STEP_S = 0.01                              # step (s) of the paper's recipe, which has no positions between steps
_MOST_HANDLES = 2_001                       # largest number of handles in a reference, counted from the head
Place = Callable[[Scene, float], Floats]     # a method: handles (m, shape (N+1, 2)) of a scene at a time (s)


def chain_by(next_angle: Callable[[float, float], float], scene: Scene, t_s: float) -> Floats:
    """Return handles (m, shape (N+1, 2)) placed by ``next_angle(theta, chord)``, with the chord in units of b."""
    b = scene.spiral.b_m
    theta = [compile_scene(scene).model.leader.place(scene.head.travelled_m(t_s)).u]
    for link in scene.dragon.link_lengths_m.tolist():
        theta.append(float(next_angle(theta[-1], link / b)))
    angle = np.array(theta)
    return np.stack((b * angle * np.cos(angle), b * angle * np.sin(angle)), axis=-1)


def cosine_rule(theta: float, outer: float, chord: float) -> float:
    """Return r1^2 + r2^2 - 2 r1 r2 cos(delta) - l^2 in units of b^2, as in the paper and most public code."""
    return theta * theta + outer * outer - 2 * theta * outer * cos(outer - theta) - chord * chord


def by_newton(tolerance: float, theta: float, chord: float) -> float:
    """Return the next angle, found with Newton's method on the cosine rule until a step is below ``tolerance`` rad."""
    outer = theta + chord / sqrt(1 + theta * theta)
    for _ in range(100):
        slope = 2 * outer - 2 * theta * cos(outer - theta) + 2 * theta * outer * sin(outer - theta)
        change = cosine_rule(theta, outer, chord) / slope
        outer -= change
        if abs(change) < tolerance:
            return outer
    return inf


NEWTON: dict[str, Place] = {f'plain Newton {name} rad': partial(chain_by, partial(by_newton, float(name)))
                             for name in ('1e-3', '1e-4', '1e-6')}


@dataclass(frozen=True)
class Solver:
    """A solver with its largest errors at any of the instants, its promise, and its time per tick.

    Errors are nan if they are unknown. A solver that does not support the scene has a note instead of a timing.
    """

    name: str
    error_m: float = nan
    speed_error_m_s: float = nan
    promise_m: float | None = None
    positions: Timing | None = None
    with_velocities: Timing | None = None
    note: str = ''


@dataclass(frozen=True)
class Accuracy:
    """All solvers, the instants (s) at which they were compared, and the number of compared handles.

    ``lack`` states why no errors are known, or is empty.
    """

    times_s: tuple[float, ...]
    handles: int
    solvers: tuple[Solver, ...]
    lack: str = ''


def measure(scene: Scene, budget_s: float, done: Callable[[str], object]) -> Accuracy:
    """Measure a scene for about ``budget_s`` seconds; ``done(what)`` is called before each part."""
    done('reference')
    times, lack = _instants(scene), _lack(scene)
    true = {} if lack else _references(scene, times, 0.3 * budget_s)
    times = list(true) or times
    found = [*_own(scene, 'paper', times, true), *_newton(scene, times, true), *_own(scene, 'march', times, true),
             *_own(scene, 'table', times, true)]
    calls = [call for _, calls in found for call in calls]
    done('time of ticks')
    spent = iter(timed_in_turn(calls, 0.5 * budget_s / max(1, len(calls)), 3))
    rows = []
    for row, of in found:
        positions, both = [*(next(spent).shared_by(len(times)) for _ in of), None, None][:2]
        rows.append(replace(row, positions=positions, with_velocities=both))
    return Accuracy(tuple(sorted(times)), min((len(one.states) for one in true.values()), default=0), tuple(rows), lack)


def _lack(scene: Scene) -> str:
    """Return why no reference can be computed for a scene, or an empty text."""
    if scene.head.lead == 'tail' and scene.dragon.benches >= _MOST_HANDLES:
        return 'the reference of a dragon this long, led by its tail, takes minutes'
    try:
        import mpmath  # noqa: F401
    except ImportError:
        return "mpmath is not installed: pip install 'dragon_ros[cost]' or pip install mpmath"
    return ''


def _references(scene: Scene, times: list[float], budget_s: float) -> dict[float, 'Reference']:
    """Return references at as many instants as the budget allows, but at least one."""
    from dragon_ros.cost.reference import reference
    began, out = time.perf_counter(), {}
    for t_s in times:
        out[t_s] = reference(scene, t_s, _MOST_HANDLES)
        if time.perf_counter() - began > budget_s:
            break
    return out


def _instants(scene: Scene) -> list[float]:
    """Return instants along the run, rounded down to steps of the paper's recipe unless the run starts later."""
    simulation = compile_scene(scene)
    start_s, stop_s = (scene.run.seconds(scene.run.time_ns(k)) for k in (0, simulation.last_tick))
    times = [start_s + part * (stop_s - start_s) for part in _PLACES]
    whole = [int(t_s / _STEP_S + 1e-9) / (1 / _STEP_S) for t_s in times]
    return list(dict.fromkeys(at if start_s <= at <= t_s else t_s for at, t_s in zip(whole, times, strict=True)))


_Found = tuple[Solver, list[Callable[[], object]]]      # a solver, and its calls that place all handles at all instants


def _own(scene: Scene, name: str, times: list[float], true: dict[float, 'Reference']) -> Iterator[_Found]:
    """Yield one of the package's solvers, unless it is the table and no table covers the scene."""
    try:
        scene = replace(scene, accuracy='exact', solver=name)
        simulation, chains = compile_scene(scene), {t_s: state(scene, t_s) for t_s in times}
    except DragonError as error:
        yield Solver(name, note=str(error.fields.get('limit', error))), []
        return
    last = chains[times[-1]]
    if name == 'table' and last.solver == 'march':
        return
    promise = None if simulation.is_paper else simulation.promise_m * max(map(conditioning, chains.values()))
    yield Solver(name, max((one.error_m(chains[t_s].p) for t_s, one in true.items()), default=nan),
                 max((one.speed_error_m_s(velocity_of(scene, chains[t_s], t_s)) for t_s, one in true.items()),
                     default=nan), promise, note=f'by {last.solver}'), [
        lambda: [state(scene, t_s) for t_s in times],
        lambda: [velocity_of(scene, state(scene, t_s), t_s) for t_s in times]]


def _newton(scene: Scene, times: list[float], true: dict[float, 'Reference']) -> Iterator[_Found]:
    """Yield plain Newton at several tolerances, which supports only one spiral on which the head leads."""
    for name, solve in NEWTON.items():
        if not isinstance(scene.track, Spiral) or scene.head.lead != 'head':
            yield Solver(name, note='requires one spiral, led by the head'), []
            continue
        with np.errstate(all='ignore'):
            handles: dict[float, Floats] = {t_s: solve(scene, t_s) for t_s in times}
        if not all(np.isfinite(one).all() for one in handles.values()):
            yield Solver(name, note='cannot place a link'), []
            continue
        yield Solver(name, max((one.error_m(handles[t_s]) for t_s, one in true.items()), default=nan)), [
            lambda solve=solve: [solve(scene, t_s) for t_s in times]]       # type: ignore[misc]
