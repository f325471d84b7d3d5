"""Where the front handles of a dragon go along the track during a run, and when one of them is at a place.

Handles behind a leader move on as it moves on, so each goes between its places at the leader's least and greatest way.
On a single spiral led by its head the second and the third handle may turn back near the centre, and those behind
follow (docs/contact.md): their least places are where that happens.
"""
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from math import inf, pi

import numpy as np

from dragon_ros.core.chain.dragon import is_even
from dragon_ros.core.chain.lock import turning_places, turns
from dragon_ros.core.errors import FieldError
from dragon_ros.core.inwards import inwards, span
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.paper import place
from dragon_ros.core.placed import PlacedArc
from dragon_ros.core.scene import Scene
from dragon_ros.core.walk import Walk

_SAME = 1e-13       # of a distance along the track: nearer places are the same
_TOLERANCE = 1e-9   # of Newton's last step: its square is below what floats keep


class Visits:
    """The ways of all front handles in a scene's run, at the accuracy of the tier exact."""

    def __init__(self, scene: Scene) -> None:
        """Prepare for a scene."""
        self.scene = replace(scene, accuracy='exact', solver='march')
        run, law = scene.run, scene.head
        inside = [t_s for t_s in law.breaks_s if run.start_s < t_s < compile_scene(scene).end.t_s]
        self._times_s = [run.start_s, *inside, compile_scene(scene).end.t_s]
        self._gone_m = [float(law.travelled_m(t_s)[0]) for t_s in self._times_s]

    @cached_property
    def walk(self) -> Walk:
        """The track as a walk."""
        return self.scene.led.walk if self.scene.led else inwards(self.scene.spiral)

    @property
    def lap_m(self) -> float:
        """Length of the circle that the track begins with, round which it goes for ever; infinite if it has none."""
        first = self.walk.pieces[0]
        return 2 * pi * first.radius_m if isinstance(first, PlacedArc) and first.first == -inf else inf

    @cached_property
    def _chords(self) -> tuple[float, float]:
        links = self._all_chords
        return links[0], links[min(1, len(links) - 1)]

    @cached_property
    def _all_chords(self) -> list[float]:
        out: list[float] = (self.scene.dragon.link_lengths_m / self.scene.spiral.b_m).tolist()
        return out

    @cached_property
    def _polar(self) -> tuple[float, float]:
        """Least and greatest polar angle of the head on a single spiral."""
        low, high = (self._polar_at(gone) for gone in (max(self._gone_m), min(self._gone_m)))
        return low, high

    def _polar_at(self, gone_m: float) -> float:
        spiral = self.scene.spiral
        return spiral.inward(min(gone_m, spiral.length_m)).hi

    @cached_property
    def ranges_m(self) -> Floats:
        """Least and greatest distance (2, N) of the front handles along the walk."""
        scene, links = self.scene, self.scene.dragon.link_lengths_m
        if scene.led:
            ends = [scene.led.chain((gone, 0.0), compile_scene(scene).model.effort) for gone in (min(self._gone_m), max(self._gone_m))]
            out: Floats = np.sort([self.walk.distances(end.piece, end.u)[:-1] for end in ends], axis=0)
            return out
        spans = [self._polar]
        for chord in self._chords:
            low, high = spans[-1]
            places = [_behind(theta, chord) for theta in (low, high, *turns(chord)) if low <= theta <= high]
            spans.append((min(places), max(places)))
        rest = [place(scene.spiral, links[2:], DoubleDouble(edge, 0.0), compile_scene(scene).model.effort).theta[1:] for edge in spans[-1]]
        theta = np.concatenate((np.array(spans).T, rest), axis=1)[:, :links.size]
        self._check_rest(theta)
        return np.sort(self.walk.distances(np.zeros(theta.shape, dtype=np.int64), theta), axis=0)

    def _check_rest(self, theta: Floats) -> None:
        """Refuse ranges (2, N) of polar angles in which a handle behind the third turns back: they are not all."""
        links = self._all_chords[2:theta.shape[1]]
        if is_even(self.scene.dragon.link_lengths_m):
            return
        for n, (chord, low, high) in enumerate(zip(links, *theta[:, 2:].tolist(), strict=True), 2):
            if any(low < turn < high for turn in turns(chord)):
                raise FieldError('dragon.groups', self.scene.dragon.link_lengths_m[n], f'bench {n} turns back near the '
                                 'centre, and how far it comes is not known', 'stop earlier, or use shorter benches')

    def turns_m(self, link: int) -> list[float]:
        """Return the distances of the front handle along the walk at which a link's rear handle turns back."""
        if self.scene.led:
            return []
        return [self._along_m(theta) for theta in turns(self._all_chords[link])]

    def _along_m(self, theta: float) -> float:
        return self.scene.spiral.distance_to(theta)

    def when_s(self, handle: int, along_m: float) -> float:
        """Return a time at which a handle is at a distance along the walk."""
        gone = self._leader_m(handle, along_m)
        pairs = zip(pairwise(self._times_s), pairwise(self._gone_m), strict=True)
        times, ways = min(pairs, key=lambda pair: max(min(pair[1]) - gone, gone - max(pair[1])))
        low, high = (way - gone for way in ways)
        if low * high >= 0:
            return times[0] if abs(low) <= abs(high) else times[1]
        return illinois(lambda t_s: float(self.scene.head.travelled_m(t_s)[0]) - gone, *times, low, high)

    def _leader_m(self, handle: int, along_m: float) -> float:
        """Return how far the leader has gone where a handle is at a distance along the walk."""
        ways = [min(self._gone_m), *self._turning_m, max(self._gone_m)]
        over = [self._front_m(handle, gone) - along_m for gone in ways]
        nearest = min(range(len(ways)), key=lambda n: abs(over[n]))
        if abs(over[nearest]) <= _SAME * (1 + abs(along_m)):
            return ways[nearest]
        for n in range(len(ways) - 1):
            if over[n] * over[n + 1] < 0:
                return illinois(lambda gone: self._front_m(handle, gone) - along_m, *ways[n:n + 2], *over[n:n + 2])
        return ways[nearest]

    @cached_property
    def _turning_m(self) -> list[float]:
        """How far the leader has gone where the second or the third handle turns back, growing."""
        if self.scene.led:
            return []
        return sorted(map(self._along_m, turning_places(*self._chords, *self._polar)))

    def _front_m(self, handle: int, gone_m: float) -> float:
        """Return the distance of a handle along the walk when the leader has gone so far."""
        scene = self.scene
        if scene.led:
            chain = scene.led.chain((gone_m, 0.0), compile_scene(scene).model.effort)
            return float(self.walk.distances(chain.piece[handle:handle + 1], chain.u[handle:handle + 1])[0])
        theta = self._polar_at(gone_m)
        for chord in self._chords[:handle]:
            theta = _behind(theta, chord)
        rest = place(scene.spiral, scene.dragon.link_lengths_m[2:handle], DoubleDouble(theta, 0.0), compile_scene(scene).model.effort)
        return self._along_m(float(rest.theta[-1]))


def _behind(theta: float, chord: float) -> float:
    """Return the polar angle of the next handle."""
    return theta + span(theta, chord, _TOLERANCE)[0]
