"""Each town on the page ``cost venue`` has the stated number of corners, a free street, and a line in the table."""
import numpy as np
import pytest

from benchmarks import command, venues
from dragon_ros.core.search.venue_fit import venue_fit
from dragon_ros.core.venue import corners
from dragon_ros.cost.measure import Timing


def test_the_town_has_as_many_corners_as_it_says_and_leaves_room_for_the_dragon():
    town = venues.town(400, 50.0, 8)
    assert (corners(town.venue), len(town.venue.obstacles), town.dragon.benches) == (400, 100, 8)
    found = venue_fit(town)
    assert found.fits
    assert 2.0 < found.gaps[0].high_m < 20.0


@pytest.mark.long
def test_the_page_has_a_line_a_town_and_a_picture(tmp_path):
    def row(varied, size, fit_s):
        timings = {name: Timing(one, one, one, 9) for name, one in zip(venues.CALLS, (fit_s, 0.3, 0.2), strict=True)}
        sizes = {'corners': 2000, 'distance (m)': 300.0, 'benches': 61} | {varied: size}
        return venues.Row(varied, *sizes.values(), timings)
    rows = [row(name, size, 0.1 * n) for name, sizes in venues._LADDERS.items() for n, size in enumerate(sizes, 1)]
    assert [one.size for one in rows[:3]] == [200, 2000, 20_000]
    with np.errstate(all='warn'):
        paths = command.write('venue', rows, tmp_path)
    assert [path.name for path in paths] == ['venue.md', 'venue.csv', 'venue.png', 'venue.svg']
    assert '| corners | 20,000 | 300 | 61 | 0.3 | 0.3 | 0.2 | 1.50 |' in venues.table(rows)
    assert len(venues.csv_text(rows).splitlines()) == 1 + 9 * 3
