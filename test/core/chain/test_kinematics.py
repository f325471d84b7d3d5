"""Accelerations of all handles agree with 40 digits on every track, under every law, with either end leading."""
from dataclasses import replace

import numpy as np
import pytest
from high_precision import rates
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import FACTORS, examples, magnified, thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.forward import next_place
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.chain.kinematics import RigidLinks, carried, entered_curvatures
from dragon_ros.core.errors import DragonError
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS, Run, Scene
from dragon_ros.core.step import frame_of, state
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn

SHORT = Dragon(9)
MIXED = Mixed((Group(1.2, 2), Group(3.41), Group(0.6), Group(2.2, 4), Group(0.9)))
LAW = Profile(((0.0, 0.5), (8.0, 2.0), (20.0, 2.0), (27.0, -1.5), (30.0, -1.5), (30.0, 1.0)), 'smooth')
LINEAR = replace(LAW, ramps='linear')
BENDY = Composite((Line(25.0), Arc(2.0, 170.0), Line(1.0), Arc(1.9, -100.0), SpiralArc(1.0, 1.5, 3.0, 'left'),
                   Line(30.0)), start_m=25.0)


def accelerations(scene, t_s):
    """Return the accelerations computed by the effect."""
    scene = replace(scene, effects=Effect.ACCELERATIONS)
    return frame_of(compile_scene(scene), None, round(t_s * NS), state(scene, t_s)).acceleration_m_s2


def allowed(v, a, scene):
    """Return the allowed error of accelerations: two position errors turn a link by their sum divided by its length.

    Position errors are at most 2e-12 m. They add up along the chain and grow in proportion to speeds near a lock.
    """
    links = scene.dragon.link_lengths_m
    angle = 4e-12 / np.min(links[links > 0], initial=1.0)
    growth = np.max(np.hypot(*v.T)) / max(abs(scene.head.speed_at_m_s(0.0)), np.min(np.hypot(*v.T)), 1e-3)
    return angle * max(1.0, growth) ** 2 * links.size * max(1.0, float(np.max(np.hypot(*a.T))))


SCENES = {
    'inwards on a spiral': (Scene(SHORT), (0.0, 100.0, 430.0, 432.8)),
    'outwards on a spiral': (Scene(SHORT, head=Head(-1.5), run=Run(stop_s=60.0)), (0.0, 40.0)),
    'on a spiral with a profile': (Scene(SHORT, head=LAW, run=Run(stop_s=60.0)), (3.0, 15.0, 24.5, 29.0, 45.0)),
    'mixed on a spiral': (Scene(MIXED), (50.0, 400.0)),
    'unwinding behind the tail': (Scene(SHORT, Spiral(0.55, 4.0), replace(LAW, lead='tail'), Run(stop_s=60.0)),
                                  (0.0, 3.0, 25.0, 40.0)),
    'through the turn': (Scene(SHORT, STurn(before_m=5.0), run=Run(stop_s=40.0)), (0.0, 7.0, 12.0, 19.0, 30.0)),
    'through the turn with a profile': (Scene(MIXED, STurn(before_m=5.0), LINEAR, Run(stop_s=60.0)),
                                      (4.0, 12.0, 25.0, 50.0)),
    'back through the turn behind the tail': (Scene(SHORT, STurn(before_m=-20.0), replace(LAW, lead='tail'),
                                                    Run(stop_s=60.0)), (2.0, 12.0, 23.0)),
    'lines, arcs and a spiral': (Scene(SHORT, BENDY, run=Run(stop_s=30.0)), (1.0, 5.0, 9.3, 15.0, 22.0)),
    'lines, arcs and a spiral behind a mixed tail': (
        Scene(MIXED, replace(BENDY, start_m=50.0), Head(1.0, 'tail'), Run(stop_s=20.0)), (1.0, 9.0, 17.0)),
}


@pytest.mark.parametrize('name', thinned(SCENES, lambda name: [*SCENES].index(name) % 4 == 0))
def test_accelerations_agree_with_40_digits(name):
    scene, times = SCENES[name]
    for t_s in times:
        v, a = rates(scene, t_s)
        assert np.max(np.abs(accelerations(scene, t_s) - a)) <= allowed(v, a, scene), t_s


SHAPES = st.lists(st.one_of(
    st.builds(Line, st.floats(0.1, 9)),
    st.builds(lambda radius, angle, left: Arc(radius, angle if left else -angle), st.floats(1.8, 9), st.floats(5, 200),
              st.booleans()),
    st.builds(SpiralArc, st.floats(0.3, 3), st.floats(3, 4), st.floats(1.5, 2.9), st.sampled_from(['left', 'right']))),
    min_size=1, max_size=5).map(lambda pieces: Composite(tuple(pieces)))
