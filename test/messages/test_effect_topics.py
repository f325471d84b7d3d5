"""The topics of an effect exist only if it is on, can be decoded, and do not depend on other effects."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.flags import NEEDS, Effect, known
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels, live
from dragon_ros.messages.decode import (
    MessageError,
    decode,
    read_diagnostics,
    read_multi_array,
    read_odometry,
    read_pose_array,
)
from dragon_ros.messages.encode import encoders

SCENE = Scene(dragon=Dragon(benches=24), effects=~Effect.NONE)
FRAME = tick(SCENE, 413 * 50)
BYTES = {name: encode(FRAME) for name, encode in encoders(SCENE).items()}


def with_needs(effect):
    return effect | (with_needs(NEEDS[effect]) if effect in NEEDS else Effect.NONE)


@pytest.mark.parametrize('effect', known().values(), ids=known())
def test_an_effect_brings_its_topics_and_the_bytes_of_all_topics_stay_the_same(effect):
    scene = replace(SCENE, effects=with_needs(effect))
    encode = encoders(scene)
    frame = tick(scene, 413 * 50)
    assert {name: one(frame) for name, one in encode.items()} == {name: BYTES[name] for name in encode}
    ticked = [row for row in channels().values() if row.publisher == 'sim' and row.durability == 'volatile']
    assert set(encode) == {row.name for row in ticked if row.effect is None or row.effect in with_needs(effect)}


def test_every_topic_of_an_effect_decodes_to_its_last_byte():
    for row in live(SCENE.effects):
        data = bytes(BYTES[row.name])
        decode(row.type, data)
        spare = bytes(16 if row.name == 'joint_states' else 0)      # Fast DDS sends these after two empty float64[]
        for other in (data[:-1], *(data + spare + bytes(more) for more in (1, 4, 8))):
            with pytest.raises(MessageError):
                decode(row.type, other)


def test_tables_hold_the_numbers_of_the_frame():
    labels, values = read_multi_array(BYTES['model/contacts'])
    assert labels == ['pair', 'inner_outer_gap_x_y']
    assert values.tolist() == [[0, 8, FRAME.contacts.gap_m[0], *FRAME.contacts.point_m[0]]]
    assert np.array_equal(read_multi_array(BYTES['accelerations'])[1][:, :2], FRAME.acceleration_m_s2)
    assert np.array_equal(read_multi_array(BYTES['forces'])[1][:, 0], FRAME.tension_n_kg)
    assert np.array_equal(read_pose_array(BYTES['measured']).poses[:, :2], FRAME.measured.p)
    assert decode('std_msgs/msg/Float64', BYTES['model/clearance']) == {'data': FRAME.closeness.clearance_m}


def test_the_cloud_has_places_as_viewers_want_them_and_speeds_to_the_last_bit():
    sensor_msgs, serialization = pytest.importorskip('sensor_msgs.msg'), pytest.importorskip('rclpy.serialization')
    cloud = serialization.deserialize_message(BYTES['cloud'], sensor_msgs.PointCloud2)
    kinds = {sensor_msgs.PointField.FLOAT32: 'f4', sensor_msgs.PointField.FLOAT64: 'f8',
             sensor_msgs.PointField.UINT32: 'u4'}
    rows = np.frombuffer(cloud.data, {'names': [one.name for one in cloud.fields], 'itemsize': cloud.point_step,
                                      'formats': [kinds[one.datatype] for one in cloud.fields],
                                      'offsets': [one.offset for one in cloud.fields]})
    assert (cloud.header.stamp.sec, cloud.header.frame_id) == (413, 'dragon')
    assert (cloud.height, cloud.width, cloud.row_step, cloud.is_dense) == (1, 25, len(cloud.data), True)
    assert np.array_equal(np.stack((rows['x'], rows['y']), axis=1), FRAME.chain.p.astype(np.float32))
    assert np.array_equal(np.stack((rows['vx'], rows['vy']), axis=1), FRAME.velocity_m_s)
    assert np.array_equal(rows['speed'], np.hypot(*FRAME.velocity_m_s.T))
    assert rows['handle'].tolist() == list(range(25))


def test_the_leader_says_where_it_goes_and_how_fast():
    odometry = decode('nav_msgs/msg/Odometry', BYTES['leader'])
    assert odometry['child_frame_id'] == 'dragon/leader'
    x, y, _, _, _, sine, cosine = odometry['pose']['pose'].tolist()
    assert [x, y] == FRAME.chain.p[0].tolist()
    assert (cosine**2 - sine**2, 2 * sine * cosine) == pytest.approx(tuple(FRAME.velocity_m_s[0]))
    assert read_odometry(BYTES['leader']) == (413 * 10**9, 1.0)
    assert not np.any(odometry['pose']['covariance'])


def test_markers_show_the_benches_in_contact_after_the_last_ones_are_deleted():
    clear, *shown = decode('visualization_msgs/msg/MarkerArray', BYTES['model/markers'])['markers']
    assert clear['action'] == 3
    assert [(one['ns'], one['id']) for one in shown] == [('contact bench', 0), ('contact bench', 1),
                                                       ('contact point', 0)]
    assert shown[1]['pose'][:2].tolist() == FRAME.benches.centre[8].tolist()
    assert all(one['header']['stamp'] == {'sec': 413, 'nanosec': 0} for one in (clear, *shown))
    apart = tick(SCENE, 0)
    assert len(decode('visualization_msgs/msg/MarkerArray', encoders(SCENE)['model/markers'](apart))['markers']) == 1


def test_a_trail_is_one_line_through_its_points():
    (line,) = decode('visualization_msgs/msg/MarkerArray', BYTES['trail'])['markers']
    assert np.array_equal(line['points'][:, :2], FRAME.trail_m)


def test_diagnostics_report_ok_or_the_worst_link():
    (status,) = read_diagnostics(BYTES['model/diagnostics'])
    assert status.level == 0
    bad = FRAME._replace(health=replace(FRAME.health, off_m=1.0))
    (status,) = read_diagnostics(encoders(SCENE)['model/diagnostics'](bad))
    assert status.level == 2
    assert f'link {FRAME.health.link} is off by 1 m' in status.message


def test_a_bag_has_channels_of_what_was_published_alone(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for name, row in channels().items():
            bag.add_channel(f'/dragon/{name}', row)
        bag.write('/dragon/handles', BYTES['handles'], 0, 0)
    with BagReader(tmp_path / 'a.mcap') as bag:
        assert [topic.name for topic in bag.topics] == ['/dragon/handles']
