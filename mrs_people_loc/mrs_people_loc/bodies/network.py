"""A small convolutional network that recognizes people in the left image.

At each place where a body may be, the grey values of an upright window that faces the lens are
sampled in metres, so that bodies have one size at any range. The network sees them with a mask of
what is in the image. `train_network.py` of the studies trains it on simulated rooms only; its
weights are in `person_network.onnx`.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray

_FILE = "person_network.onnx"
#: Samples from top to bottom and from left to right; edges of the window over the floor and half
#: of its width [m]. The network is trained with them.
ROWS, COLUMNS = 48, 24
LOW, HIGH, HALF_WIDTH = -0.1, 2.1, 0.55
#: Distance of two rows of samples [m].
_STEP = (HIGH - LOW) / ROWS
_HEIGHTS: Float32 = (HIGH - (np.arange(ROWS) + 0.5) * _STEP).astype(np.float32)
_ACROSS: Float32 = (HALF_WIDTH * (1.0 - (2.0 * np.arange(COLUMNS) + 1.0) / COLUMNS)).astype(
    np.float32
)
#: Where a row covers as many pixels as the first number, the image is smoothed by the second one
#: (sigma) first [px].
_SMOOTHING = ((1.25, 0.7), (2.5, 1.4))
#: Windows nearer than this are smoothed as if they were there [m].
_LEAST_RANGE = 0.3
#: Samples with less depth than this are not in the image [m].
_LEAST_DEPTH = np.float32(0.05)
#: Added to the standard deviation of a window [square roots of grey levels]: noise stays small.
_LEAST_CONTRAST = np.float32(0.5)


class PersonNetwork:
    """Scores places in the images of one head. Not for several threads at once.

    Args:
        camera: The head.

    Raises:
        ConfigError: The file of the network is missing or cannot be read.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self._network = read_network(_FILE)

    def __call__(self, left: Gray, bearing: Float, ranges: Float) -> Float:
        """Log-odds of a person, about -5 to 5, shape (n,).

        Args:
            left: Left image, uint8, shape (height, width).
            bearing: Of the bodies' axes, from the lens [rad], shape (n,).
            ranges: Likewise, horizontal [m], shape (n,).
        """
        if not len(bearing):
            return np.zeros(0)
        grey, inside = sample_windows(self.camera, left, bearing, ranges)
        self._network.setInput(normalized(grey, inside))
        return np.asarray(self._network.forward(), dtype=np.float64).reshape(-1)


def read_network(file: str | Path) -> Any:
    """A network.

    Args:
        file: Its name in this package, or its path.

    Raises:
        ConfigError: It is missing or cannot be read.
    """
    try:
        own = resources.files("mrs_people_loc.bodies")
        data = (file if isinstance(file, Path) else own.joinpath(file)).read_bytes()
        return cv2.dnn.readNetFromONNX(np.frombuffer(data, dtype=np.uint8))
    except (OSError, cv2.error) as err:
        raise ConfigError(f"{file} cannot be read; wanted: the file of this package") from err


def sample_windows(
    camera: StereoCamera, left: Gray, bearing: Float, ranges: Float
) -> tuple[Float32, Bool]:
    """Grey values of the windows and which samples are in the image, shape (n, `ROWS`, `COLUMNS`).

    Beyond the image its border is repeated. Args: as those of `PersonNetwork`.
    """
    u, v, inside = upright_pixels(camera, bearing, ranges, _HEIGHTS, _ACROSS)
    covered = camera.fx * _STEP / np.maximum(ranges, _LEAST_RANGE)
    level = np.searchsorted([px for px, _ in _SMOOTHING], covered, side="right")
    image: Any = left.astype(np.float32)
    values = np.empty(u.shape, dtype=np.float32)
    for k in np.unique(level):
        mine = level == k
        smooth = cv2.GaussianBlur(image, (0, 0), _SMOOTHING[k - 1][1]) if k else image
        values[mine] = cv2.remap(
            smooth,
            u[mine].reshape(-1, COLUMNS),
            v[mine].reshape(-1, COLUMNS),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ).reshape(-1, ROWS, COLUMNS)
    return values, inside


def upright_pixels(
    camera: StereoCamera, bearing: Float, ranges: Float, heights: Float32, across: Float32
) -> tuple[Any, Any, Any]:
    """Columns and rows [px] of the samples of upright windows, and whether they are in the image.

    Args:
        camera: The head.
        bearing: Of the windows' axes, from the lens [rad], shape (n,).
        ranges: Likewise, horizontal [m].
        heights: Of the samples over the floor [m], float32, shape (rows,).
        across: How far they are to the left of the axis [m], float32, shape (columns,).

    Returns:
        Shapes (n, rows, columns).
    """
    rotation, lens = camera.robot_from_optical
    cos, sin, zero = np.cos(bearing), np.sin(bearing), np.zeros_like(bearing)
    away: Any = np.stack([ranges * cos, ranges * sin, zero], axis=1) @ rotation
    aside: Any = np.stack([-sin, cos, zero], axis=1) @ rotation
    up: Any = (heights - lens[2])[:, np.newaxis]
    x, y, z = (
        (away[:, k, np.newaxis, np.newaxis] + up * rotation[2, k]).astype(np.float32)
        + aside[:, k, np.newaxis, np.newaxis].astype(np.float32) * across
        for k in range(3)
    )
    inverse = 1.0 / np.maximum(z, _LEAST_DEPTH)
    u = x * inverse * np.float32(camera.fx) + np.float32(camera.cx)
    v = y * inverse * np.float32(camera.fy) + np.float32(camera.cy)
    inside = (z > _LEAST_DEPTH) & (u > -0.5) & (u < camera.width - 0.5)
    inside &= (v > -0.5) & (v < camera.height - 0.5)
    return u, v, inside


def normalized(grey: Float32, inside: Bool) -> Float32:
    """The input of the network: normalized square roots of grey values, and what is in the image.

    Args:
        grey: Shape (n, rows, columns).
        inside: Which samples count, likewise; the others become 0.

    Returns:
        Shape (n, 2, rows, columns), float32.
    """
    mask = inside.astype(np.float32)
    count = np.maximum(mask.sum(axis=(1, 2), keepdims=True), 1.0)
    root = np.sqrt(grey + np.float32(1.0))
    offset = (root - (root * mask).sum(axis=(1, 2), keepdims=True) / count) * mask
    deviation = np.sqrt((offset**2).sum(axis=(1, 2), keepdims=True) / count)
    return np.stack([offset / (deviation + _LEAST_CONTRAST), mask], axis=1)
