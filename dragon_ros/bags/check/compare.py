"""Compare a bag with the model tick by tick: bit for bit or, if bits may differ, to within the scene's promise.

The last bits differ between versions of this software and between kernels of BLAS and numpy. If a bag names another
version or other kernels, its numbers must agree to within twice the promise, because each side may be wrong by
up to one promise.

Every message in the bag is either compared or listed as unchecked, with the reason. A message that is missing between
the first and the last recorded tick is a fault; a recording that begins late, ends early or lacks topics is noted.
"""
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from heapq import merge
from itertools import chain, count, groupby
from math import ceil, inf
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.bags.read.frames import about_of, law_on, log_times_are_ticks
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.record.loss_accounting import RECEIVED
from dragon_ros.core.batches import ticks
from dragon_ros.core.chain.chain import conditioning, lag
from dragon_ros.core.errors import InputError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Array, Ints
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import Frame, contact_frame, led_tick, tick, ticks_before
from dragon_ros.core.words import counted
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import (
    MessageError,
    decode,
    read_marker_array,
    read_multi_array,
    read_odometry,
    read_pose_array,
    read_stamp_ns,
    stamp_of_message,
)
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.fixed_size import Encode, Together, each
from dragon_ros.messages.latched import DESCRIPTION, ENCODE, latched_messages
from dragon_ros.messages.length import LengthCheck
from dragon_ros.scenes.provenance import ATTACHMENT, RECORD, other_kernel
from dragon_ros.version import __version__

_HUGE = 1e100
_MOST_LAST = 8          # final ticks of a led run in which topics may be missing because the recorder was killed
_PART_BYTES = 2**23     # size of a part of a run: about eight message chunks, which take a tenth of a second
_TOGETHER_BYTES = 2**20   # size of the messages that are recomputed together; a group of 2**18 takes a tenth longer
_Messages = dict[str, list[bytes]]       # by topic name
_Instant = tuple[int, _Messages]
_Span = tuple[int, int]
_SHOWN = 'model/markers'        # drawings may differ between versions; model/contacts has the contacts themselves
_VARYING = (_SHOWN, 'model/diagnostics')        # topics whose messages may have another length in another version
_SOLVED = ('solver', 'evaluations', 'worst_link', 'off_m')      # solver diagnostics, which may differ between versions
_POINT_FIELDS = {6: '<u4', 7: '<f4', 8: '<f8'}       # datatypes in point clouds: handle number, coordinate, speed
MOST_FAULTS = 1000      # limit on the stored fault lines; all faults are counted
_VIEWS: dict[str, Callable[[bytes | bytearray], list[Array]]] = {
    'handles': lambda data: [read_pose_array(data).poses],
    'benches': lambda data: read_marker_array(data).geometry,
    'velocities': lambda data: [read_multi_array(data)[1]]}


class _Fault(NamedTuple):
    """A fault that affects one topic in consecutive ticks."""

    name: str
    what: str
    first: int
    last: int

    def __str__(self) -> str:
        """Return a line that reports the fault."""
        ticks = f'tick {self.last}' if self.first == self.last else f'ticks {self.first} to {self.last}'
        return f'{ticks}: {self.name} {self.what}'


