"""Enclosures: what positions, speeds and gaps stay within while the leader goes from one place to another."""
