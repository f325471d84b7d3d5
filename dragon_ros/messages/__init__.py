"""Frames to CDR bytes and back: topics, templates and decoders, without rclpy."""
