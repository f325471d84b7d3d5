"""The latched message that shows the track, as bytes."""
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.messages.cdr import Writer, stamp_of

_LINE_STRIP = 4
_WIDTH_M, _BELOW_M = 0.03, -0.06
_GREY = (0.6, 0.6, 0.6, 1.0)


def track_message(scene: Scene, frame_id: str) -> bytes:
    """Return a visualization_msgs/Marker: the track as a line just below the benches, stamped with the run's start."""
    writer, points = Writer(), compile_scene(scene).track_line()
    writer.put('I', *stamp_of(scene.run.start_ns))
    writer.text(frame_id)
    writer.text('track')
    writer.put('i', 0, _LINE_STRIP, 0)
    writer.put('d', 0, 0, 0, 0, 0, 0, 1)
    writer.put('d', _WIDTH_M, 0, 0)
    writer.put('f', *_GREY)
    writer.put('i', 0, 0)           # lifetime: for ever
    writer.put('?', False)          # frame_locked
    writer.put('I', len(points))
    writer.put('d', *(value for x, y in points.tolist() for value in (x, y, _BELOW_M)))
    writer.put('I', 0)              # colors
    writer.text('')                 # texture_resource
    writer.header('')               # texture
    writer.text('')
    writer.put('I', 0, 0)           # texture data, uv_coordinates
    writer.text('')                 # text
    writer.text('')                 # mesh_resource
    writer.text('')                 # mesh_file
    writer.put('I', 0)
    writer.put('?', False)          # mesh_use_embedded_materials
    return bytes(writer.finish())
