"""Images to disparities. The block matching itself is OpenCV's."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.config import Disparity
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray, StereoImages
from oracle.arrays import Float32
from oracle.head import scale_of, vertical_scale_of


def disparity_of(images: StereoImages, camera: StereoCamera, config: Disparity) -> Float32:
    """Disparity of the left image [px], NaN where there is none, shape (height, width)."""
    greatest = scale_of(camera) / config.min_range + camera.disparity_offset_px
    horizontal = _match(images.left, images.right, greatest, config)
    if not camera.vertical_baseline:
        return horizontal
    assert images.top is not None
    # A camera above becomes one to the right when the images are turned clockwise.
    turns = -1 if camera.vertical_baseline > 0 else 1
    pair = [np.ascontiguousarray(np.rot90(image, turns)) for image in (images.left, images.top)]
    vertical_scale = vertical_scale_of(camera)
    greatest = vertical_scale / config.min_range + camera.vertical_offset_px
    vertical = np.rot90(_match(pair[0], pair[1], greatest, config), -turns)
    ratio = np.float32(scale_of(camera) / vertical_scale)
    result = np.full_like(horizontal, np.nan)
    for row, column in np.ndindex(horizontal.shape):
        one = horizontal[row, column]
        other = (vertical[row, column] - np.float32(camera.vertical_offset_px)) * ratio
        other += np.float32(camera.disparity_offset_px)
        if math.isnan(one) or math.isnan(other):
            result[row, column] = other if math.isnan(one) else one
        elif abs(one - other) <= np.float32(config.trinocular_difference_px):
            result[row, column] = (one + other) * np.float32(0.5)
    return result


def _match(left: Gray, right: Gray, greatest_px: float, config: Disparity) -> Float32:
    """StereoBM on images that are padded by what it leaves out; where it has a value inside."""
    searched = 16 * max(1, math.ceil((greatest_px + 1.0) / 16))
    blocks = [config.block_size_px, config.fill_block_size_px]
    half = max(blocks) // 2
    margin = ((half, half), (searched + half, half))
    padded = [np.pad(image, margin, mode="edge") for image in (left, right)]
    passes = [_stereo_bm(config, block, searched).compute(*padded) for block in blocks if block]
    result = np.full(left.shape, np.nan, dtype=np.float32)
    for row, column in np.ndindex(left.shape):
        for fixed in passes:
            value = int(fixed[row + half, column + searched + half])
            if 0 <= value <= 16 * column:
                result[row, column] = value / 16
                break
    return result


def _stereo_bm(config: Disparity, block: int, searched: int) -> Any:
    bm: Any = cv2.StereoBM_create(searched, block)  # type: ignore[attr-defined]
    sobel, normalized = cv2.STEREO_BM_PREFILTER_XSOBEL, cv2.STEREO_BM_PREFILTER_NORMALIZED_RESPONSE
    bm.setPreFilterType(sobel if config.pre_filter == "xsobel" else normalized)
    bm.setPreFilterSize(config.pre_filter_size_px)
    bm.setPreFilterCap(config.pre_filter_cap)
    bm.setUniquenessRatio(config.uniqueness_ratio)
    bm.setTextureThreshold(config.texture_threshold)
    bm.setDisp12MaxDiff(config.left_right_difference_px)
    return bm
