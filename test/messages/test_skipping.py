"""If more ticks arrive than can be processed, whole ticks are skipped, evenly and within the budget."""
from itertools import groupby

import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.messages.skipping import FROM_FILL, TickSkipper


def kept(fill, ticks=1000):
    skips = TickSkipper()
    found = [skips.keeps('handles', k, fill) for k in range(ticks)]
    assert skips.skipped == found.count(False)
    return found


@pytest.mark.parametrize(('fill', 'share'), [(0.0, 1.0), (FROM_FILL, 1.0), (0.625, 0.75), (0.75, 0.5), (0.875, 0.25),
                                             (1.0, 0.0), (3.0, 0.0)])
def test_all_ticks_are_kept_up_to_half_of_the_budget_and_none_beyond_it(fill, share):
    assert sum(kept(fill)) == 1000 * share


@pytest.mark.parametrize('fill', [1.0, 1.5, 3.0])
def test_once_a_queue_beyond_its_budget_is_empty_again_the_next_tick_is_kept(fill):
    skips = TickSkipper()
    assert not any(skips.keeps('handles', k, fill) for k in range(10))
    assert skips.keeps('handles', 10, 0.0)


@pytest.mark.parametrize(('fill', 'longest'), [(0.625, 1), (0.75, 1), (0.875, 3)])
def test_what_is_skipped_is_spread_evenly(fill, longest):
    assert max(len(list(run)) for keeps, run in groupby(kept(fill)) if not keeps) == longest


@examples(40)
@given(st.lists(st.tuples(st.integers(0, 9), st.sampled_from('abc'), st.floats(0, 2)), max_size=60))
def test_a_tick_is_kept_on_all_topics_or_on_none(messages):
    skips, said = TickSkipper(), {}
    for t_ns, topic, fill in messages:
        keeps, ahead = skips.keeps(topic, t_ns, fill), said.setdefault(t_ns, {})
        if topic in ahead:      # the run has been restarted
            ahead.clear()
        ahead[topic] = keeps
        assert len(set(ahead.values())) == 1


@examples(20)
@given(st.floats(1.0, 20.0), st.integers(20, 80))
def test_a_queue_settles_within_its_budget_and_the_steps_between_ticks_stay_even(faster, room):
    skips, waiting, taken, last, steps = TickSkipper(), 0, 0.0, -1, []
    for k in range(40 * room):
        if skips.keeps('handles', k, waiting / room):
            waiting += 1
            if k > 25 * room:
                steps.append(k - last)
            last = k
        taken += 1 / faster
        done = min(waiting, int(taken))
        waiting, taken = waiting - done, taken - int(taken)
        assert waiting <= room
    assert max(steps) <= faster + 2 + 4 * faster * faster / room
