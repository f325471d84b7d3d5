"""Find the first contact and the clearance over time in a bag."""
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite

from dragon_ros.bags.read.frames import BagFrame, RecordedObstacles, Walk, claimed_contact, frames
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.near_obstacles import SmallestGap
from dragon_ros.core.limits import PROOF_S, SEARCH_WORK, SEARCHED_BENCHES
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import MessageError, Status, decode, read_diagnostics, read_stamp_ns
from dragon_ros.scenes.certificate import of_claim

_STAMPED = 'clearance/stamped'
Progress = Callable[[int], object]


@dataclass(frozen=True)
class RecordedContact:
    """The first contact of a recorded run; ``t_s`` is None if there is none or if it is unknown.

    ``source`` is 'collision' for the report of a monitor, 'scene' for a search of the scene, and None if the bag has
    neither. ``benches`` are two benches, or one bench that touches ``obstacle``. ``unsearched`` states why the scene
    was not searched to the end of the recording. ``in_bag`` tells whether the bag includes the time of the contact.
    """

    source: str | None
    t_s: float | None = None
    benches: tuple[int, ...] = ()
    point_m: tuple[float, float] | None = None
    obstacle: str | None = None
    in_bag: bool | None = None
    unsearched: str | None = None


def _quiet(states: int) -> None:
    """Show no progress."""


def first_contact_in(bag: BagReader, namespace: str, walk: Walk | None, trust: bool = False,
                     progress: Progress = _quiet) -> RecordedContact:
    """Return the first contact, either from the topic ``collision`` or from a search of the scene.

    The scene is untrusted input: unless ``trust`` is set, a search beyond the budgets is skipped (``unsearched``).
    """
    for status in contacts_on(bag, f'{namespace}/collision'):
        with suppress(KeyError, ValueError):        # the status is from another publisher
            return _reported(status)
    if walk is None:
        return RecordedContact(None)
    try:
        found = searched(walk.scene, trust, progress)
    except InputError as error:
        return RecordedContact('scene', unsearched=str(error))
    if not isinstance(found, Contact):
        return RecordedContact('scene', unsearched=walk.lack or None)
    return RecordedContact('scene', found.t_s + walk.scene.run.stamp_offset_s, tuple(found.benches), found.point_m,
                           found.obstacle.name if found.obstacle else None,
                           bool(bag.start_ns <= walk.scene.run.stamp_ns(found.t_s) <= bag.end_ns))


def searched(scene: Scene, trust: bool, progress: Progress = _quiet) -> Contact | NoContact:
    """Return the first contact of a scene. Raises InputError if the search exceeds its budgets."""
    benches, states = scene.dragon.benches, 0
    if benches > SEARCHED_BENCHES and not trust:
        raise InputError(f'the scene has {benches} benches, but only scenes with up to {SEARCHED_BENCHES} are '
                         'searched for contacts; give --trust')

    def spend(more: int) -> None:
        nonlocal states
        states += more
        progress(more)
        if states * benches > SEARCH_WORK and not trust:
            raise InputError(f'searching the scene for contacts takes more than {states} states of {benches} '
                             'benches; give --trust')
    return first_contact(scene, spend)


def end_in_contact(bag: BagReader, namespace: str, scene: Scene, trust: bool) -> tuple[float | None, str | None]:
    """Return the time (s) of the contact that ends a run, and the statement that the checker proved, each or None.

    If a search would exceed its budgets, the bag's own claim about the contact is used after the checker has proved it.
    Raises InputError.
    """
    try:
        found = searched(scene, trust)
    except InputError as error:
        claim = claimed_contact(bag, namespace)
        if claim is None:
            raise
        from dragon_ros.scenes.checker import prove  # imported lazily, because few bags need the checker
        try:
            said = prove(of_claim(scene, claim), PROOF_S)
        except InputError as why:
            raise InputError(f'{bag.path}: {why}; {error}') from None
        return (None if claim['t_s'] is None else float(claim['t_s'])), said
    return (found.t_s if isinstance(found, Contact) else None), None


def contacts_on(bag: BagReader, topic: str) -> Iterator[Status]:
    """Yield the beginnings of contacts that a monitor reported on a topic; messages of other types are ignored."""
    for message in bag.messages([topic]):
        with suppress(MessageError):
            yield from (one for one in read_diagnostics(message.data) if one.values.get('phase') == 'begin')


def _reported(status: Status) -> RecordedContact:
    """Return the contact in a report. Raises KeyError or ValueError if it has other values."""
    values, obstacle = status.values, status.values.get('obstacle')
    return RecordedContact('collision', float(values['t_contact_s']),
                           tuple(int(values[name]) for name in (('inner',) if obstacle else ('inner', 'outer'))),
                           (float(values['x_m']), float(values['y_m'])), obstacle, True)


@dataclass(frozen=True)
class ClearanceOverTime:
    """Smallest signed gaps (m), their times (s) and their source topic; the numbers of examined and of all ticks."""

    source: str
    t_s: list[float]
    gap_m: list[float]
    looks: int
    ticks: int


def clearance_in(bag: BagReader, namespace: str, looks: int, progress: Progress = _quiet) -> ClearanceOverTime:
    """Return the clearance over time from the stamped topic or, without that topic, from ``looks`` ticks (0 for all).

    Obstacles in the bag are included.

    The topic ``clearance`` has no stamps. In a bag from an earlier version or from another recorder, the values of this
    topic may have the log times of other ticks.
    """
    counts = {topic.name: topic.messages for topic in bag.topics}
    ticks = counts.get(f'{namespace}/handles', 0)
    if counts.get(f'{namespace}/{_STAMPED}'):
        rows = [_stamped(m.data) for m in bag.messages([f'{namespace}/{_STAMPED}'])]
        return _of(rows, _STAMPED, len(rows), ticks)
    seen = frames(bag, namespace) if looks == 0 or looks >= ticks else _some(bag, namespace, looks)
    rows, examined, gap = [], 0, SmallestGap()
    recorded: RecordedObstacles | None = None
    for frame in seen:
        recorded = recorded or RecordedObstacles(bag, namespace, frame.frame_id)
        gap.surround(recorded.at(frame.t_ns))
        examined += 1
        progress(1)
        if frame.benches is not None:
            rows.append((frame.t_ns / NS, gap.at_m(frame.handles_m, frame.benches)))
    return _of(rows, 'benches', examined, ticks)


def _stamped(data: bytes) -> tuple[float, float]:
    """Return the time (s) and the clearance (m) in a message."""
    gap_m, *_ = decode(channels()[_STAMPED].type, data)['vector'].tolist()
    return read_stamp_ns(data) / NS, gap_m


def _of(rows: list[tuple[float, float]], source: str, looks: int, ticks: int) -> ClearanceOverTime:
    near = [row for row in rows if isfinite(row[1])]
    return ClearanceOverTime(source, [t_s for t_s, _ in near], [gap for _, gap in near], looks, ticks)


def _some(bag: BagReader, namespace: str, looks: int) -> Iterator[BagFrame]:
    """Yield the first tick at or after each of ``looks`` evenly spaced times."""
    span = bag.end_ns - bag.start_ns
    for n in range(looks):
        frame = next(frames(bag, namespace, bag.start_ns + span * n // max(1, looks - 1)), None)
        if frame is not None:
            yield frame
