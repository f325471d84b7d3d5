"""Compare a bag with the model tick by tick: bit for bit, or to the promise of its tier where bits differ.

Last bits may differ between machines, and between versions of this software. Handles, benches and velocities are then
held to twice the promise of the tier: each side may be off by it. In a bag of another version so is everything that is
computed from them.
"""
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from math import inf

import numpy as np

from dragon_ros import __version__
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.frame import Frame
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Array
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import tick
from dragon_ros.core.tiers import position_promise_m, speed_promise_m_s
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import MessageError, decode, read_marker_array, read_multi_array, read_pose_array
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.provenance import RECORD

_HUGE = 1e100
_SHOWN = 'model/markers'        # how contacts are shown is a version's own affair; model/contacts has their places
_SOLVED = ('solver', 'evaluations', 'worst_link', 'off_m')      # how a tick was solved: another version's own affair
MOST_FAULTS = 1000      # lines that are kept; all are counted
_VIEWS: dict[str, Callable[[bytes | bytearray], list[Array]]] = {
    'handles': lambda data: [read_pose_array(data).poses],
    'benches': lambda data: read_marker_array(data).geometry,
    'velocities': lambda data: [read_multi_array(data)[1]]}


@dataclass
class Comparison:
    """How many messages are equal bit for bit, how many only ``close``, and a line for each range of faults.

    ``close`` messages keep twice the promise of the tier (each side may be off by one); ``worst_m`` is the largest
    position difference among them. ``fault_count`` counts messages that are missing, extra or different;
    ``missing_count`` those that are missing.
    ``other_version`` is the version that made the bag, where that is another one: then all topics may be close.
    """

    other_version: str | None = None
    equal: int = 0
    close: int = 0
    worst_m: float = 0.0
    fault_count: int = 0
    missing_count: int = 0
    faults: list[str] = field(default_factory=list)
    _last: dict[str, tuple[str, int, int, int]] = field(default_factory=dict)

    def note(self, name: str, k: int, what: str) -> None:
        """Count a fault of a tick; consecutive ticks with the same fault share a line."""
        self._note(name, k, k, what)

    def missing(self, name: str, first: int, last: int) -> None:
        """Count the messages of ticks ``first`` to ``last``, which are missing, however many they are."""
        self.missing_count += last - first + 1
        self._note(name, first, last, 'is missing')

    def _note(self, name: str, first: int, last: int, what: str) -> None:
        self.fault_count += last - first + 1
        before = self._last.get(name)
        if before and before[0] == what and before[2] == first - 1:
            first, line = before[1], before[3]
        else:
            line = len(self.faults)
            if line < MOST_FAULTS:
                self.faults.append('')
        if line < MOST_FAULTS:
            self.faults[line] = f'tick {last}: {name} {what}' if first == last else (
                f'ticks {first} to {last}: {name} {what}')
        self._last[name] = what, first, last, line

    def stray(self, name: str, t_ns: int, count: int) -> None:
        """Count messages whose log time is not a tick."""
        self.fault_count += count
        if len(self.faults) < MOST_FAULTS:
            self.faults.append(f'{name} at {t_ns} ns belongs to no tick')


def compare_with_model(bag: BagReader, scene: Scene, namespace: str = '/dragon',
                       progress: Callable[[int], object] = lambda k: None, frame_id: str = 'dragon') -> Comparison:
    """Recompute every tick of the scene's run and compare each topic's message with the bag's."""
    made_by = bag.metadata(RECORD).get('about.dragon_ros')
    encode, result = encoders(scene, frame_id), Comparison(None if made_by in (None, __version__) else made_by)
    ticks, k = compile_scene(scene).last_tick + 1, 0
    for t_ns, recorded in _instants(bag, namespace, encode):
        here = scene.run.tick_at(t_ns)
        is_tick = 0 <= here < ticks and scene.run.time_ns(here) == t_ns
        k = _missing(result, encode, k, min(here if is_tick else here + 1, ticks))
        if not is_tick:
            for name, found in recorded.items():
                result.stray(name, t_ns, len(found))
            continue
        frame = tick(scene, here)
        for name in encode:
            _compare(result, name, frame, encode[name](frame), recorded.get(name, []), scene)
        progress(here)
        k = here + 1
    _missing(result, encode, k, ticks)
    return result


def _instants(bag: BagReader, namespace: str, names: Iterable[str]) -> Iterator[tuple[int, dict[str, list[bytes]]]]:
    """Yield (log time, messages by topic name) for the topics of a namespace."""
    topics = [f'{namespace}/{name}' for name in names]
    for t_ns, group in groupby(bag.messages(topics), lambda message: message.t_ns):
        recorded: dict[str, list[bytes]] = {}
        for message in group:
            found = recorded.setdefault(message.topic.removeprefix(f'{namespace}/'), [])
            found.append(message.data if not found else b'')        # of several only their number counts
        yield t_ns, recorded


def _missing(result: Comparison, names: Iterable[str], k: int, stop: int) -> int:
    """Count the ticks from ``k`` to before ``stop`` as missing; return the next one."""
    if stop <= k:
        return k
    for name in names:
        result.missing(name, k, stop - 1)
    return stop


