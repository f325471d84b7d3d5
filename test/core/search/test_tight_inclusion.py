"""An independent continuous collision detector, Tight Inclusion (Wang et al. 2021), agrees with the proved contact.

It moves corners and edges along straight lines between two states, so its error falls with the square of the step.
"""
from itertools import pairwise, product

import numpy as np
import pytest

from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state

ipctk = pytest.importorskip('ipctk', reason='ipctk is not installed; pip install ipctk')
SCENE = Scene()
PROVED_S = 412.473837682115


def corners(times_s):
    """Return the corners (m) of benches 0 and 8 at each time, of shape (T, 2, 4, 2)."""
    chains = [state(SCENE, t_s) for t_s in times_s]
    return np.array([benches_of(chain, SCENE.dragon, axes_of(chain)).corners[[0, 8]] for chain in chains])


def first_contact_s(step_s):
    """Return the first time at which a corner of one bench meets an edge of the other, on straight lines."""
    times_s = PROVED_S + step_s * (np.arange(11) - 7.3)
    ccd, boxes = ipctk.TightInclusionCCD(1e-12, 10**7, 1.0), corners(times_s)
    for t_s, one, two in zip(times_s[:-1], boxes[:-1], boxes[1:], strict=True):
        met = []
        for bench, corner, edge in product((0, 1), range(4), range(4)):
            before, after = ((box[bench, corner], box[1 - bench, edge], box[1 - bench, (edge + 1) % 4])
                             for box in (one, two))
            touches, share = ccd.point_edge_ccd(*before, *after)
            met += [share] * touches
        if met:
            return t_s + min(met) * step_s
    return None


def test_tight_inclusion_converges_to_the_proved_contact():
    errors_s = [abs(first_contact_s(step_s) - PROVED_S) for step_s in (6e-2, 6e-3, 6e-4, 6e-5, 6e-6)]
    assert all(later < 0.02 * earlier for earlier, later in pairwise(errors_s))
    assert errors_s[-1] < 1e-10
