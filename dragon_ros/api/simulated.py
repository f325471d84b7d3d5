"""Scenes, and what can be computed from them: states, contacts, gaps and bags.

Lengths are in metres, angles in radians and times in seconds; all arrays are numpy arrays. Handle 0 is the head's front
handle. Every error that dragon_ros raises deliberately is a DragonError; its subclass InputError reports invalid input.
"""
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np

from dragon_ros.core.batches import batches, states, velocity_of
from dragon_ros.core.checks import number, whole
from dragon_ros.core.domain import TRACK
from dragon_ros.core.errors import FieldError, MissingError, naming_arguments
from dragon_ros.core.geometry.rectangles import axes_of, benches_of, corner_levers
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame, state, tick
from dragon_ros.core.words import COLUMNS, counted
from dragon_ros.scenes.load import changed_scene, scene_of
from dragon_ros.scenes.load import scene_values as values_of_scene
from dragon_ros.scenes.yaml import Document

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dragon_ros.core.model import End
    from dragon_ros.core.search.certificate import Contact, NoContact
    from dragon_ros.core.search.near_misses import NearMisses

_SAME_M = 1e-9          # rounding of distances along a track
Progress = Callable[[int], object]


def quiet(states: int) -> None:
    """Show no progress."""


def scene(name_or_path: str | PathLike[str] = 'winding', **changes: Any) -> Scene:
    """Return a scene of the package by name, or the scene in a file, with changes applied.

    The changes use the keys of a scene file: ``scene('winding', track={'pitch_m': 0.5}, solver='march')``. Scenes are
    frozen, compare by value and can be pickled. Raises an InputError that names the invalid key, or a MissingError for
    an unknown scene.
    """
    return changed_scene(given_path('name_or_path', name_or_path), changes)


def scene_values(scene: Scene) -> dict[str, Any]:
    """Return a scene as a mapping that is laid out like a complete scene file."""
    return values_of_scene(given_scene('scene', scene))


def scene_from(values: Mapping[str, Any]) -> Scene:
    """Return the scene of a mapping that is laid out like a scene file. Raises an InputError that names the key."""
    return scene_of(Document('scene', dict(values)))


def compile(scene: Scene) -> 'Simulated':       # noqa: A001 - the usual term; always called as dr.compile
    """Return an object that you can query about a scene. Scenes with the same geometry share one model."""
    return Simulated(compile_scene(given_scene('scene', scene)))


def given_scene(field: str, value: Any) -> Scene:
    """Return ``value`` or, if it is a compiled scene, its scene. Raises FieldError for any other value."""
    if isinstance(value, Simulated):
        return value.scene
    if not isinstance(value, Scene):
        raise FieldError(field, value, f'it is a {type(value).__name__}, not a scene', "write dr.scene('winding')")
    return value


def given_path(field: str, value: Any) -> str:
    """Return a name or a path as a string. Raises FieldError for any other value."""
    if not isinstance(value, (str, PathLike)):
        raise FieldError(field, value, f'it is a {type(value).__name__}, not a name or a path',
                         'give a string or a Path')
    return fspath(value)


def _times(values: Any) -> list[float]:
    """Return times (s) as a list. Raises FieldError if ``values`` is not a sequence of numbers."""
    out: list[float] = _numbers('times_s', values).tolist()
    return out


def _numbers(field: str, values: Any) -> Floats:
    """Return a sequence of numbers as an array. Raises FieldError for any other value."""
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.empty((0, 0))
    if numbers.ndim != 1:
        raise FieldError(field, values, 'it is not a sequence of numbers', 'give for example [0.0, 60.0]')
    return numbers


