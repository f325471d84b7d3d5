"""Measure what accuracy, effects, contact and bags cost for a scene on this machine."""
