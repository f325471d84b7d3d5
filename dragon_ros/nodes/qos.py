"""Create QoS profiles from the rows of topics.yaml and from bags."""
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from dragon_ros.messages.channels import Channel

_WAITS_NS = 10**18


def profile(reliability: str, durability: str, depth: int) -> QoSProfile:
    """Return a profile with the history ``KEEP_LAST``."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy[reliability.upper()],
        durability=DurabilityPolicy[durability.upper()])


def of_channel(channel: Channel) -> QoSProfile:
    """Return the profile for publishing a channel or subscribing to it."""
    return profile(channel.reliability, channel.durability, channel.depth)


def lossless(qos: QoSProfile) -> QoSProfile:
    """Return the profile with unbounded history: a full queue blocks the publisher, so that nothing is dropped.

    The middleware's limit then applies instead of the depth (5,000 messages with Fast DDS).
    """
    qos.history = HistoryPolicy.KEEP_ALL
    return qos


def waiting(qos: QoSProfile) -> QoSProfile:
    """Return the lossless profile of a publisher that waits for its readers.

    Discovery does not reveal how much history a publisher keeps. Therefore the publisher announces a message lifespan
    of 31 years, which tells readers that it waits for them and is so long that no message expires.
    """
    qos.lifespan = Duration(nanoseconds=_WAITS_NS)
    return lossless(qos)


def waits(announced: QoSProfile) -> bool:
    """Return whether a publisher waits for its readers, according to the profile that it announces."""
    return bool(announced.lifespan.nanoseconds == _WAITS_NS)


def of_bag(qos: dict[str, Any]) -> QoSProfile:
    """Return the profile of a topic in a bag; missing policies default to reliable and volatile.

    Older versions of rosbag2 store numbers instead of names.
    """
    def policy(key: str, allowed: tuple[str, ...], numbers: dict[int, str]) -> str:
        named = qos.get(key)
        given = numbers.get(named, str(named).lower()) if isinstance(named, int) else str(named).lower()
        return given if given in allowed else allowed[0]
    depth = qos.get('depth')
    return profile(policy('reliability', ('reliable', 'best_effort'), {1: 'reliable', 2: 'best_effort'}),
                   policy('durability', ('volatile', 'transient_local'), {1: 'transient_local', 2: 'volatile'}),
                   depth if isinstance(depth, int) and 0 < depth <= 10_000 else 100)