@dataclass(frozen=True, eq=False)
class Motion:
    """All handles at one time, or at many times along a leading axis of the arrays, which are read-only.

    The fields are ``t_s`` (...), ``handles_m`` (..., N+1, 2), ``velocity_m_s`` (..., N+1, 2), and ``promise_m``, the
    largest error of a position in this run, except close to a lock.
    """

    t_s: Floats
    handles_m: Floats
    velocity_m_s: Floats
    promise_m: float

    def __repr__(self) -> str:
        """Return the times and the shape instead of the long arrays."""
        times = f'{self.t_s:g} s' if self.t_s.ndim == 0 else counted(self.t_s.size, 'time')
        return f'Motion({times}, handles_m {self.handles_m.shape}, promise_m={self.promise_m:g})'

    @cached_property
    def speed_m_s(self) -> Floats:
        """The speeds (m/s, shape (..., N+1)), as a read-only array."""
        square = np.square(self.velocity_m_s).sum(axis=-1)      # takes a third of the time of np.hypot
        return read_only(np.sqrt(square, out=square))

    def frame(self) -> Any:
        """Return a pandas DataFrame with a row per time and handle. Raises MissingError if pandas is not installed."""
        try:
            import pandas as pd  # type: ignore[import-untyped]
        except ImportError:
            raise MissingError('frame: pandas is not installed: pip install pandas') from None
        times, handles = np.atleast_1d(self.t_s), self.handles_m.shape[-2]
        rows = np.concatenate((self.handles_m, self.velocity_m_s, self.speed_m_s[..., None]), axis=-1).reshape(-1, 5)
        return pd.DataFrame({'t_s': np.repeat(times, handles), 'handle': np.tile(np.arange(handles), times.size),
                             **dict(zip(COLUMNS[2:], rows.T, strict=True))})


@dataclass(frozen=True)
class Clearance:
    """The smallest gap (m) at a time (s), negative if there is an overlap, and the largest error of this gap.

    ``benches`` are the two benches, or one bench if ``obstacle`` names the obstacle of a venue. The fields are None if
    there is no gap, as between one or two benches.
    """

    t_s: float
    gap_m: float | None
    error_m: float | None
    benches: tuple[int, ...] | None
    obstacle: str | None


