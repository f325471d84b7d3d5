"""The cost of accuracy, effects, contact and bags for one scene on this machine, as values and as text."""
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.errors import DragonError, FieldError
from dragon_ros.core.flags import known
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.words import counted
from dragon_ros.cost import accuracy, bags
from dragon_ros.cost.accuracy import Accuracy, Solver
from dragon_ros.cost.bags import BagCost
from dragon_ros.cost.effects import Price, price
from dragon_ros.cost.measure import Timing, circumstances

_NONE = '-'


@dataclass(frozen=True)
class SearchCost:
    """The cost of a search: its time, its number of states, whether it completed, and its result as text."""

    elapsed_s: float
    states: int
    complete: bool
    found: str


class _OutOfTimeError(Exception):
    """The search has exceeded its budget."""


def search(scene: Scene, budget_s: float) -> SearchCost:
    """Search for the first contact, and stop the search after about ``budget_s`` seconds."""
    began, states = time.perf_counter(), 0

    def count(more: int) -> None:
        nonlocal states
        states += more
        if time.perf_counter() - began > budget_s:
            raise _OutOfTimeError
    complete = True
    try:
        found = first_contact(scene, count)
        states, said = found.states, _said(found)
        if not found.certificate.complete:
            said += ', without a certificate'
    except _OutOfTimeError:
        complete, said = False, f'stopped after {budget_s:g} s without a result; give a longer --budget'
    except DragonError as error:
        complete, said = False, str(error)
    return SearchCost(time.perf_counter() - began, states, complete, said)


def _said(found: Contact | NoContact) -> str:
    if isinstance(found, Contact):
        return f'contact at {found.t_s:.12g} s, {found.between}'
    return f'no contact; {found.end.words} at {found.end.t_s:.9f} s'


@dataclass(frozen=True)
class Costs:
    """All measurements of a scene, and a description of the machine."""

    scene: str
    benches: int
    ticks: int
    start_s: float
    stop_s: float
    rate_hz: float
    effects: tuple[str, ...]
    accuracy: Accuracy
    prices: tuple[Price, ...]
    contact: SearchCost
    bags: tuple[BagCost, ...]
    machine: str


def measure(scene: Scene, name: str, budget_s: float, done: Callable[[str], object]) -> Costs:
    """Measure each of the four parts for about ``budget_s`` seconds; ``done(what)`` is called before each step.

    Raises FieldError for a led dragon.
    """
    if isinstance(scene.head, Commanded):
        raise FieldError('head.kind', 'commanded', 'the speeds of a led dragon are known only from a recorded run',
                         'measure the scene at a constant speed: --set head.kind=constant')
    solvers = accuracy.measure(scene, budget_s, done)
    prices = []
    for effect in known().values():
        done(effect.names[0])
        prices.append(price(effect, scene, budget_s / len(known())))
    done('contact')
    found = search(scene, budget_s)
    written = bags.measure(scene, budget_s, done)
    last = compile_scene(scene).last_tick
    start_s, stop_s = (scene.run.seconds(scene.run.time_ns(k)) for k in (0, last))
    return Costs(name, scene.dragon.benches, last + 1, start_s, stop_s, scene.run.rate_hz, tuple(scene.effects.names),
                 solvers, tuple(prices), found, written, circumstances())


def values_of(costs: Costs) -> dict[str, Any]:
    """Return all figures as plain values in seconds, metres and bytes; missing values are None."""
    return {
        'scene': costs.scene, 'benches': costs.benches, 'ticks': costs.ticks, 'start_s': costs.start_s,
        'stop_s': costs.stop_s, 'rate_hz': costs.rate_hz, 'machine': costs.machine,
        'accuracy': {'times_s': list(costs.accuracy.times_s), 'handles': costs.accuracy.handles,
                     'solvers': [_solver_values(row) for row in costs.accuracy.solvers]},
        'effects': [{'effect': row.effect, 'in_scene': row.effect in costs.effects, 'bytes': row.size,
                     'tick_s': _seconds(row.timing)} for row in costs.prices],
        'contact': asdict(costs.contact),
        'bags': [asdict(row) | {'ticks_per_s': row.ticks_per_s, 'bytes_per_tick': row.bytes_per_tick,
                                'share': row.share} for row in costs.bags]}


