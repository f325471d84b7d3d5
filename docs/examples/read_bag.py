"""Read a bag without ROS: the head's position and the smallest clearance at each whole second."""
import sys

import dragon_ros as dr

with dr.read_bag(sys.argv[1]) as bag:
    for tick in bag:
        if tick.t_ns % 10**9 == 0:
            x, y = tick.handles_m[0]
            print(f'{tick.t_ns / 1e9:.0f} s: head at ({x:.3f}, {y:.3f}) m, clearance {tick.clearance_m:.4f} m')
