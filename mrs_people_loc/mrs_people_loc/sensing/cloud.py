"""Disparity to points in the robot's frame: the paper's RAW (section 5.1)."""

from __future__ import annotations

import numpy as np

from mrs_people_loc.arrays import Float32
from mrs_people_loc.sensing.camera import StereoCamera


class CloudMaker:
    """Points of a head in its robot's base_link: z is the height over the floor.

    Args:
        camera: The head.
        min_range: Least depth along the optical axis [m].
        max_range: Greatest depth along the optical axis [m].
    """

    def __init__(self, camera: StereoCamera, *, min_range: float, max_range: float) -> None:
        self.camera = camera
        self._max_disparity = np.float32(camera.depth_disparity / min_range)
        self._min_disparity = np.float32(camera.depth_disparity / max_range)
        rotation, translation = camera.robot_from_optical
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)]
        )
        # Point = translation + depth * ray; depth = fx * baseline / disparity is in the rays.
        scaled = camera.depth_disparity * (rotation @ rays.reshape(3, -1))
        self._rays = scaled.astype(np.float32)
        self._translation = translation.astype(np.float32)

    def __call__(self, disparity: Float32) -> Float32:
        """Points of the pixels that have a disparity within the working range.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.

        Returns:
            x, y, z in base_link [m], float32, shape (n, 3), in the order of the pixels; each
            coordinate is contiguous in memory.
        """
        flat = disparity.reshape(-1)
        if self.camera.disparity_offset_px:
            flat = flat - np.float32(self.camera.disparity_offset_px)
        # NaN compares false, so pixels without a disparity drop out here.
        index = np.flatnonzero((flat >= self._min_disparity) & (flat <= self._max_disparity))
        # "clip" leaves out the check of the indices, which are good.
        inverse = np.float32(1.0) / np.take(flat, index, mode="clip")
        points = np.take(self._rays, index, axis=1, mode="clip")
        points *= inverse
        points += self._translation[:, np.newaxis]
        return points.T
