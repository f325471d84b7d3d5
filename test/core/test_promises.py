"""Promises hold for random chains of the whole world, through state, states and tick, with and without a table.

The long form of these tests is ``./dragon cost promises --chains 20000``, which compares chains with 40 digits, too.
"""
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from mpmath import mp, mpf
from properties import thinned

from benchmarks import promises
from benchmarks.promises import measure, random_scene, shares, table
from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, SpiralArc


@pytest.mark.parametrize('first', thinned(range(0, 1000, 20), lambda first: first == 0))
def test_random_chains_of_the_world_keep_their_promise_through_state_states_and_tick(first):
    found = [promises._measured(number) for number in range(first, first + 20)]
    worst = max((float(np.max(one.shares)), int(one.scenes[0])) for one in found if one.shares.size)
    assert sum(len(one.shares) for one in found) >= 60
    assert worst <= (1, first + 20)


@pytest.mark.parametrize('number', [191, 312])
def test_speeds_near_the_lock_of_a_tightly_wound_spiral_keep_their_promise(number):
    """Once a link is almost a diameter, its rear handle slows down and turns back within less than a pitch."""
    scene, times_s = random_scene(number)
    assert scene.track.pitch_m < 0.04 * float(np.mean(scene.dragon.link_lengths_m))
    assert np.max(shares(scene, times_s)) < 0.5


@pytest.mark.parametrize('pieces', [
    (SpiralArc(0.01, 5600.3 + 4 / 7, 5600.0 + 4 / 9, 'left'), Line(3000.0)), (Arc(0.1, 1e6), Line(3000.0)),
    (Arc(158.3, 359.9),) * 1000, (Line(901.23), Arc(7.7, 180.0), Line(901.23), Arc(7.7, -180.0)) * 250],
    ids=['spiral', 'arc', 'circles', 'hairpins'])
def test_a_track_ends_where_exact_arithmetic_puts_it_after_many_turns_and_pieces(pieces):
    """If whole turns were left in, or roundings of pieces added up, the end would be 6 to 19 promises off."""
    dragon, track = Dragon(3, 0.1, 0.1, 0.01, 0.0), Composite(pieces)
    end_m = compile_scene(Scene(dragon, track, run=Run(0, 1))).model.track.end_m
    scene = Scene(dragon, replace(track, start_m=end_m - 1.0), run=Run(0, 1))
    assert np.max(shares(scene, [0.0])[..., 0]) < 0.3


@pytest.mark.parametrize(('radius_m', 'links_m'), thinned(
    [(3000.0, (0.07,)), (3000.0, (0.05, 0.07)), (inf, (0.07,)), (inf, (0.05, 0.07))], lambda case: case[0] < inf))
def test_equal_roundings_of_many_links_on_an_arc_or_a_line_do_not_add_up(radius_m, links_m):
    """The tail of 20,000 links is compared with exact arithmetic; without Kahan's summation, it is 4 promises off."""
    count, start_m = 10_000 // len(links_m), 1500.0
    track = Composite((Line(9e3),) if radius_m == inf else (Arc(radius_m, 90.0),), start_m)
    dragon = Mixed(tuple(Group(length) for length in links_m) * (2 * count), 0.01, 0.0)
    model = compile_scene(Scene(dragon, track, run=Run(0, 0))).model
    with mp.workdps(40):
        spans = [mpf(link) if radius_m == inf else 2 * mp.asin(mpf(link) / (2 * radius_m)) for link in links_m]
        u = mpf(start_m) / (1 if radius_m == inf else radius_m) - 2 * count * sum(spans)
        tail = (u, 0) if radius_m == inf else (radius_m * mp.sin(u), radius_m * (1 - mp.cos(u)))
    promise_m = compile_scene(Scene(dragon, track, run=Run(0, 0))).promise_m
    for chain in (model.march(0.0), marched_many(model.track, model.links_m, model.leader.places(np.zeros(3)), BEHIND)):
        assert np.max(np.hypot(*(chain.p[..., -1, :] - np.array(tail, dtype=float)).T)) < 0.1 * promise_m


def test_an_interrupted_long_run_tells_of_the_chains_that_are_done(monkeypatch):
    parts = [promises._measured(number) for number in (5, 8)]
    measured = iter(parts)

    def interrupted(number):
        try:
            return next(measured)
        except StopIteration:
            raise KeyboardInterrupt from None
    monkeypatch.setattr(promises, '_measured', interrupted)
    found = measure(1e9)
    assert len(found.shares) == 10
    assert '10 random chains' in table(found)
