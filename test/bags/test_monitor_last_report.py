"""A recorder detects when a monitor has reported on the last tick."""
import pytest

from dragon_ros.bags.record.last_report import LastReport
from dragon_ros.messages.decode import Health


def reported_after(*events):
    """Return a ``LastReport`` after events ('tick', t), ('begins', t), ('fix',) or ('health', t, waiting, leaves)."""
    report = LastReport()

    def health(t_ns, waiting=0, leaves=False):
        report.health(Health(t_ns, waiting, leaves))
    for what, *values in events:
        {'tick': report.examinable, 'begins': report.begins, 'fix': report.fix, 'health': health}[what](*values)
    return report


TICKS = ('tick', 1), ('tick', 2)


@pytest.mark.parametrize(('events', 'said'), [
    ([], False),                                            # no monitor, or one that is just being discovered
    (TICKS, False),
    ([('health', None)], True),                             # a monitor that has nothing to examine
    ([*TICKS, ('health', 1)], False),
    ([*TICKS, ('health', 2)], True),
    ([*TICKS, ('begins', 1), ('health', 1)], False),
    ([('health', None), *TICKS, ('begins', 2)], False),     # the report has only begun
    ([('health', None), *TICKS, ('begins', 2), ('begins', 3)], True),
    ([*TICKS, ('health', 2), ('tick', 3)], False),
    ([*TICKS, ('health', 1, 0, True)], True),               # the monitor left before the last tick
    ([*TICKS, ('health', 1, 0, True), ('health', 1)], False),       # another monitor
    ([*TICKS, ('health', 1), ('health', 1)], True),         # nothing is waiting, so the last tick was skipped
    ([*TICKS, ('health', 1), ('health', 1, 5)], False),
    ([*TICKS, ('health', 1), ('health', 1, 5), ('health', 1)], False),
    ([('health', 1), ('tick', 2), ('health', 1)], False),   # the first report may be older than the tick
    ([('tick', 2), ('health', 1), ('begins', 1), ('health', 1)], False),
    ([('tick', 5), ('health', 5), ('tick', 2)], False),     # time has jumped back
    ([*TICKS, ('fix',), ('tick', 3), ('health', 2)], True),
    ([*TICKS, ('fix',), ('tick', 3), ('health', 1)], False),
    ([*TICKS, ('fix',), ('health', None), ('begins', 3), ('begins', 4)], True),     # the monitor has passed the tick
    ([*TICKS, ('fix',), ('health', 2), ('health', 1)], True),   # and then time has jumped back
    ([*TICKS, ('health', 2), ('fix',), ('begins', 0), ('begins', 1)], True),
    ([*TICKS, ('health', 2), ('begins', 0), ('begins', 1), ('fix',)], False),
])
def test_a_monitor_has_given_its_last_report_once_none_on_the_last_tick_can_follow(events, said):
    assert reported_after(*events).is_said is said


def test_the_last_report_is_missing_only_from_a_monitor_that_was_heard():
    assert not reported_after(*TICKS).is_missing
    assert not reported_after(*TICKS, ('begins', 1)).is_missing
    assert reported_after(*TICKS, ('health', 1)).is_missing
    assert not reported_after(*TICKS, ('health', 2)).is_missing
