"""Read the ticks of one dragon: its handles and benches, paired by their stamps, in order and in groups."""
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from dragon_ros.core.domain import BENCHES, COORDINATE
from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import NS
from dragon_ros.core.limits import INBOX_MESSAGES
from dragon_ros.messages.bench_reader import BenchReader
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import MessageError, is_empty_array
from dragon_ros.messages.observation import observations_of, read_handles
from dragon_ros.messages.synchronizer import Pair, Synchronizer
from dragon_ros.nodes import publishers, qos, raw_subscription, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.inbox import Inbox
from dragon_ros.nodes.logs import Seldom

_TOGETHER_HANDLES = 2**11   # handles of the ticks that are examined together: few enough to stay in the cache
_PARTNER_S = 10.0       # maximum wait for the other message of a tick; Fast DDS resends lost messages within 3 s
_OTHER = {'handles': 'benches', 'benches': 'handles'}


class TickReader:
    """Reads the handles and benches of a node's namespace; messages that are unusable are dropped and counted."""

    def __init__(self, node: DragonNode, expect: Callable[[list[Observation]], None],
                 observe: Callable[[int, int, Observation | MessageError], None], skip: Callable[[], None],
                 held: Callable[[], bool], wait: Callable[[], None]) -> None:
        """Start without messages; ``subscribe`` lets them arrive.

        ``observe`` is called for each tick with its stamp, the sequence number of its handles and its observation or
        the fault in its messages. ``expect`` is called first, with a group of observations. ``skip``, ``held`` and
        ``wait`` are those of the inbox.
        """
        self.sources = {name: publishers.Publishers(node, node.resolve_topic_name(name)) for name in _OTHER}
        self.dropped = 0
        self._node, self._expect, self._observe, self._seldom = node, expect, observe, Seldom(1.0)
        self._read: dict[str, Callable[[bytes], Any]] = {
            'handles': partial(read_handles, below_m=COORDINATE.high, most=BENCHES.high + 1),
            'benches': BenchReader().read}
        self._inbox = Inbox(node, self.sources, self._take, self._examine, skip, held, wait)
        self._pairs, self._numbers = Synchronizer(), dict[int, int]()       # sequence numbers of handles, by stamp
        self._complete: list[tuple[Pair, int]] = []     # ticks to examine, with the sequence numbers of their handles
        self._unexamined = 0        # number of ticks that are examined after the current one

    def subscribe(self) -> None:
        """Subscribe to the raw bytes of handles and benches."""
        for name in self.sources:
            row = channels()[name]
            raw_subscription.subscribe_raw(self._node, shell.message_type(row.type), name,
                                           partial(self._inbox.put, name, row.type), qos.lossless(qos.of_channel(row)),
                                           self._inbox.work)

    @property
    def waiting(self) -> int:
        """The number of messages that have not been read and examined yet."""
        return self._inbox.waiting + 2 * self._unexamined

    @property
    def skipped(self) -> int:
        """The number of ticks that were skipped because they arrive too fast."""
        return self._inbox.skipped

    def work(self) -> None:
        """Read waiting messages."""
        self._inbox.work()

    def adopt(self, t_ns: int) -> None:
        """Read only the publishers of the tick at ``t_ns`` from now on, because they form a dragon."""
        for source in self.sources.values():
            source.streams.adopt(t_ns)

    def expire(self) -> None:
        """Drop messages whose counterpart has not arrived for too long."""
        self._pairs.expire(time.monotonic() - _PARTNER_S)
        self._drop_unmatched()

    def _take(self, topic: str, data: bytes, info: Any) -> None:
        """Read a message; if it belongs to the observed dragon, it may complete a tick, which is then examined."""
        def take() -> None:
            if topic == 'benches' and is_empty_array(data):
                return
            half, number = self._read[topic](data), raw_subscription.number(info)
            if self.sources[topic].keeps(number, half.t_ns):
                if topic == 'handles':
                    self._keep_number(half.t_ns, number)
                self._gather(self._pairs.add(topic, half, time.monotonic()))
        self._guarded(take)

    def _keep_number(self, t_ns: int, number: int) -> None:
        """Keep the sequence number of handles until their tick is complete."""
        self._numbers[t_ns] = number
        if len(self._numbers) > INBOX_MESSAGES:
            del self._numbers[next(iter(self._numbers))]

    def _gather(self, pair: Pair | None) -> None:
        """Examine ticks once some are complete, because several take less time together than one by one.

        Until a dragon has been chosen, each tick is examined at once, since it decides which messages belong to it.
        """
        self._drop_unmatched()
        if pair is None:
            return
        self._complete.append((pair, self._numbers.pop(pair[0].t_ns, 0)))
        adopted = all(source.streams.has_adopted for source in self.sources.values())
        if not adopted or len(self._complete) * len(pair[0].poses) >= _TOGETHER_HANDLES:
            self._examine()

    def _examine(self) -> None:
        """Examine the complete ticks in order."""
        complete, self._complete = self._complete, []
        if not complete:
            return
        observed = observations_of([pair for pair, _ in complete])
        self._expect([each for each in observed if isinstance(each, Observation)])
        for n, ((pair, number), each) in enumerate(zip(complete, observed, strict=True), 1):
            self._unexamined = len(complete) - n
            self._guarded(partial(self._observe, pair[0].t_ns, number, each))

    def _guarded(self, work: Callable[[], None]) -> None:
        """Call ``work``; if a message is unusable, count and log it, and continue."""
        try:
            work()
        except InputError as error:
            self._drop(str(error))

    def _drop_unmatched(self) -> None:
        for topic, t_ns in self._pairs.take_unmatched():
            self._drop(f'{topic} at {t_ns / NS:.9f} s: no {_OTHER[topic]} arrived with that stamp')

    def _drop(self, why: str) -> None:
        self.dropped += 1
        if self._seldom():
            self._node.get_logger().warning(f'message dropped ({self.dropped} so far): {why}')
