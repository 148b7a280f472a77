"""Histograms of oriented gradients of upright windows in an image (Dalal & Triggs 2005).

A window is a vertical rectangle in metres that faces the lens. Its grey values are sampled wherever
it is in the image, so that bodies have one size and stand upright at any range. The histograms are
those of OpenCV's `HOGDescriptor`: blocks of 2 x 2 cells of 8 x 8 samples, at every cell; 9 unsigned
orientations; square roots of grey values; weights linear between cells and orientations, and
Gaussian within a block; L2-Hys normalization.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32, Int
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray

#: Side of a cell [samples], orientations, and numbers of a block's histograms.
CELL, BINS = 8, 9
BLOCK = 4 * BINS
#: L2-Hys: what is added to the norm, at first and after clipping, and where values are clipped.
_FIRST_ADDED, _THEN_ADDED, _CLIP = np.float32(0.1 * BLOCK), np.float32(1e-3), np.float32(0.2)
#: Where a sample covers more pixels than the first number, the image is smoothed by the second one
#: (sigma) before [px].
_SMOOTHING = ((0.0, 0.0), (1.25, 0.7), (2.5, 1.4))
#: No window is nearer than this [m], and no point of one that is looked at nearer than this along
#: the optical axis [m].
_LEAST_RANGE, _LEAST_DEPTH = 0.3, 0.1


@dataclass(frozen=True)
class Window:
    """A window and its samples.

    Attributes:
        low: Its lower edge over the floor [m].
        high: Its upper edge [m].
        width: [m].
        rows: Samples from top to bottom, a multiple of `CELL`.
        columns: Samples from left to right, likewise.
    """

    low: float
    high: float
    width: float
    rows: int
    columns: int

    @property
    def blocks(self) -> int:
        """Number of its blocks."""
        return (self.rows // CELL - 1) * (self.columns // CELL - 1)


@dataclass(frozen=True)
class Histograms:
    """Histograms of n windows.

    Attributes:
        values: Shape (n, blocks, `BLOCK`), float32, in the order of OpenCV: blocks column by
            column, likewise the cells in them, then orientations.
        inside: Blocks whose middle is in the image, shape (n, blocks).
    """

    values: Float32
    inside: Bool


class GradientSampler:
    """Histograms of one kind of window in the images of one head.

    Args:
        camera: The head.
        window: The window.
    """

    def __init__(self, camera: StereoCamera, window: Window) -> None:
        self.camera = camera
        self.window = window
        middles = [np.arange(1, n // CELL) * CELL + 0.5 for n in (window.columns, window.rows)]
        column, row = np.meshgrid(*middles, indexing="ij")
        self._middles = np.stack([column.ravel(), row.ravel(), np.ones(column.size)])

    def __call__(self, left: Gray, bearing: Float, ranges: Float) -> Histograms:
        """Histograms at some places.

        Args:
            left: Left image, uint8, shape (height, width).
            bearing: From the lens [rad], shape (n,).
            ranges: Horizontal, from the lens [m], shape (n,).
        """
        camera, window = self.camera, self.window
        pixels = self.homographies(bearing, ranges)
        u, v, depth = np.moveaxis(pixels @ self._middles, 1, 0)
        ahead = depth > _LEAST_DEPTH
        depth = np.where(ahead, depth, 1.0)
        u, v = u / depth, v / depth
        inside = ahead & (u > 0) & (u < camera.width - 1) & (v > 0) & (v < camera.height - 1)
        values = np.empty((len(ranges), window.blocks, BLOCK), dtype=np.float32)
        for k, grey in enumerate(self._grey(left, pixels, ranges)):
            values[k] = histograms_of(grey)
        return Histograms(values, inside)

    def homographies(self, bearing: Float, ranges: Float) -> Float:
        """From (column, row, 1) of a sample, counted from its border, to the image.

        Args: as those of a call.

        Returns:
            Shape (n, 3, 3); the third of the homogeneous coordinates is the depth [m].
        """
        camera, window = self.camera, self.window
        rotation, translation = camera.robot_from_optical
        across, down = window.width / window.columns, (window.high - window.low) / window.rows
        cos, sin = np.cos(bearing), np.sin(bearing)
        zeros = np.zeros_like(cos)
        left = np.stack([-sin, cos, zeros], axis=1)
        up = np.array([0.0, 0.0, 1.0])
        corner = ranges[:, np.newaxis] * np.stack([cos, sin, zeros], axis=1)
        corner = corner + 0.5 * (window.width + across) * left
        corner = corner + (window.high + 0.5 * down - translation[2]) * up
        axes = np.stack([-across * left, np.broadcast_to(-down * up, left.shape), corner], axis=2)
        return np.asarray(_intrinsics(camera) @ rotation.T @ axes)

    def _grey(self, left: Gray, pixels: Float, ranges: Float) -> Iterator[Float32]:
        """Grey values of each window with a border of one sample, shape (rows + 2, columns + 2).

        Beyond the image its border is repeated.
        """
        window = self.window
        step = (window.high - window.low) / window.rows
        covered = self.camera.fx * step / np.maximum(ranges, _LEAST_RANGE)
        size = window.columns + 2, window.rows + 2
        smooth = functools.cache(lambda sigma: _smoothed(left, sigma))
        for homography, px in zip(pixels, covered, strict=True):
            sigma = [sigma for least, sigma in _SMOOTHING if px > least][-1]
            yield np.asarray(
                cv2.warpPerspective(
                    smooth(sigma), homography, size,
                    flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                    borderMode=cv2.BORDER_REPLICATE,
                )
            )  # fmt: skip


def _intrinsics(camera: StereoCamera) -> Float:
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def _smoothed(image: Gray, sigma_px: float) -> Float32:
    values: Any = image.astype(np.float32)
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma_px) if sigma_px else values)


def histograms_of(grey: Float32) -> Float32:
    """Histograms of one window.

    Args:
        grey: Grey values with a border of one sample, shape (rows + 2, columns + 2), float32.

    Returns:
        Shape (blocks, `BLOCK`), as `Histograms.values`.
    """
    down, right = (grey.shape[0] - 2) // CELL, (grey.shape[1] - 2) // CELL
    # A cell's samples are in one half of a block, and count for the cells of both halves.
    halves: Any = _weights() @ _votes(grey).reshape(CELL, -1)
    halves = halves.reshape(2, 2, CELL, down, right * BINS)
    rows = halves[0, :, :, :-1] + halves[1, :, :, 1:]
    halves = _weights() @ rows.reshape(2, CELL, -1)
    halves = halves.reshape(2, 2, 2, down - 1, right, BINS)
    cells = halves[:, 0, :, :, :-1] + halves[:, 1, :, :, 1:]
    blocks = cells.transpose(3, 2, 1, 0, 4).reshape(-1, BLOCK)
    blocks = np.minimum(blocks / (_norms(blocks) + _FIRST_ADDED), _CLIP)
    return np.asarray(blocks / (_norms(blocks) + _THEN_ADDED))


def _norms(blocks: Any) -> Any:
    return np.sqrt(np.einsum("bk,bk->b", blocks, blocks))[:, np.newaxis]


def _votes(grey: Float32) -> Float32:
    """Magnitudes of the gradients, each shared by two orientations.

    Returns:
        A value for each sample and orientation, in the order of `_Layout.place`.
    """
    root = np.sqrt(grey)
    right: Any = root[1:-1, 2:] - root[1:-1, :-2]
    down: Any = root[2:, 1:-1] - root[:-2, 1:-1]
    size, angle = cv2.cartToPolar(right, down)
    angle = angle * np.float32(BINS / np.pi) + np.float32(0.5)
    above = angle.astype(np.intp)
    share = angle - above.astype(np.float32)
    layout = _layout(*right.shape)
    votes = np.zeros(size.size * BINS, dtype=np.float32)
    votes[layout.below[above] + layout.place] = size * (1.0 - share)
    votes[layout.above[above] + layout.place] = size * share
    return votes


class _Layout(NamedTuple):
    """Where votes are put, so that two products of matrices sum them up.

    Attributes:
        place: Of the first orientation of a sample, shape (rows, columns): by row and column within
            its cell, then by cell.
        below: The lower orientation by the whole part of an angle.
        above: The upper one.
    """

    place: Int
    below: Int
    above: Int


@functools.cache
def _layout(rows: int, columns: int) -> _Layout:
    row, column = np.ogrid[:rows, :columns]
    place = row % CELL * CELL + column % CELL
    place = place * (rows // CELL) + row // CELL
    place = place * (columns // CELL) + column // CELL
    orientation = np.arange(2 * BINS + 2)
    return _Layout(place * BINS, (orientation - 1) % BINS, orientation % BINS)


@functools.cache
def _weights() -> Float32:
    """Weights of a cell's samples along one side, shape (4, `CELL`).

    First in the upper half of a block for its upper and its lower cell, then in the lower half:
    linear between the middles of the cells, times a Gaussian whose sigma is a quarter of the block.
    """
    place = np.arange(2 * CELL)
    gauss = np.exp(-0.5 * ((place - CELL) / (0.5 * CELL)) ** 2)
    cell = np.array([[0], [1]])
    weights = gauss * np.maximum(1.0 - np.abs((place + 0.5) / CELL - 0.5 - cell), 0.0)
    return np.concatenate([weights[:, :CELL], weights[:, CELL:]]).astype(np.float32)
