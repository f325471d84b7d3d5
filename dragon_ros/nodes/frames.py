"""The frames of a run in order, with a current position: the ticks and, if the run ends in a contact, that frame."""
from collections import deque
from collections.abc import Iterable
from threading import Thread

from dragon_ros.core.batches import ticks
from dragon_ros.core.errors import FieldError
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact
from dragon_ros.core.step import Frame, contact_frame, tick, ticks_before
from dragon_ros.core.words import counted

_TOGETHER_HANDLES = 2**11       # handles per group of ticks: few enough for their messages to stay in the cache


def build_tables(simulation: Simulation) -> Thread:
    """Start building the tables of a run on a separate thread, since tracks with hundreds of joints take seconds.

    A frame waits for its own table if that table has not been built yet, so its bits do not depend on the thread.
    """
    thread = Thread(target=simulation.build_tables, name='tables', daemon=True)
    thread.start()
    return thread


class Frames:
    """Ticks 0, 1, 2, ... of a scene or, given a contact, the ticks before it and the frame at exactly that time."""

    def __init__(self, scene: Scene, contact: Contact | None = None, together: bool = False) -> None:
        """Start before the first frame. If ``together``, several ticks are computed at once, with the same bits."""
        self._scene, self._contact = scene, contact
        self._last = contact_frame(scene, contact.t_s) if contact else None
        count = compile_scene(scene).last_tick + 1
        self._ticks = min(count, ticks_before(scene, contact.t_s)) if contact else count
        self.count = self._ticks + (contact is not None)
        self.k = 0
        self.stamp_ns, self.seconds = scene.run.stamp_ns, scene.run.seconds
        self._group = max(1, _TOGETHER_HANDLES // (scene.dragon.benches + 1)) if together else 1
        self.ahead: deque[Frame] = deque()      # frames that have been computed, in order; a seek may skip them

    def prepare(self) -> None:
        """Compute the next frame in advance, and start building the tables of the run."""
        self.ahead = deque([self._frame(self.k)])
        self.tables = build_tables(compile_scene(self._scene))

    def next_ns(self) -> int | None:
        """Return the time of the next frame, or None at the end."""
        return self._time_ns(self.k) if self.k < self.count else None

    def last_ns(self) -> int:
        """Return the time of the last frame."""
        return self._time_ns(self.count - 1)

    def take(self) -> Frame:
        """Return the next frame and advance."""
        k, self.k = self.k, self.k + 1
        if not (self.ahead and self.ahead[0].k == k):
            self.ahead = deque(self._some(k))
        return self.ahead.popleft()

    def _some(self, k: int) -> Iterable[Frame]:
        """Return frame k and, if it is not the last of its group, the next frames."""
        stop = min(k + self._group, self._ticks)
        return ticks(self._scene, k, stop) if stop > k + 1 else [self._frame(k)]

    def _frame(self, k: int) -> Frame:
        return self._last if self._last and k == self._ticks else tick(self._scene, k)

    def rewind(self) -> None:
        """Move to the first frame."""
        self.k = 0

    def seek(self, t_ns: int | None) -> None:
        """Move to the last frame at or before ``t_ns`` (None: the first). Raises FieldError (see ``check_time``)."""
        if t_ns is None:
            self.rewind()
            return
        self.check_time(t_ns)
        k = min(self._scene.run.tick_at(t_ns), self._ticks - 1)
        self.k = self._ticks if self._last and t_ns >= self._last.t_ns else k

    def check_time(self, t_ns: int) -> None:
        """Raise FieldError if ``t_ns`` is before the first frame or after the end of the run."""
        first, last = self._time_ns(0), self.last_ns()
        run = self._scene.run
        end = max(last, run.stamp_ns(compile_scene(self._scene).end.t_s)) if self._last is None else last
        if not first <= t_ns <= end:
            raise FieldError('seek_s', run.seconds(t_ns), f'the run goes from {run.seconds(first):.9g} s to '
                             f'{run.seconds(end):.9g} s', 'give a time in this range')

    def place(self) -> str:
        """Describe the position of the last frame taken."""
        k = max(self.k - 1, 0)
        return f'at {self._scene.run.seconds(self._time_ns(k)):.3f} s, tick {k} of {self.count}'

    def ending(self) -> str:
        """Return why there is no next frame."""
        if self._contact:
            return f'the run ends at the contact of {self._contact.between} at {self._contact.t_s:.9f} s'
        end = compile_scene(self._scene).end
        return f'{end.words} at {end.t_s:.6f} s after {counted(self.count, "tick")}'

    def _time_ns(self, k: int) -> int:
        return self._last.t_ns if self._last and k == self._ticks else self._scene.run.time_ns(k)
