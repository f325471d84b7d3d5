"""The cost of bags for a scene, for each compression: ticks computed and written per second, and bytes per tick."""
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from dragon_ros.bags.write import COMPRESSIONS
from dragon_ros.bags.write.simulate import write_bag
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.encode import encoders


@dataclass(frozen=True)
class BagCost:
    """A bag with the first ticks of a run: the number of ticks, the time to write them, and sizes in bytes.

    The size of the messages is that of the middle tick, times the number of ticks.
    """

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
    encode, out = encoders(scene).values(), []
    tick(scene, 0)      # builds the tables, which happens once per run
    with tempfile.TemporaryDirectory(prefix='dragon_ros-') as folder:
        for compression in COMPRESSIONS:
            done(f'bag, {compression}')
            path = Path(folder) / f'{compression}.mcap'
            began = time.perf_counter()
            ticks = _written(scene, path, compression, began + budget_s / len(COMPRESSIONS))
            elapsed_s, middle = time.perf_counter() - began, tick(scene, ticks // 2)
            message_bytes = ticks * sum(len(one(middle)) for one in encode)
            out.append(BagCost(compression, ticks, elapsed_s, message_bytes, path.stat().st_size))
    return tuple(out)


def _written(scene: Scene, path: Path, compression: str, end_s: float) -> int:
    """Write whole chunks of ticks to a bag until a time of the performance counter; return the number of ticks."""
    stop = Event()

    def check(_: int) -> None:
        if time.perf_counter() > end_s:
            stop.set()
    return write_bag(scene, path, compression=compression, stop=stop, progress=check)
