"""First contacts of dragons of every kind agree with a dense scan by shapely, and special cases are handled."""
import numpy as np
import pytest
from apart import smallest
from certificates import proved
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import FACTORS, examples, magnified, thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import ChainLockError
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search import conservative_advancement
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import SpiralCurve
from dragon_ros.scenes import certificate

CROSSING = Dragon(14, 0.9, 2.9, 0.2)       # at 4.28 turns, the head is between two positions at which the body touches


@examples(15)
@given(st.integers(3, 12), st.just(0.05) | st.floats(0.1, 3), st.floats(0.1, 3), st.floats(0.02, 0.5),
       st.floats(0.05, 0.4), st.floats(0.3, 1.5), st.floats(0.6, 8), st.sampled_from([-1.0, 1.0, 3.0]), FACTORS)
def test_nothing_touches_before_the_contact_and_benches_do_then(benches, head, body, width, inset, pitch,
                                                                turns, speed, factor):
    dragon = Dragon(benches, 2 * inset + head, 2 * inset + body, width, inset)
    run = Run(0.0, 20.0 if speed < 0 else None)
    scene = Scene(dragon=dragon, track=Spiral(pitch, turns), head=Head(speed), run=run, solver='march')
    scene = magnified(scene, factor)
    try:
        end_s = compile_scene(scene).end.t_s
    except ChainLockError:
        assume(False)
    found = first_contact(scene)
    before_s = found.t_s - 1e-6 if isinstance(found, Contact) else end_s - 1e-6
    assert all(smallest(scene, t_s) > 0 for t_s in np.linspace(0, before_s, 30) if before_s > 0)
    if isinstance(found, Contact) and not found.grazing_m:
        assert smallest(scene, min(found.t_s + 1e-7, end_s)) < 1e-9
    proved(certificate.as_values(scene, found))


def test_outwards_the_tail_is_met_where_the_next_bench_has_too_few_behind_it_to_have_met_one():
    scene = Scene(Dragon(14, 2.13, 1.42, 0.354, 0.063), Spiral(0.443, 4.39), Head(-1.0), Run(0, 6.0))
    found = first_contact(scene)
    assert found.benches == (1, 13)
    assert smallest(scene, found.t_s + 1e-8) == 0
    assert all(smallest(scene, t_s) > 0 for t_s in (*np.linspace(0, found.t_s, 20, endpoint=False), found.t_s - 1e-8))


@pytest.mark.parametrize(('speed', 'pair'), thinned([(-1.0, (2, 10)), (1.0, (1, 7))], lambda case: case[0] < 0))
def test_a_body_that_touches_first_is_timed_exactly_both_ways(speed, pair):
    scene = Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), head=Head(speed), run=Run(0, 5))
    found = first_contact(scene)
    assert found.benches == pair
    for t_s, sign in ((found.t_s - 1e-9, 1), (found.t_s + 1e-9, -1)):
        chain = state(scene, t_s)
        gap = gaps(benches_of(chain, CROSSING, axes_of(chain)), *(np.array([bench]) for bench in pair))[0]
        assert 0 < sign * gap < 1e-9
    assert found.certificate.complete
    assert found.states < 280


def test_a_head_that_moves_out_into_a_contact_finds_the_end_of_one_that_moved_in():
    wide = Dragon(20, width_m=0.301)
    inward = Scene(dragon=wide)
    start = SpiralCurve.of(inward.track).inward(411.0)
    found = first_contact(Scene(dragon=wide, track=Spiral(0.55, start / (2 * np.pi)), head=Head(-1.0), run=Run(0, 5)))
    assert found.benches == (0, 11)
    t_s = 411.0 - found.t_s
    assert smallest(inward, t_s - 1e-7) == 0 < smallest(inward, t_s + 1e-7)


def meeting_time(head_length_m, pair):
    """Return the time near 424.5 s at which a pair of benches touches in a dragon with this head length."""
    scene, benches = Scene(dragon=Dragon(10, head_length_m), solver='march'), [np.array([bench]) for bench in pair]

    def gap(t_s):
        chain = state(scene, t_s)
        return float(gaps(benches_of(chain, scene.dragon, axes_of(chain)), *benches)[0])
    return illinois(gap, 424.2, 425.2, gap(424.2), gap(425.2))


def test_two_pairs_that_meet_at_the_same_time_are_one_set():
    """With a short head the body touches first, with a longer head the head; in between, both touch simultaneously."""
    def lead(head_length_m):
        return meeting_time(head_length_m, (0, 7)) - meeting_time(head_length_m, (1, 8))
    length = illinois(lead, 1.872, 1.873, lead(1.872), lead(1.873))
    assert abs(lead(length)) < 1e-11
    found = first_contact(Scene(dragon=Dragon(10, length), run=Run(424.0)))
    assert {found.benches, *found.simultaneous} == {(1, 8), (0, 7)}
    assert found.uncertainty_s > 5e-11
    for other, first in ((length - 1e-6, (1, 8)), (length + 1e-6, (0, 7))):
        apart = first_contact(Scene(dragon=Dragon(10, other), run=Run(424.0)))
        assert (apart.benches, apart.simultaneous) == (first, ())


@pytest.mark.parametrize(('scene', 'reason'), [
    (Scene(dragon=Dragon(30, width_m=0.01), run=Run(400.0)), 'lock'), (Scene(run=Run(0, 412.4)), 'stop'),
    (Scene(dragon=Dragon(3, 0.55, 1.5, 0.5, 0.25), track=Spiral(1.14453125, 1), head=Head(3.0)), 'track')])
def test_a_run_without_contact_says_how_it_ended_and_is_proved(scene, reason):
    found = first_contact(scene)
    assert isinstance(found, NoContact)
    assert found.end.reason == reason
    assert found.certificate.complete


def test_a_second_handle_that_turns_back_near_the_lock_hides_nothing():
    """In the last half second of a run of narrow benches, the head moves on inwards, and the rest moves out again."""
    scene = Scene(dragon=Dragon(30, width_m=0.01), run=Run(432.0))
    times = np.linspace(432, compile_scene(scene).end.t_s, 50)
    places = [float(np.hypot(*state(scene, t_s).p[1])) / scene.track.b_m for t_s in times]
    assert np.argmin(places) < 49
    found = first_contact(scene)
    assert isinstance(found, NoContact)
    assert found.certificate.complete


def test_a_dragon_too_long_for_the_cache_is_searched_one_interval_at_a_time_with_the_same_result(monkeypatch):
    scene = Scene(dragon=Dragon(20), run=Run(405, 413))
    found = first_contact(scene)
    for name in ('_PAIRS', '_LINKS', '_AT_ONCE'):
        monkeypatch.setattr(conservative_advancement, name, 1)
    again = first_contact(scene)
    assert (again.t_s, again.benches, again.certificate.complete) == (found.t_s, found.benches, True)


def test_a_certain_contact_after_a_near_miss_is_not_called_grazing():
    """The near miss of bench 11 has a gap of a few picometres, and benches 0 and 8 cross 2.6 s later."""
    scene = Scene(dragon=Dragon(20, width_m=0.30097406869751), run=Run(408.0))
    found = first_contact(scene)
    assert (found.benches, found.grazing_m) == ((0, 8), None)
    assert found.approach_m_s == pytest.approx(0.026934, abs=1e-6)
    assert smallest(scene, found.t_s - 1e-8) > 0 == smallest(scene, found.t_s + 1e-8)
    assert found.certificate.complete
