"""The data of the web view: a description of the run, and frames as plain numbers, in chunks."""
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dragon_ros.core.limits import VIEW_TICKS
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.venue import PolygonObstacle, Venue
from dragon_ros.pictures.sources import Check, Moment, Progress, Source, Touch, clearances, moment, thinned, window

MOST_BENCHES = 2000         # largest number of benches sent as rectangles; otherwise, only handles are sent
MOST_POINTS = 1500          # largest number of points per line
_CURVE_BENCHES = 4_000_000   # largest product of benches and points of a clearance curve, for a few seconds of work
_CHUNK_VALUES = 250_000     # number of values per chunk of frames
_WAIT_S = 0.1               # interval (s) at which a thread that waits for another one checks whether to go on
_SEEN = 5                   # number of moments that determine the window


def _wanted() -> None:
    """Let the work continue; this is the default check, for a client that keeps waiting."""


class ViewData:
    """The data of a source for a browser; only one thread at a time computes them.

    ``check`` is called at every step of long work. An exception raised by ``check`` ends the work, and partial results
    are discarded.
    """

    def __init__(self, source: Source, progress: Progress, times_s: Floats | None = None) -> None:
        """Prepare the data of a source, at its ticks unless other times are given."""
        self._source, self._progress, self._lock = source, progress, threading.Lock()
        self._touch, self._curve, self._run = list[Touch | None](), dict[str, Any](), dict[str, Any]()  # when known
        self.times_s = source.ticks_s(*source.span_s, VIEW_TICKS) if times_s is None else times_s
        self._first = moment(source, float(self.times_s[0]))
        benches, handles = len(self._first.benches.centre), len(self._first.p)
        self._drawn = benches if benches <= MOST_BENCHES else 0
        self._placed = 0 if self._drawn else handles
        self._handles = thinned(0, handles - 1, MOST_POINTS)
        values = 8 * self._drawn + 2 * self._placed + self._handles.size
        self.frames_each = max(1, min(256, _CHUNK_VALUES // values))

    @property
    def chunks(self) -> int:
        """The number of chunks."""
        return -(-len(self.times_s) // self.frames_each)

    def run(self, check: Check = _wanted) -> dict[str, Any]:
        """Return all data that do not depend on time, as JSON values."""
        with self._locked(check):
            if not self._run:
                self._run = self._described(check)
            return self._run

    def _described(self, check: Check) -> dict[str, Any]:
        track, first, last = self._source.track, float(self.times_s[0]), float(self.times_s[-1])
        shown = None if track is None else track.astype(np.float32).T.tolist()
        seen = []
        for t_s in np.linspace(first, last, _SEEN).tolist():
            check()
            seen.append(moment(self._source, t_s))
        return {'name': self._source.name, 'benches': len(self._first.benches.centre), 'drawn': self._drawn,
                'placed': self._placed, 'sizes': _sizes(self._first), 'handles': self._handles.tolist(),
                'frames_each': self.frames_each, 'times_s': self.times_s.tolist(), 'track': shown,
                'walls': _walls(self._source.venue), 'obstacles': self._source.has_obstacles,
                'speeds': self._first.speed_m_s is not None, 'note': self._note(),
                'window_m': window(track, seen, self._source.venue).tolist(),
                'length_m': 2 * float(np.median(self._first.benches.half_length)),
                'width_m': 2 * float(np.median(self._first.benches.half_width))}

    @contextmanager
    def _locked(self, check: Check) -> Iterator[None]:
        """Wait until no other thread computes."""
        while not self._lock.acquire(timeout=_WAIT_S):
            check()
        try:
            yield
        finally:
            self._lock.release()

    def _watched(self, check: Check) -> Progress:
        """Add a check before each step of the progress."""
        def steps(rows: Iterable[Any]) -> Iterable[Any]:
            for row in self._progress(rows):
                check()
                yield row
        return steps

    def _first_touch(self, check: Check) -> Touch | None:
        if not self._touch:
            self._touch.append(self._source.first_touch(self._watched(check)))
        return self._touch[0]

    def contact(self, check: Check = _wanted) -> dict[str, Any] | None:
        """Return the first contact as JSON values, or None if there is none. The search starts at the first call."""
        with self._locked(check):
            touch = self._first_touch(check)
        return None if touch is None else {'t_s': touch.t_s, 'benches': touch.benches, 'point_m': touch.point_m,
                                           'obstacle': touch.obstacle}

    def clearance(self, check: Check = _wanted) -> dict[str, Any]:
        """Return the clearance over time as JSON values."""
        with self._locked(check):
            if not self._curve:
                first, last = float(self.times_s[0]), float(self.times_s[-1])
                points = max(100, min(MOST_POINTS, _CURVE_BENCHES // len(self._first.benches.centre)))
                times_s, gaps_m = clearances(self._source, self._source.ticks_s(first, last, points),
                                             self._watched(check))
                gaps_mm = [None if np.isnan(gap) else 1e3 * gap for gap in gaps_m.tolist()]
                self._curve = {'t_s': times_s.tolist(), 'gap_mm': gaps_mm}
            return self._curve

    def frames(self, chunk: int, check: Check = _wanted) -> bytes:
        """Return the frames of one chunk as consecutive little-endian float32, with nan for ticks without a frame.

        A frame contains the corners of all benches (8 numbers each) or, if there are many benches, all handles (2
        numbers each), and the speeds of handles.
        """
        times_s = self.times_s[chunk * self.frames_each:(chunk + 1) * self.frames_each]
        out = np.full((len(times_s), 8 * self._drawn + 2 * self._placed + self._handles.size), np.nan, '<f4')
        with self._locked(check):
            for one in self._source.moments(times_s):
                check()
                out[int(np.argmin(np.abs(times_s - one.t_s)))] = self._row(one)
        return out.tobytes()

    def contact_frame(self, check: Check = _wanted) -> bytes:
        """Return the frame at the contact, which is empty if there is no contact."""
        with self._locked(check):
            touch = self._first_touch(check)
            return b'' if touch is None else self._row(moment(self._source, touch.t_s)).astype('<f4').tobytes()

    def _row(self, one: Moment) -> Floats:
        unknown = np.full(len(one.p), np.nan)
        speed = unknown if one.speed_m_s is None else one.speed_m_s
        places = one.benches.corners if self._drawn else one.p
        return np.concatenate((places.ravel(), speed[self._handles]))

    def _note(self) -> str:
        """Return notes on omitted data."""
        notes = []
        if len(self.times_s) == VIEW_TICKS:
            notes.append(f'only {VIEW_TICKS} ticks of the run are shown')
        return '; '.join(notes)


def _walls(venue: Venue | None) -> list[list[float | None]] | None:
    """Return x and y of the outlines of a venue and its obstacles, each followed by None.

    Return None if there is no venue.
    """
    if venue is None:
        return None
    x, y = list[float | None](), list[float | None]()
    closed = [ring for one in venue.obstacles if isinstance(one, PolygonObstacle)
              for ring in (one.points_m, *one.holes_m)]
    closed += [] if venue.inside is None else [venue.inside]
    lines = [one.points_m for one in venue.obstacles if not isinstance(one, PolygonObstacle)]
    for points in [*lines, *((*ring, ring[0]) for ring in closed)]:
        x += [*(float(one) for one, _ in points), None]
        y += [*(float(one) for _, one in points), None]
    return [x, y]


def _sizes(one: Moment) -> list[tuple[int, float, float]]:
    """Return groups of consecutive equal benches: their number, half their length (m) and half their width (m)."""
    halves = np.column_stack((one.benches.half_length, one.benches.half_width))
    starts = np.flatnonzero(np.any(np.diff(halves, axis=0, prepend=np.nan) != 0, axis=1))
    counts = np.diff(starts, append=len(halves))
    return [(int(count), *halves[start].tolist()) for start, count in zip(starts, counts, strict=True)]
