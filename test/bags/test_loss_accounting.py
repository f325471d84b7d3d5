"""Loss reports are based on the publisher's message numbers and on the run's ticks."""
import pytest

from dragon_ros.bags.record.loss_accounting import LossAccount
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Run, Scene

RUN = Run(5.0, 6.0, 30.0)      # the period is not a whole number of nanoseconds
SCENE = Scene(run=RUN, effects=Effect.NONE)
HANDLES = '/d/handles'


def account_of(ticks, sequence=None, scene=SCENE):
    account = LossAccount()
    account.scene(scene, '/d')
    for n, k in enumerate(ticks):
        account.note(HANDLES, RUN.time_ns(k), n + 1 if sequence is None else sequence[n])
        account.stamp(RUN.time_ns(k))
    return account


def test_a_whole_run_is_complete():
    account = account_of(range(31))
    assert account.complete(ended=True)
    assert account.lines(ended=True) == []
    report = account.report(ended=True)
    assert report['complete'] == 'true'
    assert report['/d/handles received'] == '31'
    assert report['/d/handles ticks'] == '0-30'
    assert report['/d/handles missing ticks'] == 'none'


def test_ticks_that_were_lost_on_the_way_are_named():
    ticks = [k for k in range(31) if k not in (7, 12, 13, 14)]
    account = account_of(ticks, [k + 1 for k in ticks])
    assert not account.complete(ended=True)
    assert account.missing(ended=True) == {HANDLES: [(7, 7), (12, 14)]}
    assert account.lines(ended=True) == ['/d/handles: 4 ticks are missing: 7, 12-14',
                                        '/d/handles: 4 messages were lost in transit, of 31 published']
    assert account.report(ended=True)['/d/handles missing ticks'] == '7, 12-14'


def test_a_single_lost_tick_is_reported_in_the_singular():
    ticks = [k for k in range(1, 31) if k != 7]
    account = account_of(ticks, [k + 1 for k in ticks])
    assert account.lines(ended=True) == [
        '/d/handles: the beginning is missing: 1 tick was published before the first one received',
        '/d/handles: 1 tick is missing: 7', '/d/handles: 1 message was lost in transit, of 30 published']


def test_ticks_that_were_never_published_are_missing_but_not_lost():
    account = account_of([0, 1, 5, 6])
    assert account.missing(ended=True) == {HANDLES: [(2, 4)]}
    assert account.report(ended=True)['/d/handles lost'] == '0'


@pytest.mark.parametrize('numbers', [range(11, 21), range(1, 11)])      # a sim without subscribers publishes nothing
def test_a_recorder_that_joins_late_says_so_and_misses_nothing_after(numbers):
    account = account_of(range(10, 20), numbers)
    assert account.missing(ended=True) == {}
    assert not account.complete(ended=True)
    assert account.lines(ended=True) == [
        '/d/handles: the beginning is missing: 10 ticks were published before the first one received']
    report = account.report(ended=True)
    assert report['/d/handles before'] == str(numbers[0] - 1)
    assert report['/d/handles missing at the beginning'] == '10'


def test_ticks_that_come_before_the_scene_count_from_run_to_run():
    account, second = LossAccount(), Scene(run=Run(1.0, 2.0, 10.0), effects=Effect.NONE)
    for scene, ahead in ((SCENE, 4), (second, 0), (SCENE, 3), (second, 1)):
        for k in range(11):
            if k == ahead:
                account.scene(scene, '/d')
            account.note(HANDLES, scene.run.time_ns(k), k + 1)
        assert account.report(ended=True)['/d/handles ticks'] == '0-10'
        assert account.complete(ended=True), account.lines(ended=True)


def test_without_a_scene_the_numbers_tell_what_came_before():
    account = account_of(range(3, 9), range(4, 10), scene=None)
    account.note('/d/clearance', RUN.time_ns(3), 700)       # a monitor's numbers continue across runs
    assert account.lines(ended=True) == [
        '/d/handles: the beginning is missing: 3 messages were published before the first one received']
    assert not account.complete(ended=True)
    whole = account_of(range(3, 9), scene=None)             # like a replay that starts late
    assert whole.complete(ended=True)


def test_a_topic_of_each_tick_that_never_came_is_named():
    account = LossAccount()
    account.scene(Scene(run=RUN, effects=Effect.VELOCITY), '/d')
    assert account.lines(ended=True) == [f'/d/{name}: no message was received' for name in ('handles', 'velocities')]
    assert (account.complete(ended=True), account.report(ended=True)['/d/handles received']) == (False, '0')
    account.note(HANDLES, RUN.time_ns(0), 1)
    assert account.lines(ended=True) == ['/d/velocities: no message was received']
    assert not account.complete(ended=True)


def test_a_publisher_of_which_nothing_is_heard_is_named_without_a_scene():
    account = LossAccount()
    assert account.complete(ended=True)
    account.offer(HANDLES)
    assert account.lines(ended=False) == ['/d/handles: no message was received']
    account.note(HANDLES, RUN.time_ns(0), 1)
    assert account.complete(ended=True)


def test_what_one_topic_lacks_at_the_end_is_missing_once_the_run_has_ended():
    account = LossAccount()
    account.scene(Scene(run=RUN, effects=Effect.VELOCITY), '/d')
    for k in range(10):
        account.note(HANDLES, RUN.time_ns(k), k + 1)
        if k < 8:
            account.note('/d/velocities', RUN.time_ns(k), k + 1)
    assert account.missing(ended=True) == {'/d/velocities': [(8, 9)]}
    assert account.complete(ended=False)


def test_without_a_scene_losses_show_in_the_numbers_and_the_spacing():
    account = account_of([0, 1, 2, 5, 6], [1, 2, 3, 6, 7], scene=None)
    assert account.missing(ended=True) == {}
    assert not account.complete(ended=True)
    assert account.report(ended=True)['/d/handles lost'] == '2'
    assert account.spacing().endswith('ns apart, but 1 of 4 are not: 1 are longer')


def test_a_second_publisher_in_time_is_followed_and_one_at_a_time_beside_it_is_not():
    after = account_of([0, 1, 2, 0, 1, 2], [1, 2, 4, 1, 2, 3])
    assert after.topics[HANDLES].lost_on_the_way == 1
    beside = account_of([0, 1, 2], [1, 500, 2])
    beside.share([HANDLES])
    assert beside.complete(ended=True)
    assert 'several publishers' in beside.report(ended=True)['/d/handles lost']


def test_the_frame_of_exactly_the_contact_belongs_to_no_tick_and_is_counted():
    account = account_of([0, 1])
    account.note(HANDLES, RUN.time_ns(1) + 5, 3)
    assert account.topics[HANDLES].off_ticks == 1
    assert account.complete(ended=True)


def test_another_run_starts_the_ticks_again():
    account = account_of([0, 1, 9])
    account.scene(Scene(run=Run(0, 1)), '/d')
    assert account.missing(ended=True) == {}


@pytest.mark.parametrize('stamps', [0, 1])
def test_a_spacing_needs_two_stamps(stamps):
    assert account_of(range(stamps)).spacing() == 'too few stamps'
