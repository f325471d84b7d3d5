"""The contest's turn: symmetric, smooth, within its circle."""
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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
        assert complex(track.segments[k].at(*u)) == pytest.approx(-complex(track.segments[n].at(*v)), abs=1e-13)


@given(st.floats(0.3, 2.1))
def test_the_turn_stays_within_its_circle(ratio):
    track = track_of(STurn(ratio=ratio))
    for metres in np.linspace(0.0, STurn().length_m, 200):
        k, u = track.place_at(float(metres))
        assert abs(complex(track.segments[k].at(*u))) <= 4.5 * (1 + 1e-15)


def test_the_contests_turn_has_the_contests_places():
    chain = state(TURNING, 0.0)
    np.testing.assert_allclose(chain.p[0], (7.778034, 3.717164), atol=5e-7)
    np.testing.assert_allclose(state(TURNING, 100.0).p[0], (-2.711856, -3.591078), atol=5e-7)
