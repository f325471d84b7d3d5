"""Numerics without geometry: roots, Chebyshev series, vectors and array types."""
