"""What is known of handles and links between two states of a chain, whatever the leader does in between.

Between two states the leader goes from one place to another. Handles then move one way each, but where a handle turns
back: that happens near the centre of a single spiral only, where links may lock, and ``turning_back_m`` tells where the
leader is then. Cut there, every handle passes the places between its two, and no others.
"""
from collections.abc import Sequence
from functools import reduce

import numpy as np

from dragon_ros.core.chain.leader import Leader
from dragon_ros.core.chain.lock import turns
from dragon_ros.core.enclosures.ball_arithmetic import Ball, between
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.tracks.composite import Place, Track
from dragon_ros.core.tracks.segments import BEHIND

TOLERANCE = 1e-9        # of Newton's last step: its square is below what floats keep
_FINEST = 1e-14         # of a time or a distance: intervals this short are not cut
_TURNS_WITHIN = 4.0     # rad: ``lock.turns`` finds all within the chord and this of the centre


def divisible(starts: Floats, stops: Floats) -> Array:
    """Return which intervals of time or distance between starts and stops (M,) are long enough to be cut."""
    out: Array = np.abs(stops - starts) > _FINEST * (1 + np.maximum(np.abs(starts), np.abs(stops)))
    return out


def curvatures_between(track: Track, segments: Sequence[Ints], curvatures: Sequence[Floats]) -> Ball:
    """Return the curvatures in 1/m on the track between some places, given their segments and curvatures there.

    Curvature is monotone on a segment, so on one it lies between those at the places; else all segments count whole.
    """
    low, high = track.bends
    first, last = reduce(np.minimum, segments), reduce(np.maximum, segments)
    one = first == last
    return between(np.where(one, reduce(np.minimum, curvatures), low[first, last]),
                   np.where(one, reduce(np.maximum, curvatures), high[first, last]))


def swing_rad(most: Floats, link_m: float | Floats, moved_m: Floats) -> Floats:
    """Return how far a link turns at most, in all, while its two handles move by ``moved_m`` together.

    ``most`` is the largest curvature in 1/m between the rear handle's first place and the front handle's last. A link
    turns at (v_rear sin beta - v_front sin alpha) / link, alpha and beta its angles with the track's tangents. No sine
    exceeds 1, nor, where most * link < 2, most * link / 2 (Schur's comparison with a circle).
    """
    with np.errstate(divide='ignore'):
        out: Floats = np.minimum(0.5 * most, np.divide(1.0, link_m)) * moved_m
    return out


def turning_back_of_m(track: Track, link_m: float) -> list[float]:
    """Return the distances of a link's front handle along the track at which its rear handle turns back."""
    if not track.may_lock:
        return []
    return [_distance_m(track, theta) for theta in turns(link_m / _pitch_per_rad(track))]


def turning_back_m(leader: Leader, low_m: float, high_m: float) -> list[float]:
    """Return how far the leader has gone, between two distances, where any handle turns back; growing.

    Followed from the head on: between the places so far the front handle of the next link moves one way, so its rear
    handle turns where the front one passes a place of ``lock.turns`` (contact.md, lemma 2). Far out none turns.
    """
    if not leader.track.may_lock:
        return []
    b_m = _pitch_per_rad(leader.track)
    chords = leader.links_m / b_m
    longest = np.maximum.accumulate(chords[::-1])[::-1]
    places = sorted(leader.place((gone, 0.0)).u.hi for gone in (low_m, high_m))
    here, found = list(places), list[float]()
    for k, chord in enumerate(chords.tolist()):
        if min(here) >= longest[k] + _TURNS_WITHIN:
            break
        turning = [illinois(lambda x, k=k, turn=turn: _handle(leader, x, k) - turn,    # type: ignore[misc]
                            places[n], places[n + 1], here[n] - turn, here[n + 1] - turn)
                   for turn in turns(chord) for n in range(len(places) - 1)
                   if (here[n] - turn) * (here[n + 1] - turn) < 0]
        found += turning
        here = [_behind(leader, theta, k) for theta in here] + [_handle(leader, theta, k + 1) for theta in turning]
        places, here = map(list, zip(*sorted(zip(places + turning, here, strict=True)), strict=True))
    return sorted(leader.gone_m(Place(0, DoubleDouble(theta, 0.0))) for theta in found)


def _pitch_per_rad(track: Track) -> float:
    assert track.from_afar is not None
    return track.from_afar.curve.b_m


def _distance_m(track: Track, theta: float) -> float:
    return track.distance_of(Place(0, DoubleDouble(theta, 0.0)))[0]


def _behind(leader: Leader, theta: float, link: int) -> float:
    """Return the polar angle of a link's rear handle."""
    return leader.track.next(Place(0, DoubleDouble(theta, 0.0)), float(leader.links_m[link]), BEHIND, TOLERANCE)[0].u.hi


def _handle(leader: Leader, theta: float, links: int) -> float:
    """Return the polar angle of the handle behind some links."""
    for link in range(links):
        theta = _behind(leader, theta, link)
    return theta
