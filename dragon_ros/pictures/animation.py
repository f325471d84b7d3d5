"""Animations of a run: GIFs, and MP4 films that also show the clearance and the speeds."""
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dragon_ros.cli import figures
from dragon_ros.cli.figures import HEAD, LINES, QUIET
from dragon_ros.cli.pool import ALONE, Pool
from dragon_ros.core.errors import FieldError, InputError
from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.words import counted
from dragon_ros.pictures.dragon import Overlaps, draw, overlaps, panel, sheet
from dragon_ros.pictures.film import film, prepared_as
from dragon_ros.pictures.film_layout import FilmLayout, film_layout
from dragon_ros.pictures.sources import (
    Moment,
    Progress,
    Source,
    check_times,
    clearances,
    moment,
    smallest_gap,
    thinned,
    window,
)
from dragon_ros.pictures.zoom import INSET_WIDTH, Inset, Zoom, contact_of
from dragon_ros.version import __version__

MOST_FRAMES = 3000
_INCHES = 4.6               # longer side of the axes, in inches
_SAMPLES = 24               # number of moments that determine the window
_SAME_S = 1e-9
_CURVE = 400                # number of points on a film's clearance curve
_GRID = 5                   # minimum number of ground lines across a moving window


def frame_times(source: Source, start_s: float | None, stop_s: float | None, pace: float, fps: int) -> Floats:
    """Return the time of each frame. Raises InputError for times outside the source or too many frames."""
    for name, value in (('--pace', pace), ('--fps', fps)):
        if not 0 < value <= 1e6:
            raise FieldError(name, value, 'it is not positive', 'use for example 20')
    first, last = (at if given is None else given for at, given in zip(source.span_s, (start_s, stop_s), strict=True))
    check_times(source, (first, last))
    frames = 1 + int((last - first) * fps / pace)
    if not 2 <= frames <= MOST_FRAMES:
        raise InputError(f'--pace {pace:g}: it gives {counted(frames, "frame")} from {first:g} to {last:g} s, but only '
                         f'2 to {MOST_FRAMES} can be drawn; change --pace, --fps, --start or --stop')
    times_s = first + np.arange(frames, dtype=np.float64) * pace / fps
    return times_s if last - times_s[-1] < _SAME_S else np.append(times_s, last)


def animate(source: Source, times_s: Floats, fps: int, path: Path, drawn: 'AnimatedFigure', progress: Progress,
            pool: Pool = ALONE) -> Path:
    """Write a file with a frame for each time, and return the path; the processes of a pool draw the frames."""
    frames = pool.in_order(_Frames(drawn, prepared_as(path)), source.moments(times_s))
    with film(path, drawn.size, fps) as add, closing(frames):
        for frame in progress(frames):
            add(frame)
    return path


@dataclass(frozen=True)
class _Frames:
    """Draws moments as frames of a film."""

    drawn: 'AnimatedFigure'
    prepare: Callable[[Array], Any]

    def __call__(self, one: Moment) -> Any:
        """Return the frame of a moment."""
        return self.prepare(self.drawn.frame(one))


