"""How far benches are apart, by shapely: what first contacts are held against."""
import numpy as np
import shapely

from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.step import state


def smallest(scene, t_s):
    """The smallest distance of benches that are not neighbours, 0 for overlap; infinite where there are none."""
    chain = state(scene, t_s)
    shapes = shapely.polygons(benches_of(chain, scene.dragon, axes_of(chain)).corners)
    i, j = np.triu_indices(len(shapes), 2)
    return float(np.min(shapely.distance(shapes[i], shapes[j]), initial=np.inf))
