"""Enclosures: bounds of positions, speeds and gaps while the leader moves from one place to another."""
