"""The area that benches sweep during a run, computed from closely spaced positions for drawing and measuring.

The area consists of one part for the head and one part for each length of the other benches; a part covers the benches
at all positions of their front handles. Each part is the union of overlapping benches, one step apart, and of the areas
between their ends. Nothing is proved about the area. On a track of radius R, the computed area is too narrow by about
step^2 / (8 R).
"""
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np
from shapely import (
    convex_hull,
    get_coordinates,
    get_dimensions,
    intersection,
    linestrings,
    multipoints,
    polygons,
    total_bounds,
    union_all,
)

from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats, complex_of
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.bounding_box import HandleRanges, SweptBench, by_length, intervals_of
from dragon_ros.core.tracks.composite import Track

STEP_M = 0.1            # spacing of the front handle's positions
_ENDS = ((0, 3), (1, 2))     # the indices of the corners at the front and at the rear
_TOGETHER = 32          # number of neighbouring polygons that are united first
_MOST_PLACES = 40_000   # maximum number of positions; if more are needed, the step is increased


@dataclass(frozen=True, eq=False)
class SweptArea:
    """The areas swept by the head and the body, as polygons in metres, and the small polygons (n,) that form them.

    ``at_m`` (n,) holds the distances of the front handles along the track, in increasing order. ``long_m`` is the
    length of the longest bench.
    """

    head_parts: Any
    body_parts: Any
    parts: Any
    at_m: Floats
    step_m: float
    long_m: float

    @cached_property
    def head(self) -> Any:
        """The polygon that the head sweeps."""
        return _united(self.head_parts)

    @cached_property
    def body(self) -> Any:
        """The polygon that the body sweeps."""
        return _united(self.body_parts)

    @cached_property
    def whole(self) -> Any:
        """The union of both polygons."""
        return union_all([self.head, self.body])

    @property
    def bounds(self) -> Floats:
        """The smallest and the largest coordinates (min x, min y, max x, max y), found without the polygons' union."""
        out: Floats = total_bounds(self.parts)
        return out


def swept_area(scene: Scene) -> SweptArea:
    """Return the area swept by a scene's benches during its run."""
    ranges = HandleRanges(scene)
    kinds = by_length(scene.dragon.bench_lengths_m)
    spans = [intervals_of(ranges, benches) for benches in kinds]
    step_m = max(STEP_M, sum(float(np.sum(high - low)) for low, high in spans) / _MOST_PLACES)
    parts = [_placed(ranges, int(benches[0]), span, step_m) for benches, span in zip(kinds, spans, strict=True)]
    head, body = parts[0][1], np.concatenate([benches for _, benches in parts[1:] or parts])
    at_m, placed = (np.concatenate(some) for some in zip(*parts, strict=True))
    order = np.argsort(at_m)
    return SweptArea(head, body, placed[order], at_m[order], step_m, float(np.max(scene.dragon.bench_lengths_m)))


def _placed(ranges: HandleRanges, bench: int, span: Floats, step_m: float) -> tuple[Floats, Any]:
    """Return front-handle distances, one step apart, the bench at each distance, and the areas that its ends sweep."""
    at_m, placed = [], []
    for low, high in span.T.tolist():
        along = np.linspace(low, high, 2 + ceil((high - low) / step_m))
        value = SweptBench.of(ranges.track, ranges.scene.dragon, bench).states(along).value
        corners = np.stack((value[..., 0], value[..., 2]), axis=-1)
        ends = [convex_hull(multipoints(np.concatenate((corners[:-1, end], corners[1:, end]), axis=1)))
                for end in _ENDS]
        swept = [get_dimensions(each) == 2 for each in ends]        # a bench at rest sweeps only a line
        at_m += [along, *(along[1:][some] for some in swept)]
        placed += [polygons(corners), *(each[some] for each, some in zip(ends, swept, strict=True))]
    return np.concatenate(at_m), np.concatenate(placed)


def _united(parts: Any) -> Any:
    """Return the union of polygons (n,) that follow each other; uniting neighbours first takes half the time."""
    groups = np.concatenate((parts, np.full(-len(parts) % _TOGETHER, None))).reshape(-1, _TOGETHER)
    return union_all(union_all(groups, axis=1))


def room_every_metre(scene: Scene, swept: SweptArea) -> tuple[Floats, Floats]:
    """Return distances along the track, one per metre, and the space needed to the left and right (m, shape (n, 2))."""
    stations_m = np.arange(ceil(swept.at_m[0]), swept.at_m[-1])
    return stations_m, room_needed_m(compile_scene(scene).model.track, swept, stations_m)


def room_needed_m(track: Track, swept: SweptArea, stations_m: Floats) -> Floats:
    """Return how far benches reach to the left and right (m, shape (n, 2)) of a track at distances (n,) along it.

    Only benches near each distance along the track count; benches on another part of the track do not, even if that
    part passes nearby.
    """
    places = track.places_at(stations_m)
    points, headings = (complex_of(one) for one in track.poses(*places))
    firsts = np.searchsorted(swept.at_m, stations_m - swept.long_m)
    lasts = np.searchsorted(swept.at_m, stations_m + 2 * swept.long_m)
    out = np.zeros((len(stations_m), 2))
    for n, (at, normal) in enumerate(zip(points.tolist(), (1j * headings).tolist(), strict=True)):
        out[n] = _reaches_m(swept.parts[firsts[n]:lasts[n]], at, normal * swept.long_m)
    return out


def _reaches_m(benches: Any, at: complex, normal: complex) -> tuple[float, float]:
    """Return how far polygons around a point extend along a normal, to the left and to the right of the point."""
    ends = np.array([[(at - normal).real, (at - normal).imag], [(at + normal).real, (at + normal).imag]])
    x, y = get_coordinates(intersection(benches, linestrings(ends))).T
    along = ((x + 1j * y - at) * normal.conjugate()).real / abs(normal)
    return float(np.max(along, initial=0.0)), float(-np.min(along, initial=0.0))
