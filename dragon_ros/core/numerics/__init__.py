"""Numerics without geometry: roots, double-double numbers, Chebyshev series, exact polynomials, array types."""
