"""The publishers of a topic that belongs to one dragon: if there are several, one is kept and all are reported."""
import time
from collections import Counter
from collections.abc import Iterable

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.topic_endpoint_info import TopicEndpointInfo

from dragon_ros.messages.synchronizer import Streams
from dragon_ros.nodes import qos
from dragon_ros.nodes.base import DragonNode

_UNNAMED = '_NODE_NAME_UNKNOWN_'    # name of a publisher whose node has not been discovered
_NAMED_S = 3.0      # maximum wait for a publisher's name
_ASKED_S = 1.0      # how long an answer is assumed to be valid


class Publishers:
    """The publishers of one topic. A node that follows one of them calls ``keeps`` for every message.

    The node must call ``look`` periodically, to detect publishers that have left, and ``arrived`` for each message.
    """

    def __init__(self, node: DragonNode, topic: str) -> None:
        """Start without publishers; ``topic`` is a full name."""
        self.topic, self.streams = topic, Streams()
        self._node = node
        self._there: dict[bytes, str] = {}
        self._since_s: dict[bytes, float] = {}
        self._known: bytes | None = None        # None while there are several candidates
        self._last, self._waits, self._asked_s = 0, False, 0.0

    def look(self) -> list[str]:
        """Update the publishers; return their names if there are several and the names are known, otherwise []."""
        before = self._there
        self._there = {bytes(one.endpoint_gid): f'{one.node_namespace.rstrip("/")}/{one.node_name}'
                       for one in self._ask()}
        gone = before.keys() - self._there.keys()
        if len(self._there) > 1 and (self._known in gone or (self._known is None and gone)):
            self._known = None
            self.streams.forget()
        if len(self._there) == 1:
            self._known, = self._there
        now = time.monotonic()
        self._since_s = {gid: self._since_s.get(gid, now) for gid in self._there}
        named = all(_UNNAMED not in name or now - self._since_s[gid] > _NAMED_S for gid, name in self._there.items())
        return _distinct(self._there) if len(self._there) > 1 and named else []

    def arrived(self, sequence: int) -> None:
        """Record a message's sequence number; if it does not follow the previous number, update the publishers."""
        if sequence != self._last + 1 and len(self._there) < 2:
            self.look()
        self._last = sequence

    def waits(self) -> bool:
        """Return whether any publisher waits for its readers; the answer is at most a second old.

        If all publishers have left, the answer is that for the last ones, whose messages may not have been read yet.
        """
        if time.monotonic() - self._asked_s > _ASKED_S:
            self._ask()
        return self._waits

    def _ask(self) -> list[TopicEndpointInfo]:
        """Return the publishers, and note whether any of them waits for its readers."""
        self._asked_s = time.monotonic()
        found: list[TopicEndpointInfo] = self._node.get_publishers_info_by_topic(self.topic)
        self._waits = any(qos.waits(one.qos_profile) for one in found) if found else self._waits
        return found

    def keeps(self, sequence: int, t_ns: int) -> bool:
        """Return whether a message is from the kept publisher, given its sequence number and stamp."""
        return self.streams.take(sequence, t_ns, len(self._there) < 2)


def _distinct(there: dict[bytes, str]) -> list[str]:
    """Return the sorted names; equal names are extended with the GID that ``ros2 topic info --verbose`` shows."""
    times = Counter(there.values())
    return sorted(name if times[name] == 1 else f'{name} ({gid.hex(".")})' for gid, name in there.items())


def warnings_of(name: str, several: dict[str, list[str]]) -> list[DiagnosticStatus]:
    """Return a WARN that lists the topics with several publishers and their names, or [] if there are none."""
    if not several:
        return []
    return [DiagnosticStatus(
        level=DiagnosticStatus.WARN, name=f'{name}: publishers', hardware_id='dragon',
        message=f'several publishers on {" and ".join(several)}; give each dragon its own namespace',
        values=[KeyValue(key=topic, value=', '.join(names)) for topic, names in several.items()])]


def several_of(node: DragonNode, each: Iterable[Publishers], before: dict[str, list[str]]) -> dict[str, list[str]]:
    """Return the publishers of each topic that has several, and log them if they differ from ``before``."""
    found = {one.topic: names for one in each if (names := one.look())}
    if found and found != before:
        node.get_logger().warning('several publishers on one topic: ' + '; '.join(
            f'{topic}: {" and ".join(names)}' for topic, names in found.items()))
    return found
