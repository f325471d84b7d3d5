"""Searches, with bounds on the results, for first contacts, near misses, pitches, bounding boxes and maximum speeds."""
