"""Exponential of a small matrix, for the exact solution of a linear system at a later time."""

import math

import numpy as np
from numpy.typing import NDArray

_TERMS = 12
"""Number of terms of the Taylor series. For a norm of `_SMALL`, the remainder is below 1e-16 of the sum."""
_SMALL = 0.5


def exponential(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponential of a square matrix of finite numbers, by the Taylor series of the repeatedly halved
    matrix and the same number of squarings.
    """
    norm = float(np.abs(matrix).sum(axis=1).max(initial=0.0))
    halvings = max(0, math.ceil(math.log2(norm / _SMALL))) if norm > _SMALL else 0
    part = matrix / 2.0**halvings
    one = np.eye(len(matrix))
    result = one
    for term in range(_TERMS, 0, -1):
        result = one + part @ result / term
    for _ in range(halvings):
        result = result @ result
    return result
