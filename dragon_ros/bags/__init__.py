"""MCAP bags: read, written, checked, recorded. Never imports rclpy."""
