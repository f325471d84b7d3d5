"""Measure the cost of accuracy, effects, contact and bags for a scene on this machine."""
