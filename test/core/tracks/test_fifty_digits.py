"""Random composite tracks, long and short, near and far, agree with the code of the reference data at 60 digits."""
import importlib
from dataclasses import replace
from math import exp, log
from random import Random

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import Arc, Composite, Line, SpiralArc

SCENES, LATEST_S = 12, 1e5


@pytest.fixture(scope='module')
def walk():
    return importlib.import_module('hard_cases.make_reference')


def between(dice, low, high):
    """Return a number between two limits, with equal probability for each order of magnitude."""
    return exp(log(low) + dice.random() * (log(high) - log(low)))


def piece(dice, link_m):
    """Return a line, an arc or a spiral of up to 200 turns."""
    kind = dice.random()
    if kind < 0.35:
        return Line(between(dice, 1e-3, 30) * link_m)
    if kind < 0.7:
        turn = 1 if dice.random() < 0.5 else -1
        return Arc(between(dice, 0.52, 1e3) * link_m, turn * between(dice, 1.0, 700.0))
    return SpiralArc(between(dice, 0.1, 3) * link_m, between(dice, 2, 200), between(dice, 2, 200),
                     'left' if dice.random() < 0.5 else 'right')


def scene_of(seed):
    """Return a dragon of 4 benches, scaled to some size, at the end of a composite track or within it."""
    dice = Random(seed)
    size = 10.0**(int(3 * dice.random()) - 1)
    track = Composite(tuple(piece(dice, 1.65 * size) for _ in range(1 + int(4 * dice.random()))))
    lead, share = 'head' if dice.random() < 0.6 else 'tail', 1.0 if dice.random() < 0.3 else dice.random()
    dragon = Dragon(4, 2.2 * size, 2.2 * size, 0.3 * size, 0.275 * size)
    return Scene(dragon=dragon, track=replace(track, start_m=share * track_of(track).end_m), head=Head(size, lead),
                 run=Run(0, LATEST_S))


@pytest.mark.parametrize('part', thinned(range(17), lambda part: part == 0))
def test_on_any_joined_track_every_handle_is_where_sixty_digits_put_it(walk, part):
    compared = 0
    for seed in range(part * SCENES, (part + 1) * SCENES):
        try:
            scene = scene_of(seed)
            end_s = min(compile_scene(scene).end.t_s, LATEST_S)
        except FieldError:          # a bend is too tight, or the start is too early
            continue
        times_s = [end_s * share for share in (0.0, 0.37, 1.0)]
        for t_s, at_once in zip(times_s, states(scene, times_s).p, strict=True):
            with walk.mp.workdps(60):
                try:
                    points = [point for point, _ in walk.chain_at(scene, t_s)]
                except (AssertionError, IndexError):      # ends of tracks and double roots are not supported
                    continue
                off_m = [float(abs(walk.mpc(*p.tolist()) - point)) for handles in (state(scene, t_s).p, at_once)
                         for p, point in zip(handles, points, strict=True)]
            assert np.max(off_m) <= compile_scene(scene).promise_m, (seed, t_s)
            compared += 1
    assert compared > SCENES
