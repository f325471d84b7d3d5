"""Entities and their filters on arrays, without ROS."""
import time
from dataclasses import replace

import numpy as np
import pytest
import shapely

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core import limits
from dragon_ros.core.errors import InputError
from dragon_ros.core.step import tick
from dragon_ros.nodes import entities
from dragon_ros.nodes.entities import (
    TOPICS,
    bodies_of_frame,
    bodies_of_messages,
    box,
    chosen,
    convex_hull,
    sphere,
)
from dragon_ros.scenes.load import load_scene

SCENE = load_scene('first_contact', ['effects=[velocity, benches, accelerations]', 'run.rate_hz=1000'])
BODIES = bodies_of_frame(tick(SCENE, 500), SCENE.dragon, 'dragon')


def found(region=None, pattern='', tags=(), every=False):
    return [BODIES.names[i] for i in chosen(BODIES, pattern, tags, every, region)]


def corners(*points):
    return np.array(points, dtype=float)


def test_rates_are_the_derivatives_of_place_and_heading_of_every_handle_and_bench():
    before, after = (bodies_of_frame(tick(SCENE, k), SCENE.dragon, 'dragon') for k in (499, 501))
    step_s = 0.002
    assert np.allclose((after.place_m - before.place_m) / step_s, BODIES.velocity_m_s, atol=2e-6)
    assert np.allclose((after.velocity_m_s - before.velocity_m_s) / step_s, BODIES.acceleration_m_s2, atol=2e-5)
    turned = np.angle((after.axis @ (1, 1j)) / (before.axis @ (1, 1j)))
    assert np.allclose(turned / step_s, BODIES.yaw_rate_rad_s, atol=2e-6)
    change = after.yaw_rate_rad_s - before.yaw_rate_rad_s
    assert np.allclose(change / step_s, BODIES.yaw_acceleration_rad_s2, atol=2e-5)


def test_the_messages_of_a_bag_tell_what_its_frames_tell(tmp_path):
    from dragon_ros.__main__ import main
    assert main(['simulate', '--scene', 'first_contact', '--set', 'run.stop_s=400.1', '--set',
                 'effects=[velocity, benches, accelerations]', '--output', str(tmp_path / 'a.mcap')]) == 0
    scene = load_scene('first_contact', ['effects=[velocity, benches, accelerations]'])
    with BagReader(tmp_path / 'a.mcap') as bag:
        messages = {}
        for message in bag.messages([f'/dragon/{name}' for name in TOPICS]):
            if message.t_ns == scene.run.time_ns(3):
                messages[message.topic.removeprefix('/dragon/')] = message
    told, frame = bodies_of_messages(messages), bodies_of_frame(tick(scene, 3), scene.dragon, 'dragon')
    for name in ('place_m', 'velocity_m_s', 'acceleration_m_s2'):
        assert np.array_equal(getattr(told, name)[:224], getattr(frame, name)[:224])
        assert np.allclose(getattr(told, name), getattr(frame, name), atol=1e-12)
    assert np.allclose(told.axis, frame.axis, atol=1e-15)
    handles = {'handles': messages['handles']}
    assert bodies_of_messages(handles).bench_count == 0
    assert np.isnan(bodies_of_messages(handles).velocity_m_s).all()
    assert bodies_of_messages({}) is None
    late = {**messages, 'velocities': replace(messages['velocities'], t_ns=0)}
    assert np.isnan(bodies_of_messages(late).velocity_m_s).all()