def _solver_values(row: Solver) -> dict[str, Any]:
    figures = {'error_m': row.error_m, 'speed_error_m_s': row.speed_error_m_s, 'promise_m': row.promise_m}
    return {'solver': row.name,
            **{name: value if value is not None and isfinite(value) else None for name, value in figures.items()},
            'tick_s': _seconds(row.positions), 'tick_with_velocities_s': _seconds(row.with_velocities),
            'note': row.note}


def _seconds(timing: Timing | None) -> float | None:
    return timing.median_s if timing else None


def text_of(costs: Costs) -> str:
    """Return the tables as text."""
    head = (f'{costs.scene}: {counted(costs.benches, "bench", form=",")}, '
            f'{counted(costs.ticks, "tick", form=",")} from {costs.start_s:g} to {costs.stop_s:g} s '
            f'at {costs.rate_hz:g} Hz\n{costs.machine}')
    return '\n\n'.join([head, _accuracy_text(costs.accuracy), _effects_text(costs), _contact_text(costs.contact),
                        _bags_text(costs.bags)])


def _accuracy_text(found: Accuracy) -> str:
    times = ', '.join(f'{t_s:g}' for t_s in found.times_s)
    title = (f'Accuracy: largest errors of {found.handles:,} handles at {times} s' if found.handles else
             f'Accuracy at {times} s; no errors: {found.lack}')
    rows = [(row.name, _figure(row.error_m), _figure(row.promise_m), _figure(row.speed_error_m_s), _us(row.positions),
             _us(row.with_velocities), row.note) for row in found.solvers]
    head = 'solver', 'error (m)', 'promise (m)', 'speed (m/s)', 'µs per tick', 'with velocities', ''
    return _table(title, head, rows)


def _effects_text(costs: Costs) -> str:
    rows = [(row.effect, 'yes' if row.effect in costs.effects else '', _us(row.timing), f'{row.size:,}')
            for row in costs.prices]
    return _table('Effects: time per tick to compute and encode each effect',
                  ('effect', 'in the scene', 'µs per tick', 'bytes per tick'), rows)


def _contact_text(found: SearchCost) -> str:
    return f'First contact: {found.found} ({counted(found.states, "state", form=",")} in {found.elapsed_s:.3g} s)'


def _bags_text(found: Sequence[BagCost]) -> str:
    rows = [(row.compression, f'{row.bytes_per_tick:,.0f}', f'{row.share:.1%}', f'{row.ticks_per_s:,.0f}',
             f'{row.ticks:,}') for row in found]
    return _table('Bags: computed, encoded and written',
                  ('compression', 'bytes per tick', 'of the messages', 'ticks per s', 'ticks'), rows)


def _table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as text; the first column and the notes are left-aligned, and the figures are right-aligned."""
    lines = [tuple(head), *map(tuple, rows)]
    widths = [max(len(line[n]) for line in lines) for n in range(len(head))]
    left = {0, *(n for n, name in enumerate(head) if not name)}
    cells = [[cell.ljust(width) if n in left else cell.rjust(width)
              for n, (cell, width) in enumerate(zip(line, widths, strict=True))] for line in lines]
    return '\n'.join([title, *(('  ' + '  '.join(line)).rstrip() for line in cells)])


def _figure(value: float | None) -> str:
    return f'{value:.1e}' if value is not None and isfinite(value) else _NONE


def _us(timing: Timing | None) -> str:
    return f'{timing.median_s * 1e6:,.3g}' if timing and timing.median_s < 1e-3 else (
        f'{timing.median_s * 1e6:,.0f}' if timing else _NONE)
