"""``sim``: simulates a scene tick by tick and publishes each tick as bytes."""
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher

from dragon_ros.bags.read.frames import keep_s
from dragon_ros.cli import command_line
from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.errors import FieldError, InputError, MissingError, shown
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import Frame
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.latched import DESCRIPTION, ENCODE, latched_messages
from dragon_ros.nodes import publisher_queue, qos, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.broadcast import Broadcast
from dragon_ros.nodes.clock import ClockPublisher
from dragon_ros.nodes.entities import Bodies, bodies_of_frame
from dragon_ros.nodes.frames import Frames
from dragon_ros.nodes.led import Commands, LedFrames
from dragon_ros.nodes.params import SIM
from dragon_ros.nodes.playback import STANDARD, Player
from dragon_ros.nodes.tf_publisher import TF, TfPublisher
from dragon_ros.scenes.certificate import claim_of
from dragon_ros.scenes.load import load_scene
from dragon_ros.scenes.provenance import CLAIM, scene_file


class Sim(DragonNode):
    """Publishes a scene, in any executor; ``player.done`` is true at the end of the run."""

    def __init__(self, interrupted: Callable[[], bool] = lambda: False, **overrides: Any) -> None:
        """Declare parameters, load the scene, and advertise the topics of its effects.

        If ``on_contact`` requires the first contact, also search for it. Raises InterruptedError if ``interrupted()``
        becomes true during the search, and DragonError if the parameters do not describe a valid scene.
        """
        super().__init__('sim', SIM, overrides)
        self.scene, value = scene_of(self.setting), self.setting
        found = None if self.scene.is_led else searched(self.scene, value['on_contact'], interrupted)
        contact = found if isinstance(found, Contact) else None
        if (contact or self.scene.is_led) and value['on_contact'] == 'hold':
            self.set_parameters([RosParameter('at_end', value='hold')])
        self._lossless = value['time_scale'] == 0
        encode = encoders(self.scene, value['frame_id'])
        self.topics = {name: publisher_queue.EncodedTopic(self._publisher(name), encode[name]) for name in encode}
        self.topic_publishers = {name: topic.publisher for name, topic in self.topics.items()}
        self.commands: Commands | None = None
        self._frames = Broadcast(self._led() if self.scene.is_led else Frames(self.scene, contact, self._lossless),
                                 self.topics.values())
        self._frames.also = list(self._also())
        for name, data in self._latched(about_of(value, found)):
            self.topic_publishers[name] = self._publisher(name)
            self.topic_publishers[name].publish(data)
        self._frames.frames.prepare()
        gate = publisher_queue.StartGate(self.topic_publishers, value['wait_subscribers'], value['discovery_s'])
        self.player = Player(self, self._frames, value['time_scale'], gate.is_open)
        if shell.is_installed(STANDARD):
            from dragon_ros.nodes.simulation_interfaces import SimulationInterfaces
            SimulationInterfaces(self, self.player, self._bodies)

    def refuse(self, name: str, value: Any) -> None:
        """Raise DragonError if a live parameter must not be set to this value."""
        if name == 'seek_s' and value >= 0:
            self._frames.frames.check_time(self._frames.stamp_ns(value))
        if name == 'time_scale' and value == 0 and not self._lossless:
            raise FieldError('time_scale', value, 'a lossless run needs lossless topics from the start',
                             'start sim with time_scale:=0.0, or set a value above 0')

    def changed(self, name: str) -> None:
        """Apply a new speed."""
        if name == 'time_scale':
            self.player.set_speed(self.setting['time_scale'])

    def _bodies(self) -> Bodies | None:
        """Return the handles and benches of the last frame shown."""
        frame = self._frames.shown
        return None if frame is None else bodies_of_frame(frame, self.scene.dragon, self.setting['frame_id'])

    def _led(self) -> LedFrames:
        """Return the frames of a led scene, and subscribe to commands. Raises FieldError if time_scale is 0."""
        head = self.scene.head
        assert isinstance(head, Commanded)
        if self._lossless:
            raise FieldError('time_scale', 0, 'commands arrive in real time', 'set a value above 0')
        self.commands = Commands(self, head.timeout_s, self.setting['cmd_vel_stamped'])
        return LedFrames(self.scene, self.commands.wanted_m_s, self.setting['on_contact'], self.get_logger().warning,
                         keep_s(self.scene))

    def _latched(self, about: dict[str, Any]) -> Iterator[tuple[str, bytes]]:
        """Yield (topic, message) for all latched topics; the scene's message contains the section ``about``."""
        value = self.setting
        yield from latched_messages(self.scene, value['frame_id']).items()
        if value['robot_description']:
            yield DESCRIPTION, ENCODE[DESCRIPTION](self.scene, value['frame_id'])
        yield 'scene', string_message(scene_file(self.scene, about))

    def _publisher(self, name: str) -> Publisher:
        row = channels()[name]
        profile = qos.of_channel(row)
        if self._lossless and row.durability == 'volatile':
            profile = qos.waiting(profile)
        return self.create_publisher(shell.message_type(row.type), name, profile)

    def _also(self) -> Iterator[Callable[[Frame], None]]:
        """Yield the functions to call with each frame before it is published."""
        if self.setting['publish_clock'] or Effect.CLOCK in self.scene.effects:
            clock = ClockPublisher(self, self.scene.run.start_ns)
            yield lambda frame: clock.publish(frame.t_ns)
        root = Effect.JOINTS in self.scene.effects
        if self.setting['publish_tf'] or (root and self._has_tf()):
            yield TfPublisher(self, self.setting['frame_id'], self.setting['publish_tf'], root).publish

    def _has_tf(self) -> bool:
        """Return whether tf2_msgs, which the ROS wheels lack, is installed; joint angles work without it."""
        try:
            shell.message_type(TF)
        except MissingError as error:
            self.get_logger().warning(f'effect joints: the pose of the head bench is not published on /tf: {error}')
            return False
        return True


