"""Disparity by StereoBM (SAD block matching), on horizontal and vertical pairs."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc import timing
from mrs_people_loc.arrays import Float32
from mrs_people_loc.errors import CameraError, ImageError
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray, StereoImages

#: StereoBM's results are in sixteenths of a pixel.
SUBPIXELS = 16
_STEP = 16  # StereoBM searches multiples of this


class StereoMatcher:
    """Disparity images of one head.

    The search range follows from the working distances: disparities up to that of `min_range`.
    StereoBM leaves a margin without values (the searched range on the left and half a block on
    each side); the images are padded by that margin, so no column or row is lost. A small window
    keeps a body's border and leaves holes; a second pass with a larger one fills them
    (`fill_block_size_px`).

    Args:
        camera: The head.
        config: Matching parameters.

    Attributes:
        searched_px: Disparities that StereoBM searches, for each pair.

    Raises:
        CameraError: The search range does not fit the image.
    """

    def __init__(self, camera: StereoCamera, config: cfg.Disparity) -> None:
        self.camera = camera
        self.config = config
        self._horizontal = _BlockMatcher(
            camera.disparity_of(config.min_range), config, camera.width
        )
        self._vertical: _BlockMatcher | None = None
        if camera.vertical_baseline:
            vertical_range = abs(camera.vertical_baseline) * camera.fy / config.min_range
            self._vertical = _BlockMatcher(
                vertical_range + camera.vertical_offset_px, config, camera.height
            )
        self._pairs = [pair for pair in (self._horizontal, self._vertical) if pair is not None]
        self.searched_px = tuple(pair.searched_px for pair in self._pairs)

    @property
    def stereo_bm_ms(self) -> float:
        """What StereoBM itself took of the last call, all pairs [ms]."""
        return sum(pair.took_ns for pair in self._pairs) / 1e6

    def __call__(self, images: StereoImages) -> Float32:
        """Disparity of the left image.

        Args:
            images: Rectified images of the camera's size; `top` is needed for a trinocular head.

        Returns:
            Disparity of the horizontal pair [px], float32, shape (height, width), NaN where there
            is none.

        Raises:
            ImageError: The size differs from the camera's, or `top` is missing.
        """
        wanted = (self.camera.height, self.camera.width)
        if images.left.shape != wanted:
            raise ImageError(
                f"images are {images.left.shape[1]}x{images.left.shape[0]}; "
                f"wanted as the camera: {wanted[1]}x{wanted[0]}"
            )
        horizontal = self._horizontal(images.left, images.right)
        if self._vertical is None:
            return horizontal
        if images.top is None:
            raise ImageError("the head is trinocular but there is no top image")
        # StereoBM matches along rows: turned by a quarter, a camera above becomes one to the
        # right (clockwise), one below too (counterclockwise).
        above = self.camera.vertical_baseline > 0
        turn = cv2.ROTATE_90_CLOCKWISE if above else cv2.ROTATE_90_COUNTERCLOCKWISE
        back = cv2.ROTATE_90_COUNTERCLOCKWISE if above else cv2.ROTATE_90_CLOCKWISE
        vertical = self._vertical(_rotated(images.left, turn), _rotated(images.top, turn))
        camera = self.camera
        ratio = camera.depth_disparity / (abs(camera.vertical_baseline) * camera.fy)
        vertical = np.asarray(cv2.rotate(vertical, back), dtype=np.float32)
        vertical -= np.float32(camera.vertical_offset_px)
        vertical *= np.float32(ratio)
        vertical += np.float32(camera.disparity_offset_px)
        return combine(horizontal, vertical, max_difference_px=self.config.trinocular_difference_px)


def combine(horizontal: Float32, vertical: Float32, *, max_difference_px: float) -> Float32:
    """Joins the disparities of the two pairs of a trinocular head.

    Where both have a value they must agree, and the result is their mean; where one has, it
    counts: an edge along one pair's baseline is seen by the other pair only.

    Args:
        horizontal: Disparity [px], NaN where there is none.
        vertical: Disparity of the vertical pair, in pixels of the horizontal pair, same shape.
        max_difference_px: Agreement [px].

    Returns:
        Disparity [px], float32, the same shape, NaN where there is none or no agreement.
    """
    # Where only one has a value, fmax and fmin both give that one.
    joined = (np.fmax(horizontal, vertical) + np.fmin(horizontal, vertical)) * np.float32(0.5)
    joined[np.abs(horizontal - vertical) > max_difference_px] = np.nan
    return joined


class _BlockMatcher:
    """StereoBM for one pair, with padding."""

    def __init__(self, max_disparity_px: float, config: cfg.Disparity, width: int) -> None:
        searched = _STEP * max(1, math.ceil((max_disparity_px + 1.0) / _STEP))
        if searched >= width:
            raise CameraError(
                f"disparity.min_range = {config.min_range:g} m asks for {searched} px of "
                f"disparity in an image of {width} px; allowed: less (raise min_range)"
            )
        self.searched_px = searched
        self.took_ns = 0
        half = max(config.block_size_px, config.fill_block_size_px) // 2
        self._pad = (half, half, searched + half, half)  # top, bottom, left, right
        columns = np.arange(width) * SUBPIXELS
        self._greatest = np.minimum(columns, np.iinfo(np.int16).max).astype(np.uint16)
        self._passes = [make_stereo_bm(config, searched)]
        if config.fill_block_size_px:
            fill = dataclasses.replace(config, block_size_px=config.fill_block_size_px)
            self._passes.append(make_stereo_bm(fill, searched))

    def __call__(self, left: Gray, right: Gray) -> Float32:
        height, width = left.shape
        top, _, start, _ = self._pad
        fixed, *fills = (
            raw[top : top + height, start : start + width] for raw in self.raw(left, right)
        )
        # Below 0, that is large without the sign: no match. More than the column: the match would
        # lie outside the right image.
        missing = fixed.view(np.uint16) > self._greatest
        for fill in fills:
            fixed = np.where(missing, fill, fixed)
            missing = fixed.view(np.uint16) > self._greatest
        disparity = fixed.astype(np.float32)
        disparity *= np.float32(1.0 / SUBPIXELS)
        disparity[missing] = np.nan
        return disparity

    def raw(self, left: Gray, right: Gray) -> list[NDArray[np.int16]]:
        """StereoBM's own results on the padded images, in sixteenths of a pixel, pass by pass."""
        left = cv2.copyMakeBorder(left, *self._pad, cv2.BORDER_REPLICATE)  # type: ignore[assignment]
        right = cv2.copyMakeBorder(right, *self._pad, cv2.BORDER_REPLICATE)  # type: ignore[assignment]
        began = timing.now_ns()
        results: list[NDArray[np.int16]] = [bm.compute(left, right) for bm in self._passes]
        self.took_ns = timing.now_ns() - began
        return results


def make_stereo_bm(config: cfg.Disparity, searched_px: int) -> Any:
    """OpenCV's StereoBM as configured.

    Args:
        config: Matching parameters.
        searched_px: Disparities to search, a multiple of 16.
    """
    bm: Any = cv2.StereoBM_create(  # type: ignore[attr-defined]
        numDisparities=searched_px, blockSize=config.block_size_px
    )
    bm.setPreFilterType(
        cv2.STEREO_BM_PREFILTER_XSOBEL
        if config.pre_filter == "xsobel"
        else cv2.STEREO_BM_PREFILTER_NORMALIZED_RESPONSE
    )
    bm.setPreFilterSize(config.pre_filter_size_px)
    bm.setPreFilterCap(config.pre_filter_cap)
    bm.setUniquenessRatio(config.uniqueness_ratio)
    bm.setTextureThreshold(config.texture_threshold)
    bm.setDisp12MaxDiff(config.left_right_difference_px)
    return bm


def _rotated(image: Gray, turn: int) -> Gray:
    rotated: Any = cv2.rotate(image, turn)
    return np.asarray(rotated, dtype=np.uint8)
