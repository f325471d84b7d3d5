"""The cost of accuracy for a scene: the errors and times of the paper's recipe, of simple solvers, march and table."""
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import nan

import numpy as np

from dragon_ros.core.batches import velocity_of
from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.cost.baselines import SIMPLE
from dragon_ros.cost.measure import Timing, timed_in_turn
from dragon_ros.cost.reference import Reference, reference

_PLACES = (1.0, 0.0, 0.5, 0.25, 0.75)       # times of the references as fractions of the run, the most important first
_STEP_S = 0.01                              # step (s) of the paper's recipe, which has no positions between steps
_MOST_HANDLES = 20_001                      # largest number of handles in a reference, counted from the head


@dataclass(frozen=True)
class Solver:
    """A solver with its largest error at any of the instants, its promise, and its time per tick.

    ``error_m`` is nan if there is no reference. A solver that does not support the scene has a note instead of a
    timing.
    """

    name: str
    error_m: float
    speed_error_m_s: float
    promise_m: float | None
    positions: Timing | None
    with_velocities: Timing | None
    note: str = ''


@dataclass(frozen=True)
class Accuracy:
    """All solvers, the instants (s) at which they were compared, and the number of compared handles."""

    times_s: tuple[float, ...]
    handles: int
    solvers: tuple[Solver, ...]


@dataclass(frozen=True)
class _TimedSolver:
    """A solver with its errors, and the calls to be timed: positions at every instant, without and with velocities."""

    row: Solver
    calls: tuple[Callable[[], None], ...] = ()

    def timed(self, spent: Iterator[Timing], count: int) -> Solver:
        """Return the solver with the times of its calls; each call covers ``count`` instants."""
        positions, both = [*(next(spent).shared_by(count) for _ in self.calls), None, None][:2]
        return replace(self.row, positions=positions, with_velocities=both)


def measure(scene: Scene, budget_s: float, done: Callable[[str], object]) -> Accuracy:
    """Measure a scene for about ``budget_s`` seconds; ``done(what)`` is called before each part."""
    done('reference')
    known = _references(scene, 0.3 * budget_s)
    ways = list(_ways(scene, known, done))
    calls = [call for way in ways for call in way.calls]
    done('time of ticks')
    spent = iter(timed_in_turn(calls, 0.5 * budget_s / max(1, len(calls)), 3))
    rows = [way.timed(spent, len(known)) for way in ways]
    handles = min((len(one.high) for one in known.values() if one), default=0)
    return Accuracy(tuple(sorted(known)), handles, tuple(rows))


def _references(scene: Scene, budget_s: float) -> dict[float, Reference | None]:
    """Return references at as many instants along the run as the budget allows, but at least one.

    The references of a long dragon led by its tail are None: they would take minutes, because the position of the head
    depends on every link.
    """
    times, began = _instants(scene), time.perf_counter()
    out: dict[float, Reference | None] = {}
    for t_s in times:
        if scene.head.lead == 'tail' and scene.dragon.benches >= _MOST_HANDLES:
            return dict.fromkeys(times)
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


def _ways(scene: Scene, known: dict[float, Reference | None], done: Callable[[str], object]) -> Iterator[_TimedSolver]:
    """Yield the paper's recipe, the simple solvers, the march and the table, each with its errors."""
    done('paper')
    yield from _own(scene, 'paper', known)
    for simple in SIMPLE:
        done(simple)
        yield _simple(scene, simple, known)
    for name in ('march', 'table'):
        done(name)
        yield from _own(scene, name, known)


def _own(scene: Scene, solver: str, known: dict[float, Reference | None]) -> Iterator[_TimedSolver]:
    """Yield one of the package's solvers, unless it is the table and no table covers the scene."""
    try:
        way = _way(replace(scene, accuracy='exact', solver=solver), solver, known)
    except DragonError as error:
        yield _absent(solver, str(error.fields.get('limit', error)))
        return
    if solver != 'table' or way.row.note != 'by march':
        yield way


def _way(scene: Scene, name: str, known: dict[float, Reference | None]) -> _TimedSolver:
    """Return a solver with its errors and the calls to be timed."""
    simulation = compile_scene(scene)
    error_m = error_m_s = 0.0
    worst = 1.0
    for t_s, true in known.items():
        chain = state(scene, t_s)
        velocity = velocity_of(scene, chain, t_s)
        error_m = max(error_m, true.error_m(chain.p)) if true else nan
        error_m_s = max(error_m_s, true.speed_error_m_s(velocity)) if true else nan
        worst = worst if simulation.is_paper else max(worst, conditioning(chain))
    promise = None if simulation.is_paper else simulation.promise_m * worst
    row = Solver(name, error_m, error_m_s, promise, None, None, f'by {chain.solver}')
    times_s = tuple(known)
    calls = tuple(partial(_place, scene, times_s, velocities) for velocities in (False, True))
    return _TimedSolver(row, calls)


def _place(scene: Scene, times_s: Sequence[float], velocities: bool) -> None:
    """Place all handles at every instant."""
    for t_s in times_s:
        chain = state(scene, t_s)
        if velocities:
            velocity_of(scene, chain, t_s)


def _simple(scene: Scene, name: str, known: dict[float, Reference | None]) -> _TimedSolver:
    """Return a simple solver with its error and the call to be timed.

    Simple solvers support only a dragon that is led by its head on a single spiral.
    """
    if not isinstance(scene.track, Spiral) or scene.head.lead != 'head':
        return _absent(name, 'requires one spiral, led by the head')
    solve, error_m = SIMPLE[name], 0.0
    try:
        with np.errstate(all='ignore'):
            for t_s, true in known.items():
                error_m = max(error_m, true.error_m(_finite(solve(scene, t_s)))) if true else nan
    except ArithmeticError:
        return _absent(name, 'cannot place a link')
    return _TimedSolver(Solver(name, error_m, nan, None, None, None), (partial(_solve_all, name, scene, tuple(known)),))


def _finite(handles_m: Floats) -> Floats:
    if not np.all(np.isfinite(handles_m)):
        raise ArithmeticError
    return handles_m


def _solve_all(name: str, scene: Scene, times_s: Sequence[float]) -> None:
    for t_s in times_s:
        SIMPLE[name](scene, t_s)


def _absent(name: str, why: str) -> _TimedSolver:
    return _TimedSolver(Solver(name, nan, nan, None, None, None, why))
