"""A led dragon: speeds from ``cmd_vel``, and the frames that result from them."""
import time
from collections import Counter
from collections.abc import Callable
from math import inf, isfinite
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped

from dragon_ros.core.chain.commanded import Commanded, Walked, next_law, walked_from
from dragon_ros.core.effects.proximity import closeness, named_pair
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import benches_of
from dragon_ros.core.model import Simulation, TravelEnd, compile_scene
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import Frame, led_tick
from dragon_ros.core.words import counted
from dragon_ros.nodes.base import STEADY, DragonNode
from dragon_ros.nodes.frames import build_tables
from dragon_ros.nodes.logs import Seldom

TOPIC = 'cmd_vel'
_DEPTH = 10
_LOOK_S = 1.0       # interval between checks for publishers of the other type
_KINDS = {True: 'geometry_msgs/msg/TwistStamped', False: 'geometry_msgs/msg/Twist'}


class Commands:
    """Holds the last commanded speed while it is valid. Unusable commands are dropped and counted."""

    def __init__(self, node: DragonNode, timeout_s: float, stamped: bool) -> None:
        """Subscribe to geometry_msgs/TwistStamped or to Twist, which many tools still send."""
        self.taken, self.dropped = 0, Counter[str]()
        self._seldom = Seldom(1.0)
        self._node, self._timeout_s = node, timeout_s
        self._speed_m_s, self._until_s, self._stamp_ns, self._now_ns = 0.0, 0.0, 0, 0
        self._type, self._named = _KINDS[stamped], set[str]()
        node.create_timer(_LOOK_S, self._look, clock=STEADY)
        node.create_subscription(TwistStamped if stamped else Twist, TOPIC,
                                 self._on_stamped if stamped else self._take, _DEPTH)

    def wanted_m_s(self) -> float:
        """Return the commanded speed, which is 0 after the timeout."""
        return self._speed_m_s if time.monotonic() < self._until_s else 0.0

    def _look(self) -> None:
        """Warn once about each node that publishes commands of the other type, since they are not received."""
        topic = self._node.resolve_topic_name(TOPIC)
        for one in self._node.get_publishers_info_by_topic(topic):
            name = f'{one.node_namespace.rstrip("/")}/{one.node_name}'
            if one.topic_type != self._type and name not in self._named:
                self._named.add(name)
                stamped = self._type == _KINDS[True]
                self._node.get_logger().warning(
                    f'{topic}: {name} publishes {one.topic_type}, but this sim accepts only {self._type}; start the '
                    f'sim with cmd_vel_stamped:={str(not stamped).lower()}, or have {name} '
                    f'publish {self._type}' + (' (teleop_twist_keyboard: -p stamped:=true)' if stamped else ''))

    def summary(self) -> str:
        """Return a message about how many commands were accepted and how many were dropped."""
        why = ', '.join(f'{count} {what}' for what, count in self.dropped.items())
        return f'commands: {self.taken} accepted, {self.dropped.total()} dropped' + (f' ({why})' if why else '')

    def _on_stamped(self, message: TwistStamped) -> None:
        """Accept a command if its stamp is 0, or if it is current and not older than the last command's stamp.

        The last command's stamp is forgotten if the clock was set back, as by a reset of a sim that leads the clock.
        """
        stamp_ns = message.header.stamp.sec * NS + message.header.stamp.nanosec
        before_ns, self._now_ns = self._now_ns, self._node.get_clock().now().nanoseconds
        if self._now_ns < before_ns:
            self._stamp_ns = 0
        off_s = (self._now_ns - stamp_ns) / NS
        if stamp_ns and (abs(off_s) > self._timeout_s or stamp_ns < self._stamp_ns):
            clock = 'the simulation time on /clock' if self._node.get_clock().ros_time_is_active else 'the wall clock'
            self._drop('stale', f'its stamp is {abs(off_s):.3f} s {"behind" if off_s >= 0 else "ahead of"} {clock}, '
                       'which this node follows' if abs(off_s) > self._timeout_s else
                       f'its stamp is {(self._stamp_ns - stamp_ns) / NS:.3f} s before that of an earlier command')
            return
        if self._take(message.twist):
            self._stamp_ns = stamp_ns

    def _take(self, twist: Any) -> bool:
        speed = twist.linear.x
        if not isfinite(speed):
            self._drop('not finite', f'linear.x is {speed}')
            return False
        self.taken += 1
        self._speed_m_s, self._until_s = speed, time.monotonic() + self._timeout_s
        return True

    def _drop(self, kind: str, why: str) -> None:
        self.dropped[kind] += 1
        if self._seldom():
            self._node.get_logger().warning(f'{TOPIC}: command dropped ({self.dropped.total()} so far): {why}')


