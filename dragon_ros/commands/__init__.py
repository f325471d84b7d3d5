"""Commands that need no ROS, one module each."""
