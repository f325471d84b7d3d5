"""The parts into which a search divides a box cover it exactly."""
import numpy as np
import pytest

from dragon_ros.core.search.driver import Boxes


@pytest.mark.parametrize('axis', [0, 1, [1, 0, 1]])
@pytest.mark.parametrize('parts', [2, 3])
def test_parts_of_boxes_fill_them_without_overlapping(parts, axis):
    draw = np.random.default_rng(parts)
    low = draw.uniform(-3, 3, (2, 3))
    whole = Boxes(low, low + draw.uniform(0.5, 4, (2, 3)))
    cut = whole.cut(parts, np.array(axis) if isinstance(axis, list) else axis)
    assert cut.size == parts * whole.size
    points = draw.uniform(-4, 8, (2, 1, 4000))
    inside = [np.all((points >= one.low[..., None]) & (points < one.high[..., None]), axis=0) for one in (whole, cut)]
    assert np.array_equal(inside[0], inside[1].reshape(3, parts, -1).sum(axis=1))
