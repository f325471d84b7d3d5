"""Read, write, check and record MCAP bags. This package never imports rclpy."""
