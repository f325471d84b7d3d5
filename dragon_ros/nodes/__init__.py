"""The ROS shell: thin nodes that move bytes. The only place that imports rclpy and message packages."""
