"""A convolutional network that sees where people are in the left image, read at bodies.

It judges the whole image at once, so that its cost does not grow with the bodies: a map of
log-odds, one for each 4 x 4 pixels, that they show a person. The map is read where the legs, the
trunk and the head of a body would be, at those samples of the body's patch that nothing nearer
hides. The middle one of the three counts, as one of them is often hidden or blurred.
`train_map.py` of the studies trains the network on photographs and renderings; its weights are in
`person_map.onnx`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.bodies.network import read_network
from mrs_people_loc.bodies.patches import HEIGHTS, TRUNK, Patches, in_rows
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray

_FILE = "person_map.onnx"
#: Focal length at which the network is trained [px]; images of longer lenses are reduced to it.
FOCAL = 140.0
#: Pixels of a cell of the map, and what the sides of the network's image are a multiple of.
CELL, MULTIPLE = 4, 32
#: The second channel is normalized by what is around, in a square of this size [px].
_AROUND = (17, 17)
#: Added to standard deviations [square roots of grey levels]: noise stays small.
_LEAST_CONTRAST = np.float32(0.5)
#: Where the map is read for each part [m]: legs, trunk, head.
_PARTS = (0.2, 0.9), (0.9, 1.3), (1.3, 1.9)
#: So many samples beside those that are seen are taken to say nothing: few say less.
_UNKNOWN = 6.0
#: Which rows of a patch are of each part, shape (rows, parts).
_ROWS: Float = np.array(
    [[float(low <= height < high) for low, high in _PARTS] for height in HEIGHTS.tolist()]
)


class PersonMap:
    """Sees people in the images of one head. Not for several threads at once.

    Args:
        camera: The head.
        file: A network, as `train_map.py` writes it; the package's own if None.

    Raises:
        ConfigError: The network is missing or cannot be read.
    """

    def __init__(self, camera: StereoCamera, file: Path | None = None) -> None:
        self.camera = camera
        self._scale = min(1.0, FOCAL / camera.fx)
        self._size = (round(camera.width * self._scale), round(camera.height * self._scale))
        self._network = read_network(file or _FILE)

    def __call__(self, left: Gray, patches: Patches) -> Float:
        """Log-odds of a person by the middle part of bodies, shape (n,); 0 where it is not seen.

        Args:
            left: Left image, uint8, shape (height, width).
            patches: Of the bodies.
        """
        if not len(patches):
            return np.zeros(0)
        cell = np.float32(self._scale / CELL)
        column, row = (
            in_rows((pixel[..., TRUNK] + 0.5) * cell - 0.5) for pixel in (patches.u, patches.v)
        )
        border = cv2.BORDER_REPLICATE
        log_odds = self.log_odds(left)
        shown: Any = cv2.remap(log_odds, column, row, cv2.INTER_LINEAR, borderMode=border)
        tolerance = patches.tolerance[:, np.newaxis, np.newaxis]
        with np.errstate(invalid="ignore"):
            nearer = patches.difference[..., TRUNK] > tolerance
        seen = patches.inside[..., TRUNK] & ~nearer
        total = np.where(seen, shown.reshape(seen.shape), 0.0).sum(axis=2)
        parts = (total @ _ROWS) / (seen.sum(axis=2) @ _ROWS + _UNKNOWN)
        return np.asarray(np.median(parts, axis=1))

    def log_odds(self, left: Gray) -> Float32:
        """The map, about -4 to 4, shape (rows, columns).

        Args:
            left: Left image, uint8, shape (height, width).
        """
        if self._scale < 1.0:
            left = np.asarray(cv2.resize(left, self._size, interpolation=cv2.INTER_AREA))
        self._network.setInput(normalized(left)[np.newaxis])
        return np.asarray(self._network.forward()[0, 0], dtype=np.float32)


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
    around = (root - mean) / (np.sqrt(variance) + _LEAST_CONTRAST)
    whole = (root - root.mean()) / (root.std() + _LEAST_CONTRAST)
    missing = [(0, 0), *((0, -side % MULTIPLE) for side in root.shape)]
    return np.pad(np.stack([whole, around]), missing)
