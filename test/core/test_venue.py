"""Venues are settings that are frozen, equal if equivalent, and rejected if invalid."""
import pickle
from math import nan

import pytest

from dragon_ros.core.errors import FieldError
from dragon_ros.core.limits import VENUE_CORNERS
from dragon_ros.core.scene import Scene
from dragon_ros.core.venue import INSIDE, LineObstacle, PolygonObstacle, Venue, corners

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
HOLE = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))


def test_venues_that_mean_the_same_are_equal_and_hash_alike():
    one = Venue((PolygonObstacle('a', SQUARE), LineObstacle('b', ((0.0, 0.0), (1.0, 0.0)))), SQUARE)
    two = Venue((PolygonObstacle('a', ((0, -0.0), *SQUARE[1:], (0, 0))),
                 LineObstacle('b', ((0, 0), (0, 0), (1, 0), (1, 0)))), (*SQUARE, SQUARE[0]), 0)
    assert one == two
    assert hash(Scene(venue=one)) == hash(Scene(venue=two))
    assert pickle.loads(pickle.dumps(one)) == one
    assert (one.names, corners(one)) == (('a', 'b', INSIDE), 10)
    assert one != Venue((PolygonObstacle('a', SQUARE, (HOLE,)),), SQUARE)


def test_a_venue_says_how_large_it_is_and_not_its_corners():
    assert repr(Venue((PolygonObstacle('a', SQUARE, (HOLE,)),), None, 0.5)) == (
        'Venue(1 obstacle, 7 corners, margin_m=0.5)')


@pytest.mark.parametrize(('make', 'says'), [
    (lambda: Venue(), r'venue\.obstacles: 0 .*; add one, or remove the section venue'),
    (lambda: Venue((PolygonObstacle('a', SQUARE),), margin_m=-1), r'venue\.margin_m: -1 '),
    (lambda: Venue((PolygonObstacle('', SQUARE),)), r"venue\.obstacles\.1\.name: '' .*name it"),
    (lambda: Venue((PolygonObstacle('a\n', SQUARE),)), r'venue\.obstacles\.1\.name: .* printable'),
    (lambda: Venue((PolygonObstacle('a', SQUARE), LineObstacle('a', SQUARE))), r"\.2\.name: 'a' .*another obstacle"),
    (lambda: Venue((LineObstacle(INSIDE, SQUARE),)), r"\.1\.name: 'inside' .*name of the boundary"),
    (lambda: Venue((PolygonObstacle('bow', (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3])),)),
     r"venue\.obstacles\.1: 'bow' .*crosses or touches itself at \(2, 2\) m; list its corners"),
    (lambda: Venue((PolygonObstacle('flat', ((0, 0), (1, 0), (2, 0))),)), r"obstacles\.1: 'flat' "),
    (lambda: Venue((PolygonObstacle('few', ((0, 0), (1, 0), (0, 0))),)), r"points_m: 'few' .* this polygon has 2;"),
    (lambda: Venue((PolygonObstacle('none', ()),)), r"points_m: 'none' .* this polygon has 0;"),
    (lambda: Venue((PolygonObstacle('a', SQUARE, ((),)),)), r"holes_m\.1: 'a' .* this polygon has 0;"),
    (lambda: Venue((PolygonObstacle('a', SQUARE, (((9, 9), (8, 9), (8, 8)),)),)), r"obstacles\.1: 'a' .*hole"),
    (lambda: Venue((LineObstacle('dot', ((1, 1), (1, 1))),)), r"points_m: 'dot' .* 2 .* points; this line has 1;"),
    (lambda: Venue((LineObstacle('b', ((0, 0), (nan, 1))),)), r"points_m\.2: nan .*coordinates of 'b' must be finite"),
    (lambda: Venue((LineObstacle('b', ((0, 0), (1, True))),)), r'points_m\.2: True '),
    (lambda: Venue((LineObstacle('b', ((0, 0), (2e9, 1))),)), r'points_m\.2: 2000000000\.0 .*at most 100000 m'),
    (lambda: Venue((), ((0, 0), (1, 1))), r"venue\.inside: 'inside' .* this polygon has 2"),
    (lambda: Venue((LineObstacle('b', tuple((n, 0) for n in range(VENUE_CORNERS + 1))),)),
     r"venue: '100001 corners' .*the limit is 100000; simplify")])
def test_what_is_no_venue_is_refused_with_its_name_and_the_cure(make, says):
    with pytest.raises(FieldError, match=says):
        make()


def test_the_largest_venue_is_taken():
    assert corners(Venue((LineObstacle('b', tuple((float(n), 0.0) for n in range(VENUE_CORNERS))),))) == VENUE_CORNERS
