"""The monitor's markers (red benches, a point and a label) are read back by the real serialiser."""
import numpy as np
import pytest
import shapely

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import ContactTracker, Report
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.decode import read_marker_array
from dragon_ros.messages.markers import BENCH_HEIGHT_M, BLACK, BLUE, VERMILION, YELLOW
from dragon_ros.messages.monitor_markers import clearance_marker, report_markers, stamped_clearance, vector_of


def report_at(t_s, **dragon):
    scene = Scene(Dragon(**dragon), run=Run(t_s, 415))
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
    assert 0 < point.scale.x == point.scale.y == point.scale.z < 0.3 < label.scale.z < 0.6      # a bench is 0.3 m wide
    assert {marker.color.a for marker in (*red, point, label)} == {1.0}
    assert max(marker.pose.position.z + 0.5 * marker.scale.z for marker in red) < point.pose.position.z
    assert point.pose.position.z < label.pose.position.z
    assert label.pose.position.y + 2 * label.scale.z == pytest.approx(point.pose.position.y)
    again = serialization.serialize_message(message)
    assert serialization.deserialize_message(again, MarkerArray) == message


def test_the_clearance_stands_as_a_text_beside_the_point_between_the_closest_benches():
    serialization = pytest.importorskip('rclpy.serialization')
    from geometry_msgs.msg import Vector3Stamped
    from visualization_msgs.msg import Marker
    report = report_at(412.0)
    near = (shapely.Polygon(report.observation.benches.corners[bench]) for bench in (0, 8))
    one, other = (np.array(end) for end in shapely.shortest_line(*near).coords)
    message = serialization.deserialize_message(clearance_marker(report), Marker)
    assert (message.type, message.action, message.color.a) == (Marker.TEXT_VIEW_FACING, Marker.ADD, 1.0)
    assert message.text == f'{1e3 * np.hypot(*(other - one)):.2f} mm'
    assert 0.3 < message.scale.z < 0.6
    middle = 0.5 * (one + other)
    assert message.pose.position.x == pytest.approx(middle[0], abs=0.02)
    assert message.pose.position.y + 2 * message.scale.z == pytest.approx(middle[1], abs=0.02)
    assert 0.5 * BENCH_HEIGHT_M < message.pose.position.z - message.scale.z < 1.0    # not hidden by benches
    vector = serialization.deserialize_message(vector_of(report), Vector3Stamped).vector
    assert report.closest == (0, 8)
    assert (vector.x, vector.y, vector.z) == pytest.approx((*(other - one), 0.0), abs=1e-9)


def test_the_stamped_clearance_is_a_vector_with_only_a_field_x():
    serialization = pytest.importorskip('rclpy.serialization')
    from geometry_msgs.msg import Vector3Stamped
    report = report_at(412.0)
    message = serialization.deserialize_message(stamped_clearance(report), Vector3Stamped)
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (412, 0, 'dragon')
    assert (message.vector.x, message.vector.y, message.vector.z) == (report.clearance_m, 0.0, 0.0)


@pytest.mark.parametrize('report', [Report(report_at(412.0).observation, np.inf, None), report_at(412.48)],
                         ids=['without pairs', 'in contact'])
def test_a_dragon_without_pairs_or_in_contact_has_no_clearance_to_show(report):
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import Marker
    message = serialization.deserialize_message(clearance_marker(report), Marker)
    assert (message.action, message.ns) == (Marker.DELETE, 'clearance')


def test_without_contact_all_markers_are_deleted():
    markers = read_marker_array(report_markers(report_at(404)))
    assert markers.action.tolist() == [3]


def test_the_label_of_several_contacts_counts_those_that_it_does_not_name():
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import MarkerArray
    report = report_at(300.0, width_m=0.6, benches=40)
    assert report.count > 2
    *_, label = serialization.deserialize_message(report_markers(report), MarkerArray).markers
    assert label.text.endswith(f' mm (+{report.count - 1})')


def test_the_deleting_marker_has_neither_size_nor_colour():
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import MarkerArray
    marker, = serialization.deserialize_message(report_markers(report_at(404)), MarkerArray).markers
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == (0.0, 0.0, 0.0)
    assert (marker.color.r, marker.color.g, marker.color.b, marker.color.a) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(('colour', 'published'), [
    (VERMILION, (213, 94, 0)), (BLUE, (0, 114, 178)), (BLACK, (0, 0, 0)), (YELLOW, (240, 228, 66))],
    ids=['vermilion', 'blue', 'black', 'yellow'])
def test_colours_are_those_that_okabe_and_ito_published(colour, published):
    assert np.array(colour[:3]) * 255 == pytest.approx(np.array(published), abs=1.5)
    assert colour[3] == 1.0
