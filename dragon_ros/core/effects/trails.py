"""Where the head has been in the last seconds."""
import numpy as np

from dragon_ros.core.frame import Frame
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.placed import BACK
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.walk_chain import chains_on


def trail(scene: Scene, frame: Frame) -> Floats:
    """Return where the head was in the last ``trails.seconds`` at equal times, oldest first, (points, 2) in metres."""
    now = frame.t_ns / NS
    times = np.linspace(max(0.0, now - scene.trails.seconds), now, scene.trails.points)
    return read_only(np.ascontiguousarray(_head_at(scene, times)))


def _head_at(scene: Scene, times_s: Floats) -> Floats:
    """Return where the head is at many times, (S, 2): the leader itself, or the far end of the chain behind a tail."""
    led = scene.chained
    leaders = led.leaders(scene.head.travelled_m(times_s))
    if led.way == BACK:
        return led.walk.points(*leaders)[0]
    chains = (scene.runs.place_many(leaders) if scene.runs else
              chains_on(led.walk, led.links_m, leaders, led.way, scene.effort))
    head: Floats = chains.p[:, 0]
    return head
