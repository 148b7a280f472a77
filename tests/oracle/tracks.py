"""The textbook's Kalman filter of one person: constant velocity, white noise of acceleration.

Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
section 6.2. One matrix at a time; there is no gate and nobody else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mrs_people_loc.config import Tracking
from oracle.arrays import Float
from oracle.numbers import LEAD_M, LEAD_SPEED, PUBLISHED


def filtered(
    found: Sequence[Float],
    covariances: Sequence[Float],
    stamps_ns: Sequence[int],
    times_ns: Sequence[int],
    config: Tracking,
) -> list[tuple[Float, Float]]:
    """State (x, y and velocity) and its covariance after each interval.

    Args:
        found: Where the person was found in each interval [m].
        covariances: Of these places [m^2].
        stamps_ns: When they were looked at there [ns].
        times_ns: Times of the intervals [ns].
        config: Parameters.
    """
    unknown = config.any_velocity**2
    x, p = np.array([*found[0], 0.0, 0.0]), np.diag([0.0, 0.0, unknown, unknown])
    p[:2, :2] = covariances[0]
    out = [(x, p)]
    for k in range(1, len(found)):
        t, q = (times_ns[k] - times_ns[k - 1]) / 1e9, config.acceleration**2
        move = np.eye(4)
        move[0, 2] = move[1, 3] = t
        noise = np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]) * q
        x, p = move @ x, move @ p @ move.T + np.kron(noise, np.eye(2))
        delay = (times_ns[k] - stamps_ns[k]) / 1e9
        h = np.array([[1.0, 0.0, -delay, 0.0], [0.0, 1.0, 0.0, -delay]])
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + covariances[k])
        x, p = x + gain @ (found[k] - h @ x), (np.eye(4) - gain @ h) @ p
        out.append((x, p))
    return out


def published(x: Float, p: Float) -> Float:
    """Covariance of a person's position as it is published, without a share that lasts [m^2]."""
    vx, vy = x[2:]
    along = LEAD_M / max(math.hypot(vx, vy), LEAD_SPEED)
    lead = np.array([[vx * vx, vx * vy], [vx * vy, vy * vy]]) * along**2
    return np.asarray(PUBLISHED**2 * p[:2, :2] + lead)
