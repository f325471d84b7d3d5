"""The cost of publishing a tick as bytes and as message objects; ``cost tick`` runs this script and reads its JSON."""
import json
import sys
import time
from collections.abc import Callable

import rclpy
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion, Vector3
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import ColorRGBA, Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout
from visualization_msgs.msg import Marker, MarkerArray

from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame, tick
from dragon_ros.messages.cdr import half_turns, stamp_of
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.nodes import qos, shell

_WARM = 3


def main(budget_s: float) -> None:
    """Print a mapping {name: [seconds of each call]} for the classic scene, with one reader per topic."""
    rclpy.init()
    node, scene = Node('publish_cost'), Scene()
    frame, encode = tick(scene, 100), encoders(scene)
    out = {name: _heard(node, name) for name in encode}
    data = {name: encode[name](frame) for name in encode}
    objects = _objects(scene, frame)
    print(json.dumps({
        'bytes publish': _spent(lambda: [out[name].publish(data[name]) for name in out], budget_s),
        'objects encode': _spent(lambda: _objects(scene, frame), budget_s),
        'objects publish': _spent(lambda: [out[name].publish(objects[name]) for name in out], budget_s)}))
    node.destroy_node()
    rclpy.shutdown()


def _heard(node: Node, name: str) -> Publisher:
    """Return a publisher that has one subscriber."""
    row = channels()[name]
    kind, profile = shell.message_type(row.type), qos.profile('reliable', 'volatile', 10)
    node.create_subscription(kind, name, lambda _: None, profile, raw=True)
    publisher = node.create_publisher(kind, name, profile)
    while not publisher.get_subscription_count():
        time.sleep(0.01)
    return publisher


def _spent(call: Callable[[], object], budget_s: float) -> list[float]:
    for _ in range(_WARM):
        call()
    spent: list[float] = []
    while len(spent) < 5 or sum(spent) < budget_s:
        start = time.perf_counter()
        call()
        spent.append(time.perf_counter() - start)
    return spent


def _objects(scene: Scene, frame: Frame) -> dict[str, object]:
    """Return the messages of a frame as objects, as nodes usually build them."""
    header = Header(frame_id='dragon')
    header.stamp.sec, header.stamp.nanosec = stamp_of(frame.t_ns)
    turns = half_turns(frame.axis).tolist()
    benches, velocity = frame.benches, frame.velocity_m_s
    assert benches is not None
    assert velocity is not None
    markers = [Marker(header=header, ns='bench', id=n, type=Marker.CUBE, pose=_pose(place, turn),
                      scale=Vector3(x=length_m, y=scene.dragon.width_m, z=0.1), color=ColorRGBA(b=0.7, a=1.0))
               for n, (place, turn, length_m) in enumerate(zip(benches.centre.tolist(), turns,
                                                               scene.dragon.bench_lengths_m.tolist(), strict=True))]
    poses = [_pose(place, turn) for place, turn in zip(frame.chain.p.tolist(), [*turns, turns[-1]], strict=True)]
    size = 3 * len(poses)
    layout = MultiArrayLayout(dim=[MultiArrayDimension(label='handle', size=len(poses), stride=size),
                                   MultiArrayDimension(label='vx_vy_speed', size=3, stride=3)])
    rows = [part for x, y in velocity.tolist() for part in (x, y, (x * x + y * y) ** 0.5)]
    return {'handles': PoseArray(header=header, poses=poses), 'benches': MarkerArray(markers=markers),
            'velocities': Float64MultiArray(layout=layout, data=rows)}


def _pose(place: list[float], turn: list[float]) -> Pose:
    return Pose(position=Point(x=place[0], y=place[1]), orientation=Quaternion(z=turn[0], w=turn[1]))


if __name__ == '__main__':
    main(float(sys.argv[1]))
