"""The ROS shell: thin nodes that pass bytes on. No other package imports rclpy or message packages."""
