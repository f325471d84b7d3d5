"""Bounds that exclude contacts are rounded outwards: on random boxes, all are on the safe side of arb's balls.

Each formula is evaluated twice, in floats and in arb at 200 bits (``arb_balls``), on the same boxes.
"""
import numpy as np
import pytest
from arb_balls import each_exact, in_arb
from flint import arb
from properties import thinned

from dragon_ros.core.enclosures import ball_arithmetic, on_track
from dragon_ros.core.enclosures.on_track import kinematics, link_states, second_derivatives, views
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import gaps, placement, rounding_m

LINKS = 12


def wound(seed):
    """Return two states of a chain on circles and lines, and pairs of its benches."""
    dice = np.random.default_rng(seed)
    links, radius = dice.uniform(0.3, 3, LINKS), 10 ** dice.uniform(0.6, 4)
    k = np.full((1, LINKS + 1), dice.choice((0.0, 1.0)) / radius)
    way = 10 ** dice.uniform(-9, -1)
    states = []
    for gone in (0.0, way):
        along = gone - np.insert(np.cumsum(links * (1 + dice.choice((0, 1e-3)) * dice.random(LINKS))), 0, 0.0)
        angle = along * k[0]
        p = np.stack((np.sin(angle), -np.cos(angle)), axis=-1) * radius if k[0, 0] else np.stack(
            (along, 0 * along), axis=-1)
        p += dice.choice((0, 1e-6, 1e-3)) * dice.normal(size=p.shape)
        axis = p[:-1] - p[1:]
        heading = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
        segment = dice.integers(0, 2, LINKS + 1) if seed % 3 == 0 else np.zeros(LINKS + 1, dtype=np.int64)
        states.append((along[None], segment[None], k, heading[None], p[None],
                       (axis / np.hypot(*axis.T)[:, None])[None]))
    bends = np.array([[0, 0], [0, 0]]) * k[0, 0] + k[0, 0], np.array([[1, 1.2], [1.2, 1.5]]) * k[0, 0]
    return states, links, bends, way


@pytest.mark.parametrize('seed', thinned(range(24), lambda seed: seed % 6 == 0))
@pytest.mark.parametrize('leader', [0, -1])
def test_no_bound_of_two_benches_on_any_track_is_below_what_arb_proves(seed, leader):
    states, links, bends, way = wound(seed)
    i, j = np.triu_indices(LINKS, 2)
    row, arm = np.zeros_like(i), np.full(LINKS, 1.2)

    def evaluated():
        ends = [link_states(*handles, axis, leader) for *handles, _, axis in states]
        moving = kinematics(*ends, links, bends, leader, 2e-12)
        seen = [views(p, axis, headings, row, i, j) for *_, headings, p, axis in states]
        return second_derivatives(moving, *seen, row, i, j, np.full(i.size, way), arm)

    mine = evaluated()
    with in_arb(ball_arithmetic, on_track):
        exact = evaluated()
    for one, other in zip(mine, exact, strict=True):
        assert np.any(np.isfinite(one))
        assert np.all((one >= other) | np.isnan(other))


def arb_separations(p, half, i, j):
    """Return, in arb, the separations of benches i and j along four axes from both sides, and their signed gap."""
    def bench(n):
        (x, y), (u, v) = each_exact(p[n]), each_exact(p[n + 1])
        size = ((x - u) ** 2 + (y - v) ** 2).sqrt()
        return (x + u) / 2, (y + v) / 2, (x - u) / size, (y - v) / size, arb(float(half[n])), arb(0.15)

    def seen(a, b):
        x, y = b[0] - a[0], b[1] - a[1]
        return (x * a[2] + y * a[3], y * a[2] - x * a[3], a[2] * b[2] + a[3] * b[3], a[2] * b[3] - a[3] * b[2])

    def edges(a, b):
        x, y, c, s = seen(a, b)
        along, aside = a[4] + b[4] * abs(c) + b[5] * abs(s), a[5] + b[4] * abs(s) + b[5] * abs(c)
        return [x - along, -x - along, y - aside, -y - aside]

    def corners(a, b):
        x, y, c, s = seen(a, b)
        return [(x + m * b[4] * c - n * b[5] * s, y + m * b[4] * s + n * b[5] * c) for m in (-1, 1) for n in (-1, 1)]

    def away(a, b):
        return [(arb.max(abs(x) - a[4], arb(0)) ** 2 + arb.max(abs(y) - a[5], arb(0)) ** 2).sqrt()
                for x, y in corners(a, b)]

    one, two = bench(i), bench(j)
    separations = edges(one, two), edges(two, one)
    largest = max((*separations[0], *separations[1]), key=lambda x: float(x.mid()))
    gap = min((*away(one, two), *away(two, one)), key=lambda x: float(x.mid())) if largest > 0 else largest
    return separations, gap


@pytest.mark.parametrize('seed', range(8))
def test_separations_and_gaps_err_by_no_more_than_is_said_of_rounding(seed):
    dice = np.random.default_rng(seed)
    far = 10 ** dice.uniform(-1, 6)
    p = far * dice.uniform(-1, 1, 2) + np.cumsum(dice.normal(size=(LINKS + 1, 2)), axis=0)
    axis = p[:-1] - p[1:]
    axis = axis / np.hypot(*axis.T)[:, None]
    half = dice.uniform(0.1, 2, LINKS)
    benches = Benches(0.5 * (p[:-1] + p[1:]), axis, half, np.full(LINKS, 0.15))
    i, j = np.triu_indices(LINKS, 2)
    view, off = placement(benches, i, j), rounding_m(float(np.max(np.abs(p))), float(np.max(half)) + 0.15)
    mine, gap = (view.from_edges(), view.mirrored().from_edges()), gaps(benches, i, j)
    with in_arb():
        for n, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True)):
            edges, true = arb_separations(p, half, *pair)
            assert abs(true - arb(float(gap[n]))) < off
            for ours, theirs in zip(mine, edges, strict=True):
                assert all(abs(x - arb(float(y[n]))) < off for x, y in zip(theirs, ours, strict=True))
