"""``cost promises``: errors relative to promises on random chains, by solver, method and quantity.

Each scene is determined by its number alone. It has 2 to 60 links, either in groups or all equal except for the head,
on a spiral, an S-turn or a composite track. The dragon is led by the head or the tail, by the table or the
march. Chains are computed at the start, at two random times, and at two times close to the end of the model, which is
often a lock. Each chain is compared with the march, which ``cost accuracy`` compares with a 50-digit reference.
"""
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import count
from random import Random

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT, legend_below
from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.chain.dragon import AnyDragon, Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import DragonError
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.promise import speed_promise_m_s
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Piece, Spiral, SpiralArc, STurn, TrackSpec
from dragon_ros.cost.measure import circumstances

PROMISING = ('table', 'march')
WAYS = ('state', 'states', 'tick')
WHAT = ('positions', 'speeds')
_LONGEST_M = 6.0            # maximum length of a link
_LATEST_S = 100.0
_HEAD = ('solver', 'through', 'of', 'chains', 'median', 'p99', 'p999', 'largest', 'above_1', 'worst_scene')
_COLOURS = {'table': '#0072B2', 'march': '#009E73'}


def shares(scene: Scene, times_s: Sequence[float]) -> Floats:
    """Return the errors of positions and speeds, divided by the promises of the scene's solver.

    The result has the shape (times, 3, 2), where 3 stands for ``state``, ``states`` and ``tick``. Times must be whole
    nanoseconds, as ticks require.
    """
    known, scene = replace(scene, solver='march'), replace(scene, effects=Effect.VELOCITY)
    many = states(scene, times_s)
    v_many = velocity_of(scene, many, times_s)
    return np.array([_shares_at(known, scene, t_s, (many.p[n], v_many[n])) for n, t_s in enumerate(times_s)])


def _shares_at(known: Scene, scene: Scene, t_s: float, of_states: tuple[Floats, Floats]) -> list[tuple[float, float]]:
    """Return rows for ``state``, ``states`` and ``tick`` at one time."""
    reference = state(known, t_s)
    v = velocity_of(known, reference, t_s)
    simulation, condition, speed = compile_scene(scene), conditioning(reference), scene.head.speed_at_m_s(t_s)
    promise_m = simulation.promise_m * condition
    promise_m_s = speed_promise_m_s(simulation.promise_m, simulation.model.length_m / scene.dragon.benches, condition,
                                    speed)
    one, frame = state(scene, t_s), tick(replace(scene, run=Run(t_s, t_s)), 0)
    assert frame.velocity_m_s is not None
    placed = (one.p, velocity_of(scene, one, t_s)), of_states, (frame.chain.p, frame.velocity_m_s)
    return [(float(np.max(np.hypot(*(p - reference.p).T))) / promise_m,
             float(np.max(np.hypot(*(w - v).T))) / promise_m_s) for p, w in placed]


def random_scene(number: int) -> tuple[Scene, list[float]] | None:
    """Return scene ``number`` and times (s, whole nanoseconds), or None if the model rejects the scene."""
    dice = Random(number)
    try:
        scene = Scene(_dragon(dice), _track(dice), Head(1.0, dice.choice(('head', 'tail'))), Run(0, 1e3),
                      solver=dice.choice(PROMISING))
        end_s = compile_scene(scene).end.t_s
        compile_scene(scene)
    except DragonError:
        return None
    parts = [0.0, dice.random(), dice.random(), 1 - 10 ** -dice.uniform(0, 4), 1 - 10 ** -dice.uniform(4, 8)]
    times = [round(part * min(_LATEST_S, end_s), 9) for part in parts]
    return scene, [t_s if t_s <= end_s else 0.0 for t_s in times]


def _dragon(dice: Random) -> AnyDragon:
    if dice.random() < 0.5:
        return Dragon(dice.randint(2, 60), dice.uniform(0.05, _LONGEST_M), dice.uniform(0.05, _LONGEST_M), 0.05, 0.0)
    groups = [Group(dice.uniform(0.05, _LONGEST_M), dice.randint(1, 20)) for _ in range(dice.randint(1, 3))]
    if sum(group.count for group in groups) < 2:
        groups.append(Group(dice.uniform(0.05, _LONGEST_M), 1))
    return Mixed(tuple(groups), 0.05, 0.0)


def _track(dice: Random) -> TrackSpec:
    kind = dice.choice(('spiral', 'turn', 'composite'))
    if kind == 'spiral':
        return Spiral(dice.uniform(0.1, 10), dice.uniform(1, 40))
    if kind == 'turn':
        return STurn(dice.uniform(1, 3), dice.uniform(20, 30), dice.uniform(0.5, 2), dice.uniform(-30, 30))
    return Composite(tuple(_piece(dice) for _ in range(dice.randint(1, 5))))


