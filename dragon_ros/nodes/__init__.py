"""The ROS shell: thin nodes that move bytes. Only this room imports rclpy and message packages."""
