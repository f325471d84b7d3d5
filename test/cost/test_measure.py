"""Times of calls: alternating, and the fastest of several passes."""
from dragon_ros.cost.measure import Timing, fastest, timed_in_turn


def test_of_each_call_the_fastest_pass_counts():
    slow, usual = Timing(5.0, 4.0, 6.0, 9), Timing(1.0, 0.5, 9.0, 9)
    assert fastest([[slow, usual], [usual, slow], [slow, slow]]) == [usual, usual]
    assert fastest([]) == []


def test_calls_take_turns_and_each_is_timed_when_the_caches_are_full():
    order: list[str] = []
    timings = timed_in_turn([lambda: order.append('one'), lambda: order.append('other')], 0.0, 3)
    assert order == 3 * ['one', 'one', 'other', 'other']
    assert [timing.calls for timing in timings] == [3, 3]
