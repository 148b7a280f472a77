"""One disparity per body, from grey levels: least squares over the samples of its trunk."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.sensing.images import Gray
from oracle.arrays import Float
from oracle.numbers import (
    BEHIND_PX,
    BLUR_PX,
    BODY_ROWS,
    FARTHEST_PX,
    GAINS,
    ITERATIONS,
    LEAST_TEXTURE,
    LEAST_VARIANCE,
    MATCHING_ERROR_PX,
    MOST_PER_ITERATION_PX,
    NOISE_LEVELS,
    RIDGE,
    TRUNK,
)

#: OpenCV before 5 looks between pixels in so many steps; 0: as exactly as float32 goes.
STEPS = 32 if int(cv2.__version__.partition(".")[0]) < 5 else 0


def smoothed(image: Gray, sigma: float = BLUR_PX) -> Float:
    """An image, blurred by a Gaussian of four sigmas to each side; beyond its border mirrored."""
    reach = round(4.0 * sigma)
    kernel = [math.exp(-0.5 * (k / sigma) ** 2) for k in range(-reach, reach + 1)]
    result = np.asarray(image, dtype=np.float64)
    for _ in range(2):  # along the rows, then along the columns
        padded = np.pad(result, ((0, 0), (reach, reach)), mode="reflect")
        width = result.shape[1]
        parts = [w * padded[:, k : k + width] for k, w in enumerate(kernel)]
        result = np.sum(parts, axis=0).T / sum(kernel)
    return result


def value_at(image: Float, u: float, v: float, steps: int = STEPS) -> float:
    """An image between its pixels, bilinear in so many steps; beyond its border that goes on."""
    height, width = image.shape
    if steps:
        u, v = round(float(u) * steps) / steps, round(float(v) * steps) / steps
    left, top = math.floor(u), math.floor(v)
    right_share, low_share = u - left, v - top
    columns = [min(max(c, 0), width - 1) for c in (left, left + 1)]
    rows = [min(max(r, 0), height - 1) for r in (top, top + 1)]
    upper, lower = (
        float(image[r, columns[0]]) * (1.0 - right_share)
        + float(image[r, columns[1]]) * right_share
        for r in rows
    )
    return upper * (1.0 - low_share) + lower * low_share


@dataclass(frozen=True)
class Ballot:
    """What one body's pixels say; `shift`, `sigma` and `contrast` as in `Vote`.

    Attributes:
        gain: From the right image's grey levels to the left one's.
        level: Likewise, the offset [grey levels].
    """

    shift: float
    sigma: float
    contrast: Float
    gain: float
    level: float


def vote_of(
    left: Float,
    right: Float,
    u: Float,
    v: Float,
    expected: Float,
    difference: Float,
    inside: NDArray[np.bool_],
    tolerance: float,
    offset_px: float,
) -> Ballot:
    """The vote of one patch.

    Args:
        left: Smoothed left image.
        right: Smoothed right image.
        u: Columns of its samples [px], shape (heights, across), as the next ones.
        v: Rows [px].
        expected: Disparities of the patch [px].
        difference: What is seen less what is expected [px].
        inside: Which samples are in the image.
        tolerance: Difference within which a sample is of the body [px].
        offset_px: Disparity of a point at infinity.
    """
    samples = [(row, column) for row in BODY_ROWS for column in TRUNK]
    mine = [at for at in samples if abs(difference[at]) < np.float32(tolerance)]  # not so for NaN
    seen = np.array([value_at(left, u[at], v[at]) for at in mine])
    shift, gain, level = 0.0, 0.0, 0.0
    design, residual = np.zeros((0, 3)), np.zeros(0)
    for _ in range(ITERATIONS):
        # seen = gain * other + level + slope * more, with a little of a ridge.
        rows = []
        for at in mine:
            x = float(u[at]) - float(expected[at]) - offset_px - shift
            slope = value_at(right, x - 0.5, v[at]) - value_at(right, x + 0.5, v[at])
            rows.append((value_at(right, x, v[at]), 1.0, slope))
        design = np.array(rows).reshape(-1, 3)
        normal = design.T @ design + RIDGE * np.eye(3)
        solution = np.linalg.inv(normal) @ design.T @ seen
        residual = seen - design @ solution
        gain, level = float(solution[0]), float(solution[1])
        more = float(solution[2]) / min(max(gain, GAINS[0]), GAINS[1])
        shift += min(max(more, -MOST_PER_ITERATION_PX), MOST_PER_ITERATION_PX)
        shift = min(max(shift, -FARTHEST_PX), FARTHEST_PX)
    count = max(len(mine), 1)
    variance = max(float((residual**2).sum()) / count, LEAST_VARIANCE)
    slopes = design[:, 2]
    texture = float(((slopes - slopes.sum() / count) ** 2).sum())
    return Ballot(
        shift=shift,
        sigma=math.sqrt(variance / max(texture, LEAST_TEXTURE)),
        contrast=contrast_of(
            left, right, u, v, expected, inside, tolerance, offset_px + shift, gain, level
        ),
        gain=gain,
        level=level,
    )


def contrast_of(
    left: Float,
    right: Float,
    u: Float,
    v: Float,
    expected: Float,
    inside: NDArray[np.bool_],
    tolerance: float,
    offset_px: float,
    gain: float,
    level: float,
) -> Float:
    """How much better each sample matches at the body (1) than behind it (-1).

    Args: as those of `vote_of`; `offset_px` with the body's shift.
    """
    reach = max(tolerance / MATCHING_ERROR_PX, 1.0)
    costs = []
    for behind in (0.0, *BEHIND_PX):
        cost = np.zeros(u.shape)
        for at in np.ndindex(u.shape):
            x = float(u[at]) - float(expected[at]) - offset_px + behind * reach
            seen = value_at(left, float(u[at]), float(v[at]))
            cost[at] = abs(seen - gain * value_at(right, x, float(v[at])) - level)
        costs.append(_mean_of_nine(cost))
    there, elsewhere = costs[0], np.min(costs[1:], axis=0)
    contrast = (elsewhere - there) / (elsewhere + there + NOISE_LEVELS)
    return np.where(inside, contrast, 0.0)


def _mean_of_nine(values: Float) -> Float:
    """Mean of each sample and the eight around it; beyond the border they are mirrored."""
    padded = np.pad(values, 1, mode="reflect")
    height, width = values.shape
    around = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.asarray(np.mean(around, axis=0))
