"""Covariances: what is taken for one, whatever a message says."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float

#: No standard deviation is taken for smaller [m].
LEAST_SIGMA = 0.01
#: ... and none for larger [m]: what a message says of its uncertainty may be anything.
LARGEST_SIGMA = 100.0
#: A covariance with anything larger says nothing [m^2].
_USABLE = 1e12


def bounded(covariance: Float) -> Float:
    """Covariances with standard deviations between a least and a largest one, whatever came in."""
    largest = LARGEST_SIGMA**2
    usable: Any = (np.abs(covariance) < _USABLE).all(axis=(1, 2))  # NaN compares false
    covariance = np.where(usable[:, np.newaxis, np.newaxis], covariance, largest * np.eye(2))
    values, vectors = np.linalg.eigh(covariance)
    values = np.clip(values, LEAST_SIGMA**2, largest)
    return np.asarray((vectors * values[:, np.newaxis]) @ vectors.transpose(0, 2, 1))
