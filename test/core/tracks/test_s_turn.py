"""The contest's turn is symmetric, smooth, and within its circle."""
import cmath
from fractions import Fraction
from itertools import pairwise
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import STurn

TURNING = Scene(track=STurn(before_m=100.0), run=Run(0, 200))


def test_the_turn_is_centrally_symmetric_and_joins_without_a_kink():
    track = track_of(STurn())
    for k, (one, two) in enumerate(pairwise(track.segments)):
        assert abs(one.at(one.last) - two.at(two.first)) < 1e-14, k
        assert abs(one.heading(one.last) - two.heading(two.first)) < 1e-14, k
    for metres in (0.0, 1.0, 50.0):
        (k, u), (n, v) = track.place_at(-metres), track.place_at(STurn().length_m + metres)
        assert complex(track.segments[k].at(u)) == pytest.approx(-complex(track.segments[n].at(v)), abs=1e-13)


@given(st.floats(0.3, 2.1))
def test_the_turn_stays_within_its_circle(ratio):
    track = track_of(STurn(ratio=ratio))
    for metres in np.linspace(0.0, STurn().length_m, 200):
        k, u = track.place_at(float(metres))
        assert abs(complex(track.segments[k].at(u))) <= 4.5 * (1 + 1e-15)


def test_the_contests_turn_has_the_contests_places():
    chain = state(TURNING, 0.0)
    np.testing.assert_allclose(chain.p[0], (7.778034, 3.717164), atol=5e-7)
    np.testing.assert_allclose(state(TURNING, 100.0).p[0], (-2.711856, -3.591078), atol=5e-7)


NARROW = STurn(0.1, 39.9, before_m=30.0)     # the turn begins after 199.5 turns of the spiral


@pytest.mark.parametrize('after', [0, 1])
def test_entry_and_exit_are_where_whole_turns_leave_them(after):
    turned = 2 * pi * float(Fraction(39.9) / 2 / Fraction(0.1) % 1)
    there = NARROW.radius_m * cmath.rect(1.0, turned) * (-1 if after else 1)
    scene = Scene(Dragon(3), NARROW)
    head = state(scene, NARROW.before_m + after * NARROW.length_m).p[0]
    assert abs(complex(*head) - there) < compile_scene(scene).promise_m


@pytest.mark.parametrize('t_s', [30.5, 32.0, 33.0, 155.0])
def test_links_across_the_joints_of_a_narrow_spiral_keep_their_length(t_s):
    scene = Scene(Dragon(6), NARROW, accuracy='exact', solver='march')
    for chain in (state(scene, t_s).p, states(scene, [t_s]).p[0]):
        assert np.max(np.abs(np.hypot(*np.diff(chain, axis=0).T) - scene.dragon.link_lengths_m)) < (
            0.2 * compile_scene(scene).promise_m)
