"""The space that benches occupy beside a track equals the exact values for a straight line and a circle."""
from math import hypot, sqrt

import numpy as np
import pytest
from shapely import get_dimensions

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.swept_area import room_every_metre, swept_area
from dragon_ros.core.tracks.spec import Arc, Composite, Line


def room(piece, stop_s):
    scene = Scene(dragon=Dragon(4, 2.2, 2.2), track=Composite((piece,), start_m=10.0), run=Run(0, stop_s))
    swept = swept_area(scene)
    return scene.dragon, swept, *room_every_metre(scene, swept)


def test_on_a_line_benches_take_half_their_width_to_either_side():
    dragon, swept, _, needed = room(Line(30.0), 15)
    assert needed == pytest.approx(0.5 * dragon.width_m, abs=1e-9)
    assert tuple(swept.bounds) == swept.whole.bounds
    assert swept.whole.area == pytest.approx(dragon.width_m * (15 + 4 * 2.2 - 3 * 0.55), rel=0.05)


@pytest.mark.parametrize(('angle_deg', 'inner'), [(200.0, 0), (-200.0, 1)])
def test_on_a_circle_benches_reach_inwards_with_their_middle_and_outwards_with_their_corners(angle_deg, inner):
    dragon, _, stations_m, needed = room(Arc(9.0, angle_deg), 15)
    link_m = float(dragon.link_lengths_m[0])
    middle_m = sqrt(81 - 0.25 * link_m * link_m)
    some = needed[(stations_m > 11) & (stations_m < 22)]
    assert some[:, inner] == pytest.approx(9 - middle_m + 0.5 * dragon.width_m, abs=3e-3)
    outwards_m = hypot(middle_m + 0.5 * dragon.width_m, 0.5 * dragon.bench_lengths_m[0]) - 9
    assert np.all(some[:, 1 - inner] <= outwards_m + 1e-9)
    assert some[:, 1 - inner] == pytest.approx(outwards_m, abs=3e-3)


def test_a_bench_at_rest_sweeps_itself_and_no_line():
    swept = swept_area(Scene(run=Run(0, 0)))
    assert np.all(get_dimensions(swept.parts) == 2)
    assert np.all(np.diff(swept.at_m) >= 0)
    assert swept.whole.geom_type in ('Polygon', 'MultiPolygon')
