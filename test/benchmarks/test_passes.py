"""The fastest of several passes over a page counts."""
from benchmarks.passes import fastest
from dragon_ros.cost.measure import Timing


def test_of_each_call_the_fastest_pass_counts():
    slow, usual = Timing(5.0, 4.0, 6.0, 9), Timing(1.0, 0.5, 9.0, 9)
    assert fastest([[slow, usual], [usual, slow], [slow, slow]]) == [usual, usual]
    assert fastest([]) == []
