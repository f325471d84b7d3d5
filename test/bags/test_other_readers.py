"""Independent software can read bags: rosbags, mcap-ros2-support, ros2 bag and mcap doctor."""
import shutil
import subprocess
from importlib.metadata import version

import numpy as np
import pytest

from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.provenance import ATTACHMENT, RECORD, run_metadata, scene_file

SCENE, SMALL = (Scene(dragon, run=Run(412, 412.2)) for dragon in (Dragon(60), Dragon(20)))
FORMS = [('run.mcap', {}, SCENE), pytest.param(('run', {}, SMALL), marks=pytest.mark.long),
         ('run', {'split_duration_s': 0.1}, SMALL), ('run.mcap', {'compression': 'lz4'}, SMALL),
         pytest.param(('run', {'compression': 'none'}, SMALL), marks=pytest.mark.long)]


@pytest.fixture(params=FORMS, ids=lambda form: f'{form[0]} {form[1]}')
def written(request, tmp_path):
    """A bag in each form, and the scene from which its messages were made."""
    where, options, scene = request.param
    encode, text = encoders(scene), scene_file(scene)
    with BagWriter(tmp_path / where, options=BagOptions(**options)) as bag:
        for name in (*encode, 'scene'):
            bag.add_channel(f'/dragon/{name}', channels()[name])
        bag.describe(RECORD, run_metadata(text, scene, {}))
        bag.attach(ATTACHMENT, 'application/yaml', text.encode())
        bag.write('/dragon/scene', string_message(text), scene.run.start_ns, 1)
        for k in range(11):
            frame = tick(scene, k)
            for name in encode:
                bag.write(f'/dragon/{name}', encode[name](frame), frame.t_ns, k + 1, 10**18 + k)
    return tmp_path / where, scene


def check(scene, topic, t_ns, message):
    """Compare a message decoded by another library with the model."""
    frame = tick(scene, scene.run.tick_at(t_ns))
    if topic == '/dragon/handles':
        assert message.header.frame_id == 'dragon'
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == t_ns
        assert [[pose.position.x, pose.position.y] for pose in message.poses] == frame.chain.p.tolist()
    elif topic == '/dragon/benches':
        assert [[row.pose.position.x, row.pose.position.y] for row in message.markers] == frame.benches.centre.tolist()
        assert {row.ns for row in message.markers} == {'bench'}
    elif topic == '/dragon/velocities':
        np.testing.assert_array_equal(np.reshape(message.data, (-1, 3))[:, :2], frame.velocity_m_s)
    else:
        assert message.data == scene_file(scene)


def test_mcap_ros2_support_decodes_every_message_by_the_schemas_in_the_bag(written):
    bag, scene = written
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    count = 0
    for path in [bag] if bag.is_file() else sorted(bag.glob('*.mcap')):
        with path.open('rb') as file:
            for _, channel, message, decoded in make_reader(
                    file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
                check(scene, channel.topic, message.log_time, decoded)
                count += 1
    assert count == 34


def test_rosbags_decodes_every_message_by_the_schemas_in_the_bag(written):
    bag, scene = written
    from rosbags.highlevel import AnyReader
    if bag.is_file() and tuple(map(int, version('rosbags').split('.')[:2])) < (0, 11):
        pytest.skip('rosbags before 0.11 opens only rosbag2 directories')
    with AnyReader([bag]) as reader:
        assert reader.message_count == 34
        assert reader.duration == 2 * 10**8 + 1
        assert {row.topic: row.msgcount for row in reader.connections} == {
            '/dragon/scene': 1, '/dragon/handles': 11, '/dragon/benches': 11, '/dragon/velocities': 11}
        for connection, t_ns, data in reader.messages():
            check(scene, connection.topic, t_ns, reader.deserialize(data, connection.msgtype))
        profile = next(row for row in reader.connections if row.topic == '/dragon/scene').ext.offered_qos_profiles[0]
        assert profile.durability.name == 'TRANSIENT_LOCAL'


def test_ros2_bag_lists_its_contents(written):
    bag, _ = written
    if shutil.which('ros2') is None or subprocess.run(['ros2', 'bag', '--help'], capture_output=True).returncode:
        pytest.skip('ros2 bag is not installed')
    done = subprocess.run(['ros2', 'bag', 'info', str(bag)], capture_output=True, text=True, check=True)
    assert '34' in done.stdout
    assert '/dragon/benches' in done.stdout


def test_the_mcap_tools_doctor_finds_nothing(written):
    bag, _ = written
    if shutil.which('mcap') is None:
        pytest.skip('the mcap tool is not on PATH')
    for path in [bag] if bag.is_file() else sorted(bag.glob('*.mcap')):
        done = subprocess.run(['mcap', 'doctor', '--strict-message-order', str(path)], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, ''), done.stderr
