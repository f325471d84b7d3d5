"""The contents of a plan: gaps, times and room; as an area for a map, and as marks to chalk on the ground."""
import csv
import io
import json
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np

import dragon_ros as dr
from dragon_ros.cli.inputs import Floats
from dragon_ros.cli.language import say
from dragon_ros.commands.plan_words import WORDS

_MARK_M, _CHALK_M = 10.0, 5.0       # spacing of the marks on the plan, and of those to chalk
_TIGHT_M = 2.0          # a smaller gap is tight, and so is one below twice the margin
_FEWEST_TIGHT, _MOST_TIGHT = 5, 20      # how many places are numbered
_WIDEST, _NEARLY_M = 3, 0.01    # how many places that need the most room are shown; a smaller difference is none
_TIMES = 401            # number of times at which the positions of head and tail are computed


@dataclass(frozen=True)
class Gap:
    """The smallest gap to a named part of the venue, ``after_s`` after the start, and its end points (2, 2).

    The exact gap is smaller than ``gap_m`` by at most ``within_m``; ``is_broken`` tells whether it is below the margin.
    """

    name: str
    gap_m: float
    after_s: float
    ends_m: Floats
    is_tight: bool
    is_broken: bool
    within_m: float

    @property
    def middle_m(self) -> Floats:
        """The middle of the gap."""
        out: Floats = self.ends_m.mean(axis=0)
        return out


