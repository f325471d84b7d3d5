"""Effects are absent if off, correct if on, and independent of each other."""
import json
import pickle
import subprocess
import sys
from dataclasses import fields, replace
from functools import lru_cache
from importlib.util import find_spec
from itertools import combinations

import numpy as np
import pytest
import shapely
from properties import thinned
from venues import edges_of

from dragon_ros.core.batches import ticks, velocity_of
from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.effects.noise import normal
from dragon_ros.core.effects.proximity import closeness, named_pair
from dragon_ros.core.errors import FieldError
from dragon_ros.core.flags import MEANINGS, NEEDS, Effect, Noise, Trails, check_needs, effects_of, known
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.signed_distance import gaps, witness
from dragon_ros.core.geometry.tracker import ContactTracker
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import frame_of, state, tick
from dragon_ros.core.tracks.spec import Spiral, STurn
from dragon_ros.core.venue import PolygonObstacle, Venue
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.load import load_scene

ALL = ~Effect.NONE
FIELDS = {Effect.VELOCITY: 'velocity_m_s', Effect.BENCHES: 'benches', Effect.CLEARANCE: 'closeness',
          Effect.CONTACT: 'contacts', Effect.ACCELERATIONS: 'acceleration_m_s2', Effect.FORCES: 'tension_n_kg',
          Effect.NOISE: 'measured', Effect.TRAILS: 'trail_m', Effect.DIAGNOSTICS: 'health',
          Effect.LEADER: 'leader', Effect.JOINTS: 'joint_rad'}
TOUCHING = Scene(dragon=Dragon(benches=24), effects=ALL, trails=Trails(points=5))
TICK = 413 * 50


@lru_cache
def subsets():
    """Return every set of effects that includes the effects required by its members."""
    return list(_subsets())


def _subsets():
    every = [effect for effect in known().values() if effect != Effect.PATH]     # the path is not part of a tick
    for size in range(len(every) + 1):
        for chosen in combinations(every, size):
            effects = Effect.NONE
            for effect in chosen:
                effects |= effect
            if all(NEEDS[effect] in effects for effect in chosen if effect in NEEDS):
                yield effects


def values_of(value):
    """Return plain values and bytes that are equal if all numbers in a value are bit-identical."""
    if isinstance(value, Chain):
        return value.p.tobytes(), value.evaluations
    if hasattr(value, '__dataclass_fields__'):
        return [values_of(getattr(value, field.name)) for field in fields(value)]
    return value.tobytes() if isinstance(value, np.ndarray) else value


@lru_cache
def everything(solver='table'):
    return tick(replace(TOUCHING, solver=solver), TICK)


@pytest.mark.parametrize(('solver', 'every'), [
    ('march', 131), ('table', 97), pytest.param('march', 1, marks=pytest.mark.long)],
    ids=['march: some', 'table: some', 'march: all'])
def test_every_subset_of_effects_has_its_fields_alone_and_their_values_to_the_last_bit(solver, every):
    full = {name: values_of(value) for name, value in everything(solver)._asdict().items()}
    assert all(full[name] is not None for name in FIELDS.values())
    for effects in subsets()[::every]:
        frame = tick(replace(TOUCHING, solver=solver, effects=effects), TICK)
        on = {name for effect, name in FIELDS.items() if effect in effects}
        for name, value in full.items():
            absent = name in FIELDS.values() and name not in on
            assert values_of(getattr(frame, name)) == (None if absent else value), (effects, name)


IN_A_ROW = {
    'touching': (replace(TOUCHING, run=Run(410.0, 413.0, 50.0)), (110, 130)),
    'classic': (Scene(), (0, 20)),
    'long': (Scene(dragon=Dragon(2500)), (7, 10)),
    'longer than a batch': (Scene(dragon=Dragon(5000)), (7, 9)),
    'joined by the smallest links': (Scene(Mixed((Group(3.41), Group(0.6, 2), Group(2.2, 30))), STurn(before_m=5.0),
                                           run=Run(0, 30), effects=ALL), (200, 220)),
    'mixed, led by the tail': (Scene(Mixed((Group(3.41), Group(1.7, 9), Group(2.2, 40))), Spiral(0.8, 8.0),
                                     Head(1.0, 'tail'), Run(0, 20), effects=ALL), (0, 200)),
    'paper': (Scene(accuracy='paper', effects=Effect.BENCHES), (0, 20)),
    'handles alone': (Scene(effects=Effect.NONE), (0, 20)),
}


