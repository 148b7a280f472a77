"""What a head sees of an upright surface at a place: sample by sample."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.sensing.camera import StereoCamera
from oracle.arrays import Float, Float32
from oracle.head import axes_of, lens_of, scale_of
from oracle.numbers import (
    ACROSS,
    BODY_ROWS,
    CENTRINGS,
    HEIGHTS,
    MIDDLE,
    MOST_ASIDE_M,
    MOST_NEARER_PX,
    TRUNK,
    WIDE,
)
from oracle.search import tolerance_px

#: Samples nearer to the plane of the lens than this are not looked at [m].
LEAST_DEPTH_M = 0.2


@dataclass(frozen=True)
class Patch:
    """One patch; fields as in `Patches`, each of shape (heights, across) but the last.

    Attributes:
        ahead: Which samples are ahead of the lens: only of these the others are known.
    """

    ahead: NDArray[np.bool_]
    u: Float
    v: Float
    expected: Float
    difference: Float
    inside: NDArray[np.bool_]
    tolerance: float


def patch_at(
    disparity: Float32, camera: StereoCamera, bearing: float, inverse_range: float
) -> Patch:
    """The patch that stands at a bearing [rad] and an inverse range [px] from the lens."""
    axes, lens, scale = axes_of(camera), lens_of(camera), scale_of(camera)
    away = scale / inverse_range
    shape = len(HEIGHTS), len(ACROSS)
    u, v, expected, difference = (np.full(shape, np.nan) for _ in range(4))
    ahead, inside = np.zeros((2, *shape), dtype=bool)
    for row, column in np.ndindex(shape):
        across = float(ACROSS[column])
        from_lens = (
            away * math.cos(bearing) - across * math.sin(bearing),
            away * math.sin(bearing) + across * math.cos(bearing),
            float(HEIGHTS[row]) - lens[2],
        )
        x, y, z = (sum(float(axes[k, i]) * from_lens[k] for k in range(3)) for i in range(3))
        if z < LEAST_DEPTH_M:
            continue
        at = row, column
        ahead[at] = True
        u[at], v[at] = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        expected[at] = scale / z
        inside[at] = -0.5 < u[at] < camera.width - 0.5 and -0.5 < v[at] < camera.height - 0.5
        if inside[at]:
            seen = float(disparity[math.floor(v[at] + 0.5), math.floor(u[at] + 0.5)])
            difference[at] = seen - expected[at] - camera.disparity_offset_px
    ratio = expected[MIDDLE] / inverse_range
    tolerance = tolerance_px(inverse_range, scale) * ratio
    return Patch(ahead, u, v, expected, difference, inside, tolerance)


def centred(
    disparity: Float32, camera: StereoCamera, bearing: float, inverse_range: float
) -> tuple[float, float]:
    """The middle of what stands at a place: bearing [rad] and inverse range [px].

    Twice: aside to the centroid of the samples that are of it, and nearer by their median.
    """
    for _ in range(CENTRINGS):
        patch = patch_at(disparity, camera, bearing, inverse_range)
        samples = [
            (float(patch.difference[row, column]), float(ACROSS[column]))
            for row in BODY_ROWS
            for column in TRUNK
            if abs(patch.difference[row, column]) < WIDE * patch.tolerance  # not so for NaN
        ]
        middle = float(np.median([d for d, _ in samples])) if samples else 0.0
        of_it = [across for d, across in samples if abs(d - middle) < patch.tolerance]
        aside = sum(of_it) / max(len(of_it), 1)
        aside = min(max(aside, -MOST_ASIDE_M), MOST_ASIDE_M)
        bearing += aside * inverse_range / scale_of(camera)
        nearer = min(max(middle, -MOST_NEARER_PX), MOST_NEARER_PX)
        nearer *= inverse_range / float(patch.expected[MIDDLE])
        inverse_range = max(inverse_range + nearer, 0.5 * inverse_range)
    return bearing, inverse_range