TRACKS = st.one_of(st.builds(Spiral, st.floats(0.3, 4), st.floats(0.5, 6)), SHAPES,
                   st.builds(STurn, st.floats(1, 2), st.floats(9, 14), st.floats(0.5, 2), st.floats(-30, 30)))
DRAGONS = st.builds(lambda lengths: Mixed(tuple(Group(0.55 + length) for length in lengths)), st.lists(
    st.one_of(st.sampled_from([0.05, 1.65]), st.floats(0.05, 3.0)), min_size=1, max_size=6))
LAWS = st.builds(lambda lead, ramps, speeds: Profile(tuple((4.0 * n, v) for n, v in enumerate(speeds)), ramps, lead),
                 st.sampled_from(['head', 'tail']), st.sampled_from(['linear', 'smooth']),
                 st.lists(st.floats(-1, 3), min_size=1, max_size=4))


@examples(60)
@given(DRAGONS, TRACKS, LAWS, st.floats(0, 12), FACTORS)
@example(Mixed((Group(3.41), Group(0.6), Group(2.2))), Spiral(0.55, 1.0), Profile(((0.0, 0.0), (4.0, 1.0))), 2.0, 1.0)
def test_accelerations_agree_with_40_digits_anywhere(dragon, track, law, t_s, factor):
    t_s = round(t_s * NS) / NS      # frames have stamps in whole nanoseconds
    try:
        scene = magnified(Scene(dragon, track, law, Run(stop_s=20.0)), factor)
        assume(compile_scene(scene).end.t_s > t_s)
        model = compile_scene(scene).model
        chain = model.march(scene.head.travelled_m(t_s))
    except DragonError:
        assume(False)
    speeds = state(scene, t_s).velocities(1.0)
    assume(np.max(np.hypot(*speeds.T)) < 50)            # closer to a lock, the reference's root finder fails
    along, joints = chain.track.distances(chain.segment, chain.u), np.array(chain.track.joints_m)
    assume(not joints.size or np.min(np.abs(along[:, None] - joints)) > 1e-6)       # joints have their own tests
    v, a = rates(scene, t_s)
    assert np.max(np.abs(accelerations(scene, t_s) - a)) <= allowed(v, a, scene)


@pytest.mark.parametrize('second', [False, True], ids=['the leader', 'the handle next to it'])
@pytest.mark.parametrize('lead', ['head', 'tail'])
def test_at_a_joint_accelerations_are_those_of_the_segment_being_entered(lead, second):
    """A handle passes the joint of a line and an arc forwards and, after 4 s, backwards."""
    law = Profile(((0.0, 1.0), (4.0, 1.0), (4.0, -1.0)), 'linear', lead)
    start_m = 28.0 + 2.86 * second if lead == 'head' else 30.0 + 6.16 + 2.0
    scene = Scene(Dragon(3), Composite((Line(30.0), Arc(2.0, 90.0), Line(30.0)), start_m), law, Run(stop_s=8.0))
    model, handle = compile_scene(scene).model, (0, 1, -1, -2)[2 * (lead == 'tail') + second]
    track = model.track
    place = track.place_at(track.joints_m[0])
    if second:      # the leader is one link further along
        link_m = float(scene.dragon.link_lengths_m[0 if lead == 'head' else -1])
        place = next_place(track, place, link_m, -model.direction)[0]
    travel_m = model.leader.travel_m(place)
    assert 0.5 < travel_m < 3.9
    for t_s in (travel_m, 8.0 - travel_m):
        chain = model.march(law.travelled_m(t_s))
        assert abs(track.distances(chain.segment, chain.u)[handle] - track.joints_m[0]) < 1e-12
        at, before, after = (accelerations(scene, t_s + off) for off in (0.0, -1e-7, 1e-7))
        assert np.max(np.abs(at - after)) < 1e-6        # accelerations change by a few m/s^2 per second
        assert np.hypot(*(at - before)[handle]) > 0.1   # the curvature jumps by 0.5/m


@pytest.mark.parametrize(('lead', 'speed', 'entered'), [('head', 1.0, 1), ('head', -1.0, 0), ('tail', 1.0, 0),
                                                        ('tail', -1.0, 1)])
