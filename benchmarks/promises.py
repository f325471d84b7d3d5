"""``cost promises``: errors relative to promises on random chains, by solver, method and quantity.

Each scene is determined by its number alone and is drawn from the whole world (``core.domain``): links, pitches and
radii of any size, 1 to 60 links, in groups or all equal except for the head, on a spiral, an S-turn or a composite
track, led by the head or the tail at any speed, by the table or the march. Chains are computed at the start, at two
random times, and at two times close to the end of the model, which is often a lock, and compared with 40 digits.
"""
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import count
from math import exp, log, pi
from random import Random

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT, legend_below
from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.chain import conditioning, lag
from dragon_ros.core.chain.commanded import HeadLaw
from dragon_ros.core.chain.dragon import AnyDragon, Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.domain import LINK, PIECES, PITCH, RADIUS, SPEED, TRACK
from dragon_ros.core.errors import DragonError
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Piece, Spiral, SpiralArc, STurn, TrackSpec
from dragon_ros.cost.measure import circumstances
from dragon_ros.cost.reference import NoReference, reference

PROMISING = ('table', 'march')
WAYS = ('state', 'states', 'tick')
WHAT = ('positions', 'speeds')
_MOST_LINKS = 60
_FARTHEST_M = 9e3           # largest radius of a drawn spiral
_LONGEST_M = 3e3            # largest length of a line or an arc
_LATEST_S = 1e4
_HEAD = ('solver', 'through', 'of', 'chains', 'median', 'p99', 'p999', 'largest', 'above_1', 'worst_scene')
_COLOURS = {'table': '#0072B2', 'march': '#009E73'}


def shares(scene: Scene, times_s: Sequence[float]) -> Floats:
    """Return the errors of positions and speeds, divided by the promises of the scene's solver.

    The result has the shape (times, 3, 2), where 3 stands for ``state``, ``states`` and ``tick``. Times must be whole
    nanoseconds, as ticks require. Raises NoReference if a link cannot be placed with 40 digits.
    """
    scene = replace(scene, effects=Effect.VELOCITY)
    many = states(scene, times_s)
    v_many = velocity_of(scene, many, times_s)
    return np.array([_shares_at(scene, t_s, (many.p[n], v_many[n])) for n, t_s in enumerate(times_s)])


def _shares_at(scene: Scene, t_s: float, of_states: tuple[Floats, Floats]) -> list[tuple[float, float]]:
    """Return rows for ``state``, ``states`` and ``tick`` at one time."""
    true, one, frame = reference(scene, t_s), state(scene, t_s), tick(replace(scene, run=Run(t_s, t_s)), 0)
    simulation, condition, speed = compile_scene(scene), conditioning(one), scene.head.speed_at_m_s(t_s)
    promise_m = simulation.promise_m * condition
    promise_m_s = simulation.speed_promise(condition, lag(one)) * abs(speed)
    assert frame.velocity_m_s is not None
    placed = (one.p, velocity_of(scene, one, t_s)), of_states, (frame.chain.p, frame.velocity_m_s)
    return [(true.error_m(p) / promise_m, true.speed_error_m_s(v) / promise_m_s) for p, v in placed]


def random_scene(number: int) -> tuple[Scene, list[float]] | None:
    """Return scene ``number`` and times (s, whole nanoseconds), or None if the world or the model rejects the scene."""
    dice = Random(number)
    try:
        dragon = _dragon(dice)
        scene = Scene(dragon, _track(dice, float(np.max(dragon.link_lengths_m))), _law(dice), Run(0, _LATEST_S),
                      solver=dice.choice(PROMISING))
        end_s = compile_scene(scene).end.t_s
    except DragonError:
        return None
    parts = [0.0, dice.random(), dice.random(), 1 - 10 ** -dice.uniform(0, 4), 1 - 10 ** -dice.uniform(4, 8)]
    times = [round(part * end_s, 9) for part in parts]
    return scene, [t_s if t_s <= end_s else 0.0 for t_s in times]