def test_regions_are_those_of_the_plane_touching_included_and_are_compared_with_shapely():
    places, benches = shapely.points(BODIES.place_m[:224]), shapely.polygons(BODIES.benches.corners)
    everything = np.concatenate((places, benches))
    x, y = BODIES.place_m[100]
    disc = shapely.Point(x, y).buffer(2.4, quad_segs=2000)
    for region, shape in ((sphere(corners((x, y, 0.7), (2.5, 0, 0))), disc),
                          (box(corners((x + 2, y + 1, 1), (x - 1, y - 2, -1))),
                           shapely.box(x - 1, y - 2, x + 2, y + 1)),
                          (convex_hull(corners((x, y, 0), (x + 3, y, 0), (x, y + 2, 0))),
                           shapely.Polygon([(x, y), (x + 3, y), (x, y + 2)]))):
        wanted = [name for name, hit in zip(BODIES.names, shapely.intersects(everything, shape), strict=True) if hit]
        assert 2 < len(wanted) < 100
        assert found(region) == wanted
    touching = sphere(corners((x + 1, y, 0), (1, 0, 0)))
    assert 'handle_100' in found(touching)
    assert 'handle_100' not in found(sphere(corners((x + 1, y, 1e-3), (1, 0, 0))))


@pytest.mark.parametrize('region', [sphere(corners((0, 0, 2), (1, 0, 0))), box(corners((-9, -9, 1), (9, 9, 2))),
                                    convex_hull(corners((-9, -9, 1), (9, 9, 2), (-9, 9, 1)))], ids='sbh')
def test_what_lies_above_the_plane_overlaps_nothing(region):
    assert found(region) == []


@pytest.mark.parametrize('tiny', [0.0, 5e-324, 2.8e-306, 1e-170])
def test_a_region_of_no_or_almost_no_width_overlaps_what_it_touches(tiny):
    x, y = BODIES.place_m[100]
    assert 'handle_100' in found(box(corners((x, y, 0), (x + tiny, 99, 0))))
    assert 2 < len(found(box(corners((-99, 0, 0), (99, tiny, 0))))) < 100


def test_a_hull_is_cut_where_its_edges_pass_the_plane():
    region = convex_hull(corners((0, 0, 3), (4, 0, -1), (0, 4, -1), (-4, -4, -1)))      # a tetrahedron on its tip
    assert region.shape.equals(shapely.Polygon([(3, 0), (0, 3), (-3, -3)]))


@pytest.mark.parametrize(('kind', 'points'), [
    (sphere, [(0, 0, 0)]), (sphere, [(0, 0, 0), (-1, 0, 0)]), (sphere, [(0, np.nan, 0), (1, 0, 0)]),
    (box, [(0, 0, 0)]), (box, [(0, 0, 0), (np.inf, 1, 1)]), (convex_hull, [(0, 0, 0), (1, 1, 1)]),
    (convex_hull, [(0, 0, 0), (1, 1, 1), (2, 2, 2)]), (convex_hull, [(0, 0, 0)] * (limits.FILTER_POINTS + 1))])
def test_bounds_without_a_volume_are_refused(kind, points):
    with pytest.raises(InputError, match=r'bounds\.points'):
        kind(corners(*points))


def test_names_match_whole_and_tags_any_or_all():
    assert found(pattern='bench_1') == ['bench_1']
    assert found(pattern='(handle|bench)_22[[:digit:]]') == [
        *(f'handle_22{i}' for i in range(4)), *(f'bench_22{i}' for i in range(3))]
    assert found(tags=['tail', 'nothing']) == ['handle_223', 'bench_222']
    assert found(tags=['tail', 'nothing'], every=True) == []
    assert found(tags=['bench', 'tail'], every=True) == ['bench_222']
    assert found(pattern='.*[02]', tags=['head', 'tail']) == ['handle_0', 'bench_0', 'bench_222']


@pytest.mark.parametrize('pattern', ['(', '(.*?)' * 50 + '[xyz]', 'a' * (limits.FILTER_CHARACTERS + 1)],
                         ids=['broken', 'endless', 'long'])
def test_an_expression_that_is_broken_long_or_endless_is_refused_in_time(monkeypatch, pattern):
    monkeypatch.setattr(entities, 'FILTER_S', 0.1)
    began = time.process_time()
    with pytest.raises(InputError, match='^filter'):
        found(pattern=pattern)
    assert time.process_time() - began < 20 * 0.1
