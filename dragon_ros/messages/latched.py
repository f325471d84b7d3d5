"""The latched messages of a run, encoded from the scene alone."""
from collections.abc import Callable

import numpy as np

from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.messages.cdr import Writer, half_turns, string_message
from dragon_ros.messages.markers import track_marker

DESCRIPTION = 'robot_description'


def latched_messages(scene: Scene, frame_id: str) -> dict[str, bytes]:
    """Return, by topic, the latched messages of a scene, except the message that contains the scene itself."""
    wanted = ['track', *(['path'] if Effect.PATH in scene.effects else []),
              *(['venue'] if scene.venue is not None else [])]
    return {name: ENCODE[name](scene, frame_id) for name in wanted}


def path_message(scene: Scene, frame_id: str) -> bytes:
    """Return, as a nav_msgs/Path from rear to front, the part of the track that the handles cover during the run.

    Each pose has the stamp and frame of the path, and its x axis points to the next pose.
    """
    points = compile_scene(scene).track_line()[::-1]
    steps = np.diff(points, axis=0)
    steps = np.concatenate((steps, steps[-1:])) if len(steps) else np.array([[1.0, 0.0]])
    turns = half_turns(steps / np.hypot(steps[:, 0], steps[:, 1])[:, None])
    writer = Writer()
    writer.header(frame_id, scene.run.start_ns)
    writer.put('I', len(points))
    for (x, y), turn in zip(points.tolist(), turns.tolist(), strict=True):
        writer.header(frame_id, scene.run.start_ns)
        writer.put('d', x, y, 0.0, 0.0, 0.0, *turn)
    return bytes(writer.finish())


def _venue(scene: Scene, frame_id: str) -> bytes:
    from dragon_ros.messages.venue_markers import venue_message  # imported lazily, because few scenes have a venue
    return venue_message(scene, frame_id)


def _robot(scene: Scene, _: str) -> bytes:
    from dragon_ros.messages.urdf import urdf_of  # imported lazily, because few runs need its XML library
    return string_message(urdf_of(scene))


ENCODE: dict[str, Callable[[Scene, str], bytes]] = {
    'track': track_marker, 'path': path_message, 'venue': _venue, DESCRIPTION: _robot}
