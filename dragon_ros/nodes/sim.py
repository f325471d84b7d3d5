"""``sim``: computes tick after tick of a scene and publishes it as bytes."""
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher

from dragon_ros.core.contact.certificate import Contact
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.core.effects import Effect
from dragon_ros.core.errors import FieldError
from dragon_ros.core.frame import Frame
from dragon_ros.core.scene import NS, Scene
from dragon_ros.nodes import outlet, qos, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.clock import SimulationTime
from dragon_ros.nodes.controls import Player
from dragon_ros.nodes.ends import Ends
from dragon_ros.nodes.frames import Frames
from dragon_ros.nodes.params import SIM
from dragon_ros.wire import cli
from dragon_ros.wire.cdr import string_message
from dragon_ros.wire.channels import channels
from dragon_ros.wire.encode import encoders
from dragon_ros.wire.origin import scene_file
from dragon_ros.wire.scenes import load_scene
from dragon_ros.wire.track import track_message


class Broadcast(Frames):
    """The frames of a run, each published as it is shown."""

    def __init__(self, scene: Scene, contact: Contact | None, feeds: Iterable[outlet.Feed]) -> None:
        """Stand before the first frame; ``also`` is called with each frame before it is published."""
        super().__init__(scene, contact)
        self._feeds, self._queue = tuple(feeds), outlet.Queue()
        self.also: list[Callable[[Frame], None]] = []

    def show(self) -> None:
        """Publish the next frame, and move on."""
        frame = self.take()
        for tell in self.also:
            tell(frame)
        for feed in self._feeds:
            feed.put(frame, self._queue)
        self.flush()

    def flush(self) -> bool:
        """Publish what slow readers held back; return whether nothing is held back any more."""
        return self._queue.flush()


class Sim(DragonNode):
    """Publishes a scene, in any executor; ``player.done`` at the end of its run."""

    def __init__(self, interrupted: Callable[[], bool] = lambda: False, **overrides: Any) -> None:
        """Declare parameters, load the scene, advertise what its effects switch on.

        Where ``on_contact`` asks for it, the first contact is found here. Raises InterruptedError where
        ``interrupted()`` becomes true meanwhile, DragonError where the parameters describe nothing to simulate.
        """
        super().__init__('sim', SIM, overrides)
        self.scene, value = _scene_of(self.setting), self.setting
        contact = _contact(self.scene, value['on_contact'], interrupted)
        if contact and value['on_contact'] == 'hold':
            self.set_parameters([RosParameter('at_end', value='hold')])
        self._lossless = value['time_scale'] == 0
        encode = encoders(self.scene, value['frame_id'])
        self.feeds = {name: outlet.Feed(self._publisher(name), encode[name]) for name in encode}
        self.outlets = {name: feed.publisher for name, feed in self.feeds.items()}
        self._frames = Broadcast(self.scene, contact, self.feeds.values())
        self._frames.also = list(self._also())
        self.outlets['track'] = self._publisher('track')
        self.outlets['track'].publish(track_message(self.scene, value['frame_id']))
        self.outlets['scene'] = self._publisher('scene')
        self.outlets['scene'].publish(string_message(scene_file(self.scene, {
            name: value[name] for name in ('frame_id', 'on_contact')})))
        wanted = outlet.wanted_readers(value['wait_subscribers'], self.outlets)
        self.player = Player(self, self._frames, value['time_scale'], lambda: outlet.readers_are_there(wanted))

    def refuse(self, name: str, value: Any) -> None:
        """Raise DragonError where a live parameter may not take a value."""
        if name == 'seek_s':
            self._frames.check_time(round(value * NS))
        if name == 'time_scale' and value == 0 and not self._lossless:
            raise FieldError('time_scale', value, 'a run that loses nothing has topics of its own kind from the start',
                             'start sim with time_scale:=0.0, or set it above 0')

    def changed(self, name: str) -> None:
        """Take a new speed over."""
        if name == 'time_scale':
            self.player.set_speed(self.setting['time_scale'])

    def _publisher(self, name: str) -> Publisher:
        row = channels()[name]
        profile = qos.of_channel(row)
        if self._lossless and row.durability == 'volatile':
            profile = qos.lossless(profile)
        return self.create_publisher(shell.message_type(row.type), name, profile)

    def _also(self) -> Iterator[Callable[[Frame], None]]:
        """Yield what else is told of each frame."""
        if self.setting['publish_clock'] or Effect.CLOCK in self.scene.effects:
            clock = SimulationTime(self, self.scene.run.start_ns)
            yield lambda frame: clock.tell(frame.t_ns)
        if self.setting['publish_tf']:
            yield Ends(self, self.setting['frame_id']).tell


def _contact(scene: Scene, act: str, interrupted: Callable[[], bool]) -> Contact | None:
    """Return the contact at which to act, if any. Raises InterruptedError where told to stop meanwhile."""
    def go_on(_: int) -> None:
        if interrupted():
            raise InterruptedError
    found = None if act == 'continue' else first_contact(scene, go_on)
    return found if isinstance(found, Contact) else None


def _scene_of(value: dict[str, Any]) -> Scene:
    """Return the scene that the parameters describe."""
    changed = [f'run.{key}={value[key]!r}' for key in ('start_s', 'stop_s', 'rate_hz') if value[key] >= 0]
    accuracy = [f'accuracy={value["accuracy"]}'] if value['accuracy'] else []
    return load_scene(value['scene'], [*filter(None, value['set']), *accuracy, *changed])


def run(given: dict[str, Any], stop: threading.Event) -> int:
    """Simulate a run with given parameters in an executor of its own; return the exit code."""
    try:
        node = Sim(stop.is_set, **given)
    except InterruptedError:
        return cli.OK
    try:
        code = shell.spin(node, stop, lambda: node.player.done)
        node.get_logger().info('published: ' + ', '.join(f'{name} {feed.published}'
                                                         for name, feed in node.feeds.items()))
        outlet.drain(node.outlets.values())
        return code
    finally:
        node.destroy_node()