@dataclass
class Comparison:
    """The result of a comparison: counts of bit-identical and ``close`` messages, and one line per range of faults.

    ``close`` counts messages that agree to within twice the promise (one promise per side); ``worst_m`` is the
    largest position difference in a close message. ``fault_count`` counts missing, extra and different messages;
    ``missing_count`` counts only missing messages. ``other_version`` is the version that made the bag, if it differs
    from this one; ``other_kernel`` names the bag's numpy and kernels, if they differ from this machine's. In both
    cases, messages on any topic may be close instead of identical. ``names_maker`` tells whether the bag names its
    maker at all. ``once`` counts the once-per-run messages that match the scene. ``unchecked`` maps a topic to the
    number of messages that were not compared and the reason; ``seen`` counts the compared messages on each per-tick
    topic. ``first`` and ``last`` are the first and the last recorded tick, and ``notes`` states what the recording does
    not contain. ``end_proved`` is the statement that the bag's certificate proves, if it was needed.
    """

    other_version: str | None = None
    other_kernel: str | None = None
    names_maker: bool = False
    equal: int = 0
    close: int = 0
    worst_m: float = 0.0
    fault_count: int = 0
    missing_count: int = 0
    once: int = 0
    unchecked: dict[str, tuple[int, str]] = field(default_factory=dict)
    seen: Counter[str] = field(default_factory=Counter)
    first: int | None = None
    last: int = -1
    notes: list[str] = field(default_factory=list)
    end_proved: str | None = None
    _lines: list['_Fault | str'] = field(default_factory=list)
    _last: dict[str, tuple[int, '_Fault']] = field(default_factory=dict)

    @property
    def faults(self) -> list[str]:
        """The first ``MOST_FAULTS`` fault lines."""
        return [str(line) for line in self._lines]

    def note(self, name: str, k: int, what: str, messages: int = 1) -> None:
        """Count the messages affected by a fault at one tick; consecutive ticks with the same fault share a line."""
        self._note(_Fault(name, what, k, k), messages)

    def missing(self, name: str, first: int, last: int) -> None:
        """Count one missing message for each tick from ``first`` to ``last``, however many there are."""
        self.missing_count += last - first + 1
        self._note(_Fault(name, 'is missing', first, last), last - first + 1)

    def reach(self, k: int, names: Iterable[str]) -> None:
        """Note that tick ``k`` was recorded; the ticks since the last recorded one are missing on these topics."""
        if self.first is None:
            self.first = k
        elif k > self.last + 1:
            for name in names:
                self.missing(name, self.last + 1, k - 1)
        self.last = k

    def _note(self, fault: '_Fault', messages: int) -> None:
        self.fault_count += messages
        line, before = self._last.get(fault.name, (MOST_FAULTS, None))
        if before is not None and (before.what, before.last) == (fault.what, fault.first - 1):
            fault = before._replace(last=fault.last)
        else:
            line = len(self._lines)
            if line < MOST_FAULTS:
                self._lines.append('')
        if line < MOST_FAULTS:
            self._lines[line] = fault
        self._last[fault.name] = line, fault

    def add(self, part: 'Comparison', names: Iterable[str]) -> None:
        """Add the result for the following ticks, as if this object had compared them."""
        if part.first is not None:
            self.reach(part.first, names)
            self.last = part.last
        self.equal += part.equal
        self.close += part.close
        self.worst_m = max(self.worst_m, part.worst_m)
        self.fault_count += part.fault_count
        self.missing_count += part.missing_count
        self.seen += part.seen
        for line in part._lines:
            if isinstance(line, str):
                self.fault(line, 0)
            else:
                self._note(line, 0)

    def stray(self, name: str, t_ns: int, count: int) -> None:
        """Count messages whose log time is not the time of a tick."""
        self.seen[name] += count
        self.fault(f'{name} at {t_ns} ns belongs to no tick', count)

    def fault(self, line: str, count: int) -> None:
        """Add a line about ``count`` faulty messages, without merging it with other lines."""
        self.fault_count += count
        if len(self._lines) < MOST_FAULTS:
            self._lines.append(line)

    @property
    def may_be_close(self) -> bool:
        """Whether positions may be close: not if the bag was made by this version with the kernel of this machine."""
        return self.may_all_be_close or not self.names_maker

    @property
    def may_all_be_close(self) -> bool:
        """Whether messages on any topic may be close, because the bag was made by another version or kernel."""
        return self.other_version is not None or self.other_kernel is not None

    @property
    def passed(self) -> bool:
        """Whether all recorded ticks were compared and agree with the model, and no message among them is missing."""
        return not self.fault_count and self.equal + self.close > 0


