"""Scene files: load, schema, YAML, and what made a run. Never imports rclpy."""