@pytest.mark.parametrize('name', thinned(IN_A_ROW, lambda name: not name.startswith('mixed')))
def test_ticks_in_a_row_have_the_bits_that_each_has_alone(name):
    scene, (first, stop) = IN_A_ROW[name]
    frames = list(ticks(scene, first, stop))
    assert [frame.k for frame in frames] == list(range(first, stop))
    for frame in frames:
        alone = tick(scene, frame.k)
        for name, value in alone._asdict().items():
            assert values_of(getattr(frame, name)) == values_of(value), name
        for array in (frame.axis, frame.benches.centre if frame.benches else frame.chain.p):
            assert not array.flags.writeable


@pytest.mark.parametrize(('first', 'stop'), [(-1, 3), (5, 4), (0, 152)])
def test_ticks_outside_of_the_run_are_refused(first, stop):
    with pytest.raises(FieldError, match='0 to 150'):
        next(ticks(Scene(run=Run(410.0, 413.0)), first, stop))


def test_no_ticks_are_none():
    assert not list(ticks(Scene(), 5, 5))


def test_what_is_off_is_not_even_imported():
    code = ('import sys, json\nfrom dragon_ros.core.scene import Scene\nfrom dragon_ros.core.step import tick\n'
            'from dragon_ros.messages.encode import encoders\nscene = Scene()\n'
            '[encode(tick(scene, 0)) for encode in encoders(scene).values()]\nprint(json.dumps(list(sys.modules)))')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = set(json.loads(done.stdout))
    for name in ('core.effects.proximity', 'core.effects.dynamics', 'core.effects.noise', 'core.effects.trails',
                 'core.effects.health', 'core.effects.leading', 'core.effects.joints', 'core.geometry.near_pairs',
                 'core.geometry.broad_phase', 'core.geometry.tracker', 'messages.encode_effects',
                 'messages.monitor_markers'):
        assert find_spec(f'dragon_ros.{name}')
        assert f'dragon_ros.{name}' not in loaded


def test_there_are_as_many_subsets_as_needs_allow():
    assert len(subsets()) == 5 * 3 * 3 * 2**6


@pytest.mark.parametrize(('names', 'line'), [
    (['clearance'], 'write effects: [benches, clearance]'),
    (['velocity', 'markers'], 'write effects: [velocity, benches, clearance, contact, markers]'),
    (['forces'], 'write effects: [accelerations, forces]')])
def test_an_effect_without_what_it_needs_is_refused_with_the_line_that_cures_it(names, line):
    with pytest.raises(FieldError) as error:
        Scene(effects=effects_of(names))
    assert line in str(error.value)
    check_needs(effects_of(line.partition('[')[2].rstrip(']').split(', ')))


def test_every_effect_has_a_meaning():
    assert list(MEANINGS) == list(known().values())


def test_clearance_and_contacts_are_what_the_monitor_sees():
    frame, tracker = everything(), ContactTracker()
    (report,) = tracker.add(Observation(frame.t_ns, frame.chain.p, frame.benches))
    assert frame.closeness.clearance_m == report.clearance_m < 0
    assert tuple(map(tuple, frame.contacts.benches.tolist())) == report.touching == ((0, 8),)
    assert frame.contacts.gap_m[0] == report.clearance_m
    assert tuple(frame.contacts.point_m[0]) == witness(frame.benches, 0, 8).point_m


def test_clearance_is_infinite_where_nothing_is_near():
    alone = Scene(dragon=Dragon(benches=1), effects=ALL)
    frame = tick(alone, 0)
    assert frame.closeness.clearance_m == np.inf
    assert frame.contacts.benches.shape == (0, 2)
    assert closeness(compile_scene(alone), frame.chain, frame.benches).i.size == 0


def test_the_clearance_vanishes_in_the_frame_of_the_first_contact():
    found = first_contact(TOUCHING)
    frame = frame_of(compile_scene(TOUCHING), None, round(found.t_s * 1e9), state(TOUCHING, found.t_s))
    assert frame.closeness.clearance_m == pytest.approx(0, abs=1e-11)
    assert gaps(frame.benches, np.array([0]), np.array([8]))[0] == frame.closeness.clearance_m


@pytest.mark.parametrize('speed', [1.0, 2.5, -0.5])
def test_accelerations_are_the_rate_of_the_velocities(speed):
    scene = Scene(head=Head(speed), run=Run(stop_s=150.0), effects=ALL)
    step, t_s = 1e-4, 100.0
    before, after = (velocity_of(scene, state(scene, t_s + k * step), t_s + k * step) for k in (-1, 1))
    found = frame_of(compile_scene(scene), None, round(t_s * 1e9), state(scene, t_s)).acceleration_m_s2
    assert found == pytest.approx((after - before) / (2 * step), abs=2e-8 * speed**2)


