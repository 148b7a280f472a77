"""One disparity per body, voted by all its pixels.

StereoBM gives each pixel a disparity of its own, to 1/16 px at best. The samples of one body
together give the shift of the right image that minimizes the sum of squared differences between
left and right, with gain and offset between the cameras fitted at the same time (Lucas & Kanade
1981, for one body at a time).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.bodies.patches import ACROSS, BODY, BODY_HEIGHTS, HEIGHTS, Patches, in_rows
from mrs_people_loc.precision import BODY_TOLERANCE_PX
from mrs_people_loc.sensing.images import Gray


@dataclass(frozen=True)
class VotesTuning:
    """Constants of the vote, chosen on the training suite.

    Attributes:
        iterations: Of Gauss-Newton.
        blur_px: Both images are smoothed by this before (sigma) [px].
        max_step_px: No iteration moves a body farther [px] ...
        max_shift_px: ... and all of them together no farther than this [px].
        gains: Gain between the cameras, at least and at most.
        behind_px: The background is looked for at this much less disparity, for a body no deeper
            than what matching errs by [px].
        noise: Added to the costs that are compared: smaller ones tell nothing [grey levels].
    """

    iterations: int = 3
    blur_px: float = 0.7
    max_step_px: float = 0.5
    max_shift_px: float = 1.2
    gains: tuple[float, float] = (0.3, 3.0)
    behind_px: tuple[float, ...] = (0.8, 1.5, 2.4, 3.6)
    noise: float = 4.0


VOTES_TUNING = VotesTuning()
#: Added to the diagonal of the normal equations, which are singular where an image is flat.
_RIDGE = np.eye(3) * 1e-2
#: Where the right image is looked up: at the samples, and half a pixel to either side [px].
_ASIDE = np.array([[0.0], [-0.5], [0.5]], dtype=np.float32)


@dataclass(frozen=True)
class Vote:
    """Voted disparities of n bodies.

    Attributes:
        shift: Disparity of a body minus its patch's [px], shape (n,).
        sigma: Standard deviation of the shift, by the residuals [px], shape (n,).
        contrast: Whether a sample matches at the body's disparity (1) or behind it (-1), shape (n,
            heights, across), float32.
    """

    shift: Float
    sigma: Float
    contrast: Float32

    @classmethod
    def nothing(cls, count: int) -> Vote:
        """No vote: zeros."""
        zeros = np.zeros(count)
        return cls(zeros, zeros, np.zeros((count, len(HEIGHTS), len(ACROSS)), dtype=np.float32))


def vote(
    left: Gray,
    right: Gray,
    patches: Patches,
    *,
    offset_px: float,
    tuning: VotesTuning = VOTES_TUNING,
) -> Vote:
    """The disparity of each body, and the samples that match there.

    Args:
        left: Left image, uint8, shape (height, width).
        right: Right image, likewise.
        patches: Patches, centred on the bodies.
        offset_px: Disparity of a point at infinity.
        tuning: Its constants.
    """
    if not len(patches):
        return Vote.nothing(0)
    smooth_left, smooth_right = (_smoothed(image, tuning.blur_px) for image in (left, right))
    found, gain, level = _align(smooth_left, smooth_right, patches, offset_px, tuning)
    offset = found.shift.astype(np.float32) + np.float32(offset_px)
    contrast = _contrast(smooth_left, smooth_right, patches, offset, (gain, level), tuning)
    return replace(found, contrast=contrast)


def _align(
    left: Float32, right: Float32, patches: Patches, offset_px: float, tuning: VotesTuning
) -> tuple[Vote, Float, Float]:
    """Gauss-Newton iterations for the shift, all bodies at a time.

    Args: as those of `vote`, images smoothed.

    Returns:
        The vote, still without contrast; gain and offset of the grey levels from right to left,
        shape (n,) each.
    """
    u, v, expected, difference = (
        in_rows(part[:, BODY_HEIGHTS, BODY])
        for part in (patches.u, patches.v, patches.expected, patches.difference)
    )
    with np.errstate(invalid="ignore"):
        same = np.abs(difference) < patches.tolerance.astype(np.float32)[:, np.newaxis]
    weight = same.astype(np.float32)
    seen = _look_up(left, u, v)
    matched = u - expected - np.float32(offset_px)
    rows = np.hstack([v] * len(_ASIDE))
    total = np.maximum(weight.sum(axis=1), 1.0)
    shift = np.zeros(len(patches), dtype=np.float32)
    for _ in range(tuning.iterations):
        x = matched - shift[:, np.newaxis]
        # seen = gain * other + offset + slope * more, least squares over the samples.
        at = x[:, np.newaxis] + _ASIDE
        design = _look_up(right, in_rows(at), rows).reshape(at.shape)
        slope = design[:, 2]
        np.subtract(design[:, 1], slope, out=slope)
        design[:, 1] = 1.0
        weighted = design * weight[:, np.newaxis]
        normal = weighted @ design.transpose(0, 2, 1) + _RIDGE
        right_side = weighted @ seen[:, :, np.newaxis]
        solution = np.linalg.solve(normal, right_side.astype(np.float64))[..., 0]
        more = solution[:, 2] / np.clip(solution[:, 0], *tuning.gains)
        shift += np.clip(more, -tuning.max_step_px, tuning.max_step_px).astype(np.float32)
        np.clip(shift, -tuning.max_shift_px, tuning.max_shift_px, out=shift)
    fitted = design.transpose(0, 2, 1) @ solution[:, :, np.newaxis].astype(np.float32)
    residual = seen - fitted[..., 0]
    variance = np.maximum((weight * residual**2).sum(axis=1) / total, 1.0)
    mean_slope = (weight * slope).sum(axis=1) / total
    texture = (weight * (slope - mean_slope[:, np.newaxis]) ** 2).sum(axis=1)
    sigma = np.sqrt(variance / np.maximum(texture, 1e-3)).astype(np.float64)
    found = replace(Vote.nothing(len(patches)), shift=shift.astype(np.float64), sigma=sigma)
    return found, solution[:, 0], solution[:, 1]


def _contrast(
    left: Float32,
    right: Float32,
    patches: Patches,
    offset: Float32,
    fitted: tuple[Float, Float],
    tuning: VotesTuning,
) -> Float32:
    """Cost of matching behind the bodies against that of matching at them.

    StereoBM's windows make thin things wide; the pixels themselves tell what is in front.

    Args:
        left: Smoothed left image.
        right: Smoothed right image.
        patches: The patches.
        offset: Disparity of the bodies beyond their patches' [px], shape (n,).
        fitted: Gain and offset of the grey levels from right to left, shape (n,) each.
        tuning: Its constants.
    """
    u, v, expected = (in_rows(part) for part in (patches.u, patches.v, patches.expected))
    gain, level, offset, reach = (
        values.astype(np.float32)[:, np.newaxis]
        for values in (*fitted, offset, np.maximum(patches.tolerance / BODY_TOLERANCE_PX, 1.0))
    )
    matched = u - expected - offset
    seen = _look_up(left, u, v) - level
    costs = []
    for behind in (0.0, *tuning.behind_px):
        cost = _look_up(right, matched + behind * reach, v)
        cost *= gain
        np.subtract(seen, cost, out=cost)
        costs.append(_blurred(np.abs(cost, out=cost)))
    there, elsewhere = costs[0], functools.reduce(np.minimum, costs[1:])
    contrast = (elsewhere - there) / (elsewhere + there + np.float32(tuning.noise))
    contrast = np.ascontiguousarray(contrast.T).reshape(patches.u.shape)
    contrast[~patches.inside] = 0.0
    return np.asarray(contrast, dtype=np.float32)


def _blurred(patches: Float32) -> Any:
    """Means over 3 x 3 samples, patch by patch; from shape (n, samples) to (samples, n).

    Args:
        patches: At most 128 patches, the channels that OpenCV takes.
    """
    # As channels of one image, so that no patch gets anything from its neighbour.
    channels = np.ascontiguousarray(patches.T).reshape(len(HEIGHTS), len(ACROSS), -1)
    return cv2.blur(channels, (3, 3)).reshape(patches.T.shape)


def _smoothed(image: Gray, sigma_px: float) -> Float32:
    smooth: Any = cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma_px)
    return np.asarray(smooth, dtype=np.float32)


def _look_up(image: Float32, u: Float32, v: Float32) -> Float32:
    """Bilinear values of an image at (u, v), shape (n, samples), the border repeated."""
    values: Any = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float32)
