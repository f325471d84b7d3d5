"""Searches over a run: first contact, near misses, smallest pitch, bounding box and maximum speed, all with bounds."""
