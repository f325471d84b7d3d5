"""The monitor's markers: red benches, the point, a label, read back by the real serialiser."""
import pytest

from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import ContactTracker, Report
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.decode import read_marker_array
from dragon_ros.messages.monitor_markers import report_markers


def report_at(t_s):
    scene = Scene(run=Run(t_s, 415))
    frame = tick(scene, 0)
    (report,) = ContactTracker().add(Observation(frame.t_ns, frame.chain.p, frame.benches, 'dragon'))
    return report


def test_benches_in_contact_are_red_and_stand_where_they_are_with_a_point_and_a_label():
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import Marker, MarkerArray
    report = report_at(412.48)
    assert isinstance(report, Report)
    message = serialization.deserialize_message(report_markers(report), MarkerArray)
    clear, *red, point, label = message.markers
    assert (clear.action, [marker.id for marker in red]) == (Marker.DELETEALL, [0, 8])
    assert {(marker.header.stamp.sec, marker.header.stamp.nanosec, marker.header.frame_id)
            for marker in message.markers} == {(412, 480_000_000, 'dragon')}
    for marker in red:
        centre = report.observation.benches.centre[marker.id]
        assert (marker.pose.position.x, marker.pose.position.y) == tuple(centre)
        assert marker.pose.orientation.z**2 + marker.pose.orientation.w**2 == pytest.approx(1)
        assert (marker.type, marker.ns, marker.action) == (Marker.CUBE, 'bench in contact', Marker.ADD)
        assert marker.color.r > 0.8 > 0.4 > marker.color.g
    assert [marker.scale.x for marker in red] == pytest.approx([3.41, 2.2])
    assert (point.type, label.type) == (Marker.SPHERE, Marker.TEXT_VIEW_FACING)
    assert (point.pose.position.x, point.pose.position.y) == pytest.approx((1.479876, 2.106451), abs=1e-5)
    assert label.text == '0 x 8: -0.16 mm'
    again = serialization.serialize_message(message)
    assert serialization.deserialize_message(again, MarkerArray) == message


def test_without_contact_all_markers_are_deleted():
    markers = read_marker_array(report_markers(report_at(404)))
    assert markers.action.tolist() == [3]
