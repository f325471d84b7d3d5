"""The range of each front handle while the head moves through a range, and the proof that the chain always exists.

If the curvature excludes locks, all handles move in the same direction as the head, and the limits of the head's range
determine the limits of all ranges. On a spiral that leads to its centre, handles may turn back and links may lock. In
this case, the range of each link is halved until the direction in which the next handle moves is proved, and until it
is proved that the chord grows up to its span.
"""
from functools import reduce

from flint import arb

from dragon_ros.verify.balls import PI
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.motion import spiral_slopes
from dragon_ros.verify.posture import Dragon
from dragon_ros.verify.segments import HALF, ONE, Link, SpiralSegment, rises
from dragon_ros.verify.track import Place, Track

_HALVINGS = 70          # maximum number of halvings, which reduce a range of a million radians to 1e-15
_NARROW = 1e-9          # accepted error of the bounds on a handle's turning position, relative to its coordinate
Range = tuple[arb, arb]


def ranges(track: Track, dragon: Dragon, low: arb, high: arb) -> list[Range]:
    """Return bounds on all front handles' distances along the track while the head is between two distances.

    Raises Refused if a link may lock in between, or a handle may leave the track.
    """
    if track.to_centre:
        return _to_centre(track, dragon, low, high)
    ends = [_distances(track, dragon, end) for end in (low, high)]
    return [(one.lower(), two.upper()) for one, two in zip(*ends, strict=True)]


def _distances(track: Track, dragon: Dragon, head: arb) -> list[arb]:
    place = track.place_at(head)
    out = [head]
    for bench in dragon.benches:
        place = track.next(place, bench.link, -1)
        out.append(track.distance(place))
    return out[:-1]


def _to_centre(track: Track, dragon: Dragon, low: arb, high: arb) -> list[Range]:
    segment = track.segments[0]
    assert isinstance(segment, SpiralSegment)
    inner, outer = track.place_at(high).u, track.place_at(low).u
    out = []
    for bench in dragon.benches:
        out.append((track.distance(Place(0, outer)).lower(), track.distance(Place(0, inner)).upper()))
        inner, outer = _image(segment, inner, outer, bench.link)
    return out


def _image(segment: SpiralSegment, low: arb, high: arb, link: Link) -> Range:
    """Return bounds on the coordinate of a handle while the handle in front of it is between two positions."""
    one, two = low + segment.span(low, link), high + segment.span(high, link)
    lows, highs = [], []
    parts = [(low, high, one, two, _HALVINGS)]
    while parts:
        left, right, from_left, from_right, halvings = parts.pop()
        ratio, stands = _ratio(segment, left, right, from_left, from_right, link)
        if stands and (ratio > 0 or ratio < 0):
            pair = (from_left, from_right) if ratio > 0 else (from_right, from_left)
        elif stands and right - left < _NARROW * from_right:    # it turns back here; the span bounds how far it moves
            pair = left + (from_right - right), right + (from_left - left)
        elif halvings:
            middle = (HALF * (left + right)).mid()
            at_middle = middle + segment.span(middle, link)
            parts += [(left, middle, from_left, at_middle, halvings - 1),
                      (middle, right, at_middle, from_right, halvings - 1)]
            continue
        else:
            raise Refused('a link may lock during the run: its position could not be proved everywhere')
        lows.append(pair[0])
        highs.append(pair[1])
    return reduce(arb.min, lows), reduce(arb.max, highs)


def _ratio(segment: SpiralSegment, left: arb, right: arb, from_left: arb, from_right: arb, link: Link
           ) -> tuple[arb, bool]:
    """Return the ratio of the next handle's speed to this handle's, and whether chords grow up to each span."""
    theta, longest = left.union(right), from_left - left
    slopes = spiral_slopes(segment, theta, longest.union(from_right - right), link)
    stands = longest < PI or rises(theta, PI.lower(), longest.upper())
    return ONE + slopes.delta_1, stands
