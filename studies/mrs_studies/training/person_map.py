"""A convolutional network that sees where people are in the left image, read at bodies.

It judges the whole image at once, so that its cost does not grow with the bodies: a map of
log-odds, one for each 4 x 4 pixels, that they show a person. The map is read where the legs, the
trunk and the head of a body would be, and above its head, where nobody is unless somebody nearer is
taken for it. `train_map.py` trains it on photographs. The method does not use it yet.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.bodies.network import upright_pixels
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray

#: Focal length at which the network is trained [px]; images of longer lenses are reduced to it.
FOCAL = 140.0
#: Pixels of a cell of the map, and what the sides of the network's image are a multiple of.
CELL, MULTIPLE = 4, 32
#: Heights over the floor at which the map is read [m], and how far to the left of the axis [m].
HEIGHTS: Float32 = np.arange(0.25, 2.3, 0.1).astype(np.float32)
ACROSS: Float32 = np.array([0.1, 0.0, -0.1], dtype=np.float32)
#: From which height on it is read for each part [m]: legs, trunk, head, above.
PARTS = (0.0, 0.9, 1.3, 1.9)
#: So many samples beside those in the image are taken to say nothing: few say less.
_UNKNOWN = 3.0
#: Added to the standard deviation of an image [square roots of grey levels]: noise stays small.
_LEAST_CONTRAST = np.float32(0.5)


class PersonMap:
    """Sees people in the images of one head. Not for several threads at once.

    Args:
        camera: The head.
        file: The network, as `train_map.py` writes it.
    """

    def __init__(self, camera: StereoCamera, file: Path) -> None:
        self.camera = camera
        self.scale = min(1.0, FOCAL / camera.fx)
        self._size = (round(camera.width * self.scale), round(camera.height * self.scale))
        self._network = cv2.dnn.readNetFromONNX(str(file))

    def __call__(self, left: Gray) -> Float32:
        """Log-odds of a person by cell, about -4 to 4, shape (rows, columns).

        Args:
            left: Left image, uint8, shape (height, width).
        """
        if self.scale < 1.0:
            left = np.asarray(cv2.resize(left, self._size, interpolation=cv2.INTER_AREA))
        self._network.setInput(normalized(left)[np.newaxis, np.newaxis])
        return np.asarray(self._network.forward()[0, 0], dtype=np.float32)

    def parts(self, log_odds: Float32, bearing: Float, ranges: Float) -> Float:
        """Mean log-odds by part of bodies; 0 where it is outside the image, shape (n, parts).

        Args:
            log_odds: The map.
            bearing: Of the bodies' axes, from the lens [rad], shape (n,).
            ranges: Likewise, horizontal [m].
        """
        if not len(bearing):
            return np.zeros((0, len(PARTS)))
        at = upright_pixels(self.camera, bearing, ranges, HEIGHTS, ACROSS)
        u, v, inside = (part.reshape(len(bearing), -1) for part in at)
        cell = np.float32(self.scale / CELL)
        column, row = ((pixel + 0.5) * cell - 0.5 for pixel in (u, v))
        border = cv2.BORDER_REPLICATE
        seen: Any = cv2.remap(log_odds, column, row, cv2.INTER_LINEAR, borderMode=border)
        values: Float = np.where(inside, seen, 0.0)
        of_part = np.searchsorted(PARTS, np.repeat(HEIGHTS, len(ACROSS)), side="right") - 1
        chosen = (of_part[:, np.newaxis] == np.arange(len(PARTS))).astype(np.float64)
        return (values @ chosen) / (inside @ chosen + _UNKNOWN)


def normalized(grey: Gray) -> Float32:
    """The input of the network: normalized square roots of grey values, float32.

    Args:
        grey: Shape (height, width).

    Returns:
        Likewise, with zeros below and to the right up to multiples of `MULTIPLE`.
    """
    root = np.sqrt(grey.astype(np.float32) + np.float32(1.0))
    missing = [(0, -side % MULTIPLE) for side in root.shape]
    return np.pad((root - root.mean()) / (root.std() + _LEAST_CONTRAST), missing)