def _here(run: '_PartOfRun', jobs: Sequence[_Span]) -> Iterable[Comparison]:
    """Compare all parts in this process."""
    return map(run, jobs)


def compare_with_model(bag: BagReader, scene: Scene, namespace: str = '/dragon',
                       progress: Callable[[int], object] = lambda k: None, frame_id: str = 'dragon',
                       contact_s: float | None = None,
                       compared: Callable[['_PartOfRun', Sequence[_Span]], Iterable[Comparison]] = _here) -> Comparison:
    """Recompute every recorded tick and compare each topic's message with the one in the bag.

    A run that ends in a contact consists of the ticks before ``contact_s`` and a final frame at exactly that time.
    ``compared(run, parts)`` applies the function ``run`` to each part of the run, in this or another process, and
    returns the results in order. A led run, or a bag with wall-clock log times, is a single part.
    """
    made = {f'about.{key}': str(value) for key, value in about_of(bag, namespace).items()} | bag.metadata(RECORD)
    version = made.get('about.dragon_ros')
    made_by = (None if version in (None, __version__) else version), other_kernel(made), version is not None
    result = Comparison(*made_by)
    encode, left = encoders(scene, frame_id), ''
    if not bag.metadata(RECORD):        # our recorders take all topics, but others may have been given a few
        encode = {name: one for name, one in encode.items() if _has(bag, f'{namespace}/{name}')}
        lacking = [name for name in (*encoders(scene, frame_id), *_once_topics(scene, frame_id))
                   if not _has(bag, f'{namespace}/{name}')]
        result.notes += [f'the recording lacks {", ".join(lacking)}'] if lacking else []
    elif not log_times_are_ticks(bag, namespace):
        result.fault('no handles are logged at their stamp, as our recorders do', 1)
        result.missing_count += 1       # log times are missing; the messages themselves are compared below
    if scene.is_led:
        # A killed recorder writes no record RECEIVED.
        may_lack = {name for name in encode if not bag.metadata(RECEIVED) and _has(bag, f'{namespace}/{name}')}
        left = _compare_led(result, scene, encode, _instants(bag, namespace, encode), may_lack, progress)
    else:
        run = _PartOfRun(bag, scene, namespace, frame_id, contact_s, list(encode), made_by)
        spans = run.spans()
        for (_, end), part in zip(spans, compared(run, spans), strict=True):
            result.add(part, encode)
            progress(end - 1)
        _note_span(result, scene, run.ticks)
    _account(result, bag, scene, namespace, frame_id, dict.fromkeys(encode, left))
    return result


def _has(bag: BagReader, topic: str) -> bool:
    return any(row.messages for row in bag.topics if row.name == topic)


def _once_topics(scene: Scene, frame_id: str) -> list[str]:
    """Return the topics on which a run of the scene has exactly one message."""
    return ['scene', *latched_messages(scene, frame_id)]


def _note_span(result: Comparison, scene: Scene, ticks: int) -> None:
    """Note the ticks of the run before and after the recording."""
    if result.first is None:
        return
    for k, words in ((result.first, 'begins'), (result.last, 'ends')):
        if k != (0 if words == 'begins' else ticks - 1):
            result.notes.append(f'the recording {words} at tick {k} of 0 to {ticks - 1} '
                                f'({scene.run.time_ns(k) / NS:.9f} s)')