@dataclass(frozen=True, eq=False)
class Simulated:
    """A compiled scene that can be queried for the handles at any time, the first contact, or a tick's contents."""

    simulation: Simulation

    def __reduce__(self) -> tuple[Callable[[Scene], 'Simulated'], tuple[Scene]]:
        """Return how a copy, also in another process, is made: its scene is compiled again."""
        return compile, (self.scene,)

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.simulation.scene

    @property
    def span_s(self) -> tuple[float, float]:
        """The times (s) at which the run starts and ends."""
        return self.scene.run.start_s, self.simulation.end.t_s

    @property
    def ends(self) -> str:
        """The reason for the end of the run: 'stop', 'lock' or 'track'."""
        return self.simulation.end.reason

    @property
    def ticks(self) -> int:
        """The number of ticks in the run."""
        return self.simulation.last_tick + 1

    def state(self, t_s: float) -> Motion:
        """Return all handles at any time up to the end of the model.

        Raises ModelEnd for a later time, and FieldError for an invalid time.
        """
        t_s = number('t_s', t_s)
        chain = state(self.scene, t_s)
        return Motion(np.array(t_s), chain.p, velocity_of(self.scene, chain, t_s), self.simulation.promise_m)

    def states(self, times_s: Sequence[float] | Floats, out: tuple[Floats, Floats] | None = None) -> Motion:
        """Return all handles at many times, several times faster than one call per time.

        ``out``, if given, is a pair of arrays (times, N+1, 2) for the handles and velocities, so that a loop can reuse
        its memory. Raises FieldError if ``out`` has any other value.
        """
        times = _times(times_s)
        if out is not None and not (isinstance(out, (tuple, list)) and len(out) == 2
                                    and all(isinstance(one, np.ndarray) for one in out)):
            raise FieldError('out', out, 'it is not a pair of arrays', 'give arrays for handles and velocities')
        if out is not None and np.may_share_memory(*out):
            raise FieldError('out', 'two arrays', 'they share memory', 'give separate arrays')
        handles, velocity = out or (None, None)
        chain = states(self.scene, times, handles)
        return Motion(np.array(times), chain.p, velocity_of(self.scene, chain, times, velocity),
                      self.simulation.promise_m)

    def handles_m(self, times_s: Sequence[float] | Floats) -> Floats:
        """Return the handles (m, shape (times, N+1, 2)) at many times, without computing velocities."""
        return states(self.scene, _times(times_s)).p

    def along_m(self, times_s: Sequence[float] | Floats) -> Floats:
        """Return the distances (m, shape (times, N+1)) of all handles along the track at many times."""
        chain = states(self.scene, _times(times_s))
        return self.simulation.model.track.distances(chain.segment, chain.u)

    def benches_m(self, times_s: Sequence[float] | Floats) -> Floats:
        """Return the corners (m, shape (times, N, 4, 2)) of all benches at many times, in order around each bench."""
        times = _times(times_s)
        chain = states(self.scene, times)
        out: Floats = benches_of(chain, self.scene.dragon, axes_of(chain)).corners
        return out.reshape(len(times), self.scene.dragon.benches, 4, 2)

    def batches(self, times_s: Sequence[float] | Floats, size: int | None = None) -> Iterator[Motion]:
        """Yield all handles at many times, in batches of ``size`` times (by default, as many as fit into a cache).

        All batches share memory: copy what you want to keep. Raises FieldError.
        """
        size = None if size is None else whole('size', size, low=1, high=2**31)
        for one in batches(self.scene, _times(times_s), size):
            yield Motion(*one, self.simulation.promise_m)

    def frame(self, k: int) -> Frame:
        """Return tick k with every effect of the scene, as published by the node ``sim``."""
        return tick(self.scene, whole('k', k, low=0, high=2**62))

    def contact(self, *, progress: Progress = quiet) -> 'Contact | NoContact':
        """Return the first contact of the run (truthy) or NoContact (falsy), each with its proof.

        ``progress(states)`` is called with the number of newly computed states. Raises FieldError if the run cannot be
        searched to its end; the error suggests an earlier stop.
        """
        from dragon_ros.core.search.first_contact import first_contact
        return first_contact(self.scene, progress)

    def near_misses(self, below_m: float = 0.01, *, contact: 'Contact | NoContact | None' = None,
                    progress: Progress = quiet) -> 'NearMisses':
        """Return the gaps below ``below_m`` before the first contact or the end of the run, nearest first.

        ``contact`` may pass the result of ``contact()``, so that it is not searched for again. Near misses are found by
        sampling and are not proved.
        """
        from dragon_ros.core.search.near_misses import near_misses
        found = self.contact(progress=progress) if contact is None else contact
        return near_misses(self.scene, found, number('below_m', below_m, above=0.0), progress)

    def certificate(self, found: 'Contact | NoContact') -> dict[str, Any]:
        """Return the proof of a result of ``contact()`` as plain values, which ``contact --verify`` checks.

        Raises InputError if the result has no complete proof.
        """
        from dragon_ros.scenes.certificate import as_values
        return as_values(self.scene, found)

    def clearance(self, t_s: float | None = None) -> 'Clearance':
        """Return the smallest gap between benches, or to obstacles, at a time (by default, at the end of the run)."""
        from dragon_ros.core.geometry.near_obstacles import with_obstacles  # few programs ask for it
        from dragon_ros.core.geometry.near_pairs import closeness
        from dragon_ros.core.geometry.venue import surroundings_of
        t_s = self.simulation.end.t_s if t_s is None else number('t_s', t_s)
        chain, dragon, venue = self.simulation.chain(t_s), self.scene.dragon, self.scene.venue
        benches = benches_of(chain, dragon, axes_of(chain))
        found = closeness(chain.p, benches)
        if venue is not None:
            found = with_obstacles(surroundings_of(venue), found, benches)
        if found.closest is None:
            return Clearance(t_s, None, None, None, None)
        inner, outer = found.closest
        levers, count = corner_levers(dragon), len(benches.half_length)
        met = [bench for bench in (inner, outer) if bench < count]      # the others are obstacles
        obstacle = venue.names[outer - count] if venue is not None and outer >= count else None
        return Clearance(t_s, found.clearance_m, float(levers[met].sum()) * self.simulation.promise_m,
                         (inner,) if obstacle is not None else (inner, outer), obstacle)

    @property
    def limit(self) -> 'End | None':
        """The time, reason ('lock' or 'track') and locking link at which the run would end without a stop time."""
        return compile_scene(replace(self.scene, run=replace(self.scene.run, stop_s=None))).limit

    def track_m(self, sag_m: float = 1e-4) -> Floats:
        """Return points (P, 2) along the part of the track that handles cover during the run, accurate to ``sag_m``."""
        return self.simulation.track_line(number('sag_m', sag_m, low=1e-9, high=1e9))

    def track_poses(self, along_m: Sequence[float] | Floats) -> tuple[Floats, Floats]:
        """Return points (m, shape (n, 2)) and unit headings on the track at distances (m, shape (n,)) along it.

        Raises FieldError for distances that are not on the track.
        """
        track, at_m = self.simulation.model.track, _numbers('along_m', along_m)
        low_m, high_m = max(track.begin_m, -TRACK.high), min(track.end_m, TRACK.high)
        if not np.all((at_m >= low_m - _SAME_M) & (at_m <= high_m + _SAME_M)):
            raise FieldError('along_m', along_m, f'the track goes from {low_m:g} to {high_m:g} m',
                             'give distances on it')
        return track.poses(*track.places_at(at_m))

    def plot(self, t_s: float | None = None, ax: 'Axes | None' = None) -> 'Axes':
        """Draw the dragon at a time (by default, the end of the run) on Matplotlib axes, and return the axes."""
        from dragon_ros.pictures.dragon import draw_on
        from dragon_ros.pictures.sources import SceneSource
        return draw_on(SceneSource('dragon', self.scene), t_s, ax)

    def _repr_svg_(self) -> str:
        """Return an SVG picture for Jupyter."""
        return _svg(self)


