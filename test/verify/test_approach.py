"""The slack in a contact's position cannot hide a wrong time: only the leader's first arrival is proved."""
import re
from dataclasses import replace
from functools import cache

import pytest
from certificates import proved, refusal, written
from flint import arb
from motions import at, compiled
from properties import thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes.certificate import of_claim
from dragon_ros.verify.posture import overlap

BODY, TRACK = Dragon(14, 0.9, 2.9, 0.2), Spiral(0.55, 4.28)
HOUR = 3600.0
BACK_S = 0.1        # further back on the track, other benches touch


@cache
def found():
    return written(Scene(dragon=BODY, track=TRACK, run=Run(0, 5)))['contact']


@cache
def there_m():
    """Return the distance that the head has travelled when benches begin to overlap, to the last bit of a float."""
    track, benches, _ = compiled(BODY, TRACK)
    low, high = found()['t_s'] - 1e-9, found()['t_s'] + 1e-9
    while low < (middle := 0.5 * (low + high)) < high:
        posture = at(track, benches, arb(middle))
        touches = overlap(*(posture.pose(bench) for bench in found()['benches']))
        low, high = (low, middle) if touches else (middle, high)
    return high


def claim(head, t_s=None, stop_s=None, start_s=0.0, grazing=False):
    """Return a certificate of a contact at a time, or of no contact."""
    scene = Scene(dragon=BODY, track=TRACK, head=head, run=Run(start_s, stop_s))
    contact = {'t_s': t_s}
    if t_s is not None:
        contact |= {'benches': found()['benches']} | ({'grazing': True} if grazing else {})
    return of_claim(scene, contact)


def there_and_back(beyond_m):
    """Return a head law, the time at which it turns back, and the time of its second arrival at the contact.

    The head turns back ``beyond_m`` beyond the contact, rests for an hour and returns.
    """
    turn_s = there_m() + beyond_m
    back_s = turn_s + BACK_S
    again_s = back_s + HOUR
    knots = ((0.0, 1.0), (turn_s, 1.0), (turn_s, -1.0), (back_s, -1.0), (back_s, 0.0), (again_s, 0.0), (again_s, 1.0),
             (again_s + 9.0, 1.0))
    return Profile(knots), turn_s, again_s + (there_m() - (2 * turn_s - back_s))


@pytest.mark.parametrize(('beyond_m', 'grazing'), thinned(
    [(beyond_m, grazing) for beyond_m in (1e-12, 1e-11, 1e-10, 5e-10, 9e-10, 5e-9, 1e-3) for grazing in (False, True)],
    lambda case: case == (5e-9, False)))
def test_a_contact_that_the_leader_overshoots_is_not_proved_an_hour_later(beyond_m, grazing):
    head, turn_s, again_s = there_and_back(beyond_m)
    said = 'already been beyond' if beyond_m > (1e-7 if grazing else 1e-9) else 'overlap'
    assert said in refusal(claim(head, again_s, grazing=grazing))
    assert refusal(claim(head))
    assert refusal(claim(head, stop_s=turn_s + 2 * BACK_S))
    assert f'to the contact at {there_m()!r} s' in proved(claim(head, there_m()))


@pytest.mark.parametrize('beyond_m', thinned([-1e-12, -1e-11, -1e-10, -5e-10, -9e-10, -1e-3],
                                             lambda beyond_m: beyond_m == -9e-10))
def test_one_contact_alone_is_proved_of_a_leader_that_first_turns_back_just_before_it(beyond_m):
    head, turn_s, again_s = there_and_back(beyond_m)
    assert 'do not overlap' in refusal(claim(head, turn_s))
    assert f'to the contact at {again_s!r} s' in proved(claim(head, again_s))
    assert 'it stops' in proved(claim(head, stop_s=turn_s + 2 * BACK_S))
    assert refusal(claim(head))


def test_a_leader_that_rests_just_before_a_contact_comes_to_it_after_its_rest():
    rest_s = there_m() - 5e-10
    head = Profile(((0.0, 1.0), (rest_s, 1.0), (rest_s, 0.0), (rest_s + HOUR, 0.0), (rest_s + HOUR, 1.0)))
    assert 'do not overlap' in refusal(claim(head, rest_s))
    assert 'has rested since' in refusal(claim(head, rest_s + 1.0))
    assert proved(claim(head, rest_s + HOUR + 5e-10))
    assert 'it stops' in proved(claim(head, stop_s=rest_s + HOUR))


