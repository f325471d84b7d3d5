"""A bag is held against the model tick by tick, and a run that ends in a contact to the frame at its time."""
from dataclasses import replace

import pytest

from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import contact_frame, tick, ticks_before
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders

SCENE = Scene(run=Run(412, 412.5))


def test_a_bag_of_the_model_equals_the_model(tmp_path, write_bag):
    with BagReader(write_bag(tmp_path / 'a.mcap')) as bag:
        result = compare_with_model(bag, SCENE)
        assert bag.start_ns == 412 * 10**9
    assert (result.equal, result.faults) == (3 * 26, [])


def test_a_lost_a_doubled_and_a_strange_tick_are_each_found(tmp_path, write_bag):
    ticks = [k for k in range(26) if k != 7] + [9]
    with BagReader(write_bag(tmp_path / 'a.mcap', ticks)) as bag:
        faults = [f for f in compare_with_model(bag, SCENE).faults if 'handles' in f]
        assert faults == ['tick 7: handles is missing', 'tick 9: handles is there 2 times']
    with BagReader(write_bag(tmp_path / 'b.mcap')) as bag:
        other = compare_with_model(bag, Scene(run=Run(412, 412.4)))
        assert len(other.faults) == 3 * 5
        assert 'belongs to no tick' in other.faults[0]


EVERYTHING = Scene(run=Run(412.4, 412.6), effects=~Effect.CLOCK)
CONTACT_S = first_contact(SCENE).t_s


def write_frames(path, scene, frames):
    encode = encoders(scene)
    with BagWriter(path) as bag:
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k, frame in enumerate(frames):
            for name in encode:
                bag.write(f'/dragon/{name}', bytes(encode[name](frame)), frame.t_ns, k)
    return path


@pytest.mark.parametrize('scene', [
    SCENE, EVERYTHING, replace(SCENE, accuracy='preview'), Scene(run=Run(CONTACT_S, 413))],
    ids=['usual', 'everything', 'preview', 'from the contact on'])
def test_a_run_that_ends_in_a_contact_has_the_ticks_before_it_and_its_frame(tmp_path, scene):
    before = [tick(scene, k) for k in range(ticks_before(scene, CONTACT_S))]
    end, topics = contact_frame(scene, CONTACT_S), len(encoders(scene))

    def checked(name, frames):
        with BagReader(write_frames(tmp_path / name, scene, frames)) as bag:
            return compare_with_model(bag, scene, contact_s=CONTACT_S)
    whole = checked('a.mcap', [*before, end])
    assert (whole.equal, whole.faults) == (topics * (len(before) + 1), [])
    lacking = checked('b.mcap', before[1:]) if before else checked('b.mcap', [tick(scene, 1)])
    assert lacking.missing_count == topics * (2 if before else 1)
    assert f'tick {len(before)}: handles is missing' in lacking.faults
    beyond = checked('c.mcap', [*before, end, tick(scene, len(before) + 1)])
    assert (beyond.equal, beyond.fault_count) == (whole.equal, topics)
    assert all('belongs to no tick' in fault for fault in beyond.faults)
