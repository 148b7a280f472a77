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
_WHOLE = slice(0, len(HEIGHTS)), slice(0, len(ACROSS))


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

    def __call__(self, disparity: Float32, bearing: Float, inverse_range: Float) -> Patches:
        """Patches at some places.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            bearing: From the lens [rad], shape (n,).
            inverse_range: [px], shape (n,).
        """
        samples, ratio = self._samples(disparity, bearing, inverse_range, *_WHOLE)
        shape = len(bearing), len(HEIGHTS), len(ACROSS)
        u, v, expected, difference, inside = (part.reshape(shape) for part in samples)
        return Patches(
            bearing=bearing,
            inverse_range=inverse_range,
            u=u,
            v=v,
            expected=expected,
            difference=difference,
            inside=inside,
            tolerance=tolerance_px(inverse_range, self.camera.depth_disparity) * ratio,
        )

    def _samples(
        self, disparity: Float32, bearing: Float, inverse_range: Float, rows: slice, columns: slice
    ) -> tuple[tuple[Any, ...], Float]:
        """Samples of patches.

        Args: as those of a call, and which rows and columns, with the middle ones.

        Returns:
            `u`, `v`, `expected`, `difference` and `inside` of `Patches`, of shape (n, samples);
            disparity in the middle of the patches over their inverse range, shape (n,).
        """
        camera, across = self.camera, ACROSS[columns]
        ranges = camera.depth_disparity / inverse_range
        u, v, expected, inside = map(
            in_rows, upright_pixels(camera, bearing, ranges, HEIGHTS[rows], across)
        )
        expected *= np.float32(camera.depth_disparity)
        column = np.clip(u + np.float32(0.5), 0, camera.width - 1).astype(np.int32)
        row = np.clip(v + np.float32(0.5), 0, camera.height - 1).astype(np.int32)
        difference = np.take(disparity.reshape(-1), row * camera.width + column)
        difference -= expected + np.float32(camera.disparity_offset_px)
        difference[~inside] = np.nan
        above, aside = len(HEIGHTS) // 2 - rows.start, len(ACROSS) // 2 - columns.start
        middle = above * len(across) + aside
        return (u, v, expected, difference, inside), expected[:, middle] / inverse_range

    def centred(self, disparity: Float32, bearing: Float, inverse_range: Float) -> Patches:
        """Patches moved to the median range and the centroid of the body at their places.

        Args: as those of a call.
        """
        tuning, scale = self.tuning, self.camera.depth_disparity
        across = np.tile(ACROSS[BODY].astype(np.float64), len(HEIGHTS[BODY_HEIGHTS]))
        for _ in range(tuning.passes):
            samples, ratio = self._samples(disparity, bearing, inverse_range, BODY_HEIGHTS, BODY)
            difference = samples[3]
            tolerance = (tolerance_px(inverse_range, scale) * ratio)[:, np.newaxis]
            with np.errstate(invalid="ignore"):
                near = np.abs(difference) < tuning.near * tolerance
                middle = _median(difference, near)
                same = near & (np.abs(difference - middle[:, np.newaxis]) < tolerance)
            offset = same @ across / np.maximum(same.sum(axis=1), 1)
            bearing = bearing + np.clip(offset, -tuning.max_across, tuning.max_across) * (
                inverse_range / scale
            )
            nearer = np.clip(middle, -tuning.max_px, tuning.max_px) / ratio
            inverse_range = np.maximum(inverse_range + nearer, 0.5 * inverse_range)
        return self(disparity, bearing, inverse_range)


def upright_pixels(
    camera: StereoCamera, bearing: Float, ranges: Float, heights: Float32, across: Float32
) -> tuple[Float32, Float32, Float32, Bool]:
    """Where the samples of upright rectangles that face the lens are in the left image.

    Args:
        camera: The head.
        bearing: Of the rectangles' axes, from the lens [rad], shape (n,).
        ranges: Likewise, horizontal [m].
        heights: Of the samples over the floor [m], float32, shape (rows,).
        across: How far they are to the left of the axis [m], float32, shape (columns,).

    Returns:
        Columns and rows [px], inverse depths [1/m], and which are in the image, shapes
        (n, rows, columns).
    """
    rotation, lens = camera.robot_from_optical
    cos, sin = np.cos(bearing), np.sin(bearing)
    # In the optical frame [m], shape (3, n): of the places, and of a metre to their left.
    level, up = rotation.T[:, :2], rotation.T[:, 2:].astype(np.float32)
    away = (level @ np.array([ranges * cos, ranges * sin])).astype(np.float32)
    left = (level @ np.array([-sin, cos])).astype(np.float32)[..., np.newaxis]
    upright = away[..., np.newaxis] + ((heights - np.float32(lens[2])) * up)[:, np.newaxis]
    u, v, z = upright[..., np.newaxis] + (left * across)[:, :, np.newaxis]
    inside = z > 0.1
    inverse = np.float32(1.0) / np.maximum(z, np.float32(0.05))
    for part, focal, centre in ((u, camera.fx, camera.cx), (v, camera.fy, camera.cy)):
        part *= inverse
        part *= np.float32(focal)
        part += np.float32(centre)
    inside &= (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
    return u, v, inverse, inside


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
    ordered = np.sort(np.where(chosen, values, np.finfo(np.float32).max), axis=1)
    last = np.maximum(count - 1, 0)[:, np.newaxis]
    place = last * np.array(shares)
    low = place.astype(np.intp)
    row = np.arange(len(values))[:, np.newaxis]
    below, above = ordered[row, low], ordered[row, np.minimum(low + 1, last)]
    result = below + (above.astype(np.float64) - below) * (place - low)
    result[count == 0] = 0.0
    return np.asarray(result)
