"""Bench dragon simulator for ROS 2; ``dragon_ros.core`` is the model, usable without ROS."""

__version__ = '0.2.0'
