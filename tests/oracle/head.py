"""How a stereo head stands on its robot, and what disparities mean (REP 103 axes)."""

from __future__ import annotations

import math

import numpy as np

from mrs_people_loc.sensing.camera import StereoCamera
from oracle.arrays import Float


def axes_of(camera: StereoCamera) -> Float:
    """Right, down and ahead of the left camera as columns, in base_link's axes, shape (3, 3)."""
    m = camera.mounting

    def turn(axis: int, angle: float) -> Float:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        matrix = np.eye(3)
        matrix[i, i] = matrix[j, j] = math.cos(angle)
        matrix[i, j], matrix[j, i] = -math.sin(angle), math.sin(angle)
        return matrix

    right, down, ahead = (0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
    return turn(2, m.yaw) @ turn(1, m.pitch) @ turn(0, m.roll) @ np.array([right, down, ahead]).T


def lens_of(camera: StereoCamera) -> tuple[float, float, float]:
    """Place of the left camera in base_link [m]."""
    return camera.mounting.forward, camera.mounting.left, camera.mounting.height


def scale_of(camera: StereoCamera) -> float:
    """Disparity times depth, of the horizontal pair [px m]."""
    return camera.fx * camera.baseline


def vertical_scale_of(camera: StereoCamera) -> float:
    """Disparity times depth, of the vertical pair [px m]."""
    return abs(camera.vertical_baseline) * camera.fy
