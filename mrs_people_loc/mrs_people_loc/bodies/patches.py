"""Upright patches: disparities at, beside and behind a place where a body may be.

A patch is a vertical rectangle that stands at the place and faces the lens, sampled every few
centimetres. Each sample compares the disparity of the pixel that shows it with the patch's own, so
that later steps see bodies in metres, at any range, however a head is mounted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.anthropometry import CHEST_DEPTH, SHOULDER_BREADTH, TALLEST
from mrs_people_loc.arrays import Bool, Float, Float32, StructOfArrays
from mrs_people_loc.bodies.search import tolerance_px
from mrs_people_loc.sensing.camera import StereoCamera

# The sampling grid, and the parts of a body on it. The model is fitted to them: after a change, run
# `mrs fit`. Where no origin is given, numbers were chosen.

#: Across the line of sight, to the left [m], and over the floor [m].
ACROSS: Float32 = np.linspace(-0.70, 0.70, 29, dtype=np.float32)
HEIGHTS: Float32 = np.linspace(0.1, 2.275, 30, dtype=np.float32)
#: Distances of the samples [m].
COLUMN, ROW = float(ACROSS[1] - ACROSS[0]), float(HEIGHTS[1] - HEIGHTS[0])

#: Bands of height over the floor [m]: legs, thighs, belly, chest, shoulders, head, above.
BANDS = ((0.1, 0.5), (0.5, 0.9), (0.9, 1.25), (1.25, 1.5), (1.5, 1.75), (1.75, 2.0), (2.0, 2.4))
#: Stripes by distance from the middle [m]: the trunk, which is there whichever way a body faces;
#: arms; beside the body.
STRIPES = (
    (0.0, CHEST_DEPTH / 2.0), (CHEST_DEPTH / 2.0, SHOULDER_BREADTH / 2.0),
    (0.34, 0.49), (0.49, 0.71),
)  # fmt: skip
#: Slices of height whose centroids are compared [m].
SLICES = tuple((low, low + 0.35) for low in (0.3, 0.6, 0.9, 1.2, 1.4, 1.6))


def span(chosen: Bool) -> slice:
    """The samples from the first chosen one to the last."""
    index = np.flatnonzero(chosen)
    return slice(int(index[0]), int(index[-1]) + 1)


#: Rows of a body, from the knees to the top of the head, and those that go out as cells.
BODY_HEIGHTS = span((HEIGHTS > 0.3) & (HEIGHTS < TALLEST))
CELL_HEIGHTS = span((HEIGHTS > 0.2) & (HEIGHTS < TALLEST))
#: Columns of the trunk; of the trunk with arms; and of arms that swing, too.
TRUNK = span(np.abs(ACROSS) < CHEST_DEPTH / 2.0)
BODY = span(np.abs(ACROSS) < SHOULDER_BREADTH / 2.0)
SILHOUETTE = span(np.abs(ACROSS) < SHOULDER_BREADTH / 2.0 + COLUMN)


@dataclass(frozen=True)
class PatchTuning:
    """Constants of centring patches, chosen on the training suite.

    Attributes:
        passes: How often patches are moved.
        near: Samples within so many tolerances of a patch may belong to its body.
        max_across: Longest move across the line of sight [m].
        max_px: Longest move in disparity [px].
    """

    passes: int = 2
    near: float = 1.5
    max_across: float = 0.12
    max_px: float = 0.6


PATCH_TUNING = PatchTuning()


@dataclass(frozen=True)
class Patches(StructOfArrays):
    """Patches of n places; arrays over samples have the shape (n, heights, across).

    Attributes:
        bearing: Of the places, from the lens [rad], shape (n,).
        inverse_range: Of the places [px], shape (n,).
        u: Column of the sample in the left image [px], float32.
        v: Row, likewise.
        expected: Disparity of the patch itself [px], float32.
        difference: Disparity seen there minus the expected one [px], float32; NaN where there is
            none or the sample is not in the image.
        inside: Whether the sample is in the image.
        tolerance: Difference within which a sample belongs to a body there [px], shape (n,).
    """

    bearing: Float
    inverse_range: Float
    u: Float32
    v: Float32
    expected: Float32
    difference: Float32
    inside: Bool
    tolerance: Float


class PatchSampler:
    """Samples patches of one head.

    Args:
        camera: The head.
        tuning: Its constants.
    """

    def __init__(self, camera: StereoCamera, tuning: PatchTuning = PATCH_TUNING) -> None:
        self.camera = camera
        self.tuning = tuning
        rotation, translation = camera.robot_from_optical
        self._optical_from_robot = rotation.T
        self._up: Any = rotation[2].astype(np.float32)  # the vertical in the optical frame
        self._lens_height = np.float32(translation[2])

    def __call__(self, disparity: Float32, bearing: Float, inverse_range: Float) -> Patches:
        """Patches at some places.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            bearing: From the lens [rad], shape (n,).
            inverse_range: [px], shape (n,).
        """
        camera = self.camera
        x, y, z = self._optical(bearing, camera.depth_disparity / inverse_range)
        inverse = 1.0 / np.maximum(z, np.float32(0.05))
        u = x * inverse * np.float32(camera.fx) + np.float32(camera.cx)
        v = y * inverse * np.float32(camera.fy) + np.float32(camera.cy)
        inside = (
            (z > 0.1)
            & (u > -0.5)
            & (u < camera.width - 0.5)
            & (v > -0.5)
            & (v < camera.height - 0.5)
        )
        expected: Any = inverse * np.float32(camera.depth_disparity)
        column = np.clip(u + np.float32(0.5), 0, camera.width - 1).astype(np.intp)
        row = np.clip(v + np.float32(0.5), 0, camera.height - 1).astype(np.intp)
        seen = np.take(disparity.reshape(-1), row * camera.width + column)
        difference = seen - (expected + np.float32(camera.disparity_offset_px))
        difference[~inside] = np.nan
        ratio: Any = expected[:, len(HEIGHTS) // 2, len(ACROSS) // 2] / inverse_range
        return Patches(
            bearing=bearing,
            inverse_range=inverse_range,
            u=u,
            v=v,
            expected=expected,
            difference=difference,
            inside=inside,
            tolerance=tolerance_px(inverse_range, camera.depth_disparity) * ratio,
        )

    def _optical(self, bearing: Float, ranges: Float) -> tuple[Any, Any, Any]:
        """Samples in the optical frame [m], three arrays of shape (n, heights, across)."""
        cos, sin = np.cos(bearing), np.sin(bearing)
        away: Any = np.stack([ranges * cos, ranges * sin, np.zeros_like(cos)], axis=1)
        left: Any = np.stack([-sin, cos, np.zeros_like(cos)], axis=1)
        away = (away @ self._optical_from_robot.T).astype(np.float32)[:, :, np.newaxis, np.newaxis]
        left = (left @ self._optical_from_robot.T).astype(np.float32)[:, :, np.newaxis, np.newaxis]
        up: Any = (HEIGHTS - self._lens_height)[:, np.newaxis]
        x, y, z = (away[:, k] + up * self._up[k] + left[:, k] * ACROSS for k in range(3))
        return x, y, z

    def centred(self, disparity: Float32, bearing: Float, inverse_range: Float) -> Patches:
        """Patches moved to the median range and the centroid of the body at their places.

        Args: as those of a call.
        """
        tuning = self.tuning
        for _ in range(tuning.passes):
            patches = self(disparity, bearing, inverse_range)
            difference = in_rows(patches.difference[:, BODY_HEIGHTS, BODY])
            tolerance = patches.tolerance[:, np.newaxis]
            with np.errstate(invalid="ignore"):
                near = np.abs(difference) < tuning.near * tolerance
            middle = _median(difference, near)[:, np.newaxis]
            with np.errstate(invalid="ignore"):
                same = near & (np.abs(difference - middle) < tolerance)
            across = ACROSS[BODY]
            columns = same.reshape(-1, len(HEIGHTS[BODY_HEIGHTS]), len(across)).sum(axis=1)
            offset = columns @ across / np.maximum(columns.sum(axis=1), 1)
            bearing = bearing + np.clip(offset, -tuning.max_across, tuning.max_across) * (
                inverse_range / self.camera.depth_disparity
            )
            nearer = np.clip(middle[:, 0], -tuning.max_px, tuning.max_px) * (
                inverse_range / patches.expected[:, len(HEIGHTS) // 2, len(ACROSS) // 2]
            )
            inverse_range = np.maximum(inverse_range + nearer, 0.5 * inverse_range)
        return self(disparity, bearing, inverse_range)


def in_rows(values: NDArray[Any]) -> NDArray[Any]:
    """The values of each patch in a row: (n, a, b) to (n, a * b), also for no patch at all."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def _median(values: Float32, chosen: Bool) -> Float:
    """Median of the chosen values of each row, 0 where there are none, shape (n,)."""
    return quantiles(values, chosen, (0.5,))[:, 0]


def quantiles(values: Float32, chosen: Bool, shares: tuple[float, ...]) -> Float:
    """Quantiles of the chosen values of each row, interpolated; 0 where there are none.

    Args:
        values: Shape (n, m).
        chosen: Shape (n, m).
        shares: From 0 to 1, k of them.

    Returns:
        Shape (n, k).
    """
    count: Any = chosen.sum(axis=1)
    ordered = np.sort(np.where(chosen, values, np.float32(np.inf)), axis=1)
    place = np.maximum(count - 1, 0)[:, np.newaxis] * np.array(shares)
    low = place.astype(np.intp)
    row = np.arange(len(values))[:, np.newaxis]
    high = np.minimum(low + 1, np.maximum(count - 1, 0)[:, np.newaxis])
    below, above = ordered[row, low].astype(np.float64), ordered[row, high].astype(np.float64)
    with np.errstate(invalid="ignore"):
        result = below + (above - below) * (place - low)
    result[count == 0] = 0.0
    return np.asarray(result)
