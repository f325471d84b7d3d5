"""Animations of a run: GIF, or MP4 where ffmpeg is installed."""
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure

from dragon_ros.cli import figures
from dragon_ros.cli.figures import BODY, HEAD, TOUCHED
from dragon_ros.commands.plot.dragon import draw, panel, sheet
from dragon_ros.commands.sources import Moment, Progress, Source, Touch, check_times, moment, thinned, window
from dragon_ros.core.errors import FieldError, InputError, MissingError
from dragon_ros.core.numerics.types import Floats

FORMATS = '.gif, .html, .mp4'
MOST_FRAMES = 3000
_INCHES = 4.6               # of the longer side of the axes
_SAMPLES = 24               # moments whose dragons set the window
_HAIR_S = 1e-9
_HOLD_MS = 1500             # of the last frame of a GIF


def frame_times(source: Source, start_s: float | None, stop_s: float | None, pace: float, fps: int) -> Floats:
    """Return the time of each frame. Raises InputError for times outside the source and for too many frames."""
    for name, value in (('--pace', pace), ('--fps', fps)):
        if not 0 < value <= 1e6:
            raise FieldError(name, value, 'it must be positive', 'try --pace 20 --fps 20')
    first, last = (at if given is None else given for at, given in zip(source.span_s, (start_s, stop_s), strict=True))
    check_times(source, (first, last))
    frames = 1 + int((last - first) * fps / pace)
    if not 2 <= frames <= MOST_FRAMES:
        raise InputError(f'--pace {pace:g}: gives {frames} frames from {first:g} to {last:g} s; 2 to {MOST_FRAMES} can '
                         'be drawn: change --pace, --fps, --start or --stop')
    times_s = first + np.arange(frames, dtype=np.float64) * pace / fps
    return times_s if last - times_s[-1] < _HAIR_S else np.append(times_s, last)


def animate(source: Source, times_s: Floats, fps: int, path: Path, dpi: int, progress: Progress) -> Path:
    """Draw a frame for each time into a file and return its path."""
    touch, drawn = source.first_touch(lambda rows: rows), AnimatedFigure(source, times_s)
    with _movie(drawn.figure, path, dpi, fps) as writer:
        for one in progress(source.moments(times_s)):
            drawn.show(one, touch)
            writer.grab_frame()
    return path


class AnimatedFigure:
    """A figure whose window holds the dragon at all times of an animation, and shows one of them."""

    def __init__(self, source: Source, times_s: Floats) -> None:
        """Draw the first time; the window is that of up to 24 times and of the track."""
        samples = source.moments(times_s[thinned(0, len(times_s) - 1, _SAMPLES)])
        inches, seen = panel(window(source.track, samples), _INCHES)
        self.figure = Figure(figsize=sheet(inches, (1, 1), legend=False))
        axes, first = self.figure.add_subplot(), moment(source, float(times_s[0]))
        self._benches = draw(axes, seen, source.track, first, venue=source.venue)
        self._dots, self._name = axes.lines[-1], source.name
        self._title, self._width_in = axes.set_title(' '), float(inches[0])
        self.show(first, None)

    def show(self, one: Moment, touch: Touch | None) -> None:
        """Move the benches; from the first contact on, those that touch have its colour."""
        self._benches.set_verts(list(one.benches.corners))
        self._dots.set_data(*one.p.T)
        self._title.set_text(figures.titled(self._name, f'{one.t_s:.2f} s', self._width_in))
        if touch is not None and one.t_s >= touch.t_s:
            _show_touch(self._benches, one, touch.benches)


@contextmanager
def _movie(figure: Figure, path: Path, dpi: int, fps: int) -> Iterator[AbstractMovieWriter]:
    """Write frames to a temporary file and rename it at the end; an interrupted animation leaves nothing."""
    writer, part = _writer(path, fps), path.with_name(f'.{path.stem}.part{path.suffix}')
    try:
        writer.setup(figure, str(part), dpi)
        yield writer
        writer.finish()
        part.replace(path)
    except OSError as error:
        raise MissingError(f'--output {path}: cannot be written: {error.strerror}') from None
    except KeyboardInterrupt:
        with suppress(Exception):       # the writer may already be closed
            writer.finish()
        raise
    finally:
        part.unlink(missing_ok=True)


def _show_touch(benches: Any, one: Moment, touching: tuple[int, ...]) -> None:
    """Colour the benches in contact; the head keeps its colour."""
    colours = benches.get_facecolor()
    if len(colours) == len(one.benches.centre):
        for bench in set(touching) - {0}:
            colours[bench] = to_rgba(TOUCHED)
        benches.set_facecolor(colours)


def _writer(path: Path, fps: int) -> AbstractMovieWriter:
    """Return the writer for the path's suffix. Raises InputError, MissingError."""
    kind = path.suffix.lower()
    if kind not in ('.gif', '.mp4'):
        raise InputError(f'--output {path}: an animation is {FORMATS}')
    if kind == '.mp4' and not FFMpegWriter.isAvailable():
        raise MissingError(f'--output {path}: MP4 needs ffmpeg, which is not installed; install it, or write .gif or '
                           '.html')
    return _GifWriter(fps=fps) if kind == '.gif' else FFMpegWriter(fps=fps)


class _GifWriter(PillowWriter):
    """Writes frames with few colours and without dithering, which takes a sixth of the size."""

    def grab_frame(self, **options: Any) -> None:
        """Add a frame."""
        super().grab_frame(**options)
        frames: list[Any] = self._frames  # type: ignore[attr-defined]
        frames[-1] = frames[-1].convert('RGB').quantize(palette=_palette(), dither=0)

    def finish(self) -> None:
        """Write the file; its last frame stays for a while before the animation starts again."""
        frames: list[Any] = self._frames  # type: ignore[attr-defined]
        each_ms = [round(1000 / self.fps)] * (len(frames) - 1)
        frames[0].save(self.outfile, save_all=True, append_images=frames[1:], duration=[*each_ms, _HOLD_MS], loop=0)


@lru_cache
def _palette() -> Any:
    """Return an image of the palette: greys, and our colours mixed with white and with black."""
    from PIL import Image
    mixed = [np.array(to_rgb(colour)) * part + end * (1 - part) for colour in (BODY, HEAD, TOUCHED)
             for part in (1.0, 0.75, 0.5, 0.25) for end in (0.0, 1.0)]
    colours = np.array([*(np.full(3, grey) for grey in np.linspace(0, 1, 17)), *mixed])
    out = Image.new('P', (1, 1))
    out.putpalette((255 * colours).round().astype(np.uint8).tobytes())
    return out
