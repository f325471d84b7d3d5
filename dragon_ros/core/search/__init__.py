"""Searches over a run, each with bounds: first contact, near misses, smallest pitch, bounding box, maximum speed."""
