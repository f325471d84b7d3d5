"""Numerics without geometry: root finders, ball arithmetic, array types."""
