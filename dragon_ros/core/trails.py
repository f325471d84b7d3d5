"""The way that the head has come lately."""
from dataclasses import replace
from functools import lru_cache

import numpy as np

from dragon_ros.core.dragon import Group, Mixed
from dragon_ros.core.effects import Effect
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import Frame, states
from dragon_ros.core.types import Floats, read_only


def trail(scene: Scene, frame: Frame) -> Floats:
    """Return where the head was in the last ``trails.seconds`` at equal times, oldest first, (points, 2) in metres."""
    now = frame.t_ns / NS
    times = np.linspace(max(0.0, now - scene.trails.seconds), now, scene.trails.points)
    return read_only(np.ascontiguousarray(states(_head_of(scene), times.tolist()).p[:, 0]))


@lru_cache(maxsize=8)
def _head_of(scene: Scene) -> Scene:
    """Return the scene of the head bench alone, which goes the same way, at any time; a tail that leads needs all."""
    if scene.head.lead == 'tail':
        return scene
    alone = Mixed((Group(float(scene.dragon.bench_lengths_m[0])),), scene.dragon.width_m, scene.dragon.hole_inset_m)
    return replace(scene, dragon=alone, accuracy='exact', effects=Effect.NONE)