def gaps(handles_m: Floats, first: Sequence[int], second: Sequence[int], *, width_m: float = 0.3,
         inset_m: float = 0.275) -> Floats:
    """Return the signed gaps (m, shape (..., pairs)) between benches at given handles (m, shape (..., N+1, 2)).

    Bench k connects the handles k and k + 1, extends ``inset_m`` beyond both and is ``width_m`` wide. ``first`` and
    ``second`` are the benches of each pair. A gap is negative if the benches overlap.
    """
    from dragon_ros.core.geometry.rectangles import Benches
    from dragon_ros.core.geometry.signed_distance import gaps as signed_gaps
    along = (handles_m[..., :-1, :] - handles_m[..., 1:, :]).reshape(-1, 2)
    length_m, count = np.hypot(*along.T), handles_m.shape[-2] - 1
    benches = Benches(0.5 * (handles_m[..., :-1, :] + handles_m[..., 1:, :]).reshape(-1, 2), along / length_m[:, None],
                      0.5 * length_m + inset_m, np.full(length_m.size, 0.5 * width_m))
    start = np.arange(length_m.size // count)[:, None] * count
    apart = signed_gaps(benches, (start + np.asarray(first)).ravel(), (start + np.asarray(second)).ravel())
    out: Floats = apart.reshape(*handles_m.shape[:-2], len(first))
    return out


@naming_arguments()
def write_bag(scene: Scene | Simulated, path: str | PathLike[str], *, overwrite: bool = False,
              namespace: str = '/dragon', compression: str = 'zstd', workers: int | None = 1,
              stop: Event | None = None, progress: Progress = quiet) -> int:
    """Write the bag that ``sim`` and ``record`` would write, bit for bit, and return the number of its ticks.

    ``path`` is a file that ends in .mcap, or a rosbag2 folder. ``compression`` is 'zstd', 'lz4' or 'none'. Setting
    ``stop`` ends the bag after a whole tick. ``progress(ticks)`` is called with the number of newly written ticks.
    """
    from dragon_ros.bags.write.simulate import write_bag as write
    from dragon_ros.cli.pool import Pool
    pool = Pool(workers)
    return write(given_scene('scene', scene), Path(given_path('path', path)), overwrite=overwrite, namespace=namespace,
                 compression=compression, workers=pool.workers, in_order=pool.in_order, stop=stop, progress=progress)


def _svg(of: Simulated | Scene) -> str:
    """Return an SVG picture of a scene at the end of its run."""
    from dragon_ros.pictures.dragon import svg_of
    from dragon_ros.pictures.sources import SceneSource
    return svg_of(SceneSource('dragon', given_scene('of', of)))


def _draw_in_jupyter() -> None:
    """Register the pictures of scenes with IPython if it is running, because scenes must not import drawing code."""
    shell = sys.modules['IPython'].get_ipython() if 'IPython' in sys.modules else None
    if shell is not None:
        shell.display_formatter.formatters['image/svg+xml'].for_type(Scene, _svg)


_draw_in_jupyter()
