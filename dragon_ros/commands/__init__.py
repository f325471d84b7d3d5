"""Commands that do not need ROS, each in its own module."""