def searched(scene: Scene, act: str, interrupted: Callable[[], bool]) -> Contact | NoContact | None:
    """Return the first contact if the run reacts to it. Raises InterruptedError if ``interrupted()`` becomes true."""
    def go_on(_: int) -> None:
        if interrupted():
            raise InterruptedError
    return None if act == 'continue' else first_contact(scene, go_on)


def about_of(value: dict[str, Any], found: Contact | NoContact | None) -> dict[str, Any]:
    """Return the ``about`` section of the published scene, which contains the first contact if the run ends there."""
    about = {name: value[name] for name in ('frame_id', 'on_contact')}
    claim = None if found is None else claim_of(found)
    return about if claim is None else {**about, CLAIM: claim}


def scene_of(value: dict[str, Any]) -> Scene:
    """Return the scene that the parameters describe."""
    changed = [f'run.{key}={value[key]!r}' for key in ('start_s', 'stop_s', 'rate_hz') if value[key] >= 0]
    accuracy = [f'accuracy={value["accuracy"]}'] if value['accuracy'] else []
    scene = load_scene(value['scene'], [*filter(None, value['set']), *accuracy, *changed])
    if not value['stamp_offset']:
        return scene
    return replace(scene, run=replace(scene.run, stamp_offset_s=_stamp_offset_s(value, scene.run.start_s)))


def _stamp_offset_s(value: dict[str, Any], start_s: float) -> float:
    """Return the offset of stamps in seconds; with 'wall', the first tick has the wall time at which it is due.

    Raises InputError for any other text.
    """
    if value['stamp_offset'] == 'wall':
        wait_s = publisher_queue.discovery_of(value['discovery_s'], value['wait_subscribers'])
        return round(time.time() + wait_s - start_s, 3)
    try:
        return float(value['stamp_offset'])
    except ValueError:
        raise InputError(f'parameter stamp_offset: {shown(value["stamp_offset"])} is neither wall nor a number of '
                         'seconds') from None


def run(given: dict[str, Any], stop: threading.Event) -> int:
    """Simulate a run with the given parameters in a new executor; return the exit code."""
    try:
        node = Sim(stop.is_set, **given)
    except InterruptedError:
        return command_line.OK
    try:
        code = shell.spin(node, stop, lambda: node.player.done)
        node.get_logger().info('published: ' + ', '.join(f'{name} {topic.published}'
                                                         for name, topic in node.topics.items()))
        if node.commands:
            node.get_logger().info(node.commands.summary())
        publisher_queue.drain(node.topic_publishers.values(), stop, node.get_logger().warning)
        return code
    finally:
        node.destroy_node()
