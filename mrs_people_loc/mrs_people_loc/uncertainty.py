"""Bounds of covariances that come in messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float

#: Least standard deviation [m].
LEAST_SIGMA = 0.01
#: Largest standard deviation [m].
LARGEST_SIGMA = 100.0
#: A covariance with a larger element is taken for unknown [m^2].
_USABLE = 1e12


def bounded(covariance: Float) -> Float:
    """Covariances with standard deviations from `LEAST_SIGMA` to `LARGEST_SIGMA`.

    Args:
        covariance: [m^2], any values, NaN included, shape (n, 2, 2).
    """
    largest = LARGEST_SIGMA**2
    usable: Any = (np.abs(covariance) < _USABLE).all(axis=(1, 2))  # NaN compares false
    covariance = np.where(usable[:, np.newaxis, np.newaxis], covariance, largest * np.eye(2))
    values, vectors = np.linalg.eigh(covariance)
    values = np.clip(values, LEAST_SIGMA**2, largest)
    return np.asarray((vectors * values[:, np.newaxis]) @ vectors.transpose(0, 2, 1))