def _between(dice: Random, low: float, high: float) -> float:
    """Return a number whose logarithm is evenly distributed."""
    return exp(dice.uniform(log(low), log(high)))


def _dragon(dice: Random) -> AnyDragon:
    link_m = _between(dice, LINK.low, LINK.high)

    def near() -> float:
        return min(max(link_m * _between(dice, 0.3, 3), LINK.low), LINK.high)
    if dice.random() < 0.5:
        return Dragon(dice.randint(1, _MOST_LINKS), near(), link_m, 0.05, 0.0)
    return Mixed(tuple(Group(near(), dice.randint(1, 20)) for _ in range(dice.randint(1, 3))), 0.05, 0.0)


def _track(dice: Random, link_m: float) -> TrackSpec:
    """Draw a track for links up to a length."""
    kind = dice.choice(('spiral', 'turn', 'composite'))
    if kind == 'spiral':
        return Spiral(*_spiral(dice, link_m))
    if kind == 'turn':
        return STurn(_between(dice, PITCH.low, PITCH.high), _between(dice, 4 * link_m, 5e3), dice.uniform(0.5, 2),
                     dice.choice((1, -1)) * _between(dice, 0.1, 1e3))
    most = PIECES.high if dice.random() < 0.1 else 6
    track = Composite(tuple(_piece(dice, link_m) for _ in range(round(_between(dice, 1, most)))))
    alone = Scene(Dragon(1, LINK.low, LINK.low, 0.01, 0.0), track, run=Run(0, 0))
    return replace(track, start_m=dice.uniform(0, compile_scene(alone).model.track.end_m))


def _spiral(dice: Random, link_m: float) -> tuple[float, float]:
    """Draw the pitch and the outer end, in turns, of a spiral."""
    pitch_m = _between(dice, PITCH.low, PITCH.high)
    most = min((TRACK.high / (pi * pitch_m)) ** 0.5, _FARTHEST_M / pitch_m)
    return pitch_m, _between(dice, min(0.5 * most, 0.6 + link_m / pitch_m), most)


def _piece(dice: Random, link_m: float) -> Piece:
    kind = dice.choice(('line', 'line', 'arc', 'arc', 'spiral'))
    if kind == 'line':
        return Line(_between(dice, 0.1 * link_m, _LONGEST_M))
    if kind == 'arc':
        radius_m = _between(dice, max(RADIUS.low, 0.52 * link_m), RADIUS.high if dice.random() < 0.2 else 2e3)
        return Arc(radius_m, dice.choice((1, -1)) * min(_between(dice, 1, 800), 180 / pi * _LONGEST_M / radius_m))
    pitch_m, turns = _spiral(dice, link_m)
    return SpiralArc(pitch_m, turns, turns * dice.uniform(0.7, 1.3), dice.choice(('left', 'right')))


def _law(dice: Random) -> HeadLaw:
    lead, speed_m_s = dice.choice(('head', 'head', 'tail')), dice.choice((1, 1, -1)) * _between(dice, 0.01, SPEED.high)
    if dice.random() < 0.7:
        return Head(speed_m_s, lead)
    times_s = np.cumsum([_between(dice, 0.1, 100) for _ in range(dice.randint(1, 5))]).tolist()
    return Profile(((0.0, speed_m_s), *((t_s, speed_m_s * dice.uniform(-0.5, 1)) for t_s in times_s)),
                   dice.choice(('linear', 'smooth')), lead)


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
    """Measure the chains of one scene; there are none if it is rejected, or if a handle is at the track's very end."""
    drawn, found = random_scene(number), np.empty((0, len(WAYS), len(WHAT)))
    if drawn:
        with suppress(NoReference):
            found = shares(*drawn)
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
    return (f'On {len(found.shares):,} random chains of the world, each computed by `state`, `states` and `tick` '
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
