from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.scene import Run, Scene

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
