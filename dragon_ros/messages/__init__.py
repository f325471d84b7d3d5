"""Convert frames to CDR bytes and back, without rclpy: topics, templates and decoders."""
