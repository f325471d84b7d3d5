"""Frames to CDR bytes and back: topics, templates, decoders. Never imports rclpy."""
