"""Which benches are near each other at one instant, which of them touch, and where."""
import numpy as np

from dragon_ros.core.chain.rectangles import benches_of
from dragon_ros.core.contact.broad_phase import candidates
from dragon_ros.core.contact.signed_distance import gaps, witnesses
from dragon_ros.core.contact.tracker import NEAR_M, TOUCH_M
from dragon_ros.core.frame import Closeness, Contacts, Frame
from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.types import Floats


def closeness(_: Simulation, frame: Frame) -> Closeness:
    """Return all pairs within ``NEAR_M`` of each other, and others, with their gaps, as the monitor sees them."""
    assert frame.benches is not None
    i, j = candidates(frame.chain.p, frame.benches, NEAR_M)
    return Closeness(i, j, gaps(frame.benches, i, j))


def touching(simulation: Simulation, frame: Frame) -> list[tuple[int, int]]:
    """Return the pairs that touch, the deepest first, whatever effects are on."""
    benches = frame.benches or benches_of(frame.chain, simulation.scene.dragon, frame.axis)
    i, j = candidates(frame.chain.p, benches, 0.0)
    gap_m = gaps(benches, i, j)
    rows = np.flatnonzero(gap_m <= TOUCH_M)
    return [(int(i[row]), int(j[row])) for row in rows[np.argsort(gap_m[rows], kind='stable')]]


def contacts(_: Simulation, frame: Frame) -> Contacts:
    """Return the pairs that touch."""
    near, benches = frame.closeness, frame.benches
    assert near is not None
    assert benches is not None
    rows = np.flatnonzero(near.gap_m <= TOUCH_M)
    rows = rows[np.argsort(near.gap_m[rows], kind='stable')]
    pairs = np.stack((near.i[rows], near.j[rows]), axis=1)
    point: Floats = witnesses(benches, near.i[rows], near.j[rows]).point_m if rows.size else np.empty((0, 2))
    return Contacts(pairs, near.gap_m[rows], point)
