"""The bag that is simulated offline is the one that real nodes record."""
import json
import threading
import time

import pytest

from dragon_ros.__main__ import main
from dragon_ros.wire.bag_frames import scene_of_bag
from dragon_ros.wire.log_read import LogReader

SCENE = ('--scene', 'first_contact', '--set', 'run.start_s=412.2', '--set', 'run.stop_s=412.7')
READERS = 'wait_subscribers:=[handles=1,benches=1,velocities=1,scene=1]'


def by_topic(bag):
    out = {}
    for message in bag.messages():
        out.setdefault(message.topic, []).append((message.t_ns, message.sequence, message.data))
    return out


def test_the_scene_recorded_live_and_simulated_offline_give_equal_messages(start, tmp_path):
    from rclpy.serialization import deserialize_message
    from std_msgs.msg import String
    from visualization_msgs.msg import Marker
    record = start('record', '--output', tmp_path / 'live.mcap')
    sim = start('sim', *SCENE, '--ros-args', '-p', READERS, '-p', 'time_scale:=0.0')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    assert main(['simulate', *SCENE, '--output', str(tmp_path / 'offline.mcap')]) == 0
    with LogReader(tmp_path / 'live.mcap') as live, LogReader(tmp_path / 'offline.mcap') as offline:
        recorded, simulated = by_topic(live), by_topic(offline)
        assert scene_of_bag(live) == scene_of_bag(offline)
        assert {one.name: one.type for one in live.topics} == {one.name: one.type for one in offline.topics}
    assert len(simulated['/dragon/handles']) == 26
    for name in ('handles', 'benches', 'velocities'):
        assert recorded[f'/dragon/{name}'] == simulated[f'/dragon/{name}']
    for name, kind in (('scene', String), ('track', Marker)):
        (live,), (offline,) = recorded[f'/dragon/{name}'], simulated[f'/dragon/{name}']
        assert live[:2] == offline[:2]
        # What the sender serialised has padding of its own: the fields are compared. The scene tells settings of sim.
        told, expected = (deserialize_message(row[2], kind) for row in (live, offline))
        assert name == 'scene' or told == expected


@pytest.mark.parametrize('size', [100_000, 900_000])
def test_a_recorder_that_is_killed_leaves_a_bag_that_is_repaired_and_holds_what_the_model_says(start, tmp_path, size,
                                                                                              capsys):
    path, whole = tmp_path / 'killed.mcap', tmp_path / 'whole.mcap'
    record = start('record', '--output', path, '--flush-s', '0.05')
    sim = start('sim', *SCENE[:2], '--ros-args', '-p', READERS, '-p', 'time_scale:=4.0')
    end = time.monotonic() + 60
    while not path.exists() or path.stat().st_size < size:
        assert time.monotonic() < end, record.text + sim.text
        threading.Event().wait(0.01)
    record.kill()
    sim.kill()
    assert main(['inspect', str(path)]) == 1
    assert main(['inspect', str(path), '--repair', str(whole)]) == 0
    assert main(['inspect', str(whole)]) == 0
    capsys.readouterr()
    main(['inspect', str(whole), '--check', '--format', 'json'])
    found = json.loads(capsys.readouterr().out)
    assert found['equal'] > 3
    assert all('is missing' in fault for fault in found['faults'])
