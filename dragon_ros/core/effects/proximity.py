"""Close pairs of benches at one instant, the pairs that touch, and their points of contact."""
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.geometry.contacts import Closeness, Contacts, pair_words
from dragon_ros.core.geometry.near_pairs import NearPairs
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import witnesses
from dragon_ros.core.model import Model, Simulation
from dragon_ros.core.scene import Scene

if TYPE_CHECKING:
    from dragon_ros.core.geometry.near_obstacles import NearObstacles

# The close pairs of a model's previous instant speed up the next search without changing a single bit of its result.
_NEAR: WeakKeyDictionary[Model, NearPairs] = WeakKeyDictionary()
_OBSTACLES: WeakKeyDictionary[Model, 'NearObstacles'] = WeakKeyDictionary()


def closeness(simulation: Simulation, chain: Chain, benches: Benches) -> Closeness:
    """Return the closest pair and all touching pairs, including those with obstacles, as the monitor reports them."""
    near = _NEAR.get(simulation.model)
    if near is None:
        near = _NEAR[simulation.model] = NearPairs()
    found, venue = near.look(chain.p, benches), simulation.scene.venue
    if venue is None:
        return found
    from dragon_ros.core.geometry.near_obstacles import NearObstacles
    from dragon_ros.core.geometry.venue import surroundings_of
    around, obstacles = surroundings_of(venue), _OBSTACLES.get(simulation.model)
    if obstacles is None or obstacles.around is not around:
        obstacles = _OBSTACLES[simulation.model] = NearObstacles(around)
    return obstacles.look(found, benches)


def named_pair(scene: Scene, pair: tuple[int, int]) -> str:
    """Return a description of two benches, or of a bench and an obstacle, that touch."""
    number = pair[1] - scene.dragon.benches
    return pair_words(pair, scene.venue.names[number] if scene.venue and number >= 0 else '')


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
