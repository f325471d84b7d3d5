"""Bytes and files: scenes, topics, CDR messages, MCAP logs. Never imports rclpy."""
