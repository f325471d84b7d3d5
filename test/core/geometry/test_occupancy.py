"""The boundaries of occupied cells equal those of shapely's union of these cells."""
import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from properties import examples

from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry import occupancy
from dragon_ros.core.geometry.occupancy import outlines

CORNER, ACROSS = -3.0 + 2.0j, 0.05 * np.exp(0.7j)
GRIDS = st.tuples(st.integers(1, 9), st.integers(1, 9)).flatmap(lambda shape: arrays(bool, shape))
SPIRAL = np.array([[int(c) for c in row] for row in ('1111111', '0000001', '1111101', '1000101', '1011101', '1000001',
                                                     '1111111')], bool)


@examples(100)
@example(SPIRAL)
@example(np.eye(6, dtype=bool))
@example(np.indices((7, 8)).sum(axis=0) % 2 == 0)
@given(GRIDS)
def test_edges_bound_the_occupied_cells_part_by_part(occupied):
    found = outlines(occupied, 'map', CORNER, ACROSS)
    row, column = np.nonzero(occupied)
    if found is None:
        assert not row.size
        return
    boxes = shapely.box(column, row, column + 1, row + 1)
    start, stop = ((one - CORNER) / ACROSS for one in (found.start, found.stop))
    lines = shapely.linestrings(np.stack((start, stop), 1).view(float).reshape(-1, 2, 2))
    union = shapely.unary_union(boxes)
    assert shapely.unary_union(shapely.set_precision(lines, 1e-6)).symmetric_difference(union.boundary).length < 1e-6
    assert np.sum(np.abs(stop - start)) == pytest.approx(union.length)     # each side once
    parts = shapely.get_parts(shapely.unary_union(shapely.buffer(boxes, 1e-3, join_style='mitre')))
    mine = [shapely.unary_union(lines[found.owner == n]) for n in range(len(found.names))]
    assert sorted(sum(part.intersects(one) for part in parts) for one in mine) == [1] * len(parts)
    points = np.stack(np.meshgrid(np.arange(-1, 11) + 0.3, np.arange(-1, 11) + 0.6), -1).reshape(-1, 2)
    z = CORNER + points.view(complex)[:, 0] * ACROSS
    covered = found.misplaced_points(np.stack((z.real, z.imag), 1))[0]
    assert covered.tolist() == np.flatnonzero(shapely.contains_xy(union, *points.T)).tolist()


def test_straight_walls_are_one_edge_a_side():
    occupied = np.zeros((40, 60), bool)
    occupied[5:8, 2:50] = True
    assert outlines(occupied, 'map', 0j, 1 + 0j).start.size == 4


def test_parts_are_numbered_by_row_and_column_and_one_alone_is_not():
    assert outlines(np.eye(3, dtype=bool), 'map', 0j, 1 + 0j).names == ('map',)
    occupied = np.zeros((5, 5), bool)
    occupied[4, 0] = occupied[0, 4] = True
    found = outlines(occupied, 'map', 0j, 1 + 0j)
    assert found.names == ('map 1', 'map 2')
    assert found.start[found.owner == 0].real.min() == 4


def test_too_many_edges_are_refused_with_both_cures(monkeypatch):
    monkeypatch.setattr(occupancy, 'MAP_EDGES', 11)
    chequered = np.indices((2, 2)).sum(axis=0) % 2 == 0
    assert outlines(chequered[:1], 'map', 0j, 1 + 0j).start.size == 4
    row = np.indices((1, 6)).sum(axis=0) % 2 == 0
    with pytest.raises(InputError, match='12 edges; the limit is 11; filter its noise, or reduce its resolution'):
        outlines(row, 'map', 0j, 1 + 0j)
    monkeypatch.setattr(occupancy, '_MOST_SIDES', 11)
    with pytest.raises(InputError, match='12 boundaries between occupied and free cells'):
        outlines(row, 'map', 0j, 1 + 0j)
