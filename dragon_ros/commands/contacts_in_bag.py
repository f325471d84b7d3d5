"""Find the first contact and the clearance over time in a bag."""
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Any

from dragon_ros.bags.read.frames import BagFrame, RecordedObstacles, Walk, claimed_contact, frames
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.sources import SmallestGap
from dragon_ros.core.errors import InputError
from dragon_ros.core.limits import PROOF_S, SEARCH_WORK, SEARCHED_BENCHES
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import MessageError, Status, decode, read_diagnostics, read_stamp_ns
from dragon_ros.scenes.certificate import of_claim

_STAMPED = 'clearance/stamped'


def first_contact_in(bag: BagReader, namespace: str, walk: Walk | None, trust: bool = False) -> dict[str, Any]:
    """Return the first contact and its source, which is either the topic ``collision`` or a search of the scene.

    The scene is untrusted input: unless ``trust`` is set, a search beyond the budgets is skipped (``unsearched``).
    """
    reported = _reported(bag, f'{namespace}/collision')
    if reported is not None:
        return reported
    if walk is None:
        return {'source': None, 't_s': None}
    try:
        found = searched(walk.scene, trust)
    except InputError as error:
        return {'source': 'scene', 't_s': None, 'unsearched': str(error)}
    if not isinstance(found, Contact):
        return {'source': 'scene', 't_s': None, **({'unsearched': walk.lack} if walk.lack else {})}
    return {'source': 'scene', 't_s': found.t_s + walk.scene.run.stamp_offset_s,
            'benches': list(found.benches), 'point_m': list(found.point_m),
            **({'obstacle': found.obstacle.name} if found.obstacle else {}),
            'in_bag': bool(bag.start_ns <= walk.scene.run.stamp_ns(found.t_s) <= bag.end_ns)}


def searched(scene: Scene, trust: bool) -> Contact | NoContact:
    """Return the first contact of a scene. Raises InputError if the search exceeds its budgets."""
    benches, states = scene.dragon.benches, 0
    if benches > SEARCHED_BENCHES and not trust:
        raise InputError(f'the scene has {benches} benches, but only scenes with up to {SEARCHED_BENCHES} are '
                         'searched for contacts; give --trust')
    with Progress('contact', 'states') as bar:
        def spend(more: int) -> None:
            nonlocal states
            states += more
            bar.update(more)
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
        from dragon_ros.commands.checker import prove  # imported lazily, because few bags need the checker
        try:
            said = prove(of_claim(scene, claim), PROOF_S)
        except InputError as why:
            raise InputError(f'{bag.path}: {why}; {error}') from None
        return (None if claim['t_s'] is None else float(claim['t_s'])), said
    return (found.t_s if isinstance(found, Contact) else None), None


def _reported(bag: BagReader, topic: str) -> dict[str, Any] | None:
    """Return the first contact that a monitor reported in the bag, or None."""
    for message in bag.messages([topic]):
        try:
            for status in read_diagnostics(message.data):
                if status.values.get('phase') == 'begin':
                    return _event(status)
        except (MessageError, KeyError, ValueError):
            continue        # the status is from another publisher
    return None


def _event(status: Status) -> dict[str, Any]:
    values = status.values
    obstacle = {'obstacle': values['obstacle']} if 'obstacle' in values else {}
    return {'source': 'collision', 't_s': float(values['t_contact_s']), 'in_bag': True,
            'benches': [int(values[name]) for name in ('inner', 'outer')[:1 if obstacle else 2]], **obstacle,
            'point_m': [float(values['x_m']), float(values['y_m'])]}


@dataclass(frozen=True)
class Clearance:
    """Smallest signed gaps (m), their times (s) and their source topic; the numbers of examined and of all ticks."""

    source: str
    t_s: list[float]
    gap_m: list[float]
    looks: int
    ticks: int


def clearance_in(bag: BagReader, namespace: str, looks: int) -> Clearance:
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
    seen = _every(bag, namespace, ticks) if looks == 0 or looks >= ticks else _some(bag, namespace, looks)
    rows, examined, gap = [], 0, SmallestGap()
    recorded: RecordedObstacles | None = None
    for frame in seen:
        recorded = recorded or RecordedObstacles(bag, namespace, frame.frame_id)
        gap.surround(recorded.at(frame.t_ns))
        examined += 1
        if frame.benches is not None:
            rows.append((frame.t_ns / NS, gap.at_m(frame.handles_m, frame.benches)))
    return _of(rows, 'benches', examined, ticks)


def _stamped(data: bytes) -> tuple[float, float]:
    """Return the time (s) and the clearance (m) in a message."""
    gap_m, *_ = decode(channels()[_STAMPED].type, data)['vector'].tolist()
    return read_stamp_ns(data) / NS, gap_m


def _of(rows: list[tuple[float, float]], source: str, looks: int, ticks: int) -> Clearance:
    near = [row for row in rows if isfinite(row[1])]
    return Clearance(source, [t_s for t_s, _ in near], [gap for _, gap in near], looks, ticks)


def _every(bag: BagReader, namespace: str, ticks: int) -> Iterator[BagFrame]:
    yield from Progress('clearance', 'ticks', ticks)(frames(bag, namespace))


def _some(bag: BagReader, namespace: str, looks: int) -> Iterator[BagFrame]:
    """Yield the first tick at or after each of ``looks`` evenly spaced times."""
    span = bag.end_ns - bag.start_ns
    for n in Progress('clearance', 'ticks', looks)(range(looks)):
        frame = next(frames(bag, namespace, bag.start_ns + span * n // max(1, looks - 1)), None)
        if frame is not None:
            yield frame
