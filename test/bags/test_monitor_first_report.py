"""A recorder counts the first reports of a monitor that it did not receive."""
import pytest

from dragon_ros.bags.record.first_report import FirstReport
from dragon_ros.messages.decode import Health


def missing_after(*events):
    """Return the number of missing reports after the events ('tick', t), ('begins', t) or ('health', t, reports)."""
    word = FirstReport()
    for what, *values in events:
        if what == 'health':
            t_ns, reports = values
            word.health(Health(t_ns, 0, leaves=False, reports=reports))
        else:
            {'tick': word.examinable, 'begins': word.begins}[what](*values)
    return word.missing


TICKS = tuple(('tick', t) for t in range(1, 5))


@pytest.mark.parametrize(('events', 'missing'), [
    (TICKS, 0),                                                     # there is no monitor
    ([*TICKS, ('health', None, 0)], 0),                             # it has not examined any tick
    ([*TICKS, ('begins', 1), ('health', 1, 1)], 0),
    ([*TICKS, ('begins', 3), ('health', 3, 3)], 2),
    ([*TICKS, ('health', 3, 3), ('begins', 3)], 2),                 # the health arrived first
    ([*TICKS, ('begins', 3), ('begins', 4), ('health', 3, 3)], 2),  # or late
    ([*TICKS, ('begins', 3), ('begins', 4), ('health', 4, 4)], 2),
    ([*TICKS, ('begins', 3), ('health', 3, 1)], 0),                 # a monitor that started late
    ([*TICKS, ('begins', 3), ('health', 3, 2)], 1),                 # or that started late and discovered us later
    ([*TICKS, ('begins', 1), ('health', 1, 501)], 0),               # it has observed an earlier run
    ([*TICKS, ('begins', 3), ('health', 3, 503)], 2),
    ([('begins', 3), *TICKS, ('health', 3, 503)], 0),               # the recorder has received no earlier tick
    ([*TICKS, ('begins', 3), ('health', 3, 3), ('health', 1, 1)], 2),       # another monitor follows
    ([*TICKS, ('begins', 3), ('health', 3, 0)], 0),                 # a monitor that does not state a number
    ([*TICKS, ('health', 4, 4)], 4),                                # no report arrived at all
    ([*TICKS, ('health', 2, 2)], 2),
    ([*TICKS, ('health', 4, 1)], 1),
])
def test_reports_on_recorded_ticks_before_the_first_one_received_are_counted(events, missing):
    assert missing_after(*events) == missing