class LedFrames:
    """The ticks of a led scene: each tick is computed when it is due, from the speed commanded at that time."""

    ahead = ()      # no later frame is known

    def __init__(self, scene: Scene, wanted_m_s: Callable[[], float], on_contact: str, say: Callable[[str], None],
                 keep_s: float) -> None:
        """Start at rest; ``say`` receives a message if the dragon brakes for an end or stops at a contact."""
        assert isinstance(scene.head, Commanded)
        self._settings, self._simulation = scene.head, compile_scene(scene)
        self._scene, self._wanted_m_s, self._say, self._keep_s = scene, wanted_m_s, say, keep_s
        self._minds_contact = on_contact != 'continue'
        self.count = self._simulation.last_tick + 1
        self.k = 0
        self.stamp_ns, self.seconds = scene.run.stamp_ns, scene.run.seconds
        self._law: Walked | None = None
        self._stopped, self._brakes = '', False

    def prepare(self) -> None:
        """Build the tables of the first frame, and start building those of the run."""
        led_tick(self._simulation, walked_from(self._settings, self._t_s(0)), 0)
        self.tables = build_tables(self._simulation)

    def next_ns(self) -> int | None:
        """Return the time of the next frame, or None at the end and after a contact that stops the run."""
        return None if self._stopped or self.k >= self.count else self._scene.run.time_ns(self.k)

    def last_ns(self) -> int:
        """Return the time of the last frame, which the run may not reach if it stops earlier."""
        return self._scene.run.time_ns(self.count - 1)

    def take(self) -> Frame:
        """Return the next frame and advance."""
        t_s = self._t_s(self.k)
        self._law = self._next_law(t_s) if self._law else walked_from(self._settings, t_s)
        frame = led_tick(self._simulation, self._law, self.k)
        if self._minds_contact and (pairs := _touching(self._simulation, frame)):
            self._stopped = f'{named_pair(self._scene, pairs[0])} are in contact at {t_s:.9f} s, tick {self.k}'
            self._say(f'stopping: {self._stopped}')
        self.k += 1
        return frame

    def _next_law(self, t_s: float) -> Walked:
        """Return the head law up to the next tick; it follows the commanded speed within the limits."""
        assert self._law
        back, onwards = self._simulation.model.limits
        ends_m = back.travel_m if back else -inf, onwards.travel_m if onwards else inf
        law, end = next_law(self._law, t_s, self._wanted_m_s(), ends_m, self._keep_s)
        self._mind((None, onwards, back)[end])
        return law

    def _mind(self, limit: TravelEnd | None) -> None:
        """Report once that the dragon brakes, because it approaches a lock or the end of the track."""
        if limit and not self._brakes:
            what = f'the chain would lock at link {limit.link}' if limit.reason == 'lock' else 'the track ends'
            self._say(f'braking: {what} when the leader has travelled {limit.travel_m:.6f} m')
        self._brakes = limit is not None

    def _t_s(self, k: int) -> float:
        """Return the time of tick k in the simulation."""
        return self.seconds(self._scene.run.time_ns(k))

    def rewind(self) -> None:
        """Restart from rest."""
        self.k, self._law, self._stopped, self._brakes = 0, None, '', False

    def seek(self, t_ns: int | None) -> None:
        """Raise FieldError, because future commands are unknown and past commands are not kept."""
        raise FieldError('seek_s', -1 if t_ns is None else self.seconds(t_ns), 'a led dragon cannot seek, because '
                         'its ticks depend on live commands', 'reset it to start again')

    def check_time(self, t_ns: int) -> None:
        """Raise FieldError, as ``seek`` does."""
        self.seek(t_ns)

    def place(self) -> str:
        """Describe the position of the last frame taken."""
        k, travel_m = max(self.k - 1, 0), self._law.travel_m if self._law else 0.0
        return f'at {self._t_s(k):.3f} s, tick {k}, {travel_m:.3f} m travelled'

    def ending(self) -> str:
        """Return why there is no next frame."""
        return self._stopped or f'the run ends after {counted(self.count, "tick")}'


def _touching(simulation: Simulation, frame: Frame) -> list[tuple[int, int]]:
    """Return the pairs that touch, the deepest first, regardless of which effects are on."""
    benches = frame.benches or benches_of(frame.chain, simulation.scene.dragon, frame.axis)
    found = frame.closeness or closeness(simulation, frame.chain, benches)
    return list(zip(found.i.tolist(), found.j.tolist(), strict=True))
