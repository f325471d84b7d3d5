import numpy as np

from dragon_ros.messages.decode import Poses
from dragon_ros.messages.markers import CubesTemplate
from dragon_ros.messages.observation import read_benches
from dragon_ros.messages.synchronizer import Synchronizer


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
    assert pairs.add_benches(other := shown(3), 0.3) is None
    assert pairs.add_handles(third := poses(3), 0.4) == (third, other)
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


def test_waiting_for_partners_is_bounded():
    pairs = Synchronizer()
    for t_ns in range(300):
        pairs.add_handles(poses(t_ns, 2**20), 0.0)
    assert len(pairs.take_unmatched()) == 300 - 128