def _compare(result: Comparison, name: str, frame: Frame, wanted: bytes, found: list[bytes], scene: Scene) -> None:
    """Compare one topic's messages of one tick and count the result."""
    k = frame.k
    assert k is not None
    if found == [wanted]:
        result.equal += 1
    elif not found:
        result.missing(name, k, k)
    elif len(found) > 1:
        result.note(name, k, f'is there {len(found)} times')
    elif (off_m := _off_m(name, wanted, found[0], frame, scene, result.other_version)) <= _allowed_m(frame, scene):
        result.close += 1
        result.worst_m = max(result.worst_m, off_m)
    else:
        result.note(name, k, 'differs')


def _allowed_m(frame: Frame, scene: Scene) -> float:
    """Return twice the promise, since each side may be off by it; 0 for a tier without a promise."""
    compiled = compile_scene(scene)
    promise_m = position_promise_m(compiled.tier, compiled.size_m, conditioning(frame.chain))
    return 2 * promise_m if promise_m < inf else 0.0


def _off_m(name: str, wanted: bytes, found: bytes, frame: Frame, scene: Scene, other_version: str | None) -> float:
    """Return how far a message is off in metres; inf where anything but its numbers differs.

    Quaternions are scaled by the shortest link, speeds by the promise for speeds (``speed_promise_m_s``).
    """
    if name not in _VIEWS:
        return _off_by_version_m(name, wanted, found, frame, scene) if other_version else inf
    ours, theirs = bytearray(wanted), bytearray(found)
    try:
        expected, got = _VIEWS[name](ours), _VIEWS[name](theirs)
    except MessageError:
        return inf
    if [one.shape for one in expected] != [one.shape for one in got] or not all(
            np.all(np.abs(one) < _HUGE) for one in got):
        return inf
    offs = [np.abs(one - other) for one, other in zip(got, expected, strict=True)]
    for view in (*expected, *got):
        view[...] = 0.0         # these are views: what remains in the bytes is everything else
    if ours != theirs:
        return inf
    if not any(np.any(off) for off in offs):        # a speed of 0 may be -0
        return 0.0
    if name == 'velocities':
        compiled = compile_scene(scene)
        one = speed_promise_m_s(compiled.tier, compiled.size_m, compiled.model.length_m / scene.dragon.benches,
                                conditioning(frame.chain), scene.head.speed_at_m_s(frame.t_ns / NS))
        return float(np.max(offs[0])) / one * compiled.promise_m if one else inf
    link_m = float(np.min(scene.dragon.link_lengths_m))
    return max(_farthest_m(off, link_m) for off in offs if off.size)


def _farthest_m(off: Array, link_m: float) -> float:
    """Return the largest of differences of points (K, 3), or of poses (K, 7): quaternions count at a link's end."""
    turned = float(np.max(off[:, 3:], initial=0.0)) * link_m
    return max(float(np.max(np.hypot(off[:, 0], off[:, 1]))), float(np.max(off[:, 2])), turned)


def _off_by_version_m(name: str, wanted: bytes, found: bytes, frame: Frame, scene: Scene) -> float:
    """Return how far a message of another version is off in metres; inf where anything but its numbers differs.

    Accelerations and tensions are second derivatives of places: an error of these counts 1 / link^2 times the square of
    the leader's speed, and once more for each power of the conditioning that derivatives add. A tension sums what all
    handles up to the free end need, handed on from link to link through directions, which are exact to places / link.
    """
    kind = channels()[name].type
    try:
        expected, got = (list(_leaves(decode(kind, data))) for data in (wanted, found))
    except MessageError:
        return inf
    if name == _SHOWN:
        return 0.0
    if len(expected) != len(got):
        return inf
    off = 0.0
    for one, other in zip(expected, got, strict=True):
        if isinstance(one, float) and isinstance(other, float) and abs(other) < _HUGE:
            off = max(off, abs(one - other))
        elif one != other:
            return inf
    if name in ('accelerations', 'forces'):
        speed_m_s, link_m = scene.head.speed_at_m_s(frame.t_ns / NS), float(np.min(scene.dragon.link_lengths_m))
        condition = conditioning(frame.chain)
        scale = (speed_m_s / link_m) ** 2 * condition**3
        if frame.tension_n_kg is not None and name == 'forces':
            most = float(np.max(np.abs(frame.tension_n_kg), initial=0.0))
            scale = len(frame.tension_n_kg) * scale + condition * most / link_m
        return off / scale if scale else inf
    return off


def _leaves(value: object) -> Iterator[object]:
    """Yield the numbers and texts of a decoded message, without how a tick was solved."""
    if isinstance(value, dict):
        if value.get('key') in _SOLVED:
            return
        for one in value.values():
            yield from _leaves(one)
    elif isinstance(value, (list, tuple)):
        for one in value:
            yield from _leaves(one)
    elif isinstance(value, np.ndarray):
        yield from value.reshape(-1).tolist()
    else:
        yield value
