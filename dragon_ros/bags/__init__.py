"""MCAP bags: reading, writing, checking and recording. Never imports rclpy."""
