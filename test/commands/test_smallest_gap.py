"""The clearance in pictures and the view includes obstacles: the curve reaches zero at a contact with an obstacle."""
from dataclasses import replace

import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure
from venues import SCENES, corners_at, random_venue

from dragon_ros.__main__ import main
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.commands.view.data import ViewData
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.venue import PolygonObstacle
from dragon_ros.pictures.animation import AnimatedFigure
from dragon_ros.pictures.series import clearance_picture
from dragon_ros.pictures.sources import SceneSource, clearances, dragon_in
from dragon_ros.scenes.load import load_scene

# Bench 0 touches an obstacle before any two benches touch.
WALLED = replace(SCENES['street'], venue=random_venue(SCENES['street'], 1))
SQUARE = ['dragon.benches=12', 'run.stop_s=8', 'run.rate_hz=10']


def obstacles_at(scene, times_s):
    """Return shapely's smallest distance (m) between any bench and any edge of the venue at each time."""
    rings = [[*one.points_m, one.points_m[0]] if isinstance(one, PolygonObstacle) else one.points_m
             for one in scene.venue.obstacles] + [[*scene.venue.inside, scene.venue.inside[0]]]
    edges = shapely.MultiLineString(rings)
    return np.array([min(shapely.distance(shapely.Polygon(bench), edges) for bench in benches)
                     for benches in corners_at(scene, times_s)])


def test_the_curve_of_a_scene_is_zero_at_its_contact_with_an_obstacle():
    found = first_contact(WALLED)
    assert found.obstacle
    _, gaps_m = clearances(SceneSource('walled', WALLED), np.array([found.t_s]), iter)
    assert gaps_m[0] == pytest.approx(0.0, abs=1e-9)


def test_the_curve_before_the_contact_is_the_distance_to_the_nearest_obstacle():
    times_s = np.linspace(0.0, first_contact(WALLED).t_s, 40)[:-1]
    _, gaps_m = clearances(SceneSource('walled', WALLED), times_s, iter)
    alone = clearances(SceneSource('street', replace(WALLED, venue=None)), times_s, iter)[1]
    expected = np.fmin(alone, obstacles_at(WALLED, times_s))
    np.testing.assert_allclose(gaps_m, expected, rtol=0, atol=1e-9)
    assert np.any(gaps_m < np.nan_to_num(alone, nan=np.inf))


def test_a_bag_gives_the_same_curve_as_its_scene(tmp_path):
    path = tmp_path / 'square.mcap'
    changes = [part for change in SQUARE for part in ('--set', change)]
    assert main(['simulate', '--scene', 'square', *changes, '--output', str(path)]) == 0
    scene = SceneSource('square', load_scene('square', SQUARE))
    times_s = scene.ticks_s(*scene.span_s, 30)
    with BagReader(path) as bag:
        source = dragon_in(bag)
        assert source.has_obstacles
        np.testing.assert_allclose(clearances(source, times_s, iter), clearances(scene, times_s, iter), atol=1e-9)


@pytest.mark.parametrize(('venue', 'words'), [(WALLED.venue, True), (None, False)])
def test_pictures_and_the_view_say_whether_obstacles_count(venue, words):
    run = replace(WALLED.run, rate_hz=WALLED.run.rate_hz / 10)      # the curve has a tenth of the points
    source = SceneSource('street', replace(WALLED, venue=venue, run=run))
    figure = clearance_picture(source, iter)
    assert isinstance(figure, Figure)
    assert ('obstacles' in figure.axes[0].get_title()) == words
    assert ViewData(source, iter).run()['obstacles'] == words
    film = AnimatedFigure(source, np.array([0.0, 1.0]), film=(640, 360))
    assert any('obstacles' in axes.get_title() for axes in film.figure.axes) == words


def test_the_heading_of_a_film_has_the_gap_to_the_nearest_obstacle():
    t_s = first_contact(WALLED).t_s
    film = AnimatedFigure(SceneSource('walled', WALLED), np.array([t_s, t_s + 0.1]), film=(640, 360))
    assert 'clearance 0.0 mm' in film._title.get_text()
