"""Rows of a table out of a bag: one for each tick and handle."""
from collections.abc import Iterable, Iterator

import numpy as np

from dragon_ros.bags.read.frames import BagFrame, frames
from dragon_ros.bags.read.reader import LogReader
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import NS


def values_of(frame: BagFrame, handles: list[int]) -> Floats:
    """Return (handles, 5): x and y in m, vx, vy and speed in m/s; nan where the bag has no velocities."""
    out = np.full((len(handles), 5), np.nan)
    out[:, :2] = frame.handles_m[handles]
    if frame.velocity_m_s is not None:
        out[:, 2:4] = frame.velocity_m_s[handles]
        out[:, 4] = np.hypot(out[:, 2], out[:, 3])
    return out


def at_times(bag: LogReader, namespace: str, times_s: Iterable[float]) -> Iterator[BagFrame]:
    """Yield, for each time, the first tick that is in the bag at or after it; nothing after the last."""
    for t_s in times_s:
        frame = next(frames(bag, namespace, max(0, round(t_s * NS))), None)
        if frame is not None:
            yield frame
