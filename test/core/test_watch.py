import numpy as np
import pytest

from dragon_ros.core.benches import Benches
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.core.watch import Sight, Watch


def sights(scene, ticks):
    for k in ticks:
        frame = tick(scene, k)
        yield Sight(frame.t_ns, frame.chain.p, frame.benches)


def events(scene, ticks, watch=None):
    watch = watch or Watch()
    return [event for sight in sights(scene, ticks) if (event := watch.look(sight))]


def test_the_event_brackets_the_contact_and_interpolates_it():
    (event,) = events(Scene(run=Run(410, 413)), range(151))
    assert event.benches == (0, 8)
    assert (event.before_ns, event.after_ns) == (412_460_000_000, 412_480_000_000)
    assert event.t_contact_s == pytest.approx(412.473837682, abs=1e-6)
    assert event.point_m == pytest.approx((1.474395, 2.110665), abs=1e-4)
    assert event.gap_m == pytest.approx(-1.618e-4, abs=1e-6)


@pytest.mark.parametrize('rate', [5, 20, 50, 200])
def test_interpolation_gets_better_with_the_rate(rate):
    scene = Scene(run=Run(411.9, 413, rate))
    (event,) = events(scene, range(scene.last_tick + 1))
    assert abs(event.t_contact_s - 412.473837682115) < 0.02 / rate**2


def test_a_watch_that_starts_in_contact_has_an_open_bracket():
    (event,) = events(Scene(run=Run(412.6, 413)), range(5))
    assert event.before_ns is None
    assert event.t_contact_s == 412.6


def test_the_same_tick_again_tells_nothing_new():
    scene, watch = Scene(run=Run(412.4, 413)), Watch()
    assert len(events(scene, [3, 4, 4, 4, 5, 5], watch)) == 1


def test_time_going_back_starts_afresh():
    scene, watch = Scene(run=Run(412, 413)), Watch()
    assert len(events(scene, range(51), watch)) == 1
    assert len(events(scene, range(51), watch)) == 1


def test_a_contact_that_lasts_is_one_event():
    assert len(events(Scene(run=Run(412.4, 414)), range(60))) == 1


@pytest.mark.parametrize(('turn', 'mirror'), [(1.0, 1), (-2.5, 1), (0.0, -1), (2.0, -1)])
def test_a_turned_or_mirrored_dragon_has_the_same_contact(turn, mirror):
    move = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ np.diag([1, mirror])
    scene, watch = Scene(run=Run(412.3, 412.6)), Watch()
    (plain,) = events(scene, range(16))
    moved = []
    for sight in sights(scene, range(16)):
        b = sight.benches
        benches = Benches(b.centre @ move.T, b.axis @ move.T, b.half_length, b.half_width)
        moved += filter(None, [watch.look(Sight(sight.t_ns, sight.p @ move.T, benches))])
    (event,) = moved
    assert event.benches == plain.benches
    assert event.t_contact_s == pytest.approx(plain.t_contact_s, abs=1e-9)
    assert event.point_m == pytest.approx(tuple(move @ plain.point_m), abs=1e-9)


def test_another_number_of_benches_starts_afresh():
    from dragon_ros.core.dragon import Dragon
    watch = Watch()
    assert len(events(Scene(run=Run(412.4, 413)), range(10), watch)) == 1
    assert len(events(Scene(dragon=Dragon(50), run=Run(412.7, 413)), range(3), watch)) == 1
    assert np.isfinite(watch._seen[-1].p).all()
