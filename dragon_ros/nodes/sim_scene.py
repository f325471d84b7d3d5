"""What ``sim`` simulates: the scene that its parameters describe, and the first contact at which its run may end."""
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from dragon_ros.core.errors import InputError, shown
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.nodes import publisher_queue
from dragon_ros.scenes.certificate import claim_of
from dragon_ros.scenes.load import load_scene
from dragon_ros.scenes.provenance import CLAIM


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
