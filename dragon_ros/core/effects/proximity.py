"""Near pairs of benches at one instant, the pairs that touch, and where they touch."""
from weakref import WeakKeyDictionary

import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.frame import Frame
from dragon_ros.core.geometry.contacts import Closeness, Contacts
from dragon_ros.core.geometry.near_pairs import NearPairs
from dragon_ros.core.geometry.rectangles import Benches, benches_of
from dragon_ros.core.geometry.signed_distance import witnesses
from dragon_ros.core.model import Model, Simulation
from dragon_ros.core.numerics.types import Floats

# The near pairs of a model's previous instant speed up the next one, and do not change a bit of its result.
_NEAR: WeakKeyDictionary[Model, NearPairs] = WeakKeyDictionary()


def closeness(model: Model, chain: Chain, benches: Benches) -> Closeness:
    """Return the closest two benches and all that touch, as the monitor reports them."""
    near = _NEAR.get(model)
    if near is None:
        near = _NEAR[model] = NearPairs()
    return near.look(chain.p, benches)


def touching(simulation: Simulation, frame: Frame) -> list[tuple[int, int]]:
    """Return the pairs that touch, the deepest first, whichever effects are on."""
    benches = frame.benches or benches_of(frame.chain, simulation.scene.dragon, frame.axis)
    found = frame.closeness or closeness(simulation.model, frame.chain, benches)
    return list(zip(found.i.tolist(), found.j.tolist(), strict=True))


def contacts(near: Closeness, benches: Benches) -> Contacts:
    """Return the pairs that touch."""
    point: Floats = witnesses(benches, near.i, near.j).point_m if near.i.size else np.empty((0, 2))
    return Contacts(np.stack((near.i, near.j), axis=1), near.gap_m, point)
