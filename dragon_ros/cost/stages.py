"""The stages of one tick, from the head to the bytes, each measured alone."""
from collections.abc import Callable
from functools import partial

import numpy as np

from dragon_ros.core.chain.rectangles import axes_of, benches_of
from dragon_ros.core.contact.broad_phase import candidates
from dragon_ros.core.contact.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import frame_of, velocity_of
from dragon_ros.core.tracks.composite import Place
from dragon_ros.cost.solvers import CHAIN_SOLVERS
from dragon_ros.messages.encode import encoders

MODEL = ('head', 'chain', 'velocities', 'benches')
CHECK = ('neighbours', 'gaps')
STAGES = (*MODEL, *CHECK, 'encode')


def stages_of(scene: Scene, solver: str, t_s: float) -> dict[str, Callable[[], object]]:
    """Return a call for each stage at one time; the results of earlier stages are computed here."""
    head = _head(scene, t_s)
    chain = CHAIN_SOLVERS[solver](scene, head)
    axis = axes_of(chain)
    benches = benches_of(chain, scene.dragon, axis)
    i, j = candidates(chain.p, benches)
    encode = list(encoders(scene).values())
    frame = frame_of(scene, None, round(t_s * NS), chain)
    return {'head': partial(_head, scene, t_s), 'chain': partial(CHAIN_SOLVERS[solver], scene, head),
            'velocities': partial(velocity_of, scene, chain, t_s),
            'benches': lambda: benches_of(chain, scene.dragon, axes_of(chain)),
            'neighbours': partial(candidates, chain.p, benches),
            'gaps': lambda: np.min(gaps(benches, i, j), initial=np.inf),
            'encode': lambda: [one(frame) for one in encode]}


def _head(scene: Scene, t_s: float) -> Place:
    simulation = compile_scene(scene)
    simulation.check_time(t_s)
    return simulation.model.leader.place(scene.head.travelled_m(t_s))