class _PartOfRun:
    """Compares parts of a run that is fully determined by its scene; a pickled copy compiles the scene again."""

    def __init__(self, bag: BagReader, *settings: Any) -> None:
        """``settings`` holds the scene, namespace, frame ID, contact time, topics, and the bag's version and kernel."""
        self._bag, self._settings = bag, settings
        self._scene, self._namespace, frame_id, contact_s, names, self._made_by = settings
        every = encoders(self._scene, frame_id)
        self._encode = {name: every[name] for name in names}
        self._ticks, self._last = compile_scene(self._scene).last_tick + 1, None
        if contact_s is not None:
            self._ticks = min(self._ticks, ticks_before(self._scene, contact_s))
            self._last = contact_frame(self._scene, contact_s)

    @property
    def ticks(self) -> int:
        """The number of frames in the run, including a frame at its end in a contact."""
        return self._ticks + (self._last is not None)

    @cached_property
    def _tick_bytes(self) -> int:
        frame = tick(self._scene, 0)
        return sum(len(encode(frame)) for encode in self._encode.values())

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments."""
        return _PartOfRun, (self._bag, *self._settings)

    def spans(self) -> list[_Span]:
        """Return the parts as (first tick, tick after the last); they outnumber the messages by at most one."""
        if not log_times_are_ticks(self._bag, self._namespace):
            return [(0, self._ticks)]
        messages = sum(topic.messages for topic in self._bag.topics)
        size = max(1, _PART_BYTES // max(1, self._tick_bytes), ceil(self._ticks / (messages + 1)))
        return [(k, min(k + size, self._ticks)) for k in range(0, self._ticks, size)] or [(0, 0)]

    def __call__(self, span: _Span) -> Comparison:
        """Compare the ticks of a part and the messages between them; the last part includes all later messages."""
        result, encode, scene, (first, stop) = Comparison(*self._made_by), self._encode, self._scene, span
        is_last = stop == self._ticks
        last = self._last if is_last else None
        start_ns, end_ns = (scene.run.time_ns(first) if first else None), (None if is_last else
                                                                           scene.run.time_ns(stop))
        waiting = _Waiting(result, scene, encode, self._tick_bytes)
        for t_ns, recorded in _instants(self._bag, self._namespace, encode, start_ns, end_ns):
            k, is_contact = scene.run.tick_at(t_ns), last is not None and t_ns == last.t_ns
            is_tick = not is_contact and 0 <= k < stop and scene.run.time_ns(k) == t_ns
            if not is_tick or k != result.last + 1:
                waiting.compare()
            if last is not None and is_contact:
                result.reach(stop, encode)
                _compare_ticks(result, scene, encode, [(stop, last, recorded)])
            elif is_tick:
                result.reach(k, encode)
                waiting.add(k, recorded)
            else:
                for name, found in recorded.items():
                    result.stray(name, t_ns, len(found))
        waiting.compare()
        return result


class _Waiting:
    """Consecutive ticks of a run that are compared together, which takes less time than one by one."""

    def __init__(self, result: Comparison, scene: Scene, encode: Mapping[str, Encode], tick_bytes: int) -> None:
        """``tick_bytes`` is the size of a tick's messages."""
        self._result, self._scene, self._encode, self._tick_bytes = result, scene, encode, tick_bytes
        self._first, self._bytes, self._recorded = 0, 0, list[_Messages]()

    def add(self, k: int, recorded: _Messages) -> None:
        """Add the messages of a tick; it must be the one after the last added tick, or the first since ``compare``."""
        self._first = self._first if self._recorded else k
        self._recorded.append(recorded)
        self._bytes += max(self._tick_bytes, sum(len(data) for found in recorded.values() for data in found))
        if self._bytes >= _TOGETHER_BYTES:
            self.compare()

    def compare(self) -> None:
        """Compare the ticks, and remove them."""
        frames = ticks(self._scene, self._first, self._first + len(self._recorded))
        _compare_ticks(self._result, self._scene, self._encode, list(zip(count(self._first), frames, self._recorded)))
        self._bytes = 0
        self._recorded.clear()


