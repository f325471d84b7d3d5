"""A publisher may number its messages beyond 32 bits, and send them without a source time: all are recorded."""
import pytest
from mcap.reader import make_reader

from dragon_ros.bags.record.recording import Recording
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders

SCENE = Scene(dragon=Dragon(3), run=Run(10, 10.1))


@pytest.mark.parametrize(('source_ns', 'first'), [(-1, 1), (-2**63, 1), (2**63 - 1, 1), (0, 2**32 - 1), (5, 2**62)])
def test_odd_numbers_and_source_times_lose_nothing(tmp_path, source_ns, first):
    path, encode = tmp_path / 'a.mcap', encoders(SCENE)
    recording = Recording(BagWriter(path, threaded=False), {name: f'/dragon/{name}' for name in channels()}, 'dragon',
                          {}, flush_s=1.0, queue_mb=1.0, trust=False, warn=pytest.fail, warn_of_invalid=pytest.fail,
                          publisher_waits=lambda: False, on_monitor=pytest.fail)
    take = {name: recording.receiver(channels()[name]) for name in ('handles', 'benches')}
    for k in range(3):
        for name, receive in take.items():
            receive(encode[name](tick(SCENE, k)), {'source_timestamp': source_ns, 'publication_sequence_number':
                                                   first + k, 'received_timestamp': 1})
    recording.close(gone=True)
    with path.open('rb') as file:
        rows = [message for _, _, message in make_reader(file).iter_messages()]
    assert sorted(row.data for row in rows) == sorted(
        encode[name](tick(SCENE, k)) for name in take for k in range(3))
    assert [row.publish_time for row in rows] == [source_ns if source_ns >= 0 else row.log_time for row in rows]
