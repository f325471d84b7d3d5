"""Commands that need no ROS, each in its own module."""