def _compare_led(result: Comparison, scene: Scene, encode: Mapping[str, Encode], instants: Iterable[_Instant],
                 may_lack: set[str], progress: Callable[[int], object]) -> str:
    """Compare the ticks of a led dragon, recomputed from speeds on its topic ``leader``; return why some are left.

    A led run may end at any tick. In the last ticks of a killed recorder, the topics ``may_lack`` may be missing if
    none of their messages follows, and the last tick may lack its speed. After any other tick without a speed, no tick
    can be recomputed.
    """
    law, waiting, left, why = None, list[tuple[int, Frame, _Messages]](), iter(instants), ''
    for t_ns, recorded in left:
        k, here = result.last + 1, scene.run.tick_at(t_ns)
        if here < 0 or scene.run.time_ns(here) != t_ns:
            for name, found in recorded.items():
                result.stray(name, t_ns, len(found))
            continue
        speed_m_s = _walked_m_s(recorded.get('leader', []), t_ns)
        if here != k or speed_m_s is None:
            if result.first is None and here:
                result.notes.append(f'the recording begins at tick {here} ({scene.run.seconds(t_ns):.9f} s)')
            after = next(left, None)
            if here == k and after is None and may_lack and 'leader' not in recorded:
                why = f'the speed of tick {k} is not known'
                break
            for t_ns, more in chain([(t_ns, recorded)], [after] if after else [], left):    # noqa: B020 - the rest
                for name, found in more.items():
                    result.seen[name] += len(found)
                    result.note(name, scene.run.tick_at(t_ns), 'cannot be compared, because the speed of tick '
                                f'{k} does not occur exactly once', len(found))
            break
        law = law_on(scene, law, t_ns, speed_m_s)
        result.reach(k, encode)
        waiting.append((k, led_tick(compile_scene(scene), law, k), recorded))
        whole = not may_lack or set(recorded) >= set(encode)
        while waiting and (whole or len(waiting) > _MOST_LAST):
            _compare_ticks(result, scene, encode, [waiting.pop(0)])
        progress(k)
    for n, one in enumerate(waiting):
        later = set[str]().union(*(recorded for _, _, recorded in waiting[n:]))
        if lacking := [name for name in encode if name in may_lack - later]:
            result.notes.append(f'tick {one[0]} lacks {", ".join(lacking)}, probably because the recorder was killed')
        _compare_ticks(result, scene, {name: encode[name] for name in encode if name not in lacking}, [one])
    return why


def _account(result: Comparison, bag: BagReader, scene: Scene, namespace: str, frame_id: str,
             per_tick: Mapping[str, str]) -> None:
    """Account for messages that belong to no tick, or to a tick that could not be compared.

    ``per_tick`` contains the topics that are compared at each tick, with the reason why ticks are left.
    """
    for topic in bag.topics:
        name = topic.name.removeprefix(f'{namespace}/')
        left, row = topic.messages - result.seen[name], channels().get(name)
        if name in per_tick:
            why = per_tick[name]
        elif name == topic.name:
            why = 'belongs to another dragon or to none' if row is None else 'published by all nodes at any time'
        elif name == 'scene' or name in ENCODE:
            continue
        elif row is not None and row.each_tick:
            if left:
                result.fault(f'{name}: {counted(left, "message")} on a topic that the scene does not declare', left)
            continue
        else:
            why = 'unknown to this version' if row is None else f'published by {row.publisher} at its own rate'
        if left:
            result.unchecked[name] = left, why
    _compare_once(result, bag, scene, namespace, frame_id)


