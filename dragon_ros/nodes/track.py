"""The track as a marker, for whoever looks at the dragon, early or late."""
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from dragon_ros.core.outline import outline
from dragon_ros.core.scene import Scene
from dragon_ros.wire.cdr import stamp_of

_WIDTH_M, _BELOW_M = 0.03, -0.06
_GREY = ColorRGBA(r=0.6, g=0.6, b=0.6, a=1.0)




def track_marker(scene: Scene, frame_id: str) -> Marker:
    """Return the track as a line just below the benches, stamped with the start of the run."""
    header = Header(frame_id=frame_id)
    header.stamp.sec, header.stamp.nanosec = stamp_of(scene.run.start_ns)
    return Marker(header=header, ns='track', type=Marker.LINE_STRIP, scale=Vector3(x=_WIDTH_M), color=_GREY,
                  pose=Pose(orientation=Quaternion(w=1.0)),
                  points=[Point(x=x, y=y, z=_BELOW_M) for x, y in outline(scene).tolist()])
