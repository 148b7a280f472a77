"""Disparities to points in base_link: the paper's RAW."""

from __future__ import annotations

import numpy as np

from mrs_people_loc.config import Disparity
from mrs_people_loc.sensing.camera import StereoCamera
from oracle.arrays import Float32
from oracle.head import axes_of, lens_of, scale_of


def cloud_of(disparity: Float32, camera: StereoCamera, config: Disparity) -> list[list[float]]:
    """The points of all pixels within the working range, in the order of the pixels [m]."""
    axes, lens, scale = axes_of(camera), lens_of(camera), scale_of(camera)
    near, far = np.float32(scale / config.min_range), np.float32(scale / config.max_range)
    points = []
    for (row, column), value in np.ndenumerate(disparity):
        d = value - np.float32(camera.disparity_offset_px)
        if far <= d <= near:  # not so for NaN
            depth = scale / float(d)
            optical = (
                depth * (column - camera.cx) / camera.fx,
                depth * (row - camera.cy) / camera.fy,
                depth,
            )
            points.append(
                [sum(float(axes[i, k]) * optical[k] for k in range(3)) + lens[i] for i in range(3)]
            )
    return points
