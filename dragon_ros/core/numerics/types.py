"""Array types of the core, and vectors in the plane as arrays (..., 2)."""
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Complexes = NDArray[np.complex128]
Array = NDArray[Any]
Index = Array | tuple[Array, ...]


def read_only(array: Floats) -> Floats:
    """Make an array read-only and return it, so that callers cannot change results of the core."""
    array.flags.writeable = False
    return array


def distinct(values: Array) -> Array:
    """Return the sorted distinct values of an array (n,), like ``np.unique`` but without importing masked arrays."""
    grown = np.sort(values)
    out: Array = grown[np.append(True, grown[1:] != grown[:-1])[:grown.size]]
    return out


def left(vectors: Floats) -> Floats:
    """Return vectors rotated by a quarter turn to the left."""
    return np.stack((-vectors[..., 1], vectors[..., 0]), axis=-1)


def dot(a: Floats, b: Floats) -> Floats:
    """Return scalar products of vectors."""
    out: Floats = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
    return out


def complex_of(vectors: Floats) -> Complexes:
    """Return vectors as complex numbers (...): a view, if the vectors are contiguous."""
    return np.ascontiguousarray(vectors).view(np.complex128)[..., 0]
