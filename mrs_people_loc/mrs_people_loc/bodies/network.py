"""A convolutional network that sees people in the left image, asked at bodies.

It sees the whole image at once, so that its cost hardly grows with the bodies, and gives features
of each 4 x 4 pixels. These are sampled in an upright window of a body, in metres, so that bodies
have one size at any range, and a small second network judges whether a person stands just there.
`train_network.py` of the studies trains both together on photographs and renderings; their weights
are in `person_features.onnx` and `person_window.onnx`.
"""

from __future__ import annotations

from importlib import resources
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32
from mrs_people_loc.bodies.patches import in_rows, upright_pixels
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray

_FEATURES, _WINDOW = "person_features.onnx", "person_window.onnx"
#: Focal length at which the network is trained [px]; images of longer lenses are reduced to it.
FOCAL = 140.0
#: Pixels of a cell of the features, and what the sides of the network's image are a multiple of.
CELL, MULTIPLE = 4, 32
#: The second channel is normalized by what is around, in a square of this size [px].
_AROUND = (17, 17)
#: Added to standard deviations [square roots of grey levels]: noise stays small.
_LEAST_CONTRAST = np.float32(0.5)
#: Samples of a window from top to bottom and from left to right; its edges over the floor and half
#: of its width [m].
ROWS, COLUMNS = 12, 6
LOW, HIGH, HALF_WIDTH = -0.1, 2.1, 0.55
#: Samples over the floor, and to the left of a body's axis [m].
WINDOW_HEIGHTS: Float32 = (HIGH - (np.arange(ROWS) + 0.5) * (HIGH - LOW) / ROWS).astype(np.float32)
WINDOW_ACROSS: Float32 = (HALF_WIDTH * (1.0 - (2.0 * np.arange(COLUMNS) + 1.0) / COLUMNS)).astype(
    np.float32
)
#: A window is told its size as the logarithm of its pixels of a metre over so many.
MIDDLE_SIZE = 60.0


class PersonNetwork:
    """Sees people in the images of one head. Not for several threads at once.

    Args:
        camera: The head.

    Raises:
        ConfigError: A network is missing or cannot be read.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self._scale = min(1.0, FOCAL / camera.fx)
        self._size = (round(camera.width * self._scale), round(camera.height * self._scale))
        self._see, self._judge = _read(_FEATURES), _read(_WINDOW)

    def __call__(self, left: Gray, bearing: Float, ranges: Float) -> Float:
        """Log-odds of a person, about -6 to 6, shape (n,).

        Args:
            left: Left image, uint8, shape (height, width).
            bearing: Of the bodies' axes, from the lens [rad], shape (n,).
            ranges: Likewise, horizontal [m], shape (n,).
        """
        if not len(bearing):
            return np.zeros(0)
        place = self.camera, bearing, ranges
        u, v, _, inside = upright_pixels(*place, WINDOW_HEIGHTS, WINDOW_ACROSS)
        size = self.camera.fx * self._scale / ranges
        self._judge.setInput(window_input(self._sampled(self.features(left), u, v), inside, size))
        return np.asarray(self._judge.forward(), dtype=np.float64).reshape(-1)

    def features(self, left: Gray) -> Float32:
        """Features of cells, shape (rows, columns, channels).

        Args:
            left: Left image, uint8, shape (height, width).
        """
        if self._scale < 1.0:
            left = np.asarray(cv2.resize(left, self._size, interpolation=cv2.INTER_AREA))
        self._see.setInput(normalized(left)[np.newaxis])
        return np.ascontiguousarray(self._see.forward()[0].transpose(1, 2, 0))

    def _sampled(self, features: Float32, u: Any, v: Any) -> Float32:
        """Features at pixels of the image, shape (n, rows, columns, channels)."""
        cell, half = np.float32(self._scale / CELL), np.float32(0.5)
        column, row = (in_rows((pixel + half) * cell - half) for pixel in (u, v))
        border = cv2.BORDER_REPLICATE
        values: Any = cv2.remap(features, column, row, cv2.INTER_LINEAR, borderMode=border)
        return np.asarray(values.reshape(*u.shape, features.shape[2]))


def _read(name: str) -> Any:
    try:
        data = resources.files("mrs_people_loc.bodies").joinpath(name).read_bytes()
        return cv2.dnn.readNetFromONNX(np.frombuffer(data, dtype=np.uint8))
    except (OSError, cv2.error) as err:
        raise ConfigError(f"{name} cannot be read; wanted: the file of this package") from err


def normalized(grey: Gray) -> Float32:
    """The input of the network: square roots of grey values, normalized in the image and around.

    Args:
        grey: Shape (height, width).

    Returns:
        Two channels, float32, with zeros below and to the right up to multiples of `MULTIPLE`.
    """
    root = np.sqrt(grey.astype(np.float32) + np.float32(1.0))
    mean = np.asarray(cv2.blur(root, _AROUND))
    variance = np.maximum(np.asarray(cv2.blur(root * root, _AROUND)) - mean * mean, 0.0)
    whole = root - root.mean()
    rows, columns = root.shape
    made = np.zeros((2, rows + -rows % MULTIPLE, columns + -columns % MULTIPLE), np.float32)
    made[0, :rows, :columns] = whole / (np.sqrt((whole * whole).mean()) + _LEAST_CONTRAST)
    made[1, :rows, :columns] = (root - mean) / (np.sqrt(variance) + _LEAST_CONTRAST)
    return made


def window_input(features: Float32, inside: Bool, size: Float) -> Float32:
    """The input of the network that judges windows, shape (n, `ROWS` * `COLUMNS` * (c + 1) + 1).

    Args:
        features: Shape (n, `ROWS`, `COLUMNS`, c).
        inside: Which samples are in the image, shape (n, `ROWS`, `COLUMNS`).
        size: Pixels of a metre in the network's image, shape (n,).
    """
    mask = inside[..., np.newaxis].astype(np.float32)
    seen = np.concatenate([features * mask, mask], axis=3).reshape(len(size), -1)
    told = np.log(size / MIDDLE_SIZE).astype(np.float32)[:, np.newaxis]
    return np.concatenate([seen, told], axis=1)
