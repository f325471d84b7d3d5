"""Commands that work offline, without ROS."""
