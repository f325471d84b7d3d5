"""The ROS shell: thin nodes that move bytes. No other package imports rclpy or message packages."""
