"""Scene files: loading, JSON Schema, YAML with line numbers, and provenance."""
