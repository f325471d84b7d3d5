"""``sim``: computes tick after tick of a scene and publishes it as bytes."""
import threading
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher

from dragon_ros.core.first_contact import Contact, first_contact
from dragon_ros.core.scene import LATEST_S, NS, Scene
from dragon_ros.core.step import Frame, frame_of, state, tick
from dragon_ros.nodes import outlet, qos, shell
from dragon_ros.nodes.pacer import Pacer
from dragon_ros.nodes.params import Parameter, declare
from dragon_ros.wire import cli
from dragon_ros.wire.channels import channels
from dragon_ros.wire.encode import encoders
from dragon_ros.wire.scenes import load_scene

_AS_SCENE = -1.0
_ON_CONTACT = ('continue', 'hold', 'stop')
PARAMETERS = (
    Parameter('scene', 'winding', 'Scene: a name (see msg_configs/scenes) or the path of a .yaml file'),
    Parameter('set', [''], 'Overrides of scene keys, each key=value with a dotted key'),
    Parameter('accuracy', '', 'Largest position error: metres or a tier; empty: as the scene says'),
    Parameter('start_s', _AS_SCENE, 'First tick, in seconds of the scene; negative: as the scene says', -1.0, LATEST_S),
    Parameter('stop_s', _AS_SCENE, 'End of the run, in seconds of the scene; negative: its own', -1.0, LATEST_S),
    Parameter('rate_hz', _AS_SCENE, 'Ticks for each second of simulation; negative: as the scene says', -1.0, 1e6),
    Parameter('time_scale', 1.0, 'Seconds of simulation for each second; 0: as fast as the readers follow', 0.0, 1e6),
    Parameter('wait_subscribers', [''], 'Start when topics have so many subscribers, e.g. [handles=2, velocities=1]'),
    Parameter('on_contact', 'continue', 'At the first contact: continue; hold (end with the frame of exactly that time '
              'and stay until a signal); stop (end with that frame)', choices=_ON_CONTACT),
    Parameter('frame_id', 'dragon', 'Frame of all messages'),
)


class Sim(Node):
    """Publishes a scene; ``run`` does all the work."""

    def __init__(self, **overrides: Any) -> None:
        """Declare parameters, load the scene, advertise what its effects switch on."""
        super().__init__('sim', namespace=shell.NAMESPACE, parameter_overrides=[
            RosParameter(name, value=value) for name, value in overrides.items()])
        value = {parameter.name: declare(self, parameter) for parameter in PARAMETERS}
        self.scene = _scene_of(value)
        self._time_scale, self._on_contact = value['time_scale'], value['on_contact']
        encode = encoders(self.scene, value['frame_id'])
        self._feeds = {name: outlet.Feed(self._publisher(name), encode[name]) for name in encode}
        self._outlets = {name: feed.publisher for name, feed in self._feeds.items()}
        self._wanted = outlet.wanted_readers(value['wait_subscribers'], self._outlets)

    def _publisher(self, name: str) -> Publisher:
        row = channels()[name]
        profile = qos.of_channel(row)
        return self.create_publisher(shell.message_type(row.type), name,
                                     qos.lossless(profile) if self._time_scale == 0 else profile)

    def run(self, stop: threading.Event) -> int:
        """Publish every tick of the run; return the exit code."""
        scene, count = self.scene, self.scene.last_tick + 1
        try:
            contact = self._first_contact(stop)
        except InterruptedError:
            return cli.OK
        if contact:
            count = min(count, _ticks_before(scene, contact))
        if not outlet.wait_for_readers(self._wanted, stop):
            return cli.OK
        pacer, told = Pacer(self._time_scale, stop), time.monotonic()
        self.get_logger().info(f'runs from {scene.run.start_s:g} s, {count} ticks')
        for k in range(count):
            t_ns = scene.run.time_ns(k)
            if not pacer.wait(t_ns):
                return self._ended(f'stopped before tick {k} of {count}', pacer)
            self._publish(tick(scene, k), stop)
            if time.monotonic() - told >= 1:
                told = time.monotonic()
                self.get_logger().info(f'at {t_ns / NS:.3f} s, tick {k} of {count}, {pacer.overruns} overruns')
        if contact:
            return self._end_in(contact, pacer, stop)
        end = scene.end
        why = {'stop': 'the run ends', 'lock': f'the chain locks at link {end.link}', 'track': 'the track ends'}
        return self._ended(f'{why[end.reason]} at {end.t_s:.6f} s after {count} ticks', pacer)

    def _publish(self, frame: Frame, stop: threading.Event) -> None:
        for feed in self._feeds.values():
            feed.publish(frame, stop)

    def _first_contact(self, stop: threading.Event) -> Contact | None:
        """Return the contact at which to act, if any. Raises InterruptedError where told to stop meanwhile."""
        def go_on(_: int) -> None:
            if stop.is_set():
                raise InterruptedError
        found = None if self._on_contact == 'continue' else first_contact(self.scene, go_on)
        return found if isinstance(found, Contact) else None

    def _end_in(self, contact: Contact, pacer: Pacer, stop: threading.Event) -> int:
        """Publish the frame of exactly the contact; return there, or hold until told to stop."""
        frame = contact_frame(self.scene, contact)
        if not pacer.wait(frame.t_ns):
            return self._ended('stopped before the contact', pacer)
        self._publish(frame, stop)
        inner, outer = contact.benches
        what = f'contact of benches {inner} and {outer} at {contact.t_s:.9f} s'
        if self._on_contact == 'hold':
            self.get_logger().info(f'{what}: holds there until a signal')
            stop.wait()
        return self._ended(f'the run ends in the {what}', pacer)

    def _ended(self, what: str, pacer: Pacer) -> int:
        late = f'; {pacer.overruns} overruns, the worst {pacer.worst_late_s:.3f} s late' if pacer.overruns else ''
        (self.get_logger().warning if late else self.get_logger().info)(f'{what}{late}')
        counts = ', '.join(f'{name} {feed.published}' for name, feed in self._feeds.items())
        self.get_logger().info(f'published: {counts}')
        outlet.drain(self._outlets.values())
        return cli.OK


