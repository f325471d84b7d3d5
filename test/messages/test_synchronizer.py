from collections import deque
from random import Random

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.limits import MONITOR_BYTES
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.decode import MessageError, Poses
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.markers import CubesTemplate
from dragon_ros.messages.observation import observation_of, read_benches
from dragon_ros.messages.synchronizer import Streams, Synchronizer


def poses(t_ns, values=7):
    return Poses(t_ns, 'dragon', np.zeros(values))


def shown(t_ns):
    template = CubesTemplate(np.array([3.41]), 0.3, 'dragon')
    return read_benches(template.encode(t_ns, np.zeros((1, 2)), np.array([[1.0, 0.0]])))


def test_pairs_are_made_by_stamp_and_what_was_overtaken_is_given_up():
    pairs = Synchronizer()
    assert pairs.add_handles(poses(1), 0.0) is None
    assert pairs.add_handles(second := poses(2), 0.1) is None
    assert pairs.add_benches(benches := shown(2), 0.2) == (second, benches)
    assert pairs.take_unmatched() == [('handles', 1)]
    assert pairs.add_benches(shown(3), 0.3) is None
    found, other = pairs.add_handles(third := poses(3), 0.4)
    assert found is third
    assert other.t_ns == 3
    assert pairs.take_unmatched() == []


def test_a_run_that_restarts_while_one_topic_lags_costs_no_pair():
    pairs = Synchronizer()
    for first in (poses(1), poses(2), again := poses(1)):
        pairs.add_handles(first, 0.0)
    found = [pairs.add_benches(shown(t_ns), 0.0) for t_ns in (1, 2, 1)]
    assert [one.t_ns for one, _ in found] == [1, 2, 1]
    assert found[-1][0] is again
    assert pairs.take_unmatched() == []


def test_a_partner_that_does_not_come_in_time_is_given_up_on_both_topics():
    pairs = Synchronizer()
    pairs.add_handles(poses(1), 10.0)
    pairs.add_benches(shown(2), 11.0)
    pairs.expire(10.5)
    assert pairs.take_unmatched() == [('handles', 1)]
    pairs.expire(11.5)
    assert pairs.take_unmatched() == [('benches', 2)]


def test_a_stamp_that_comes_again_after_its_pair_waits_for_another_partner():
    pairs = Synchronizer()
    for _ in range(3):
        assert pairs.add_handles(poses(1), 0.0) is None
        assert pairs.add_benches(shown(1), 0.0) is not None
        assert pairs.add_benches(shown(1), 0.0) is None
        assert pairs.add_handles(poses(1), 0.0) is not None
    assert pairs.take_unmatched() == []
    assert pairs.held_bytes == 0


def test_of_messages_that_wait_only_those_that_came_before_are_given_up():
    pairs = Synchronizer()
    for t_ns, now_s in ((1, 10.0), (2, 10.4), (3, 11.0)):
        pairs.add_handles(poses(t_ns), now_s)
    pairs.expire(10.4)
    assert pairs.take_unmatched() == [('handles', 1)]
    pairs.expire(10.5)
    assert pairs.take_unmatched() == [('handles', 2)]


