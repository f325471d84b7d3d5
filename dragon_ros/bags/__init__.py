"""MCAP bags: reading, writing, checking and recording. This package never imports rclpy."""
