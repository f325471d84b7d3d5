"""Numerics without geometry: roots, double-double numbers, ball arithmetic, Chebyshev series, array types."""
