"""The cost of bags for a scene, for each compression: ticks computed and written per second, and bytes per tick."""
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dragon_ros.bags.write import COMPRESSIONS
from dragon_ros.bags.write.writer import BagOptions, BagWriter, prompt_switches
from dragon_ros.core.batches import ticks
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.messages.channels import channels, live
from dragon_ros.messages.encode import encoders

_LEAST_TICKS = 2


@dataclass(frozen=True)
class BagCost:
    """A bag with the first ticks of a run: the number of ticks, the time to write them, and sizes in bytes."""

    compression: str
    ticks: int
    elapsed_s: float
    message_bytes: int
    file_bytes: int

    @property
    def ticks_per_s(self) -> float:
        """Ticks computed, encoded and written per second."""
        return self.ticks / self.elapsed_s

    @property
    def bytes_per_tick(self) -> float:
        """Size of the file per tick, in bytes."""
        return self.file_bytes / self.ticks

    @property
    def share(self) -> float:
        """Size of the file relative to the size of its messages."""
        return self.file_bytes / self.message_bytes


def measure(scene: Scene, budget_s: float, done: Callable[[str], object]) -> tuple[BagCost, ...]:
    """Write bags as ``simulate`` does, for about ``budget_s`` seconds in total, and delete them."""
    share_s = budget_s / len(COMPRESSIONS)
    out = []
    with tempfile.TemporaryDirectory(prefix='dragon_ros-') as folder, prompt_switches():
        for compression in COMPRESSIONS:
            done(f'bag, {compression}')
            out.append(_written(scene, compression, Path(folder) / f'{compression}.mcap', share_s))
    return tuple(out)


def _written(scene: Scene, compression: str, path: Path, budget_s: float) -> BagCost:
    """Write as many of the run's first ticks to a bag as the budget allows."""
    topics, count, size = list(encoders(scene).items()), compile_scene(scene).last_tick + 1, 0
    next(ticks(scene, 0, 1))        # builds the tables and templates, which happens once per run
    began = time.perf_counter()
    with BagWriter(path, options=BagOptions(compression)) as bag:
        for row in live(scene.effects):
            bag.add_channel(row.name, channels()[row.name])
        for k, frame in enumerate(ticks(scene, 0, count), 1):
            for name, encode in topics:
                data = encode(frame)
                size += len(data)
                bag.write(name, data, frame.t_ns, k)
            if k >= _LEAST_TICKS and time.perf_counter() - began > budget_s:
                break
    return BagCost(compression, k, time.perf_counter() - began, size, path.stat().st_size)
