"""Array types of the core."""
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