class AnimatedFigure:
    """A figure that shows one moment at a time; the parts that do not move are drawn only once.

    Without a ``zoom``, the window contains the dragon at all times. With a zoom that follows the dragon, the window
    moves with the head or tail, and lines on the ground make this motion visible. A film also shows the clearance over
    time and the speeds.
    """

    def __init__(self, source: Source, times_s: Floats, zoom: Zoom | None = None, follow: bool = False,
                 film: tuple[int, int] | None = None, dpi: int = 130, progress: Progress = iter) -> None:
        """Lay out the figure and draw the first moment; ``film`` is the frame size of a film in pixels."""
        first = moment(source, float(times_s[0]))
        self._name, self._zoom, self._follow = source.name, zoom, follow
        self._point_m, self._gap = contact_of(zoom, source), smallest_gap(source.venue)
        self._touch = source.first_touch(progress) if source.venue is not None else None     # by obstacles
        samples = source.moments(times_s[thinned(0, len(times_s) - 1, _SAMPLES)])
        self._whole = window(source.track, samples, source.venue)
        self._seen = self._whole if zoom is None else zoom.window(first, self._point_m)
        layout = film_layout(*film, zoom is not None) if film else None
        self.figure, axes, small = self._laid_out(layout, dpi)
        self._reach = np.array((-0.5, 0.5))[:, None] * (self._seen[1] - self._seen[0])
        self.axes = axes
        self._dragon = draw(axes, self._seen, source.track, first, venue=source.venue)
        self._ground = [one for one in (*axes.patches, *axes.lines) if one not in self._dragon.moving] if follow else []
        self._lines = axes.plot([], [], color='#DDDDDD', linewidth=0.8, zorder=0.5) if follow else []
        self._inset = Inset(small, self._whole, source.track) if zoom is not None else None
        self._title = axes.set_title(' ', linespacing=1.3)
        self._curves = _Curves(self.figure, layout, source, times_s, progress) if layout else None
        self._moving = self._parts()
        self._canvas: Any = FigureCanvasAgg(self.figure)
        self._background: Any = None
        self._show(first)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to be pickled, without the pixels."""
        self._draw_background()
        return {key: value for key, value in vars(self).items() if key not in ('_canvas', '_background')}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the figure in another process."""
        vars(self).update(state, _canvas=FigureCanvasAgg(state['figure']), _background=None)

    def _laid_out(self, film: FilmLayout | None, dpi: int) -> tuple[Figure, Any, Any]:
        """Return the figure, the axes of the dragon, and the axes of the inset."""
        if film:
            figure = Figure(tuple(film.size_in.tolist()), film.dots_per_inch)
            figure.set_layout_engine('none')
            box_in = film.size_in * film.dragon[2:]
            self._width_in = float(box_in[0])
            half = 0.5 * box_in * float(np.max((self._seen[1] - self._seen[0]) / box_in))
            self._seen = self._seen.mean(axis=0) + np.array((-half, half))
            return figure, figure.add_axes(film.dragon), figure.add_axes(film.inset) if self._zoom is not None else None
        inches, self._seen = panel(self._seen, _INCHES)
        self._width_in = float(inches[0])
        widths = [1.0] if self._zoom is None else [1.0, INSET_WIDTH]
        figure = Figure(figsize=sheet(inches * (sum(widths), 1), (1, 1), legend=False), dpi=dpi)
        axes, *small = figure.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0]
        return figure, axes, *(small or [None])

    def _touching(self, one: Moment, clearance_m: float) -> Overlaps:
        """Return the overlapping benches and, from the first contact on, the bench that touches an obstacle."""
        areas = overlaps(one) if clearance_m < 0 else Overlaps()
        if self._touch is None or one.t_s < self._touch.t_s:
            return areas
        return replace(areas, benches=tuple(sorted({*areas.benches, *self._touch.benches})))

    def _heading(self, one: Moment, clearance_m: float) -> str:
        """Return the title: the name and the time, followed by the clearance and the largest speed."""
        rounded_mm = round(1e3 * clearance_m, 1) + 0.0     # + 0.0 removes the minus sign of a zero
        gap = f'clearance {rounded_mm:.1f} mm' if np.isfinite(clearance_m) else 'no benches that could touch'
        if one.speed_m_s is not None:
            gap = figures.joined(f'{gap},', f'fastest handle {np.max(one.speed_m_s):.3f} m/s', ' ', self._width_in)
        return f'{figures.titled(self._name, f"{one.t_s:.2f} s", self._width_in)}\n{gap}'

    def _parts(self) -> list[Artist]:
        """Return the moving parts, from bottom to top, and exclude them from the background."""
        parts: list[Artist] = [*self._lines, *self._ground, *self._dragon.moving, self._title]
        if self._follow:
            self.axes.set(xticks=(), yticks=(), xlabel='', ylabel='')
            self.axes.grid(visible=False)
        if self._inset is not None:
            parts += self._inset.moving
        if self._curves is not None:
            parts += self._curves.moving
        for part in parts:
            part.set_animated(True)
        return parts

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame in pixels."""
        width, height = self._canvas.get_width_height()
        return int(width), int(height)

    def frame(self, one: Moment) -> Array:
        """Return the picture of a moment, a uint8 array (H, W, 4) that is valid until the next picture is drawn."""
        self._draw_background()
        self._show(one)
        self._canvas.restore_region(self._background)
        for part in self._moving:
            self.figure.draw_artist(part)
        return np.asarray(self._canvas.buffer_rgba())

    def _draw_background(self) -> None:
        """Lay out the figure and draw the parts that do not move, unless this has been done."""
        if self._background is None:
            layout = self.figure.get_layout_engine()
            if layout is not None:      # without it, the figure would be drawn once more to lay it out
                layout.execute(self.figure)
            self.figure.set_layout_engine('none')
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self.figure.bbox)

    def _show(self, one: Moment) -> None:
        """Show the dragon and all other moving parts at a moment."""
        clearance_m = self._gap.at_m(one.p, one.benches)
        self._dragon.show(one, self._touching(one, clearance_m))
        if self._follow:
            assert self._zoom is not None
            self._seen = self._zoom.window(one, self._point_m).mean(axis=0) + self._reach
            self.axes.set(xlim=self._seen[:, 0], ylim=self._seen[:, 1])
            lines, step_m = _ground_lines(self._seen)
            self._lines[0].set_data(*lines)
            self.axes.set_xlabel(f'lines on the ground every {step_m:g} m')
        if self._inset is not None:
            self._inset.show(one, self._seen)
        self._title.set_text(self._heading(one, clearance_m))
        if self._curves is not None:
            self._curves.show(one, clearance_m)


def _ground_lines(seen: Floats) -> tuple[Floats, float]:
    """Return the lines (2, K) of a square grid at round coordinates, separated by nan, and their spacing (m)."""
    side = float(np.max(seen[1] - seen[0]))
    step = 10.0 ** floor(log10(side / _GRID))
    step = next(step * many for many in (1, 2, 5, 10) if side / (step * many) <= 2 * _GRID)
    parts = []
    for axis in (0, 1):
        for at in np.arange(np.ceil(seen[0, axis] / step), seen[1, axis] / step) * step:
            line = np.array(((at, at, np.nan), (seen[0, 1 - axis], seen[1, 1 - axis], np.nan)))
            parts.append(line if axis == 0 else line[::-1])
    return np.concatenate(parts, axis=1) if parts else np.empty((2, 0)), step


class _Curves:
    """The clearance over time and the speeds along the chain, beside or below the dragon in a film."""

    def __init__(self, figure: Figure, film: FilmLayout, source: Source, times_s: Floats, progress: Progress) -> None:
        """Draw the clearance over the whole film; a line and a point on the curve mark the moment."""
        gap, speed = figure.add_axes(film.gap), figure.add_axes(film.speed)
        some = times_s[thinned(0, len(times_s) - 1, _CURVE)]
        at_s, gaps_m = clearances(source, some, progress)
        gap.plot(at_s, 1e3 * gaps_m, color=LINES[0], linewidth=1.6)
        which = 'to benches or obstacles' if source.has_obstacles else 'between benches'
        gap.set(title=f'smallest gap {which} (mm)', xlabel='time (s)', xlim=(times_s[0], times_s[-1]))
        _thin_labels(gap.xaxis)
        gap.axhline(0.0, color=QUIET, linewidth=0.8)
        self._now = gap.axvline(times_s[0], color=QUIET, linewidth=1.0)
        self._gap, = gap.plot([], [], marker='o', markersize=8, color=HEAD, linestyle='none', clip_on=False)
        moments = list(source.moments(times_s[thinned(0, len(times_s) - 1, _SAMPLES)]))
        speeds = [one.speed_m_s for one in moments if one.speed_m_s is not None]
        self._speed, = speed.plot([], [], color=LINES[0], linewidth=1.6)
        speed.set(title='speed of each handle (m/s)', xlabel='handle', xlim=(0, max(1, len(moments[0].p) - 1)))
        if speeds:
            low, high = min(map(np.min, speeds)), max(map(np.max, speeds))
            margin = 0.05 * (high - low) + 1e-4
            speed.set_ylim(low - margin, high + margin)
        figure.text(0.98, 0.015, f'dragon_ros {__version__}', ha='right', color=QUIET)

    @property
    def moving(self) -> list[Artist]:
        """The parts that change from moment to moment."""
        return [self._now, self._gap, self._speed]

    def show(self, one: Moment, clearance_m: float) -> None:
        """Show a moment."""
        self._now.set_xdata([one.t_s, one.t_s])
        finite = np.isfinite(clearance_m)
        self._gap.set_data([one.t_s] if finite else [], [1e3 * clearance_m] if finite else [])
        if one.speed_m_s is not None:
            self._speed.set_data(np.arange(one.speed_m_s.size), one.speed_m_s)


def _thin_labels(axis: Any) -> None:
    """Use as many ticks as possible on a horizontal axis of fixed size and range, without overlapping labels.

    By default, Matplotlib assumes labels of three digits.
    """
    for intervals in range(9, 0, -1):
        axis.set_major_locator(MaxNLocator(intervals, steps=(1, 2, 2.5, 5, 10)))
        boxes = [label.get_window_extent() for label in axis.get_ticklabels()]
        if all(one.x1 + one.height / 2 < other.x0 for one, other in pairwise(boxes)):
            return


def film_size(text: str) -> tuple[int, int]:
    """Return the width and the height (in pixels) that a string WIDTHxHEIGHT states. Raises InputError."""
    parts = text.lower().split('x')
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() and len(part) < 6 for part in parts):
        raise InputError(f'--size {text}: it is not a size; write WIDTHxHEIGHT in pixels, such as 1920x1080')
    width, height = map(int, parts)
    if width % 2 or height % 2 or not (320 <= width <= 7680 and 240 <= height <= 4320):
        raise InputError(f'--size {text}: both numbers must be even, from 320x240 to 7680x4320; try 1920x1080')
    return width, height
