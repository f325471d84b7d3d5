"""Read a bag without ROS: the head's position and the smallest clearance at each whole second."""
import sys
from pathlib import Path

from dragon_ros.bags.read.frames import frames
from dragon_ros.bags.read.reader import BagReader

with BagReader(Path(sys.argv[1])) as bag:
    for frame in frames(bag):
        if frame.t_ns % 10**9 == 0:
            x, y = frame.handles_m[0]
            print(f'{frame.t_ns / 1e9:.0f} s: head at ({x:.3f}, {y:.3f}) m, clearance {frame.clearance_m:.4f} m')
