"""Close pairs of benches at one instant, the pairs that touch, and where they touch."""
from weakref import WeakKeyDictionary

import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.frame import Frame
from dragon_ros.core.geometry.contacts import Closeness, Contacts
from dragon_ros.core.geometry.near_pairs import TOUCH_M, NearPairs
from dragon_ros.core.geometry.rectangles import Benches, benches_of
from dragon_ros.core.geometry.signed_distance import witnesses
from dragon_ros.core.model import Model, Simulation
from dragon_ros.core.scene import Scene

# The close pairs of a model's previous instant speed up the next one and do not change a bit of its result.
_NEAR: WeakKeyDictionary[Model, NearPairs] = WeakKeyDictionary()


def closeness(simulation: Simulation, chain: Chain, benches: Benches) -> Closeness:
    """Return the closest two benches and all that touch, including obstacles, as the monitor reports them."""
    near = _NEAR.get(simulation.model)
    if near is None:
        near = _NEAR[simulation.model] = NearPairs()
    found, venue = near.look(chain.p, benches), simulation.scene.venue
    if venue is None:
        return found
    from dragon_ros.core.geometry.venue import surroundings_of
    return surroundings_of(venue).together(found, benches, TOUCH_M)


def touching(simulation: Simulation, frame: Frame) -> list[tuple[int, int]]:
    """Return the pairs that touch, the deepest first, whichever effects are on."""
    benches = frame.benches or benches_of(frame.chain, simulation.scene.dragon, frame.axis)
    found = frame.closeness or closeness(simulation, frame.chain, benches)
    return list(zip(found.i.tolist(), found.j.tolist(), strict=True))


def named_pair(scene: Scene, pair: tuple[int, int]) -> str:
    """Return a description of two benches, or of a bench and an obstacle, that touch."""
    if scene.venue is None or pair[1] < scene.dragon.benches:
        return f'benches {pair[0]} and {pair[1]}'
    return f'bench {pair[0]} and obstacle {scene.venue.names[pair[1] - scene.dragon.benches]!r}'


def contacts(simulation: Simulation, near: Closeness, benches: Benches) -> Contacts:
    """Return the pairs that touch."""
    count, venue, point = len(benches.half_length), simulation.scene.venue, np.empty((near.i.size, 2))
    two = near.j < count
    if np.any(two):
        point[two] = witnesses(benches, near.i[two], near.j[two]).point_m
    if venue is not None and not np.all(two):
        from dragon_ros.core.geometry.venue import surroundings_of
        point[~two] = surroundings_of(venue).points(benches, near.i[~two], near.j[~two] - count)
    return Contacts(np.stack((near.i, near.j), axis=1), near.gap_m, point)
