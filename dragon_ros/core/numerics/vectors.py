"""Vectors in the plane as arrays (..., 2)."""
import numpy as np

from dragon_ros.core.numerics.types import Array, Floats


def left(vectors: Floats) -> Floats:
    """Return vectors rotated by a quarter turn to the left."""
    return np.stack((-vectors[..., 1], vectors[..., 0]), axis=-1)


def dot(a: Floats, b: Floats) -> Floats:
    """Return scalar products of vectors."""
    out: Floats = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
    return out


def complex_of(vectors: Floats) -> Array:
    """Return contiguous vectors as a view of complex numbers (...), which can be copied faster."""
    return vectors.view(np.complex128)[..., 0]
