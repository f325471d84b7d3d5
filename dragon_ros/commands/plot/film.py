"""Writers of animations: GIF by Pillow, and MP4 by Pillow's AV1 encoder or by an installed ffmpeg.

Pillow's wheels bundle libavif with libaom, both under BSD-2-Clause. PyAV is not used, because its wheels bundle x264
and x265, which are under the GPL. An AVIF image sequence is an MP4 file that contains AV1 (both are ISO base media
files, ISO/IEC 14496-12); ``mp4_of`` replaces its brands and its handler with those of a film.
"""
import struct
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from queue import Full, Queue
from shutil import which
from threading import Thread
from typing import IO, Any, Protocol

import numpy as np
from matplotlib.colors import to_rgb

from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.cli.figures import BODY, HEAD, LINES, TOUCHED
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.numerics.types import Array

FORMATS = '.gif, .html, .mp4'
_HOLD_MS = 1500             # duration (ms) of a GIF's last frame
_AHEAD = 4                  # largest number of frames that wait for the encoder
_QUALITY, _SPEED = 80, 10   # settings of AV1: a quality that keeps fine lines sharp, and the fastest speed
_WAIT_S = 0.2
_BRANDS = (b'iso6', b'mp41', b'av01')       # brands that replace those of an image sequence
_PARENTS = (b'moov', b'trak', b'mdia', b'edts')


class FilmWriter(Protocol):
    """A writer of frames that all have the same size."""

    @property
    def prepare(self) -> Callable[[Array], Any]:
        """A function that converts a picture, a uint8 array (H, W, 4), to a frame; another process may call it."""

    def add(self, frame: Any) -> None:
        """Add a frame."""

    def finish(self) -> None:
        """Write the file."""

    def stop(self) -> None:
        """Abandon the file."""


@contextmanager
def movie(path: Path, size: tuple[int, int], fps: int, frames: int, codec: str | None = None) -> Iterator[FilmWriter]:
    """Write frames to a file that replaces an old one only when it is complete; an interrupted film leaves no file.

    Raises InputError for other formats, and MissingError if no program can write the format, or if the file cannot be
    written.
    """
    start = _writer(path, size, fps, frames, codec)
    try:
        with whole_or_none(path, overwrite=True) as file:
            writer = start(file)
            try:
                yield writer
                writer.finish()
            except BaseException:
                writer.stop()
                raise
    except OSError as error:
        raise MissingError(f'--output {path}: cannot be written: {error.strerror or error}') from None


def _writer(path: Path, size: tuple[int, int], fps: int, frames: int,
            codec: str | None) -> Callable[[IO[bytes]], FilmWriter]:
    """Return the function that starts the writer for the path's suffix, given the open file."""
    kind = path.suffix.lower()
    if kind == '.gif':
        return lambda file: _Gif(file, fps)
    if kind != '.mp4':
        raise InputError(f'--output {path}: the formats of an animation are {FORMATS}')
    if codec in (None, 'av1') and has_av1():
        return lambda file: _Av1(file, fps, frames)
    ffmpeg = which('ffmpeg')
    if codec != 'av1' and ffmpeg is not None:
        return lambda file: _Ffmpeg(file, size, fps, ffmpeg)
    needs = {'av1': "--codec av1 needs Pillow 11.3: pip install 'dragon_ros[film]'",
             'h264': '--codec h264 needs ffmpeg: install it (apt install ffmpeg), or omit --codec'}
    raise MissingError(f'--output {path}: ' + needs.get(str(codec), "MP4 needs Pillow 11.3 or ffmpeg: pip install "
                                                        "'dragon_ros[film]', or write .gif or .html"))


def has_av1() -> bool:
    """Return whether Pillow is installed with an AV1 encoder."""
    from PIL import features
    if 'avif' not in features.modules or not features.check('avif'):
        return False
    from PIL import _avif
    return bool(_avif.encoder_codec_available('aom'))


class _Gif:
    """A writer of GIFs with few colours and without dithering, which reduces the size to a sixth."""

    def __init__(self, file: IO[bytes], fps: int) -> None:
        self._file, self._fps, self._frames = file, fps, list[Any]()

    @staticmethod
    def prepare(picture: Array) -> Any:
        from PIL import Image
        return _image(picture).quantize(palette=_palette(), dither=Image.Dither.NONE)

    def add(self, frame: Any) -> None:
        self._frames.append(frame)

    def finish(self) -> None:
        """Write the file; the last frame remains visible for a while before the animation restarts."""
        each_ms = [round(1000 / self._fps)] * (len(self._frames) - 1)
        self._frames[0].save(self._file, 'GIF', save_all=True, append_images=self._frames[1:],
                             duration=[*each_ms, _HOLD_MS], loop=0)

    def stop(self) -> None:
        self._frames.clear()


def _image(picture: Array) -> Any:
    from PIL import Image
    return Image.fromarray(np.ascontiguousarray(picture[..., :3]))


@lru_cache
def _palette() -> Any:
    """Return an image with the palette: greys, and the package's colours mixed with white and black."""
    from PIL import Image
    mixed = [np.array(to_rgb(colour)) * part + end * (1 - part) for colour in (BODY, HEAD, TOUCHED, LINES[0])
             for part in (1.0, 0.75, 0.5, 0.25) for end in (0.0, 1.0)]
    colours = np.array([*(np.full(3, grey) for grey in np.linspace(0, 1, 17)), *mixed])
    out = Image.new('P', (1, 1))
    out.putpalette((255 * colours).round().astype(np.uint8).tobytes())
    return out


