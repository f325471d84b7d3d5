"""Summarise a bag: its contents, its dragon, the first contact and the clearance."""
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dragon_ros.bags.check.contacts import ClearanceOverTime, RecordedContact, clearance_in, first_contact_in
from dragon_ros.bags.check.examine import Contents, Gaps, examine, gaps_of
from dragon_ros.bags.read.frames import log_times_are_ticks, namespace_of, scene_of_bag, walk_in
from dragon_ros.bags.read.mcap import BagError
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.core.scene import NS, Scene
from dragon_ros.messages.channels import channel_of
from dragon_ros.scenes.provenance import RECORD

Progress = Callable[[str, int], object]


@dataclass(frozen=True)
class BagSummary:
    """What a bag contains; what is unknown is None. ``unread`` states why the dragon was not read completely.

    ``start_s`` and ``end_s`` are the log times (s) of the first and the last message, and ``about`` names what made the
    bag. ``logs_ticks`` tells whether log times are those of the simulation.
    """

    contents: Contents
    about: dict[str, str] = field(default_factory=dict)
    scene: Scene | None = None
    logs_ticks: bool = False
    start_s: float | None = None
    end_s: float | None = None
    namespace: str | None = None
    first_contact: RecordedContact | None = None
    clearance: ClearanceOverTime | None = None
    unread: str | None = None

    def gaps(self, topic: str) -> Gaps:
        """Return the rate, and the missing and the doubled ticks of a topic."""
        channel = channel_of(topic)
        run = self.scene.run if self.scene and self.logs_ticks else None
        return gaps_of(self.contents.topics[topic].times_ns, run, channel is not None and channel.each_tick)


def summary_of(path: Path, namespace: str | None, trust: bool, looks: int, progress: Progress) -> BagSummary:
    """Return a summary of a bag, also of a damaged one. Raises InputError for an unknown namespace."""
    contents = examine(path, lambda size: progress('bytes', size))
    if namespace is not None:
        with BagReader(path, bool(contents.problems.count)) as bag:
            namespace_of(bag, namespace)
    try:
        return BagSummary(contents, **_dragon(path, namespace, trust, looks, progress))
    except DragonError as error:
        found: dict[str, Any] = {}
        if isinstance(error, BagError):
            with suppress(DragonError):
                found = _dragon(path, namespace, trust, looks, progress, damaged=True)
        return BagSummary(contents, **found, unread=str(error))


def _dragon(path: Path, asked: str | None, trust: bool, looks: int, progress: Progress,
            damaged: bool = False) -> dict[str, Any]:
    """Return the fields about the dragon in a bag, or in the intact part of a damaged bag."""
    with BagReader(path, damaged) as bag:
        namespace = None
        with suppress(InputError):
            namespace = namespace_of(bag, asked)
        scene = scene_of_bag(bag, namespace, trust)
        about = {key: value for key, value in bag.metadata(RECORD).items() if key != 'scene'}
        out: dict[str, Any] = {'about': about, 'scene': scene,
                               'logs_ticks': namespace is None or log_times_are_ticks(bag, namespace)}
        if bag.empty:
            return out
        out |= {'start_s': bag.start_ns / NS, 'end_s': bag.end_ns / NS}
        if namespace is None:
            return out
        walk = walk_in(bag, scene, namespace) if scene else None
        return {**out, 'namespace': namespace,
                'first_contact': first_contact_in(bag, namespace, walk, trust, lambda more: progress('states', more)),
                'clearance': clearance_in(bag, namespace, looks, lambda more: progress('ticks', more))}
