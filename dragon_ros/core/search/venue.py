"""Checks that a dragon starts inside its venue and clear of its obstacles."""
from contextlib import suppress
from typing import NoReturn

from dragon_ros.core.errors import FieldError, ModelEnd
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.venue import surroundings_of
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.venue import INSIDE


def check_start(scene: Scene) -> None:
    """Raise FieldError if a bench touches an obstacle, or is outside the venue, when the run starts."""
    if scene.venue is None:
        return
    around, simulation = surroundings_of(scene.venue), compile_scene(scene)
    with suppress(ModelEnd):        # a run that starts after the model's end has no states
        chain = simulation.model.march(scene.head.travelled_m(scene.run.start_s))
        benches = benches_of(chain, scene.dragon, axes_of(chain))
        bench, number, _ = around.touching(benches)
        if bench.size:
            _refuse(scene, around.names[number[0]], f'bench {bench[0]} touches it when the run starts')
    check_sides(simulation)


def check_sides(simulation: Simulation) -> None:
    """Raise FieldError if the middle of the head is in an obstacle, or outside the venue, when the run starts."""
    scene = simulation.scene
    assert scene.venue
    around = surroundings_of(scene.venue)
    with suppress(ModelEnd):
        front, rear = simulation.model.march(scene.head.travelled_m(scene.run.start_s)).p[:2]
        misplaced = around.misplaced(*(0.5 * (front + rear)).tolist())
        if misplaced is not None:
            _refuse(scene, around.names[misplaced], 'the dragon is outside this polygon when the run starts' if
                    misplaced == around.inside else 'this obstacle covers the dragon when the run starts')


def _refuse(scene: Scene, name: str, why: str) -> NoReturn:
    assert scene.venue
    field = 'inside' if name == INSIDE else f'obstacles.{scene.venue.names.index(name) + 1}'
    raise FieldError(f'venue.{field}', name, why, 'move it, or start the run elsewhere '
                     '(track.start_m, run.start_s)')
