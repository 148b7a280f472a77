"""Covariances of places: bounds of those that come in messages, and what poses add to them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import unit_vectors

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
    usable: Any = np.abs(covariance) < _USABLE  # NaN compares false
    if not usable.all():
        usable = usable.all(axis=(1, 2), keepdims=True)
        covariance = np.where(usable, covariance, largest * np.eye(2))
    values, vectors = np.linalg.eigh(covariance)
    values = np.clip(values, LEAST_SIGMA**2, largest)
    return np.asarray((vectors * values[:, np.newaxis]) @ vectors.transpose(0, 2, 1))


def pose_effect(places: Float, covariances: Float, positions: Float) -> Float:
    """Covariance of places that were measured from uncertain poses [m^2].

    Args:
        places: Where each was measured from [m], shape (m, 2).
        covariances: Of that pose, shape (m, 3, 3).
        positions: What was measured [m], shape (m, 2).

    Returns:
        Shape (m, 2, 2).
    """
    lever = np.zeros((len(positions), 2, 3))
    lever[:, 0, 0] = lever[:, 1, 1] = 1.0
    lever[:, 0, 2], lever[:, 1, 2] = (places - positions)[:, 1], (positions - places)[:, 0]
    with np.errstate(over="ignore", invalid="ignore"):  # DBL_MAX may stand for "unknown"
        effect: Float = lever @ covariances @ lever.transpose(0, 2, 1)
    return effect


def covariance_of_places(
    xy: Float, origin: Float, covariances: Float, *, along: Float, across: Float
) -> Float:
    """Covariance of places that robots saw: of what they measured, and of their poses.

    Args:
        xy: Places in the common frame [m], shape (n, 2).
        origin: Where each was seen from [m], shape (n, 2).
        covariances: Of that pose, shape (n, 3, 3).
        along: Variance along the line of sight [m^2], shape (n,).
        across: Variance across it [m^2], shape (n,).

    Returns:
        In the common frame [m^2], shape (n, 2, 2); NaN or infinite where a pose's is too large.
    """
    bearing = unit_vectors(xy - origin)
    outer = bearing[:, :, np.newaxis] * bearing[:, np.newaxis]
    covariance = across[:, np.newaxis, np.newaxis] * (np.eye(2) - outer)
    covariance += along[:, np.newaxis, np.newaxis] * outer
    return covariance + pose_effect(origin, covariances, xy)