def test_the_first_link_does_the_work_that_moves_the_masses_behind_it():
    frame = everything()
    v, a = frame.velocity_m_s[1:], frame.acceleration_m_s2[1:]
    work = frame.tension_n_kg[0] * frame.axis[0] @ v[0]
    assert work == pytest.approx(np.sum(v * a), rel=1e-9)


def test_tensions_and_the_track_alone_accelerate_every_handle():
    frame = everything()
    pull = frame.tension_n_kg[:, None] * frame.axis
    force = pull.copy()
    force[:-1] -= pull[1:]
    along = np.sum(force * frame.chain.headings[1:], axis=1)
    assert along == pytest.approx(np.sum(frame.acceleration_m_s2[1:] * frame.chain.headings[1:], axis=1), abs=1e-12)


def test_noise_repeats_for_a_seed_and_a_tick_and_differs_for_others():
    scene = replace(TOUCHING, effects=Effect.NOISE, noise=Noise(0.01, 0.02, seed=7))
    again, first = tick(scene, 5).measured.p, tick(scene, 4).measured.p
    assert np.array_equal(again, tick(scene, 5).measured.p)
    assert not np.array_equal(again, tick(replace(scene, noise=Noise(0.01, 0.02, seed=8)), 5).measured.p)
    assert np.max(np.abs((again - tick(scene, 5).chain.p) - (first - tick(scene, 4).chain.p))) > 1e-3


def test_noise_is_normal_with_the_sizes_that_the_scene_says():
    scene = Scene(dragon=Dragon(benches=5000), effects=Effect.NOISE, noise=Noise(0.01, 0.02))
    frame = tick(scene, 3)
    off = (frame.measured.p - frame.chain.p).ravel()
    turned = np.sum(frame.measured.axis * np.stack((-frame.axis[:, 1], frame.axis[:, 0]), axis=1), axis=1)
    assert (np.mean(off), np.std(off)) == pytest.approx((0, 0.01), abs=3e-4)
    assert (np.mean(turned), np.std(turned)) == pytest.approx((0, 0.02), abs=1e-3)
    assert np.hypot(*frame.measured.axis.T) == pytest.approx(1, abs=1e-12)
    assert np.mean(np.abs(off) < 0.01) == pytest.approx(0.6827, abs=0.02)


def test_the_numbers_of_a_seed_are_these_for_good():
    assert normal(1, 2, False, 3) == pytest.approx(KNOWN, abs=1e-13)
    assert not np.array_equal(normal(1, 2, True, 3), normal(1, 2, False, 3))


KNOWN = [0.26397651350406276, 0.5501003148099652, 0.20499684864083353]


def test_a_trail_ends_at_the_head_and_goes_back_where_it_was():
    scene = replace(TOUCHING, trails=Trails(seconds=4.0, points=9))
    frame = tick(scene, 1000)
    assert frame.trail_m.shape == (9, 2)
    for place, t_s in zip(frame.trail_m, np.linspace(16.0, 20.0, 9), strict=True):
        assert place == pytest.approx(state(scene, t_s).p[0], abs=1e-11)
    assert tick(replace(scene, accuracy='paper'), 1000).trail_m == pytest.approx(frame.trail_m, abs=1e-11)
    assert tick(scene, 0).trail_m[0] == pytest.approx(tick(scene, 0).chain.p[0], abs=1e-11)


@pytest.mark.parametrize('accuracy', ['exact', 'standard', 'preview', 'paper'])
def test_health_tells_how_far_the_worst_link_is_off(accuracy):
    frame = tick(Scene(accuracy=accuracy, effects=Effect.DIAGNOSTICS), 5000)
    assert frame.health.good
    assert frame.health.off_m == np.max(np.abs(frame.chain.residuals_m))
    assert frame.health.evaluations == frame.chain.evaluations


def test_a_trail_of_a_dragon_that_its_tail_leads_is_where_its_head_was():
    scene = replace(TOUCHING, effects=Effect.TRAILS, head=Head(1.0, lead='tail'), run=Run(stop_s=50.0),
                    trails=Trails(seconds=4.0, points=3))
    for place, t_s in zip(tick(scene, 1000).trail_m, (16.0, 18.0, 20.0), strict=True):
        assert place == pytest.approx(state(scene, t_s).p[0], abs=1e-11)


