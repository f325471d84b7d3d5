"""Compare a bag with the model, tick for tick and bit for bit."""
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field

from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.wire.encode import encoders
from dragon_ros.wire.log import LogReader


@dataclass
class Comparison:
    """How many messages were equal, and a line for each that was lost, extra or different."""

    equal: int = 0
    faults: list[str] = field(default_factory=list)


def compare_with_model(bag: LogReader, scene: Scene, namespace: str = '/dragon',
                       progress: Callable[[int], object] = lambda k: None) -> Comparison:
    """Recompute every tick of the scene's run and compare each topic's message with the bag's, byte for byte."""
    encode = encoders(scene)
    recorded: dict[tuple[str, int], list[bytes]] = defaultdict(list)
    for message in bag.messages([f'{namespace}/{name}' for name in encode]):
        recorded[message.topic.removeprefix(f'{namespace}/'), message.t_ns].append(message.data)
    result = Comparison()
    for k in range(scene.last_tick + 1):
        frame = tick(scene, k)
        for name in encode:
            found = recorded.pop((name, frame.t_ns), [])
            if found == [encode[name](frame)]:
                result.equal += 1
            else:
                what = {0: 'is missing', 1: 'differs'}.get(len(found), f'is there {len(found)} times')
                result.faults.append(f'tick {k}: {name} {what}')
        progress(k)
    result.faults += [f'{name} at {t_ns} ns belongs to no tick' for name, t_ns in recorded]
    return result
