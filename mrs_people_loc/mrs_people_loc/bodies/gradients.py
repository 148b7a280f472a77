"""Histograms of oriented gradients of upright windows in an image (Dalal & Triggs 2005).

A window is a vertical rectangle in metres that faces the lens. Its grey values are sampled wherever
it is in the image, so that bodies have one size and stand upright at any range. The histograms are
those of OpenCV's `HOGDescriptor`: blocks of 2 x 2 cells of 8 x 8 samples, at every cell; 9 unsigned
orientations; square roots of grey values; weights linear between cells and orientations, and
Gaussian within a block; L2-Hys normalization.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32
from mrs_people_loc.bodies.patches import optical_from_upright
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
#: No window is nearer than this [m].
_LEAST_RANGE = 0.3


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
        self._step = (window.high - window.low) / window.rows
        across = window.width / window.columns
        row, column = np.arange(-1, window.rows + 1), np.arange(-1, window.columns + 1)
        # With a border of one sample, for the gradients at the edges.
        self._heights = (window.high - (row + 0.5) * self._step).astype(np.float32)
        self._across = (0.5 * window.width - (column + 0.5) * across).astype(np.float32)
        row, column = (np.arange(1, n // CELL) * CELL for n in (window.rows, window.columns))
        self._block_heights = (window.high - row * self._step).astype(np.float32)
        self._block_across = (0.5 * window.width - column * across).astype(np.float32)

    def __call__(self, left: Gray, bearing: Float, ranges: Float) -> Histograms:
        """Histograms at some places.

        Args:
            left: Left image, uint8, shape (height, width).
            bearing: From the lens [rad], shape (n,).
            ranges: Horizontal, from the lens [m], shape (n,).
        """
        return Histograms(
            values=histograms_of(self.grey(left, bearing, ranges)),
            inside=self.inside(bearing, ranges),
        )

    def grey(self, left: Gray, bearing: Float, ranges: Float) -> Float32:
        """Grey values with a border of one sample, shape (n, rows + 2, columns + 2).

        Beyond the image its border is repeated. Args: as those of a call.
        """
        u, v, _ = self._pixels(bearing, ranges, self._heights, self._across)
        covered = self.camera.fx * self._step / np.maximum(ranges, _LEAST_RANGE)
        level = sum((covered > px).astype(int) for px, _ in _SMOOTHING[1:])
        values = np.empty(u.shape, dtype=np.float32)
        image: Any = left.astype(np.float32)
        for k in np.unique(level):
            sigma = _SMOOTHING[k][1]
            smooth = cv2.GaussianBlur(image, (0, 0), sigma) if sigma else image
            mine = level == k
            flat = (-1, u.shape[2])
            seen: Any = cv2.remap(
                smooth, u[mine].reshape(flat), v[mine].reshape(flat), cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
            values[mine] = seen.reshape(-1, *u.shape[1:])
        return values

    def inside(self, bearing: Float, ranges: Float) -> Bool:
        """Blocks whose middle is in the image, shape (n, blocks)."""
        camera = self.camera
        u, v, z = self._pixels(bearing, ranges, self._block_heights, self._block_across)
        inside = (z > 0.1) & (u > 0) & (u < camera.width - 1) & (v > 0) & (v < camera.height - 1)
        return np.asarray(inside.transpose(0, 2, 1).reshape(len(u), self.window.blocks))

    def _pixels(
        self, bearing: Float, ranges: Float, heights: Float32, across: Float32
    ) -> tuple[Any, Any, Any]:
        """Columns, rows [px] and depths [m], shape (n, heights, across) each."""
        camera = self.camera
        x, y, z = optical_from_upright(camera, bearing, ranges, heights, across)
        inverse = 1.0 / np.maximum(z, np.float32(0.05))
        u = x * inverse * np.float32(camera.fx) + np.float32(camera.cx)
        v = y * inverse * np.float32(camera.fy) + np.float32(camera.cy)
        return u, v, z


def histograms_of(grey: Float32) -> Float32:
    """Histograms of windows.

    Args:
        grey: Grey values with a border of one sample, shape (n, rows + 2, columns + 2), float32.

    Returns:
        As `Histograms.values`.
    """
    count, rows, columns = len(grey), grey.shape[1] - 2, grey.shape[2] - 2
    down, right = rows // CELL - 1, columns // CELL - 1
    if not count:
        return np.zeros((0, down * right, BLOCK), dtype=np.float32)
    cells: Any = _weights(rows) @ _votes(grey) @ _weights(columns).T
    blocks = cells.reshape(count, BINS, down, 2, right, 2).transpose(0, 4, 2, 5, 3, 1)
    blocks = blocks.reshape(count, right * down, BLOCK)
    blocks = blocks / (_norm(blocks) + _FIRST_ADDED)
    blocks = np.minimum(blocks, _CLIP)
    return np.asarray(blocks / (_norm(blocks) + _THEN_ADDED))


def _norm(blocks: Any) -> Any:
    return np.sqrt((blocks * blocks).sum(axis=2, keepdims=True))


def _votes(grey: Float32) -> Float32:
    """Magnitude of the gradients by orientation, shape (n, `BINS`, rows, columns)."""
    root = np.sqrt(grey)
    right: Any = root[:, 1:-1, 2:] - root[:, 1:-1, :-2]
    down: Any = root[:, 2:, 1:-1] - root[:, :-2, 1:-1]
    count, rows, columns = right.shape
    size, angle = cv2.cartToPolar(right.reshape(-1, columns), down.reshape(-1, columns))
    angle = angle * np.float32(BINS / np.pi) - np.float32(0.5)
    low = np.floor(angle)
    above = (size * (angle - low)).reshape(count, 1, -1)
    below = size.reshape(count, 1, -1) - above
    first = low.astype(np.intp).reshape(count, 1, -1) % BINS
    votes = np.zeros((count, BINS, rows * columns), dtype=np.float32)
    np.put_along_axis(votes, first, below, axis=1)
    np.put_along_axis(votes, (first + 1) % BINS, above, axis=1)
    return votes.reshape(count, BINS, rows, columns)


def _weights(samples: int) -> Float32:
    """Weights of the samples along one side of a window, a row for each half of each block.

    Linear between the middles of cells, times a Gaussian whose sigma is a quarter of a block.
    """
    side = 2 * CELL
    place = np.arange(side)
    gauss = np.exp(-0.5 * ((place - 0.5 * side) / (0.25 * side)) ** 2)
    halves = [
        gauss * np.clip(1.0 - np.abs((place + 0.5) / CELL - 0.5 - half), 0.0, None)
        for half in (0, 1)
    ]
    weights = np.zeros((samples // CELL - 1, 2, samples), dtype=np.float32)
    for block, rows in enumerate(weights):
        rows[:, block * CELL : block * CELL + side] = halves
    return weights.reshape(-1, samples)
