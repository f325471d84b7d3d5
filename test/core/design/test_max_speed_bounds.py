"""What is derived between two looks at a chain on a walk holds at every look in between."""
import numpy as np
import pytest
from dragon_ros.core.joined import Joined
from dragon_ros.core.led import Led
from dragon_ros.core.placed import BACK
from dragon_ros.core.turn import Turn

from dragon_ros.core.rising import looks_at, tops
from dragon_ros.core.tracks.segments import AHEAD, Effort
from dragon_ros.core.tracks.spec import Arc, Line

LINKS = np.array([2.86, *(1.65,) * 12, 0.0, *(1.65,) * 8])
BENDY = Joined((Line(50.0), Arc(2.0, 170.0), Line(1.0), Arc(1.5, -100.0), Line(60.0)), start_m=50.0).walk
TRACKS = [(Turn().walk, -3.0, BACK), (Turn(ratio=0.6).walk, 0.0, BACK), (BENDY, 50.0, BACK),
          (Turn().walk, 40.0, AHEAD), (BENDY, 100.0, AHEAD)]


def looks(led, gone_m):
    return looks_at([led.chain((gone, 0.0), Effort(1e-12)) for gone in gone_m.tolist()], gone_m, led.way)


@pytest.mark.parametrize(('walk', 'start_m', 'way'), TRACKS)
@pytest.mark.parametrize('apart_m', [0.3, 0.01])
def test_no_handle_is_faster_between_two_looks_than_the_bound(walk, start_m, way, apart_m):
    led = Led(walk, LINKS, start_m, way)
    for low in np.random.default_rng(3).uniform(0, 45, 25):
        above = tops(looks(led, np.array([low, low + apart_m])))[0]
        assert np.max(looks(led, np.linspace(low, low + apart_m, 15)).log) <= above + 1e-14


@pytest.mark.parametrize(('walk', 'start_m', 'way'), TRACKS)
def test_the_logs_are_those_of_the_speeds(walk, start_m, way):
    led = Led(walk, LINKS, start_m, way)
    v = led.chain((20.0, 0.0), Effort(1e-12)).velocities(1.0)
    speed = np.hypot(v[:, 0], v[:, 1])[::-way]
    assert looks(led, np.array([20.0])).log[0] == pytest.approx(np.log(speed), abs=1e-13)


def test_closer_looks_bring_the_bound_down_with_the_square_of_their_distance():
    led = Led(Turn().walk, LINKS, 14.4799694, BACK)
    over = []
    for apart_m in (1e-2, 1e-3):
        seen = looks(led, np.array([-0.5 * apart_m, 0.5 * apart_m]))
        over.append(tops(seen)[0] - np.max(seen.log))
    assert over[1] < over[0] / 50
