"""Axes, rotations and angles.

Everything inside and on the wire follows REP 103: x forward, y left, z up, metres, radians; camera
frames are optical: x right, y down, z forward. The paper's axes are X right, Y up, Z forward with
the ground plane XZ, so paper Z is our x, paper X is our -y, paper Y is our z, and its "XZ
quantization" works on our x-y plane.
"""

from __future__ import annotations

import math

import numpy as np

from mrs_people_loc.arrays import Float as Float

#: Turns a vector of an optical frame into the frame of the same head with REP 103 body axes.
BODY_FROM_OPTICAL: Float = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Float:
    """Rotation matrix of roll, pitch and yaw about fixed x, y, z (REP 103), shape (3, 3)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_2d(yaw: float) -> Float:
    """Rotation matrix of a heading, shape (2, 2)."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])


def unit_vectors(vectors: Float) -> Float:
    """Unit vectors in the same directions; (1, 0) for vectors of length 0, shape (n, 2)."""
    length = np.hypot(vectors[:, 0], vectors[:, 1])[:, np.newaxis]
    ahead = np.zeros_like(vectors)
    ahead[:, 0] = 1.0
    return np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), ahead)


def wrap_angle(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    wrapped = math.remainder(angle, 2.0 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


def wrap_angles(angles: Float) -> Float:
    """The same angles in [-pi, pi)."""
    return np.asarray((angles + math.pi) % (2.0 * math.pi) - math.pi)


def yaw_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Heading of a unit quaternion [rad]."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion_from_yaw(yaw: float) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of a heading [rad]."""
    return 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)


def quaternion_from_rotation(rotation: Float) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of a rotation matrix of shape (3, 3)."""
    # Eigenvector method (Bar-Itzhack 2000): no branches on the sign of the trace.
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    k = np.array(
        [
            [xx - yy - zz, 0.0, 0.0, 0.0],
            [yx + xy, yy - xx - zz, 0.0, 0.0],
            [zx + xz, zy + yz, zz - xx - yy, 0.0],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    _, vectors = np.linalg.eigh(k / 3.0)
    x, y, z, w = vectors[:, -1] * (1.0 if vectors[3, -1] >= 0 else -1.0)
    return float(x), float(y), float(z), float(w)


def margins(costs: Float) -> Float:
    """By how much each pair is cheaper than any other of its row or column, shape (n, m).

    Args:
        costs: Of the pairs of n things and m others, shape (n, m).
    """
    sides = [
        np.where(np.eye(table.shape[1], dtype=bool), np.inf, table[:, np.newaxis]).min(axis=2)
        for table in (costs, costs.T)
    ]
    return np.asarray(np.minimum(sides[0], sides[1].T) - costs)


def squared_mahalanobis(offset: Float, covariance: Float) -> Float:
    """Squared Mahalanobis lengths, shape (...).

    Args:
        offset: Shape (..., 2) [m].
        covariance: Symmetric, of full rank, shape (..., 2, 2) [m^2].
    """
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    x, y = offset[..., 0], offset[..., 1]
    return np.asarray((yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))
