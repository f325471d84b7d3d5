"""The ROS shell: thin nodes that move bytes. Only this package imports rclpy and message packages."""