@dataclass(frozen=True)
class Plan:
    """The contents of a scene's plan."""

    scene: dr.Scene
    title: str
    lang: str = 'en'

    def say(self, key: str, **parameters: object) -> str:
        """Return a message in the language of the plan."""
        return say(WORDS, key, self.lang, **parameters)

    @cached_property
    def run(self) -> dr.Simulated:
        """The compiled scene."""
        return dr.compile(self.scene)

    @cached_property
    def line(self) -> Floats:
        """The points of the track, from the rear to the front."""
        return self.run.track_m(1e-3)[::-1]

    @cached_property
    def room(self) -> dr.Room:
        """The room that the run requires along the track, and the swept area."""
        return dr.design.room(self.scene)

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """The gaps to obstacles and to the boundary, smallest first."""
        venue = self.scene.venue
        if venue is None:
            return ()
        from shapely import Polygon, get_coordinates, shortest_line
        found, start_s, out = dr.design.fit(self.scene), self.run.span_s[0], []
        assert isinstance(found, dr.VenueFit)
        for one in found.gaps:
            bench = Polygon(self.run.benches_m([one.t_s])[0, one.bench])
            gap_m = max(one.high_m, 0.0)
            out.append(Gap(one.name, gap_m, one.t_s - start_s,
                           get_coordinates(shortest_line(bench, outlines(venue)[one.name])),
                           gap_m < max(_TIGHT_M, 2 * venue.margin_m), one in found.lacking,
                           gap_m - max(one.low_m, 0.0)))
        return tuple(out)

    @property
    def tight(self) -> list[Gap]:
        """The gaps that are numbered on the plan: the smallest few, and all that are tight."""
        return [gap for n, gap in enumerate(self.gaps[:_MOST_TIGHT]) if gap.is_tight or n < _FEWEST_TIGHT]

    @cached_property
    def widest(self) -> list[tuple[float, float, float]]:
        """Distances along the track at which the most room is required, with the room to the left and right."""
        both = np.stack((self.room.left_m, self.room.right_m), axis=1)
        straight_m = both.min(axis=0, initial=np.inf).sum()
        out = list[tuple[float, float, float]]()
        for n in np.argsort(-both.sum(axis=1), kind='stable').tolist():
            at_m, (left_m, right_m) = float(self.room.at_m[n]), both[n].tolist()
            if left_m + right_m < straight_m + _NEARLY_M or len(out) == _WIDEST:
                break
            if all(abs(at_m - other) > _MARK_M for other, *_ in out):
                out.append((at_m, left_m, right_m))
        return out

    def marks_m(self, every_m: float = _MARK_M) -> Floats:
        """Return the distances (m) along the track of the marks that front handles pass."""
        at_m = self.room.area.at_m
        return np.arange(ceil(at_m[0] / every_m), at_m[-1] // every_m + 1) * every_m

    def passes_s(self, marks_m: Floats) -> tuple[Floats, Floats]:
        """Return the times (s) after which head and tail first reach marks, accurate to 1/400 of the run, or nan."""
        times_s = np.linspace(*self.run.span_s, _TIMES)
        at_m = self.run.along_m(times_s)
        return _passed(at_m[:, 0], times_s, marks_m), _passed(at_m[:, -1], times_s, marks_m)

    @cached_property
    def fastest(self) -> str:
        """A sentence that states the largest speed of any handle."""
        try:
            bound = dr.design.max_speed(self.scene).bound
        except dr.DragonError:
            return self.say('unbounded')
        peak = getattr(self.scene.head, 'speed_m_s', None)
        ratio = _rounded_up(bound)
        if peak is None:
            return self.say('slower', ratio=ratio)
        return self.say('slower_than', ratio=ratio, speed=_rounded_up(bound * abs(peak)))


def outlines(venue: Any) -> dict[str, Any]:
    """Return the edges of each obstacle, and of the boundary, as lines by name."""
    from shapely import MultiLineString
    rings = {one.name: [[*ring, ring[0]] for ring in one.rings_m] if hasattr(one, 'rings_m') else [one.points_m]
             for one in venue.obstacles}
    if venue.inside is not None:
        rings[venue.names[-1]] = [[*venue.inside, venue.inside[0]]]
    return {name: MultiLineString(lines) for name, lines in rings.items()}


def _rounded_up(value: float) -> float:
    return ceil(value * 100 - 1e-6) / 100


def _passed(at_m: Floats, times_s: Floats, marks_m: Floats) -> Floats:
    """Return, for each mark, the first time (s) at which a handle reaches the mark."""
    out = np.full(marks_m.shape, np.nan)
    for n, mark_m in enumerate(marks_m.tolist()):
        side = at_m >= mark_m
        k = int(np.argmax(side != side[0]))
        if k:
            share = (mark_m - at_m[k - 1]) / (at_m[k] - at_m[k - 1])
            out[n] = times_s[k - 1] + share * (times_s[k] - times_s[k - 1])
        elif at_m[0] == mark_m:
            out[n] = times_s[0]
    return out


def geojson(plan: Plan) -> str:
    """Return swept area, track and gaps as GeoJSON, in degrees (RFC 7946) or, if the scene has no origin, in metres."""
    from shapely import LineString, normalize, reverse
    from shapely.geometry import mapping
    area, origin = plan.room.area, plan.scene.origin
    drawn: list[tuple[dict[str, Any], Any]] = [
        ({'name': 'swept by the head'}, reverse(normalize(area.head))),        # outer rings run anticlockwise
        ({'name': 'swept by the body'}, reverse(normalize(area.body))),
        ({'name': 'track'}, LineString(plan.line)),
        *(({'name': f'gap to {gap.name}', 'gap_m': gap.gap_m}, LineString(gap.ends_m)) for gap in plan.gaps)]
    if origin is not None:
        from dragon_ros.scenes.georeference import degrees_of
        drawn = [(properties, degrees_of(shape, origin)) for properties, shape in drawn]
    features = [{'type': 'Feature', 'properties': properties, 'geometry': mapping(shape)}
                for properties, shape in drawn]
    return json.dumps({'type': 'FeatureCollection', **({'units': 'm'} if origin is None else {}),
                       'features': features})


def minutes(t_s: float) -> str:
    """Return a time as minutes and seconds, or nothing for nan."""
    return '' if np.isnan(t_s) else f'{round(t_s) // 60}:{round(t_s) % 60:02d}'


def chalk_marks(plan: Plan) -> str:
    """Return marks to chalk on the ground as CSV, one every five metres; those of the plan are among them.

    The bearing leads to the next mark, in degrees clockwise from the y axis, which is north in a scene from a map.
    """
    way_m, origin = plan.marks_m(_CHALK_M), plan.scene.origin
    points, _ = plan.run.track_poses(way_m)
    legs = np.diff(points, axis=0)
    columns = {'mark_m': [f'{mark:g}' for mark in way_m], 'head_min_s': [*map(minutes, plan.passes_s(way_m)[0])],
               'to_next_m': [*(f'{length:.2f}' for length in np.hypot(*legs.T)), ''][:len(way_m)],
               'bearing_deg': [*(f'{turn:.1f}' for turn in np.degrees(np.arctan2(*legs.T)) % 360), ''][:len(way_m)],
               'x_m': [f'{x:.2f}' for x in points[:, 0]], 'y_m': [f'{y:.2f}' for y in points[:, 1]]}
    if origin is not None:
        from shapely import MultiPoint, get_coordinates

        from dragon_ros.scenes.georeference import degrees_of
        degrees = get_coordinates(degrees_of(MultiPoint(points), origin)).T
        columns |= {name: [f'{one:.7f}' for one in values] for name, values in zip(
            ('longitude', 'latitude'), degrees, strict=True)}
    file = io.StringIO()
    rows = csv.writer(file, lineterminator='\n')
    rows.writerow(columns)
    rows.writerows(zip(*columns.values(), strict=True))
    return file.getvalue().rstrip('\n')
