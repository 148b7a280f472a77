"""Negative evidence: what it tells about people that no robot has found them.

Somebody in plain view would be found, mostly. Who is not found is therefore rather where no robot
looks: the parts of their distribution that are in view lose weight (Koch, On exploiting 'negative'
sensor evidence for target tracking and sensor data fusion, Information Fusion 8(1), 2007).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mrs_people_loc.arrays import Bool, Float

#: Nodes [sigma] and weights of the Gauss-Hermite quadrature, three by three.
_NODES = math.sqrt(3.0) * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
_WEIGHTS = np.array([x * y for x in (1, 4, 1) for y in (1, 4, 1)]) / 36.0
#: Least variance of a place [m^2].
_LEAST = 1e-9


def not_found(
    state: Float, covariance: Float, missed: float, in_view: Callable[[Float], Bool]
) -> tuple[Float, Float, Float]:
    """Updates people after an interval in which they were not found.

    Args:
        state: Places [m] and velocities [m/s], shape (n, 4).
        covariance: Of the states, shape (n, 4, 4).
        missed: Probability that somebody in plain view is not found, over 0.
        in_view: Tells which places, shape (n, 9, 2) [m], are in plain view of a robot; returns
            shape (n, 9).

    Returns:
        States and covariances likewise, and the share of the distribution of each place that was in
        plain view, shape (n,).
    """
    before, cross = covariance[:, :2, :2], covariance[:, 2:, :2]
    values, vectors = np.linalg.eigh(before)
    values = np.maximum(values, _LEAST)[:, np.newaxis]
    axes = vectors * np.sqrt(values)
    places = state[:, np.newaxis, :2] + _NODES @ axes.transpose(0, 2, 1)
    is_in_view = in_view(places)
    weight = _WEIGHTS * np.where(is_in_view, missed, 1.0)
    weight /= weight.sum(axis=1, keepdims=True)
    place = (weight[..., np.newaxis] * places).sum(axis=1)
    off = places - place[:, np.newaxis]
    after = (weight[..., np.newaxis] * off).transpose(0, 2, 1) @ off
    # The velocity follows by its correlation with the place.
    gain = cross @ (vectors / values) @ vectors.transpose(0, 2, 1)
    moved = place - state[:, :2]
    velocity = state[:, 2:] + (gain @ moved[..., np.newaxis])[..., 0]
    of_velocity = covariance[:, 2:, 2:] - gain @ (before - after) @ gain.transpose(0, 2, 1)
    cross = gain @ after
    updated = np.block([[after, cross.transpose(0, 2, 1)], [cross, of_velocity]])
    return np.concatenate([place, velocity], axis=1), updated, is_in_view @ _WEIGHTS
