"""The contents of a plan: gaps, times and room; as an area for a map, and as marks to chalk on the ground."""
import csv
import io
import json
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from dragon_ros.cli.language import say
from dragon_ros.commands.plan_words import WORDS
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats

if TYPE_CHECKING:
    from dragon_ros.core.scene import Scene
    from dragon_ros.core.search.swept_area import SweptArea
    from dragon_ros.core.search.venue_fit import VenueFit
    from dragon_ros.core.venue import Origin

_MARK_M = 10.0
_CHALK_M = 5.0
_NARROWEST = 3          # number of positions for which the required room is shown
_NEARLY_M = 0.01
_FEWEST_TIGHT, _MOST_TIGHT = 5, 20      # how many places are numbered
_TIGHT_M = 2.0          # a smaller gap is tight, and so is one below twice the margin


@dataclass(frozen=True)
class Gap:
    """The smallest gap to a named part of the venue; ``ends_m`` holds the two end points of the gap.

    A bench has this gap ``after_s`` after the start. The exact gap is smaller than ``gap_m`` by at most ``within_m``.
    """

    name: str
    gap_m: float
    after_s: float
    ends_m: Floats
    is_tight: bool
    is_broken: bool
    within_m: float


@dataclass(frozen=True)
class Plan:
    """The contents of a scene's plan."""

    scene: 'Scene'
    title: str
    lang: str = 'en'

    def say(self, key: str, **parameters: object) -> str:
        """Return a message in the language of the plan."""
        return say(WORDS, key, self.lang, **parameters)

    def exact_gap(self, gap: Gap) -> str:
        """Return a gap as text, rounded to millimetres."""
        return self.say('broken_gap' if gap.is_broken else 'exact_gap', name=gap.name, gap=gap.gap_m)

    @property
    def origin(self) -> 'Origin | None':
        """The place of the plane's origin, or None if the scene does not state it."""
        return self.scene.origin

    @cached_property
    def swept(self) -> 'SweptArea':
        """The area that the dragon sweeps during the run."""
        from dragon_ros.core.search.swept_area import swept_area
        return swept_area(self.scene)

    @cached_property
    def line(self) -> Floats:
        """The points of the track, from the rear to the front."""
        return compile_scene(self.scene).track_line(1e-3)[::-1]

    @cached_property
    def marks_m(self) -> Floats:
        """Distances (m) along the track of the ten-metre marks that front handles pass."""
        at = self.swept.at_m
        return np.arange(ceil(at[0] / _MARK_M), at[-1] // _MARK_M + 1) * _MARK_M

    @cached_property
    def room_m(self) -> tuple[Floats, Floats]:
        """Positions at every metre of the track, and the room (m) required there to the left and right."""
        from dragon_ros.core.search.swept_area import room_every_metre
        return room_every_metre(self.scene, self.swept)

    @cached_property
    def fit(self) -> 'VenueFit':
        """The smallest gaps with their bounds."""
        from dragon_ros.core.search.venue_fit import venue_fit
        return venue_fit(self.scene)

    @property
    def tight(self) -> list[Gap]:
        """The gaps that are numbered on the plan: the smallest few, and all that are tight."""
        return [gap for n, gap in enumerate(self.gaps[:_MOST_TIGHT]) if gap.is_tight or n < _FEWEST_TIGHT]

    @cached_property
    def widest(self) -> list[tuple[float, float, float]]:
        """Distances along the track at which the most room is required, with the room to the left and right."""
        stations, room = self.room_m
        out: list[tuple[float, float, float]] = []
        for n in np.argsort(-room.sum(axis=1), kind='stable').tolist():
            if room[n].sum() < room.min(axis=0).sum() + _NEARLY_M:      # hardly more room than on a straight line
                break
            if all(abs(stations[n] - at) > _MARK_M for at, *_ in out):
                out.append((float(stations[n]), float(room[n, 0]), float(room[n, 1])))
            if len(out) == _NARROWEST:
                break
        return out

    def poses(self, along_m: Floats) -> tuple[Floats, Floats]:
        """Return the points and the headings, each an array (n, 2), at n distances along the track."""
        track = compile_scene(self.scene).model.track
        return track.poses(*track.places_at(along_m))

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """The gaps to obstacles and to the boundary, smallest first."""
        venue = self.scene.venue
        if venue is None:
            return ()
        from shapely import get_coordinates, multilinestrings, polygons, shortest_line

        from dragon_ros.core.batches import states
        from dragon_ros.core.geometry.rectangles import axes_of, benches_of
        from dragon_ros.core.geometry.venue import surroundings_of
        around, out = surroundings_of(venue), []
        for one in self.fit.gaps:
            chain = states(self.scene, [one.t_s])
            bench = polygons(benches_of(chain, self.scene.dragon, axes_of(chain)).corners.reshape(-1, 4, 2)[one.bench])
            mine = around.owner == around.names.index(one.name)
            ends = np.stack((around.start[mine], around.stop[mine]), axis=1)
            edges = multilinestrings(np.stack((ends.real, ends.imag), axis=-1))
            least_m = max(one.high_m, 0.0)
            ends_m = get_coordinates(shortest_line(bench, edges))
            out.append(Gap(one.name, least_m, one.t_s - self.scene.run.start_s, ends_m,
                           least_m < max(_TIGHT_M, 2 * venue.margin_m),
                           one.high_m < venue.margin_m or one.high_m <= 0, least_m - max(one.low_m, 0.0)))
        return tuple(out)

    @cached_property
    def passes_s(self) -> tuple[Floats, Floats]:
        """Times (s) at which head and tail pass the marks; nan if not passed."""
        return self.passes_at_s(self.marks_m)

    def passes_at_s(self, marks_m: Floats) -> tuple[Floats, Floats]:
        """Return the times (s) at which head and tail pass marks, accurate to 1/400 of the run; nan if not passed."""
        from dragon_ros.core.batches import states
        simulation = compile_scene(self.scene)
        run = self.scene.run
        times = np.linspace(run.start_s, simulation.end.t_s, 401)
        chain = states(self.scene, times.tolist())
        at = simulation.model.track.distances(chain.segment, chain.u)
        return _passed(at[:, 0], times, marks_m), _passed(at[:, -1], times, marks_m)

    @cached_property
    def fastest(self) -> str:
        """A sentence that states the largest speed of any handle."""
        from dragon_ros.core.errors import DragonError
        from dragon_ros.core.search.max_speed import max_speed
        try:
            found = max_speed(self.scene)
        except DragonError:
            return self.say('unbounded')
        peak = getattr(self.scene.head, 'speed_m_s', None)
        ratio = ceil(found.bound * 100 - 1e-6) / 100        # a bound is rounded up
        if peak is None:
            return self.say('slower', ratio=ratio)
        return self.say('slower_than', ratio=ratio, speed=ceil(found.bound * abs(peak) * 100 - 1e-6) / 100)


def _passed(at_m: Floats, times_s: Floats, marks_m: Floats) -> Floats:
    """Return, for each mark, the first time (s) at which a handle reaches the mark."""
    out = np.full(marks_m.shape, np.nan)
    for n, mark in enumerate(marks_m.tolist()):
        side = at_m >= mark
        k = int(np.argmax(side != side[0])) if np.any(side != side[0]) else 0
        if k:
            part = (mark - at_m[k - 1]) / (at_m[k] - at_m[k - 1])
            out[n] = times_s[k - 1] + part * (times_s[k] - times_s[k - 1])
        elif at_m[0] == mark:
            out[n] = times_s[0]
    return out


def geojson(plan: Plan) -> str:
    """Return swept area, track and gaps as GeoJSON, in degrees (RFC 7946) or, if the venue has no origin, in metres."""
    from shapely import LineString, normalize, reverse
    from shapely.geometry import mapping
    swept, origin = plan.swept, plan.origin
    drawn: list[tuple[dict[str, Any], Any]] = [
        ({'name': 'swept by the head'}, reverse(normalize(swept.head))),        # outer rings run anticlockwise
        ({'name': 'swept by the body'}, reverse(normalize(swept.body))),
        ({'name': 'track'}, LineString(plan.line))]
    drawn += [({'name': f'gap to {gap.name}', 'gap_m': gap.gap_m}, LineString(gap.ends_m)) for gap in plan.gaps]
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
    at = plan.swept.at_m
    way_m = np.arange(ceil(at[0] / _CHALK_M), at[-1] // _CHALK_M + 1) * _CHALK_M
    points, _ = plan.poses(way_m)
    legs = np.diff(points, axis=0)
    bearings = np.degrees(np.arctan2(legs[:, 0], legs[:, 1])) % 360
    head_s, _ = plan.passes_at_s(way_m)
    where = points.tolist()
    names = ['x_m', 'y_m']
    if plan.origin is not None:
        from shapely import MultiPoint, get_coordinates

        from dragon_ros.scenes.georeference import degrees_of
        degrees = get_coordinates(degrees_of(MultiPoint(points), plan.origin)).tolist()
        where = [[*xy, *both] for xy, both in zip(where, degrees, strict=True)]
        names += ['longitude', 'latitude']
    file = io.StringIO()
    rows = csv.writer(file, lineterminator='\n')
    rows.writerow(['mark_m', 'head_min_s', 'to_next_m', 'bearing_deg', *names])
    for n, (mark, t_s) in enumerate(zip(way_m.tolist(), head_s.tolist(), strict=True)):
        ahead = [f'{np.hypot(*legs[n]):.2f}', f'{bearings[n]:.1f}'] if n < len(legs) else ['', '']
        rows.writerow([f'{mark:g}', minutes(t_s), *ahead, *(f'{one:.2f}' for one in where[n][:2]),
                       *(f'{one:.7f}' for one in where[n][2:])])
    return file.getvalue().rstrip('\n')