def test_a_leader_that_rests_just_beyond_a_contact_came_to_it_before():
    rest_s = there_m() + 5e-10
    head = Profile(((0.0, 1.0), (rest_s, 1.0), (rest_s, 0.0), (rest_s + HOUR, 0.0), (rest_s + HOUR, 1.0)))
    assert 'overlap 0.5 nm after it' in proved(claim(head, there_m()))
    assert proved(claim(head, rest_s))
    assert 'has rested since' in refusal(claim(head, rest_s + 1.0))
    assert refusal(claim(head, rest_s + HOUR))
    assert refusal(claim(head, stop_s=rest_s + HOUR))


@pytest.mark.parametrize('early_m', thinned([-9e-10, 0.0, 9e-10], lambda early_m: early_m > 0))
def test_where_the_leader_creeps_through_the_slack_both_times_are_told(early_m):
    """At a picometre per second, a slack of a nanometre makes the time uncertain by half an hour."""
    slow_s = there_m() - 2e-9
    head = Profile(((0.0, 1.0), (slow_s, 1.0), (slow_s, 1e-12), (slow_s + 4000.0, 1e-12), (slow_s + 4000.0, 1.0)))
    t_s = slow_s + 2000.0 + early_m * 1e12
    said = proved(claim(head, t_s))
    first, last = (float(part) for part in said.split('(travelled from ')[1].split(' s)')[0].split(' to '))
    slack_s = 1e3 * float(re.search(r'less ([0-9.]+) nm', said)[1])     # it is wider, as the benches approach slowly
    within = max(0.0, t_s - slow_s - slack_s), min(4000.0, t_s - slow_s + slack_s)
    assert (first - slow_s, last - slow_s) == pytest.approx(within, abs=10.0)     # the slack is stated in three digits
    assert first < slow_s + 2000.0 < last


def test_no_times_are_told_where_the_slack_is_soon_over():
    assert 'travelled from' not in proved(claim(Head(1.0), there_m()))
    assert 'travelled from' in proved(claim(Head(1e-5), there_m() * 1e5))


@pytest.mark.parametrize('before_s', thinned([3.6e-9, 1.5e-9, 1e-9, 3e-10, 0.0], lambda before_s: before_s > 3e-9))
def test_a_run_that_starts_just_before_its_contact_is_proved(before_s):
    start_s = there_m() - before_s
    assert proved(written(Scene(dragon=BODY, track=TRACK, run=Run(start_s, 5))))


def test_at_the_start_benches_overlap_as_far_on_as_the_leader_goes_and_no_further():
    start_s = there_m() - 5e-10
    back = Profile(((0.0, 1.0), (start_s, 1.0), (start_s, -1.0)))
    rest = Profile(((0.0, 1.0), (start_s, 1.0), (start_s, 0.0)))
    for head in (back, rest):
        assert 'do not overlap' in refusal(claim(head, start_s, start_s + BACK_S, start_s))
        assert 'it stops' in proved(claim(head, None, start_s + BACK_S, start_s))
    beyond = Profile(((0.0, 1.0), (there_m() + 5e-10, 1.0), (there_m() + 5e-10, 0.0)))
    assert 'starts with its contact' in proved(claim(beyond, there_m() + 5e-10, 9.0, there_m() + 5e-10))


def test_a_contact_at_the_start_is_proved_though_the_leader_cannot_move_on():
    scene = Scene(dragon=Dragon(40, width_m=0.6), head=Head(-1.0, 'tail'), run=Run(0, 5))   # the head is at the end
    assert 'starts with its contact at 0.0 s' in proved(written(scene))


def test_a_contact_that_a_leader_overshoots_on_its_way_back_is_not_proved_an_hour_later():
    """The leader overshoots by half a nanometre, which is within the slack."""
    scene = Scene(dragon=Dragon(14, 0.9, 2.9, 0.2), track=Spiral(0.55, 4.28), head=Head(-1.0), run=Run(0, 5))
    found = first_contact(scene)
    turn_s = found.t_s + 5e-10
    again_s = turn_s + 0.05 + HOUR
    head = Profile(((0.0, -1.0), (turn_s, -1.0), (turn_s, 1.0), (turn_s + 0.05, 1.0), (turn_s + 0.05, 0.0),
                    (again_s, 0.0), (again_s, -1.0), (again_s + 9.0, -1.0)))

    def claimed(t_s):
        return of_claim(replace(scene, head=head, run=Run(0, again_s + 5)), {'t_s': t_s, 'benches': [*found.benches]})

    assert f'to the contact at {found.t_s!r} s' in proved(claimed(found.t_s))
    assert 'overlap' in refusal(claimed(again_s + 0.05 - turn_s + found.t_s))
