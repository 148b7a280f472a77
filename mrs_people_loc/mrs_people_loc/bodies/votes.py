"""One disparity per body, voted by all its pixels.

StereoBM gives each pixel a disparity of its own, to 1/16 px at best. Once it is known which samples
are one body, all of them can say together by how much the right image must be shifted: the shift
that minimizes the sum of squared differences between left and right, with gain and offset between
the cameras fitted along (Lucas & Kanade 1981, for one body at a time).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.bodies.patches import ACROSS, BODY_HEIGHTS, HEIGHTS, TRUNK, Patches, in_rows
from mrs_people_loc.bodies.search import MATCHING_ERROR_PX
from mrs_people_loc.sensing.images import Gray

Float32 = NDArray[np.float32]
Float = NDArray[np.float64]

_ITERATIONS = 3
#: Both images are smoothed by this before [px].
_BLUR_PX = 0.7
#: A vote moves a body no farther than this [px].
_FARTHEST_PX = 1.2
#: Where the background is looked for: this much less disparity, for a body no deeper than what
#: matching errs by [px].
_BEHIND_PX = (0.8, 1.5, 2.4, 3.6)
#: Cost that says nothing [grey levels].
_NOISE = 4.0


@dataclass(frozen=True)
class Vote:
    """What the pixels of n bodies say together.

    Attributes:
        shift: How much more disparity than its patch a body has [px], shape (n,).
        sigma: Standard deviation of that, as the residuals give it [px], shape (n,).
        contrast: Of each sample of a patch, how much better it matches at the body's disparity (1)
            than behind it (-1), shape (n, heights, across), float32.
    """

    shift: Float
    sigma: Float
    contrast: Float32

    @classmethod
    def nothing(cls, count: int) -> Vote:
        """No vote at all: no shift, no contrast."""
        zeros = np.zeros(count)
        return cls(zeros, zeros, np.zeros((count, len(HEIGHTS), len(ACROSS)), dtype=np.float32))


def vote(left: Gray, right: Gray, patches: Patches, *, offset_px: float) -> Vote:
    """The disparity of each body, and what matches there.

    Args:
        left: Left image, uint8, shape (height, width).
        right: Right image, likewise.
        patches: Patches, centred on the bodies.
        offset_px: Disparity of a point at infinity.
    """
    count = len(patches)
    if not count:
        return Vote.nothing(0)
    u, v, expected, difference = (
        in_rows(part[:, BODY_HEIGHTS, TRUNK])
        for part in (patches.u, patches.v, patches.expected, patches.difference)
    )
    with np.errstate(invalid="ignore"):
        weight = np.abs(difference) < patches.tolerance.astype(np.float32)[:, np.newaxis]
    weight = weight.astype(np.float32)
    smooth_left, smooth_right = _smoothed(left), _smoothed(right)
    seen = _look_up(smooth_left, u, v)
    matched = u - expected - np.float32(offset_px)
    total = np.maximum(weight.sum(axis=1), 1.0)
    shift = np.zeros(count, dtype=np.float32)
    ridge = np.eye(3) * 1e-2
    for _ in range(_ITERATIONS):
        x = matched - shift[:, np.newaxis]
        other = _look_up(smooth_right, x, v)
        slope = _look_up(smooth_right, x - np.float32(0.5), v)
        slope -= _look_up(smooth_right, x + np.float32(0.5), v)
        # seen = gain * other + offset + slope * more, least squares over the samples.
        design = np.stack([other, np.ones_like(other), slope], axis=1)
        weighted = design * weight[:, np.newaxis]
        normal = weighted @ design.transpose(0, 2, 1) + ridge
        right_side = weighted @ seen[:, :, np.newaxis]
        solution = np.linalg.solve(normal.astype(np.float64), right_side.astype(np.float64))[..., 0]
        more = solution[:, 2] / np.clip(solution[:, 0], 0.3, 3.0)
        shift += np.clip(more, -0.5, 0.5).astype(np.float32)
        np.clip(shift, -_FARTHEST_PX, _FARTHEST_PX, out=shift)
    residual = seen - (design.transpose(0, 2, 1) @ solution[:, :, np.newaxis])[..., 0]
    variance = np.maximum((weight * residual**2).sum(axis=1) / total, 1.0)
    mean_slope = (weight * slope).sum(axis=1) / total
    texture = (weight * (slope - mean_slope[:, np.newaxis]) ** 2).sum(axis=1)
    return Vote(
        shift=shift.astype(np.float64),
        sigma=np.sqrt(variance / np.maximum(texture, 1e-3)),
        contrast=_contrast(
            smooth_left, smooth_right, patches, shift + np.float32(offset_px), solution
        ),
    )


def _contrast(
    left: Float32, right: Float32, patches: Patches, offset: Float32, fitted: Float
) -> Float32:
    """Cost of matching behind the bodies against that of matching at them.

    StereoBM's windows make thin things wide; the pixels themselves tell what is in front.

    Args:
        left: Smoothed left image.
        right: Smoothed right image.
        patches: The patches.
        offset: Disparity of the bodies beyond their patches' [px], shape (n,).
        fitted: Gain and offset of the grey levels from right to left, shape (n, 2 or more).
    """
    shape = (len(patches) * len(HEIGHTS), len(ACROSS))
    seen = _look_up(left, patches.u.reshape(shape), patches.v.reshape(shape)).reshape(
        patches.u.shape
    )
    gain, level = (fitted[:, k].astype(np.float32)[:, np.newaxis, np.newaxis] for k in (0, 1))
    matched = patches.u - patches.expected - offset[:, np.newaxis, np.newaxis]
    reach = np.maximum(patches.tolerance / MATCHING_ERROR_PX, 1.0).astype(np.float32)
    costs = []
    for behind in (0.0, *_BEHIND_PX):
        x = matched + behind * reach[:, np.newaxis, np.newaxis]
        other = _look_up(right, x.reshape(shape), patches.v.reshape(shape)).reshape(x.shape)
        costs.append(_blurred(np.abs(seen - gain * other - level)))
    there, elsewhere = costs[0], np.minimum.reduce(costs[1:])
    contrast: Float32 = (elsewhere - there) / (elsewhere + there + np.float32(_NOISE))
    contrast[~patches.inside] = 0.0
    return contrast


def _blurred(patches: Float32) -> Float32:
    """Means over 3 x 3 samples, patch by patch; shape (n, heights, across), n up to 512."""
    # As channels of one image, so that no patch gets anything from its neighbour.
    channels: Any = cv2.blur(np.ascontiguousarray(np.moveaxis(patches, 0, -1)), (3, 3))
    apart = np.moveaxis(channels.reshape(*patches.shape[1:], -1), -1, 0)
    return np.asarray(apart, dtype=np.float32)


def _smoothed(image: Gray) -> Float32:
    smooth: Any = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR_PX)
    return np.asarray(smooth, dtype=np.float32)


def _look_up(image: Float32, u: Float32, v: Float32) -> Float32:
    """Bilinear values of an image at (u, v), the border repeated."""
    values: Any = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float32)
