"""Reference values for contacts: distances between benches by shapely, and candidates by the paper's corrected rule."""
import numpy as np
import shapely

from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.step import state


def smallest(scene, t_s):
    """Return the smallest distance between non-neighbouring benches: 0 if any overlap, infinite if there are none."""
    chain = state(scene, t_s)
    shapes = shapely.polygons(benches_of(chain, scene.dragon, axes_of(chain)).corners)
    i, j = np.triu_indices(len(shapes), 2)
    return float(np.min(shapely.distance(shapes[i], shapes[j]), initial=np.inf))


def adjacent_layer_windows(angle):
    """Return each bench's first and last candidate in the next layer out, by a corrected form of the paper's rule.

    The rule uses the handles' polar angles ``angle``, of shape (N+1,); both results have the shape (N,).
    """
    count = angle.size - 1
    over = np.searchsorted(angle, angle + 2 * np.pi, side='right') - 1
    first, last = over[:-1] - 1, over[1:] + 1
    beyond = first >= count
    return np.where(beyond, count, first), np.where(beyond, count - 1, np.minimum(last, count - 1))
