"""Show a part of a picture: a window around the head, the tail, the contact or a point, and an inset of the whole."""
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from dragon_ros.cli.figures import BODY, HEAD, POINT, QUIET, TRACK
from dragon_ros.core.checks import number
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.pictures.sources import Moment, Source

_PLACES = ('head', 'tail', 'contact')
_LENGTHS = 6.0              # default side of a window, in bench lengths
INSET_WIDTH = 0.36          # width of an inset, relative to the axes
_LEAST = 0.05               # size relative to the inset below which a ring marks the window
_MOST_POINTS = 1000         # largest number of points of the dragon in an inset


@dataclass(frozen=True)
class Zoom:
    """A window of a picture: its centre, and its side length (m)."""

    around: str | tuple[float, float]
    span_m: float | None = None

    def side_m(self, one: Moment) -> float:
        """Return the side length (m) of the window."""
        return self.span_m or _LENGTHS * 2 * float(np.median(one.benches.half_length))

    def window(self, one: Moment, point_m: tuple[float, float] | None) -> Floats:
        """Return the corners (2, 2) of the window at a moment, lower left first; ``point_m`` is the contact's point."""
        half = 0.5 * self.side_m(one)
        centre = {'head': one.p[0], 'tail': one.p[-1], 'contact': point_m}.get(str(self.around), self.around)
        corners: Floats = np.array(centre) + np.array(((-half, -half), (half, half)))
        return corners


def zoom_of(around: str | None, span_m: float | None) -> Zoom | None:
    """Return the window that --around and --span select, or None if neither is given. Raises InputError."""
    if span_m is not None:
        number('--span', span_m, above=0.0, high=1e6)
    if around is None:
        return None if span_m is None else Zoom('head', span_m)
    if around in _PLACES:
        return Zoom(around, span_m)
    try:
        x, y = map(float, around.split(','))
    except ValueError:
        raise InputError(f'--around {around}: it is not a place; give {", ".join(_PLACES)}, or X,Y in m, such as '
                         '--around 1.5,-2') from None
    return Zoom((number('--around', x, low=-1e9, high=1e9), number('--around', y, low=-1e9, high=1e9)), span_m)


def contact_of(zoom: Zoom | None, source: Source) -> tuple[float, float] | None:
    """Return the point of the first contact if the window is centred on it. Raises InputError if no benches touch."""
    if zoom is None or zoom.around != 'contact':
        return None
    touch = source.first_touch(iter)
    if touch is None:
        raise InputError(f'--around contact: no benches touch in {source.name}; give head, tail, or X,Y')
    return touch.point_m


class Inset:
    """A small picture beside the axes: track and dragon as lines, and the axes' window as a frame."""

    def __init__(self, small: Axes, whole: Floats, track: Floats | None) -> None:
        """Draw the track in the axes ``small``; the limits contain the box ``whole`` (2, 2)."""
        half = 0.5 * np.max(whole[1] - whole[0]) * np.ones(2)
        (left, bottom), (right, top) = (whole.mean(axis=0) + sign * half for sign in (-1, 1))
        small.grid(visible=False)
        small.set(aspect='equal', anchor='NW', xlim=(left, right), ylim=(bottom, top), xticks=(), yticks=())
        for spine in small.spines.values():
            spine.set(visible=True, edgecolor=QUIET, linewidth=0.6)
        if track is not None:
            small.plot(*track.T, color=TRACK, linewidth=0.5)
        self._side_m = float(2 * half[0])
        self._dragon, = small.plot([], [], color=BODY, linewidth=2.0, solid_capstyle='butt')
        self._head, = small.plot([], [], color=HEAD, marker='o', markersize=3.5, linestyle='none')
        self._ring, = small.plot([], [], color=POINT, marker='o', markersize=9, fillstyle='none', linestyle='none')
        self._frame = Rectangle((0, 0), 0, 0, fill=False, edgecolor=POINT, linewidth=1.0, zorder=5)
        small.add_patch(self._frame)

    @property
    def moving(self) -> list[Line2D | Rectangle]:
        """The parts that change from moment to moment."""
        return [self._dragon, self._head, self._ring, self._frame]

    def show(self, one: Moment, seen: Floats) -> None:
        """Show a dragon, and the window (2, 2) of the axes."""
        some = np.unique(np.linspace(0, len(one.p) - 1, _MOST_POINTS).astype(int))
        self._dragon.set_data(*one.p[some].T)
        self._head.set_data(*one.p[:1].T)
        size = seen[1] - seen[0]
        self._frame.set_bounds(*seen[0].tolist(), *size.tolist())
        small = float(np.max(size)) < _LEAST * self._side_m
        self._ring.set_data(*(seen.mean(axis=0)[:, None] if small else np.empty((2, 0))))