class _Later:
    """A frame that Pillow's sequence writer reads on demand; a thread encodes frames while others are drawn."""

    mode, is_animated, has_transparency_data = 'RGB', False, False

    def __init__(self, queue: 'Queue[Any]') -> None:
        self._queue = queue

    def seek(self, frame: int) -> None:
        """Move to the next frame. Raises EOFError if there are no more frames."""
        if frame:
            raise EOFError
        self._image = self._queue.get()
        if self._image is None:
            self._queue.put(None)
            raise EOFError
        self.size = self._image.size

    def tobytes(self, *how: str) -> bytes:
        """Return the pixels."""
        data: bytes = self._image.tobytes(*how)
        return data


class _Av1:
    """A writer of MP4 files with AV1, which Pillow encodes in a thread while it releases the interpreter lock."""

    def __init__(self, file: IO[bytes], fps: int, frames: int) -> None:
        self._file, self._frames = file, frames
        ends = np.round(np.arange(frames + 1) * 1000 / fps).astype(int)     # Pillow counts whole milliseconds
        self._each_ms = np.diff(ends).tolist()
        self._queue: Queue[Any] = Queue(_AHEAD)
        self._thread: Thread | None = None
        self._data, self._error = BytesIO(), list[BaseException]()

    prepare = staticmethod(_image)

    def add(self, frame: Any) -> None:
        try:
            self._queue.put_nowait(frame)
        except Full:
            self._put(frame)

    def _put(self, frame: Any) -> None:
        self._start()
        while True:
            if self._error:
                raise self._error[0]
            with suppress(Full):
                self._queue.put(frame, timeout=_WAIT_S)
                return

    def _start(self) -> None:
        """Start the thread only when frames wait for it, because processes can be forked until then."""
        if self._thread is None:
            self._thread = Thread(target=self._encode, args=(self._queue.get(),), daemon=True)
            self._thread.start()

    def _encode(self, first: Any) -> None:
        later = [_Later(self._queue) for _ in range(self._frames - 1)]
        try:
            first.save(self._data, 'AVIF', save_all=True, append_images=later, duration=self._each_ms, codec='aom',
                       quality=_QUALITY, speed=_SPEED, subsampling='4:2:0', range='limited', max_threads=2)
        except BaseException as error:  # noqa: BLE001 - raised again when a frame is added
            self._error.append(error)

    def finish(self) -> None:
        self._put(None)
        assert self._thread is not None
        self._thread.join()
        if self._error:
            raise self._error[0]
        self._file.write(mp4_of(self._data.getvalue()))

    def stop(self) -> None:
        """Let the encoder finish the frames that it has already received."""
        with suppress(Full):
            self._queue.put(None, timeout=_WAIT_S)


def mp4_of(sequence: bytes) -> bytes:
    """Turn an AVIF image sequence into an MP4 file: replace brands and handler, and remove the repetition.

    Creation times are zero, so equal films have equal bytes.
    """
    out = bytearray(sequence)
    places = {kind: (at, size) for kind, at, size in _boxes(sequence, 0, len(sequence))}
    at, size = places[b'ftyp']
    brands = [_BRANDS[n % len(_BRANDS)] for n in range((size - 16) // 4)]
    out[at + 8:at + size] = struct.pack('>4sI', b'iso6', 0) + b''.join(brands)
    at = places[b'meta'][0]
    out[at + 4:at + 8] = b'free'        # this box describes the first frame as a still picture
    at = places[b'hdlr'][0]
    out[at + 16:at + 20] = b'vide'
    length = sequence[places[b'mdhd'][0] + 32:][:8]     # all boxes have version 1, with 64-bit times
    for kind, place in ((b'mvhd', 32), (b'tkhd', 36), (b'elst', 16)):
        at = places[kind][0]
        out[at + place:at + place + 8] = length
    for kind in (b'mvhd', b'tkhd', b'mdhd'):
        at = places[kind][0]
        out[at + 12:at + 28] = bytes(16)        # creation and modification times
    at = places[b'elst'][0]
    out[at + 8:at + 12] = b'\1\0\0\0'   # version 1, without the repeat flag
    return bytes(out)


def _boxes(data: bytes, start: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield the kind, start and size of boxes, including boxes nested in containers on the path to a track."""
    while start < end:
        size, kind = struct.unpack_from('>I4s', data, start)
        yield kind, start, size or end - start
        if kind in _PARENTS:
            yield from _boxes(data, start + 8, start + size)
        start += size or end - start


class _Ffmpeg:
    """A writer of MP4 files with H.264; an ffmpeg on the PATH encodes the frames, which it receives through a pipe."""

    def __init__(self, file: IO[bytes], size: tuple[int, int], fps: int, program: str) -> None:
        raw = ['-f', 'rawvideo', '-pix_fmt', 'rgba', '-s', f'{size[0]}x{size[1]}', '-r', str(fps), '-i', '-']
        command = [program, '-y', '-loglevel', 'error', *raw, '-c:v', 'h264', '-pix_fmt', 'yuv420p',
                   '-movflags', '+faststart', '-f', 'mp4', file.name]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)

    @staticmethod
    def prepare(picture: Array) -> bytes:
        return np.ascontiguousarray(picture).tobytes()

    def add(self, frame: bytes) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(frame)
        except BrokenPipeError:
            self.finish()

    def finish(self) -> None:
        _, said = self._process.communicate()
        if self._process.returncode:
            lines = said.decode(errors='replace').strip().splitlines() or ['no reason given']
            raise MissingError(f'ffmpeg ended with an error: {lines[-1][:200]}; write .gif or .html')

    def stop(self) -> None:
        self._process.kill()
        with suppress(OSError, ValueError):
            self._process.communicate()