def _compare_once(result: Comparison, bag: BagReader, scene: Scene, namespace: str, frame_id: str) -> None:
    """Compare the once-per-run messages; the bag must contain each message that the scene declares exactly once.

    The message on the topic ``scene`` may be the bag's only copy of the scene.
    """
    text, attached = bag.metadata(RECORD).get('scene'), bag.attachment(ATTACHMENT)
    if text is not None and attached not in (None, text.encode()):
        result.fault(f'the attachment {ATTACHMENT} is not the scene in the metadata', 1)
    declared = _once_topics(scene, frame_id)
    topics = {f'{namespace}/{name}': name for name in (*ENCODE, 'scene')}
    found, ticked = Counter[str](), log_times_are_ticks(bag, namespace)
    recorded = [topic.name for topic in bag.topics if topic.messages and topic.name in topics]
    for message in bag.messages(recorded) if recorded else ():
        name = topics[message.topic]
        found[name] += 1
        wanted = ENCODE[name](scene, frame_id) if name in ENCODE else None if text is None else string_message(text)
        if found[name] > 1:
            result.fault(f'{name} at {message.t_ns} ns is a repetition', 1)
        elif name in ENCODE and name != DESCRIPTION and name not in declared:
            result.fault(f'{name} at {message.t_ns} ns is on a topic that the scene does not declare', 1)
        elif ticked and not _is_in_run(result, scene, message.t_ns):
            result.fault(f'{name} at {message.t_ns} ns is outside the recorded run', 1)
        elif _matches(result, scene, name, wanted, message.data):
            result.once += 1
        elif name in ENCODE and result.other_version and LengthCheck(channels()[name].type).fault(message.data) is None:
            result.unchecked[name] = 1, 'another version draws it differently'
        else:
            result.fault(f'{name} at {message.t_ns} ns does not match the scene', 1)
    for name in declared if bag.metadata(RECORD) else ():
        if not found[name]:
            result.missing_count += 1
            result.fault(f'{name} is missing', 1)


def _is_in_run(result: Comparison, scene: Scene, t_ns: int) -> bool:
    """Return whether a time is between the start of the run and the last recorded tick."""
    return result.first is None or scene.run.start_ns <= t_ns <= scene.run.time_ns(result.last)


def _matches(result: Comparison, scene: Scene, name: str, wanted: bytes | None, found: bytes) -> bool:
    """Return whether a once-per-run message is the wanted one or, if none is known, a single message of its type."""
    kind = channels()[name].type
    if wanted is None:
        return LengthCheck(kind).fault(found) is None
    return found == wanted or (result.may_all_be_close and len(found) == len(wanted)
                               and _nearly(scene, kind, wanted, found))


def _nearly(scene: Scene, kind: str, wanted: bytes, found: bytes) -> bool:
    """Return whether two messages differ only in numbers, and by at most twice the promise."""
    promise_m = compile_scene(scene).promise_m
    try:
        expected, got = (list(_leaves(decode(kind, data))) for data in (wanted, found))
    except MessageError:
        return False
    return len(expected) == len(got) and all(
        one == other or (isinstance(one, float) and isinstance(other, float)
                         and abs(one - other) <= 2 * promise_m < inf)
        for one, other in zip(expected, got, strict=True))


def _walked_m_s(found: list[bytes], t_ns: int) -> float | None:
    """Return the recorded speed if all messages are equal and have the tick's stamp, otherwise None."""
    if not found or any(one != found[0] for one in found):
        return None
    stamp_ns, speed_m_s = read_odometry(found[0])
    return speed_m_s if stamp_ns == t_ns else None


def _compare_ticks(result: Comparison, scene: Scene, encode: Mapping[str, Encode],
                   compared: Sequence[tuple[int, Frame, _Messages]]) -> None:
    """Compare all messages of frames of a run, given as (number, frame, recorded messages)."""
    together = Together([frame for _, frame, _ in compared])
    wanted = {name: each(encode[name], together) for name in encode}
    for n, (k, frame, recorded) in enumerate(compared):
        for name in encode:
            _compare(result, name, k, frame, wanted[name][n], recorded.get(name, []), scene)


