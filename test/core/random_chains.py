"""Random chains from the whole world, compared with 40 digits: errors divided by promises.

Run as a script for many chains: ``./dragon python test/core/random_chains.py 20000 [FIRST_SEED]``.
"""
import sys
from dataclasses import replace
from math import log, pi
from pathlib import Path
from random import Random

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from dragon_ros.core.batches import states
from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.domain import LINK, PITCH, RADIUS, SPEED, TRACK
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.cost.reference import reference

MOST_BENCHES = 40


def between(dice, low, high):
    """Return a number whose logarithm is evenly distributed."""
    return float(np.exp(dice.uniform(log(low), log(high))))


def dragon_of(dice):
    """Return a dragon of links of any length in the world, equal or not."""
    benches, link_m = dice.randint(1, MOST_BENCHES), between(dice, LINK.low, LINK.high)

    def near():
        return min(max(link_m * between(dice, 0.3, 3), LINK.low), LINK.high)
    if dice.random() < 0.6:
        return Dragon(benches, near(), link_m, 0.01, 0.0)
    return Mixed(tuple(Group(near(), dice.randint(1, 12)) for _ in range(dice.randint(1, 4))), 0.01, 0.0)


def spiral_of(dice, link_m):
    pitch_m = between(dice, PITCH.low, PITCH.high)
    most = min((TRACK.high / (pi * pitch_m)) ** 0.5, 9e3 / pitch_m)
    return pitch_m, between(dice, min(0.5 * most, 0.6 + link_m / pitch_m), most)


def piece_of(dice, link_m):
    kind = dice.choice(('line', 'line', 'arc', 'arc', 'spiral'))
    if kind == 'line':
        return Line(between(dice, 0.1 * link_m, 3e3))
    if kind == 'arc':
        radius_m = between(dice, max(RADIUS.low, 0.52 * link_m), RADIUS.high if dice.random() < 0.2 else 2e3)
        return Arc(radius_m, dice.choice((1, -1)) * min(between(dice, 1, 800), 180 / pi * 3e3 / radius_m))
    pitch_m, turns = spiral_of(dice, link_m)
    return SpiralArc(pitch_m, turns, turns * dice.uniform(0.7, 1.3), dice.choice(('left', 'right')))


def track_of(dice, link_m):
    kind = dice.choice(('spiral', 'spiral', 'turn', 'composite', 'composite'))
    if kind == 'spiral':
        return Spiral(*spiral_of(dice, link_m))
    if kind == 'turn':
        return STurn(between(dice, PITCH.low, PITCH.high), between(dice, 4 * link_m, 5e3), dice.uniform(0.5, 2),
                     dice.choice((1, -1)) * between(dice, 0.1, 1e3))
    track = Composite(tuple(piece_of(dice, link_m) for _ in range(dice.randint(1, 6))))
    return replace(track, start_m=dice.uniform(0, sum_m(track)))


def sum_m(track):
    return compile_scene(Scene(Dragon(1, LINK.low, LINK.low, 0.01, 0.0), track, run=Run(0, 0))).model.track.end_m


def law_of(dice):
    lead, speed = dice.choice(('head', 'head', 'tail')), dice.choice((1, 1, -1)) * between(dice, 0.01, SPEED.high)
    if dice.random() < 0.7:
        return Head(speed, lead)
    times = np.cumsum([between(dice, 0.1, 100) for _ in range(dice.randint(1, 5))]).tolist()
    return Profile(((0.0, speed), *((t_s, speed * dice.uniform(-0.5, 1)) for t_s in times)),
                   dice.choice(('linear', 'smooth')), lead)


def random_chain(seed):
    """Return a scene and a time, or None if the world or the model rejects them."""
    dice = Random(seed)
    try:
        dragon = dragon_of(dice)
        scene = Scene(dragon, track_of(dice, float(np.max(dragon.link_lengths_m))), law_of(dice))
        t_s = dice.choice((0.0, between(dice, 0.1, 1e4), 1e3))
        scene = replace(scene, run=Run(0, t_s))
        return scene, min(t_s, compile_scene(scene).end.t_s)
    except DragonError:
        return None


def share(scene, t_s):
    """Return the largest error of any handle, placed by table and march, alone and with others, over the promise."""
    true, out = reference(scene, t_s), 0.0
    for solver in ('table', 'march'):
        one = replace(scene, solver=solver)
        alone, promise_m = state(one, t_s), compile_scene(one).promise_m
        for p in (alone.p, states(one, [t_s, 0.0]).p[0]):
            out = max(out, true.error_m(p) / (promise_m * conditioning(alone)))
    return out


def measured(seeds):
    """Yield (share, seed) for each seed whose scene the model accepts, unless a handle is at the track's very end."""
    for seed in seeds:
        try:
            if drawn := random_chain(seed):
                yield share(*drawn), seed
        except DragonError as error:
            if 'the reference cannot place a link' not in str(error):
                raise


if __name__ == '__main__':
    count, first = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    found = []
    for one in measured(range(first, first + 10 * count)):
        found.append(one)
        if one[0] > 1 or len(found) % 1000 == 0:
            print(len(found), 'chains; latest', one, '; largest', max(found), flush=True)
        if len(found) >= count:
            break
    shares = np.array([one for one, _ in found])
    print(f'{len(found)} chains; above 1: {np.sum(shares > 1)}; median {np.median(shares):.3f}; largest {max(found)}')
