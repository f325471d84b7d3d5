"""Tracks: segments of lines, arcs and spirals, joined end to end, and the chords that they span."""