def _instants(bag: BagReader, namespace: str, names: Iterable[str], start_ns: int | None = None,
              end_ns: int | None = None) -> Iterator[_Instant]:
    """Yield (tick time, messages by topic name) for the topics in a namespace.

    ``start_ns`` and ``end_ns`` (exclusive) limit the messages; give them only if the bag's log times are tick times.
    """
    if log_times_are_ticks(bag, namespace):
        rows: Iterable[tuple[int, str, bytes]] = (
            (message.t_ns, message.topic.removeprefix(f'{namespace}/'), message.data)
            for message in bag.messages([f'{namespace}/{name}' for name in names], start_ns, end_ns))
    else:
        stamps: Ints = np.array([read_stamp_ns(one.data) for one in bag.messages([f'{namespace}/handles'])], np.int64)
        if np.any(back := np.diff(stamps) < 0):
            raise InputError(f'{bag.path}: has wall-clock log times, and its simulation time jumps back at '
                             f'{stamps[1:][back][0] / NS:.9f} s; give the bag of a single run')
        rows = merge(*(_stamped(bag, namespace, name, stamps) for name in names), key=lambda row: row[0])
    for t_ns, group in groupby(rows, lambda row: row[0]):
        recorded: dict[str, list[bytes]] = {}
        for _, name, data in group:
            found = recorded.setdefault(name, [])
            found.append(data if not found or data == found[0] else b'')     # of others, only the number matters
        yield t_ns, recorded


def _stamped(bag: BagReader, namespace: str, name: str, stamps: Ints) -> Iterator[tuple[int, str, bytes]]:
    """Yield (stamp, name, message) for one topic of a bag with wall-clock log times.

    A message without a stamp is paired with the handles message of the same index: messages on different topics may
    overtake each other, but those on one topic arrive in order.
    """
    kind = channels()[name].type
    for n, message in enumerate(bag.messages([f'{namespace}/{name}'])):
        t_ns = stamp_of_message(kind, message.data)
        yield int(stamps[min(n, len(stamps) - 1)]) if t_ns is None else t_ns, name, message.data


def _compare(result: Comparison, name: str, k: int, frame: Frame, wanted: bytes, found: list[bytes],
             scene: Scene) -> None:
    """Compare one topic's messages at one tick, and count the result."""
    result.seen[name] += len(found)
    if found == [wanted]:
        result.equal += 1
    elif not found:
        result.missing(name, k, k)
    elif len(found) > 1:
        result.note(name, k, f'occurs {len(found)} times', len(found))
    elif result.may_be_close and (
            off_m := _off_m(name, wanted, found[0], frame, scene, result)) <= _allowed_m(frame, scene):
        result.close += 1
        result.worst_m = max(result.worst_m, off_m)
    else:
        result.note(name, k, 'differs')


def _allowed_m(frame: Frame, scene: Scene) -> float:
    """Return the tolerance: twice the promise (once for each side), or 0 for the paper's solver, which has none."""
    promise_m = compile_scene(scene).promise_m
    return 2 * promise_m * conditioning(frame.chain) if promise_m < inf else 0.0


def _off_m(name: str, wanted: bytes, found: bytes, frame: Frame, scene: Scene, result: Comparison) -> float:
    """Return the deviation of a message in metres, or inf if anything but numbers differs.

    Quaternions are scaled by the shortest link, and speeds by their promise (``Simulation.speed_promise``).
    """
    if name not in _VIEWS:
        return _off_of_others_m(name, wanted, found, frame, scene, result) if result.may_all_be_close else inf
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
        view[...] = 0.0         # clears the numbers in the message itself, so that only the rest is compared
    if ours != theirs:
        return inf
    if not any(np.any(off) for off in offs):        # the bytes may still differ in the sign of a zero
        return 0.0
    if name == 'velocities':
        return _in_metres(float(np.max(offs[0])), frame, scene)
    link_m = float(np.min(scene.dragon.link_lengths_m))
    return max(_farthest_m(off, link_m) for off in offs if off.size)


def _in_metres(off_m_s: float, frame: Frame, scene: Scene) -> float:
    """Convert a speed error to the position error that is the same fraction of the promise for positions."""
    compiled = compile_scene(scene)
    one = compiled.speed_promise(conditioning(frame.chain), lag(frame.chain)) * abs(_speed_m_s(frame, scene))
    return off_m_s / one * compiled.promise_m if one else inf if off_m_s else 0.0


