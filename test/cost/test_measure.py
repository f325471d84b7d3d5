"""Times of calls that take turns."""
from dragon_ros.cost.measure import timed_in_turn


def test_calls_take_turns_and_each_is_timed_when_the_caches_are_full():
    order: list[str] = []
    timings = timed_in_turn([lambda: order.append('one'), lambda: order.append('other')], 0.0, 3)
    assert order == 3 * ['one', 'one', 'other', 'other']
    assert [timing.calls for timing in timings] == [3, 3]