def contact_frame(scene: Scene, contact: Contact) -> Frame:
    """Return the frame of exactly the time of contact, at the exact tier; its stamp is rounded to a nanosecond."""
    exact = replace(scene, accuracy='exact')
    return frame_of(exact, None, round(contact.t_s * NS), state(exact, contact.t_s))


def _ticks_before(scene: Scene, contact: Contact) -> int:
    """Return how many ticks are before the stamp of the contact."""
    t_ns = round(contact.t_s * NS)
    return scene.run.tick_at(t_ns - 1) + 1 if t_ns > scene.run.start_ns else 0


def _scene_of(value: dict[str, Any]) -> Scene:
    """Return the scene that the parameters describe."""
    changed = [f'run.{key}={value[key]!r}' for key in ('start_s', 'stop_s', 'rate_hz') if value[key] >= 0]
    accuracy = [f'accuracy={value["accuracy"]}'] if value['accuracy'] else []
    return load_scene(value['scene'], [*filter(None, value['set']), *accuracy, *changed])


def main(argv: list[str]) -> int:
    """Run the simulator with command-line arguments; return the exit code."""
    options = cli.parser('sim', 'Simulate a bench dragon and publish it. Everything is a ROS parameter:\n'
                         + '\n'.join(f'  {p.name}: {p.text}' for p in PARAMETERS),
                         'ros2 run dragon_ros sim --scene first_contact --ros-args -p time_scale:=2.0')
    cli.add_scene_options(options)
    options.set_defaults(scene=None)
    arguments = shell.parse(options, argv)
    return shell.run('sim', argv, partial(_run, arguments))


def _run(arguments: Any, stop: threading.Event) -> int:
    given = {'scene': arguments.scene, 'set': arguments.overrides, 'accuracy': arguments.accuracy}
    node = Sim(**{name: value for name, value in given.items() if value})
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    server = threading.Thread(target=_serve, args=(executor,))
    server.start()
    try:
        return node.run(stop)
    finally:
        executor.shutdown()
        server.join()
        node.destroy_node()


def _serve(executor: SingleThreadedExecutor) -> None:
    """Serve parameter requests beside the ticks."""
    with suppress(ExternalShutdownException):
        executor.spin()
