"""Enclosures: bounds on positions, speeds and gaps while the leader moves from one position to another."""
