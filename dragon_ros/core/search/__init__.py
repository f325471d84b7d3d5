"""Searches over a run: first contact, near misses, smallest pitch, bounding box, maximum speed, each with bounds."""
