"""Measure the cost of obstacles for the monitor: a check with walls along the whole dragon, and reading a large map.

``./dragon python benchmarks/obstacle_looks.py`` prints processor times. Checks with and without obstacles are
measured alternately, since other load on the machine changes over time.
"""
import time
from dataclasses import replace

import numpy as np
import shapely

from benchmarks.venues import town
from dragon_ros.core.geometry.tracker import ContactTracker
from dragon_ros.core.geometry.venue import Surroundings, surroundings_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.core.venue import LineObstacle, Venue
from dragon_ros.messages.bench_reader import BenchReader
from dragon_ros.messages.cdr import Writer
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.observation import observation_of, read_handles
from dragon_ros.messages.surroundings import CellRules, read_grid

_TICKS, _TURNS, _FIRST = 300, 5, 2500
_SIZE, _ROOMS = 4000, 400       # side of the map in cells, and number of walls


def walled(gap_m: float, corners: int = 1000) -> Scene:
    """Return a scene of 223 benches between two uneven walls along the whole track, about ``gap_m`` from it."""
    scene = replace(town(8, 300.0, 223), venue=None)
    line, rng, walls = shapely.LineString(compile_scene(scene).track_line(0.1)), np.random.default_rng(1), []
    for side in (1, -1):
        wall = line.offset_curve(side * (0.4 + gap_m))
        places = np.linspace(0, wall.length, corners // 2)
        points = shapely.get_coordinates(shapely.line_interpolate_point(wall, places))
        points += rng.uniform(-0.1, 0.1, points.shape)
        walls.append(LineObstacle(f'wall {side}', tuple(map(tuple, points.tolist()))))
    return replace(scene, venue=Venue(tuple(walls)))


def looks_s(scene: Scene) -> tuple[float, float]:
    """Return the shortest processor times (s) of a check, from bytes to report, without and with obstacles."""
    encode = encoders(scene)
    data = [(encode['handles'](frame), encode['benches'](frame))
            for frame in (tick(scene, _FIRST + k) for k in range(_TICKS))]
    assert scene.venue
    around = surroundings_of(scene.venue)
    _look(data, None), _look(data, around)
    turns = [(_look(data, None), _look(data, around)) for _ in range(_TURNS)]
    without, among = (min(one) / _TICKS for one in zip(*turns, strict=True))
    return without, among


def _look(data: list[tuple[bytes, bytes]], around: Surroundings | None) -> float:
    """Return the processor time for checking the given ticks."""
    reader, tracker = BenchReader(), ContactTracker()
    tracker.surround(around)
    began = time.process_time()
    for handles, benches in data:
        tracker.add(observation_of(read_handles(handles), reader.read(benches)))
    return time.process_time() - began


def map_message() -> bytes:
    """Return an OccupancyGrid of straight, slanted and short walls."""
    rng, cells = np.random.default_rng(1), np.zeros((_SIZE, _SIZE), np.int8)
    for _ in range(_ROOMS):
        y, x = rng.integers(0, _SIZE - 300, 2)
        height, width = rng.integers(20, 300, 2)
        cells[y:y + height, x:x + 3] = cells[y:y + 3, x:x + width] = 100
        along = np.arange(width)
        cells[np.clip(y + (rng.uniform(-1, 1) * along).astype(int), 0, _SIZE - 1), x + along] = 100
    writer = Writer()
    writer.header('map', 0)
    writer.put('I', 0, 0)
    writer.put('f', 0.05)
    writer.put('I', _SIZE, _SIZE)
    writer.put('d', 0, 0, 0, 0, 0, 0, 1)
    writer.put('I', cells.size)
    return bytes(writer.finish()) + cells.tobytes()


def _read(data: bytes) -> tuple[int, int, float]:
    """Return how many edges and obstacles a map has, and the processor time for reading and indexing it."""
    began = time.process_time()
    around = read_grid(data, CellRules()).around
    assert around
    around.misplaced_points(np.zeros((1, 2)))       # builds the index of the edges
    return around.start.size, len(around.names), time.process_time() - began


def main() -> None:
    """Print the times."""
    for gap_m in (0.2, 0.5, 1.0):
        without, among = looks_s(walled(gap_m))
        print(f'223 benches, 1,000 corners of walls at {gap_m:g} m: {without * 1e6:.0f} us per check without, '
              f'{among * 1e6:.0f} us with, ratio {among / without:.2f}')
    data = map_message()
    turns = [_read(data) for _ in range(3)]
    edges, names, _ = turns[0]
    print(f'{_SIZE} x {_SIZE} cells, {edges} edges of {names} obstacles: {min(one[2] for one in turns):.2f} s')


if __name__ == '__main__':
    main()