def test_without_room_the_topic_gives_up_that_has_waited_longest():
    pairs, half = Synchronizer(), MONITOR_BYTES // 16
    for t_ns, now_s in ((1, 1.0), (2, 9.0)):
        pairs.add_handles(poses(t_ns, half // 2), now_s)
    pairs.add_benches(shown(100), 0.5)
    pairs.add_handles(poses(3, half // 2), 10.0)
    pairs.add_handles(poses(4, half - 10_000), 10.0)
    assert pairs.take_unmatched() == [('benches', 100), ('handles', 1)]


def test_waiting_for_partners_is_bounded_in_bytes_over_both_topics():
    pairs = Synchronizer()
    room = MONITOR_BYTES // 2**23
    for t_ns in range(2 * room):
        pairs.add_handles(poses(t_ns, 2**20), float(t_ns))
        pairs.add_benches(shown(10**6 + t_ns), t_ns + 0.5)
        assert pairs.held_bytes <= MONITOR_BYTES
    dropped = pairs.take_unmatched()
    assert len(dropped) > room
    assert dropped[:2] == [('handles', 0), ('benches', 10**6)]      # the messages that have waited longest are dropped
    assert pairs.add_benches(shown(2 * room - 1), 1e3) is not None   # the newest messages are kept


@pytest.mark.parametrize(('markers', 'bytes_each'), [('cubes', 50), ('triangles', 66)])
def test_waiting_benches_of_a_long_dragon_take_what_their_rectangles_take(markers, bytes_each):
    count = 3_000
    scene = Scene(dragon=Dragon(count), markers=markers, run=Run(0, 1))
    frame = tick(scene, 0)
    data = encoders(scene)['benches'](frame)
    whole, pairs = read_benches(data), Synchronizer()
    pairs.add_benches(whole, 0.0)
    assert pairs.held_bytes < bytes_each * count < len(data) / 3
    _, kept = pairs.add_handles(poses(frame.t_ns), 0.1)
    for field, values in vars(whole.rectangles(frame.chain.p)).items():
        assert np.array_equal(getattr(kept.rectangles(frame.chain.p), field), values)
    assert pairs.held_bytes == 0


def test_benches_that_are_of_no_use_are_refused_with_their_handles():
    template = CubesTemplate(np.array([3.41]), 0.3, 'dragon')
    bad, pairs = read_benches(template.encode(1, np.array([[np.nan, 0.0]]), np.array([[1.0, 0.0]]))), Synchronizer()
    assert pairs.add_benches(bad, 0.0) is None
    pair = pairs.add_handles(Poses(1, 'dragon', np.zeros((2, 7))), 0.1)
    with pytest.raises(MessageError, match='pose'):
        observation_of(*pair)


def test_one_topic_may_run_ahead_by_thousands_of_messages_of_an_ordinary_dragon():
    pairs = Synchronizer()
    for t_ns in range(5000):
        pairs.add_handles(poses(t_ns, 7 * 224), 0.0)
    assert pairs.take_unmatched() == []
    assert pairs.add_benches(shown(0), 0.0) is not None


def test_memory_that_names_and_layouts_take_counts_as_well():
    named = Poses(0, 'x' * 10**6, np.zeros(14))
    assert named.size_bytes > 10**6
    benches = shown(0).markers
    assert benches.size_bytes > len(benches.data)


def interleaved(rng, rows):
    """Mix several publishers' messages at random, keeping each one's order; yield (publisher, number, stamp)."""
    left = {name: deque(messages) for name, messages in rows.items()}
    while any(left.values()):
        name = rng.choice([name for name, messages in left.items() if messages])
        yield name, *left[name].popleft()


@pytest.mark.parametrize('seed', range(20))
def test_of_several_publishers_the_known_one_is_told_apart_by_numbers_and_stamps(seed):
    rng, streams = Random(seed), Streams()
    step = 20_000_000
    for k in range(1, 6):
        assert streams.take(k, k * step, alone=True)
    streams.adopt(5 * step)
    rows = {'known': [(k, k * step) for k in range(6, 200) if rng.random() < 0.98],
            'new': [(k, 400 * 10**9 + k * step) for k in range(1, 200)],
            'seeks': [(5000 + k, (600 if k < 90 else 30) * 10**9 + k * step) for k in range(200)],
            'level': [(k, (3 * k + 1) * step) for k in range(4, 200)]}
    for name, number, t_ns in interleaved(rng, rows):
        assert streams.take(number, t_ns, alone=False) == (name == 'known'), (name, number)


def test_a_known_publisher_that_seeks_stays_known_until_it_is_forgotten():
    streams = Streams()
    for k in range(1, 10):
        streams.take(k, 10**9 + k, alone=True)
    streams.adopt(10**9 + 9)
    assert not streams.take(500_000, 5, alone=False)
    assert streams.take(10, 7 * 10**9, alone=False)      # the publisher has jumped to another time
    assert streams.take(11, 7 * 10**9 + 1, alone=False)
    assert not streams.take(500_001, 6, alone=False)
    streams.forget()
    assert streams.take(500_002, 7, alone=False)
    streams.adopt(7)
    assert not streams.take(12, 7 * 10**9 + 2, alone=False)


def test_all_publishers_are_taken_until_one_is_adopted_by_its_stamp():
    streams = Streams()
    for k in range(1, 5):
        assert streams.take(k, k * 10**9, alone=False)              # this publisher may send only handles
        assert streams.take(100 + k, (50 + k) * 10**9, alone=False)
    streams.adopt(54 * 10**9)
    assert not streams.take(5, 5 * 10**9, alone=False)
    assert streams.take(105, 55 * 10**9, alone=False)


def test_a_publisher_that_is_alone_is_always_taken_whatever_its_numbers():
    streams = Streams()
    for number, t_ns in ((1, 1), (2, 2), (9, 3), (1, 0), (0, 0), (0, 7), (5, 5)):
        assert streams.take(number, t_ns, alone=True)
        streams.adopt(t_ns)


@pytest.mark.parametrize(('off', 'known'), [(0.0, True), (0.2, True), (-0.2, True), (0.3, False), (-0.3, False)])
def test_beyond_lost_messages_a_stamp_tells_its_publisher_to_a_quarter_of_a_step(off, known):
    streams, step = Streams(), 20_000_000
    for k in range(1, 6):
        streams.take(k, k * step, alone=True)
    streams.adopt(5 * step)
    assert streams.take(9, 9 * step, alone=False)       # three messages were lost
    assert streams.take(5000, round((5000 + off) * step), alone=False) == known


@pytest.mark.parametrize(('lost', 'known'), [(0, True), (1000, True), (1001, False)])
def test_a_publisher_that_seeks_is_told_by_its_number_up_to_a_thousand_lost_messages(lost, known):
    streams, step = Streams(), 20_000_000
    for k in range(1, 6):
        streams.take(k, k * step, alone=True)
    streams.adopt(5 * step)
    assert streams.take(6 + lost, 10**12, alone=False) == known


def test_a_message_that_waits_with_a_later_stamp_than_its_successors_pair_is_given_up():
    pairs = Synchronizer()
    pairs.add_handles(poses(5), 0.0)
    pairs.add_handles(early := poses(3), 0.1)
    assert pairs.add_benches(benches := shown(3), 0.2) == (early, benches)
    assert pairs.take_unmatched() == [('handles', 5)]


def test_a_waiting_message_is_held_against_the_budget_with_more_than_its_values():
    pairs, one = Synchronizer(), poses(1)
    pairs.add_handles(one, 0.0)
    assert one.size_bytes < pairs.held_bytes < one.size_bytes + 10_000