EVERYWHERE = [
    replace(TOUCHING, track=STurn(before_m=5.0), run=Run(stop_s=40.0)),
    replace(TOUCHING, track=Spiral(0.55, 4.0), head=Head(1.0, lead='tail'), run=Run(stop_s=40.0)),
    replace(TOUCHING, track=STurn(before_m=-30.0), run=Run(stop_s=40.0),
            head=Profile(((0.0, 0.0), (9.0, 1.0), (30.0, -0.2)), 'smooth', 'tail')),
    replace(TOUCHING, head=Profile(((0.0, 0.0), (9.0, 1.0))), run=Run(stop_s=40.0)),
    replace(TOUCHING, dragon=Mixed((Group(1.2, 3), Group(3.41), Group(0.6), Group(2.2, 4))), run=Run(stop_s=40.0))]


@pytest.mark.parametrize('scene', EVERYWHERE, ids=['turn', 'tail', 'turn, tail and law', 'law', 'mixed'])
@pytest.mark.parametrize('t_s', [6.0, 23.0])
def test_on_every_track_tensions_accelerate_all_handles_but_the_leader_and_its_link_does_their_work(scene, t_s):
    """The tensions of N links accelerate N of the N + 1 handles; the remaining one, the leader, is moved externally."""
    frame = frame_of(compile_scene(scene), None, round(t_s * 1e9), state(scene, t_s))
    pull = frame.tension_n_kg[:, None] * frame.axis
    force = np.zeros_like(frame.acceleration_m_s2)
    force[1:] += pull
    force[:-1] -= pull
    tail_leads = scene.head.lead == 'tail'
    free, leaders_link = (slice(0, -1), -1) if tail_leads else (slice(1, None), 0)
    along, wanted = (np.sum(vectors * frame.chain.headings, axis=1)[free]
                     for vectors in (force, frame.acceleration_m_s2))
    assert along == pytest.approx(wanted, abs=1e-11)        # a sum of N terms of several m/s^2
    v, a = frame.velocity_m_s[free], frame.acceleration_m_s2[free]
    power = (-1 if tail_leads else 1) * pull[leaders_link] @ v[leaders_link]
    assert power == pytest.approx(np.sum(v * a), rel=1e-9)


def test_bad_sensors_and_trails_are_refused():
    for wrong in ({'position_m': -1.0}, {'yaw_rad': np.nan}, {'seed': -1}, {'seed': 0.5}):
        with pytest.raises(FieldError, match=f'noise.{next(iter(wrong))}'):
            Noise(**wrong)
    for wrong in ({'seconds': 0.0}, {'points': 1}):
        with pytest.raises(FieldError, match=f'trails.{next(iter(wrong))}'):
            Trails(**wrong)


def test_obstacles_count_as_benches_that_are_numbered_behind_them():
    """Clearance and contacts equal shapely's, and only the fields of these two effects change."""
    scene = replace(load_scene('street'), effects=ALL & ~Effect.PATH, trails=Trails(points=5))
    bare, seen = (tick(replace(scene, venue=venue), 4000) for venue in (None, scene.venue))
    lines, boxes = edges_of(scene.venue), shapely.polygons(seen.benches.corners)
    away = np.array([shapely.distance(boxes, line) for line in lines.values()])
    number, _ = np.unravel_index(int(np.argmin(away)), away.shape)
    assert seen.closeness.clearance_m == pytest.approx(away.min(), abs=1e-12)
    assert away.min() < bare.closeness.clearance_m
    assert seen.closeness.closest[1] == scene.dragon.benches + number
    nearest = boxes[seen.closeness.closest[0]]
    assert shapely.distance(nearest, lines[scene.venue.names[number]]) == pytest.approx(away.min())
    assert not seen.contacts.benches.size
    assert pickle.dumps(seen.chain.p) == pickle.dumps(bare.chain.p)
    x, y = seen.benches.centre[7].tolist()
    stone = PolygonObstacle('stone', ((x, y), (x + 0.2, y), (x, y + 0.2)))
    hit = tick(replace(scene, venue=Venue((*scene.venue.obstacles, stone), scene.venue.inside)), 4000)
    assert hit.contacts.benches.tolist() == [[7, scene.dragon.benches + 3]]
    assert hit.contacts.gap_m[0] == hit.closeness.clearance_m < 0
    assert shapely.distance(boxes[7], shapely.Point(hit.contacts.point_m[0])) < 0.2
    with_stone = replace(scene, venue=Venue((stone,)))
    assert named_pair(with_stone, (7, scene.dragon.benches)) == "bench 7 and obstacle 'stone'"
    assert named_pair(scene, (7, 9)) == 'benches 7 and 9'
    markers = encoders(scene, 'dragon')['model/markers'](hit)
    assert markers.count(b'contact bench') == 1
