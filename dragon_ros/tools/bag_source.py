"""A recorded dragon as a source of pictures."""
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain as joined

import numpy as np

from dragon_ros.core.contact.tracker import Sight, Watch
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import NS
from dragon_ros.tools.sources import Moment, Progress, Touch, thinned, witness_at
from dragon_ros.wire.bag_frames import frames, namespace_of
from dragon_ros.wire.cdr_read import read_stamp_ns
from dragon_ros.wire.log_read import LogReader

_HAIR_S = 1e-9


@dataclass(frozen=True)
class BagSource:
    """The dragon whose topics stand in one namespace of an open bag; times are those of its ticks."""

    bag: LogReader
    namespace: str

    @property
    def name(self) -> str:
        """The bag's file name."""
        return self.bag.path.name

    @property
    def track(self) -> Floats | None:
        """Not known."""
        return None

    @cached_property
    def _ticks(self) -> list[tuple[int, int]]:
        """Stamp and log time of each tick, in ns, by growing stamps."""
        rows = {read_stamp_ns(one.data): one.t_ns for one in self.bag.messages([f'{self.namespace}/handles'])}
        return sorted(rows.items())

    @cached_property
    def _times_s(self) -> Floats:
        return np.array([stamp for stamp, _ in self._ticks]) / NS

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last tick."""
        return float(self._times_s[0]), float(self._times_s[-1])

    def ticks_s(self, start_s: float, stop_s: float, most: int) -> Floats:
        """Return at most ``most`` ticks between two times, evenly spread."""
        first = int(np.searchsorted(self._times_s, start_s - _HAIR_S))
        last = int(np.searchsorted(self._times_s, stop_s + _HAIR_S)) - 1
        out: Floats = self._times_s[thinned(first, last, most)]
        return out

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the tick nearest to each time; both grow. Ticks without benches are left out."""
        rows = self._nearest(times_s)
        wanted = {self._ticks[row][0] for row in rows.tolist()}
        first_ns, last_ns = (self._ticks[row][1] for row in (int(rows[0]), int(rows[-1])))
        for sight, speed in self._sights(first_ns, last_ns):
            if sight.t_ns in wanted:
                yield Moment(sight.t_ns / NS, sight.p, sight.benches, speed)

    def _nearest(self, times_s: Floats) -> Ints:
        """Return the numbers of the ticks nearest to times, each once."""
        ticks = self._times_s
        after = np.clip(np.searchsorted(ticks, times_s), 0, len(ticks) - 1)
        before = np.maximum(after - 1, 0)
        return np.unique(np.where(times_s - ticks[before] < ticks[after] - times_s, before, after))

    def first_touch(self, progress: Progress) -> Touch | None:
        """Return the first contact that a monitor sees in the bag: a bracket's interpolated time."""
        watch = Watch()
        for sight, _ in progress(self._sights(self._ticks[0][1], self._ticks[-1][1])):
            for event in joined.from_iterable(report.begins for report in watch.look(sight)):
                at = Moment(sight.t_ns / NS, sight.p, sight.benches, None)
                return Touch(event.t_contact_s, event.benches, event.point_m, witness_at(at, event.benches))
        return None

    def _sights(self, first_ns: int, last_ns: int) -> Iterator[tuple[Sight, Floats | None]]:
        """Yield sights and speeds of the ticks logged between two times, in order."""
        for frame in frames(self.bag, self.namespace, first_ns, last_ns + 1):
            if frame.benches is not None:
                speeds = None if frame.velocity_m_s is None else np.hypot(*frame.velocity_m_s.T)
                yield Sight(frame.t_ns, frame.handles_m, frame.benches, frame.frame_id), speeds


def dragon_in(bag: LogReader, namespace: str | None = None) -> BagSource:
    """Return the dragon in a bag. Raises InputError where it is not clear which, or where its topics are not there."""
    chosen = namespace_of(bag, namespace)
    having = {topic.name for topic in bag.topics if topic.messages}
    for topic in ('handles', 'benches'):
        if f'{chosen}/{topic}' not in having:
            raise InputError(f'{bag.path}: has no messages on {chosen}/{topic}, which a picture needs; '
                             'record both handles and benches (scene key effects)')
    return BagSource(bag, chosen)
