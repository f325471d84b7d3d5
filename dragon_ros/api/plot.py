"""Pictures of scenes and bags."""
from typing import TYPE_CHECKING

from dragon_ros.api.bag import Bag
from dragon_ros.api.simulated import Simulated, given_scene
from dragon_ros.core.scene import Scene
from dragon_ros.pictures.dragon import draw_on
from dragon_ros.pictures.sources import BagSource, SceneSource

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot(of: Simulated | Scene | Bag, t_s: float | None = None, ax: 'Axes | None' = None) -> 'Axes':
    """Draw a dragon on its track at a time (by default, the last), and return the Matplotlib axes.

    New axes are created unless ``ax`` is given.
    """
    source = BagSource(of.reader, of.namespace) if isinstance(of, Bag) else SceneSource('dragon', given_scene('of', of))
    return draw_on(source, t_s, ax)
