"""Write animations: GIF by Pillow, and MP4 by Matplotlib's writer, which runs an installed ffmpeg.

GIFs do not use Matplotlib's ``PillowWriter``, which takes five times as long, and whose files are three times as large.
"""
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from subprocess import CalledProcessError
from typing import IO, Any

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.cli.figures import BODY, HEAD, LINES, TOUCHED
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.numerics.types import Array

FORMATS = '.gif, .html, .mp4'
_HOLD_MS = 1500             # duration (ms) of a GIF's last frame
_DPI = 100
Add = Callable[[Any], None]


def prepared_as(path: Path) -> Callable[[Array], Any]:
    """Return the function that converts a picture, a uint8 array (H, W, 4), to a frame; any process may call it.

    Raises InputError for other formats, and MissingError if the format needs a program that is not installed.
    """
    kind = path.suffix.lower()
    if kind not in ('.gif', '.mp4'):
        raise InputError(f'--output {path}: the formats of an animation are {FORMATS}')
    if kind == '.mp4' and not FFMpegWriter.isAvailable():
        raise MissingError(f'--output {path}: MP4 needs ffmpeg, which is not installed; run `apt install ffmpeg`, or '
                           'write .gif or .html')
    return np.array if kind == '.mp4' else _quantized


@contextmanager
def film(path: Path, size: tuple[int, int], fps: int) -> Iterator[Add]:
    """Yield a function that adds a frame to a file; the file is complete, or is not written.

    Raises MissingError if the file cannot be written.
    """
    kind = _mp4 if path.suffix.lower() == '.mp4' else _gif
    try:
        with whole_or_none(path, overwrite=True) as file, kind(file, size, fps) as add:
            yield add
    except (OSError, CalledProcessError) as error:
        reason = (error.stderr or 'ffmpeg failed').strip().splitlines()[-1] if isinstance(error, CalledProcessError) \
            else error.strerror
        raise MissingError(f'--output {path}: cannot be written: {reason or error}') from None


@contextmanager
def _gif(file: IO[bytes], size: tuple[int, int], fps: int) -> Iterator[Add]:
    """Write a GIF; its last frame remains visible for a while before the animation restarts."""
    frames = list[Any]()
    yield frames.append
    frames[0].save(file, 'GIF', save_all=True, append_images=frames[1:], loop=0,
                   duration=[*[round(1000 / fps)] * (len(frames) - 1), _HOLD_MS])


@contextmanager
def _mp4(file: IO[bytes], size: tuple[int, int], fps: int) -> Iterator[Add]:
    """Write an MP4 file with H.264 by name, through a figure that shows each frame as an image of the same size."""
    width, height = size
    figure = Figure((width / _DPI, height / _DPI), dpi=_DPI)
    image = figure.figimage(np.zeros((height, width, 4), np.uint8))
    writer = FFMpegWriter(fps, 'h264', extra_args=['-movflags', '+faststart', '-f', 'mp4'])

    def add(picture: Array) -> None:
        image.set_data(picture)
        writer.grab_frame()
    with writer.saving(figure, file.name, _DPI):
        yield add


def _quantized(picture: Array) -> Any:
    """Return a picture with few colours and without dithering, which reduces the size of a GIF to a sixth."""
    image = Image.fromarray(np.ascontiguousarray(picture[..., :3]))
    return image.quantize(palette=_palette(), dither=Image.Dither.NONE)


@lru_cache
def _palette() -> Any:
    """Return an image with the palette: greys, and the package's colours mixed with white and black."""
    mixed = [np.array(to_rgb(colour)) * part + end * (1 - part) for colour in (BODY, HEAD, TOUCHED, LINES[0])
             for part in (1.0, 0.75, 0.5, 0.25) for end in (0.0, 1.0)]
    colours = np.array([*(np.full(3, grey) for grey in np.linspace(0, 1, 17)), *mixed])
    out = Image.new('P', (1, 1))
    out.putpalette((255 * colours).round().astype(np.uint8).tobytes())
    return out