def _piece(dice: Random) -> Piece:
    kind = dice.choice(('line', 'arc', 'spiral'))
    if kind == 'line':
        return Line(dice.uniform(0.1, 9))
    if kind == 'arc':
        return Arc(dice.uniform(3.1, 9), dice.choice((1, -1)) * dice.uniform(5, 200))
    return SpiralArc(dice.uniform(2.5, 4), dice.uniform(3, 4), dice.uniform(1.5, 2.9), dice.choice(('left', 'right')))


@dataclass(frozen=True)
class Measured:
    """The errors of M chains divided by their promises (shape (M, 3, 2)), with each chain's solver index and scene."""

    shares: Floats
    solvers: Ints
    scenes: Ints


def measure(chains: float = 1000) -> Measured:
    """Measure a number of chains; progress goes to standard error.

    An interrupt ends the measurement early and keeps the chains measured so far.
    """
    parts, done = list[Measured](), 0
    try:
        with tqdm(total=int(chains), desc='cost promises', unit='chain', disable=None, mininterval=1) as progress:
            for part in map(_measured, count()):
                parts.append(part)
                done += len(part.shares)
                progress.update(len(part.shares))
                if done >= chains:
                    break
    except KeyboardInterrupt:
        if not parts:
            raise
    return Measured(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Measured)))


def _measured(number: int) -> Measured:
    """Measure the chains of one scene; if the model rejects the scene, there are none."""
    drawn = random_scene(number)
    found = shares(*drawn) if drawn else np.empty((0, len(WAYS), len(WHAT)))
    solver = PROMISING.index(drawn[0].solver) if drawn else 0
    return Measured(found, np.full(len(found), solver), np.full(len(found), number))


def _rows(found: Measured) -> list[tuple[str | int | float, ...]]:
    """Return one row for each solver, method and quantity, with the same columns as the CSV."""
    out: list[tuple[str | int | float, ...]] = []
    for n, solver in enumerate(PROMISING):
        mine = np.flatnonzero(found.solvers == n)
        for m, way in enumerate(WAYS if mine.size else ()):
            for k, what in enumerate(WHAT):
                one = found.shares[mine, m, k]
                figures = [float(f'{x:.3g}') for x in (*np.quantile(one, (0.5, 0.99, 0.999)), np.max(one))]
                out.append((solver, way, what, one.size, *figures, int(np.sum(one > 1)),
                            int(found.scenes[mine[np.argmax(one)]])))
    return out


def table(found: Measured) -> str:
    """Return the distributions as a Markdown table, after a line that states the machine, the versions and the date."""
    head = ('| solver | through | error of | chains | median | 99 % | 99.9 % | largest | above 1 | worst scene |\n'
            '|---|---|---|---:|---:|---:|---:|---:|---:|---:|')
    lines = [f'| {solver} | {way} | {what} | {chains:,} | ' + ' | '.join(f'{share:.1e}' for share in shown)
             + f' | {above} | {number} |' for solver, way, what, chains, *shown, above, number in _rows(found)]
    return '\n'.join([f'{circumstances()}. {summary(found)} Each figure is an error divided by its promise.', '', head,
                      *lines])


def summary(found: Measured) -> str:
    """Return a sentence about the largest error."""
    above = int(np.sum(found.shares > 1))
    over = {0: 'no error exceeds its promise', 1: '1 error exceeds its promise'}.get(
        above, f'{above} errors exceed their promises')
    return (f'On {len(found.shares):,} random chains of 2 to 60 links, each computed by `state`, `states` and `tick` '
            f'at one of the solvers, the largest error is {np.max(found.shares):.2g} times its promise, and {over}.')


def picture(found: Measured) -> Figure:
    """Return a figure of the share of chains whose error / promise exceeds a value, for positions and speeds."""
    figure = Figure(figsize=(PAGE_IN, 5), layout='constrained')
    for k, (axes, what) in enumerate(zip(figure.subplots(1, 2, sharey=True), WHAT, strict=True)):
        for n, solver in enumerate(PROMISING):
            worst = np.sort(np.max(found.shares[found.solvers == n, :, k], axis=1))
            if not worst.size:
                continue
            rank = np.arange(worst.size, 0, -1) / worst.size
            keep = np.unique(np.geomspace(1, worst.size, 600).astype(np.int64))
            axes.loglog(np.maximum(worst[-keep], 1e-9), rank[-keep], color=_COLOURS[solver], label=solver)
        axes.axvline(1.0, color='black', linewidth=1)
        axes.set(title=what.capitalize(), xlabel='error / promise, the worst of state, states and tick')
        axes.grid(True, which='major', linewidth=0.4)
        legend_below(axes, 4, fontsize=TEXT_PT)
    figure.supylabel('share of chains with a larger error', fontsize=10)
    figure.supxlabel(f'{len(found.shares):,} chains; {circumstances()}', fontsize=TEXT_PT)
    return figure


def csv_text(found: Measured) -> str:
    """Return the distributions as CSV."""
    return csv_of(_HEAD, _rows(found))