def test_a_handle_on_a_joint_is_on_the_segment_that_it_moves_into_whoever_leads(lead, speed, entered):
    track = track_of(Composite((Line(10.0), Arc(2.0, 90.0), Line(9.0)), start_m=10.0))
    onwards = speed if lead == 'head' else -speed
    joint_m = track.joints_m[0]
    for k, u in ((0, track.segments[0].last), (1, track.segments[1].first)):      # both are the same position
        place = np.array([k]), np.array([u])
        assert track.distances(*place) == joint_m
        found = entered_curvatures(track, *place, np.array([onwards]), 0.0)
        assert found == [track.segments[entered].curvature(0.0)]
    rounded = np.array([0]), np.array([track.segments[0].last - 1e-12 * onwards])
    assert entered_curvatures(track, *rounded, np.array([onwards]), 2e-12) == [track.segments[entered].curvature(0.0)]


def test_where_the_leader_rests_it_pulls_all_handles_along_the_track_by_its_acceleration():
    scene = Scene(SHORT, STurn(before_m=5.0), Profile(((0.0, 0.0), (4.0, 2.0)), 'linear'), Run(stop_s=4.0))
    chain = state(scene, 0.0)
    assert accelerations(scene, 0.0) == pytest.approx(0.5 * chain.velocities(1.0), abs=1e-12)
    assert not np.any(accelerations(replace(scene, head=replace(scene.head, ramps='smooth')), 0.0))


def test_at_a_jump_of_the_speed_and_at_a_knot_accelerations_are_those_just_after():
    law = Profile(((0.0, 1.0), (5.0, 1.0), (5.0, 2.0), (9.0, 1.0), (12.0, 1.0)), 'linear')
    assert [law.acceleration_at_m_s2(t) for t in (0.0, 4.9, 5.0, 8.9, 9.0, 12.0, 99.0)] == [
        0.0, 0.0, -0.25, -0.25, 0.0, 0.0, 0.0]
    scene = Scene(SHORT, STurn(before_m=5.0), law, Run(stop_s=15.0))
    for t_s in (5.0, 9.0):
        at, before, after = (accelerations(scene, t_s + off) for off in (0.0, -1e-7, 1e-7))
        assert np.max(np.abs(at - after)) < 1e-6
        assert np.max(np.abs(at - before)) > 0.1


@given(LAWS, st.floats(0, 16), st.floats(0, 1))
def test_the_laws_acceleration_is_the_rate_of_its_speed_and_lies_in_its_range(law, t_s, share):
    knots = [t for t, _ in law.knots]
    step = 1e-4
    assume(all(abs(t_s - knot) > 2 * step for knot in knots))
    there = law.acceleration_at_m_s2(t_s)
    rate = (law.speed_at_m_s(t_s + step) - law.speed_at_m_s(t_s - step)) / (2 * step)
    assert there == pytest.approx(rate, abs=1e-7)       # a smooth ramp's third derivative, at most 12 * 4 / 4^3
    until = min([knot for knot in knots if knot > t_s], default=t_s + 5)
    low, high = law.acceleration_range_m_s2(t_s, until)
    assert low <= law.acceleration_at_m_s2(t_s + share * (until - t_s) * (1 - 1e-9)) <= high


def test_many_instants_at_once_have_the_motion_of_each():
    scene = Scene(SHORT, STurn(before_m=5.0), run=Run(stop_s=30.0))
    chains = states(scene, [3.0, 12.0, 21.0])
    curvature = np.full(chains.p.shape[:-1], 0.2)
    many = RigidLinks(chains.p, chains.links_m, chains.headings, chains.leader)
    speeds = many.speeds(np.array([1.0, 2.0, 3.0]))
    rate = np.array([0.0, 1.0, -1.0])
    for n in range(3):
        one = RigidLinks(chains.p[n], chains.links_m, many.forward[n], chains.leader)
        assert np.array_equal(one.speeds(n + 1.0), speeds[n])
        assert one.accelerations(speeds[n], curvature[n], rate[n]) == pytest.approx(
            many.accelerations(speeds, curvature, rate)[n], abs=1e-13)
    assert many.speeds(1.0)[..., None] * many.forward == pytest.approx(chains.velocities(np.ones(3)), abs=1e-12)


@pytest.mark.parametrize('shape', [(4,), (3, 4), (2, 3, 4)])
def test_what_is_carried_along_the_chain_is_carried_from_link_to_link_in_every_row(shape):
    draw = np.random.default_rng(3)
    start, ratio, added = (draw.uniform(-2, 2, size) for size in (shape[:-1], shape, shape))
    found = carried(start, ratio, added)
    assert np.array_equal(found[..., 0], start)
    for m in range(shape[-1]):
        np.testing.assert_allclose(found[..., m + 1], ratio[..., m] * found[..., m] + added[..., m], rtol=1e-15)