def _farthest_m(off: Array, link_m: float) -> float:
    """Return the largest difference, in metres, of points (shape (K, 3)) or poses (shape (K, 7)).

    Quaternions are scaled by ``link_m``.
    """
    turned = float(np.max(off[:, 3:], initial=0.0)) * link_m
    return max(float(np.max(np.hypot(off[:, 0], off[:, 1]))), float(np.max(off[:, 2])), turned)


def _speed_m_s(frame: Frame, scene: Scene) -> float:
    if scene.is_led and frame.leader:
        return frame.leader.speed_m_s
    return scene.head.speed_at_m_s(scene.run.seconds(frame.t_ns))


def _off_of_others_m(name: str, wanted: bytes, found: bytes, frame: Frame, scene: Scene, result: Comparison) -> float:
    """Return the deviation (m) of a message from another version or kernel, or inf if anything but numbers differs.

    Accelerations and tensions contain second derivatives of positions. A second derivative multiplies a position error
    by (leader's speed)^2 / link^2, and each derivative adds one power of the conditioning. A tension is the sum of the
    forces on all handles up to the free end. The direction in which a link transmits force has a relative error of
    position error / link length.
    """
    kind = channels()[name].type
    if len(found) != len(wanted) and name not in _VARYING:
        return inf
    try:
        messages = decode(kind, wanted), decode(kind, found)
    except MessageError:
        return inf
    off = _off_of_clouds_m(*messages, frame, scene) if name == 'cloud' else 0.0
    expected, got = (list(_leaves(message)) for message in messages)
    if name == _SHOWN and result.other_version:
        return 0.0
    if len(expected) != len(got):
        return inf
    for one, other in zip(expected, got, strict=True):
        if isinstance(one, float) and isinstance(other, float) and abs(other) < _HUGE:
            off = max(off, abs(one - other))
        elif one != other:
            return inf
    if name in ('accelerations', 'forces'):
        speed_m_s, link_m = _speed_m_s(frame, scene), float(np.min(scene.dragon.link_lengths_m))
        condition = conditioning(frame.chain)
        scale = (speed_m_s / link_m) ** 2 * condition**3
        if frame.tension_n_kg is not None and name == 'forces':
            most = float(np.max(np.abs(frame.tension_n_kg), initial=0.0))
            scale = len(frame.tension_n_kg) * scale + condition * most / link_m
        return off / scale if scale else inf
    return off


def _off_of_clouds_m(wanted: dict[str, Any], found: dict[str, Any], frame: Frame, scene: Scene) -> float:
    """Return the deviation of a cloud's points in metres, and remove the points from both messages.

    Coordinates are float32, so two nearly equal numbers may be rounded to adjacent values.
    """
    expected, got = wanted.pop('data'), found.pop('data')
    if expected.size != got.size:
        return inf
    point = np.dtype({'names': [one['name'] for one in wanted['fields']], 'itemsize': wanted['point_step'],
                      'offsets': [one['offset'] for one in wanted['fields']],
                      'formats': [_POINT_FIELDS[one['datatype']] for one in wanted['fields']]})
    off, points, others = 0.0, expected.view(point), got.view(point)
    for name in point.names or ():
        one, other = points[name].astype(np.float64), others[name].astype(np.float64)
        if not np.all(np.abs(other) < _HUGE):
            return inf
        apart = np.abs(one - other)
        if point[name] == np.float32:
            off = max(off, float(np.max(apart - np.finfo(np.float32).eps * np.abs(one))))
        elif point[name] == np.float64:
            off = max(off, _in_metres(float(np.max(apart)), frame, scene))
        elif np.any(apart):
            return inf
    return off


def _leaves(value: object) -> Iterator[object]:
    """Yield the numbers and strings of a decoded message, except solver diagnostics."""
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
