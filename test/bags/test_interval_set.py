"""An interval set contains exactly the numbers that were added, in whatever order."""
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.bags.record import interval_set
from dragon_ros.bags.record.interval_set import IntervalSet


@given(st.lists(st.integers(0, 40)))
def test_the_gaps_are_what_did_not_come(numbers):
    seen = IntervalSet()
    for k in numbers:
        seen.add(k)
    missing = sorted(set(range(min(numbers, default=0), max(numbers, default=-1) + 1)) - set(numbers))
    assert [k for low, high in seen.gaps() for k in range(low, high + 1)] == missing
    assert interval_set.count(seen.gaps()) == len(missing)
    assert (seen.first, seen.last) == (min(numbers, default=None), max(numbers, default=None))
    assert all(low <= high for low, high in seen.gaps())


def test_what_is_missing_at_the_end_counts_where_the_end_is_known():
    seen = IntervalSet()
    for k in (3, 4, 6):
        seen.add(k)
    assert seen.gaps() == [(5, 5)]
    assert seen.gaps(8) == [(5, 5), (7, 8)]
    assert interval_set.text(seen.gaps(8)) == '5, 7-8'


def test_spans_are_bounded_and_say_what_they_gave_up():
    seen = IntervalSet()
    for k in range(0, 60_000, 2):
        seen.add(k)
    assert len(seen.gaps()) < 10_000
    assert seen.forgotten + interval_set.count(seen.gaps()) == 29_999
    assert 'more gaps' in interval_set.text(seen.gaps())
