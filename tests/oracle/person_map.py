"""The network that sees people, layer by layer, and what it shows at a body, sample by sample."""

from __future__ import annotations

import functools
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray
from oracle.arrays import Float
from oracle.network import weights_of
from oracle.numbers import (
    CELL_PX,
    HEIGHTS,
    LEAST_DEVIATION,
    MAP_FOCAL_PX,
    PARTS_M,
    SIDE_MULTIPLE,
    SILENT_SAMPLES,
    SQUARE_PX,
    TOP_COLUMNS,
)
from oracle.patches import Patch
from oracle.votes import value_at

#: Names of the layers with their strides, as they follow each other.
DOWN = [
    [("first.0", 2), ("quarter.0.0", 2), ("quarter.1.0", 1)],
    [("eighth.0.0", 2), ("eighth.1.0", 1)],
    [("sixteenth.0.0", 2), ("sixteenth.1.0", 1), ("sixteenth.2.0", 1)],
    [("last.0.0", 2), ("last.1.0", 1), ("last.2.0", 1)],
]
BACK = [("of_sixteenth", None), ("of_eighth", "to_eighth.0"), ("of_quarter", "to_quarter.0")]


def middle_part(left: Gray, camera: StereoCamera, patch: Patch) -> float:
    """What the map shows at the middle part of a body, where nothing nearer is."""
    scale = min(1.0, MAP_FOCAL_PX / camera.fx)
    shown = _map_of(left.tobytes(), left.shape, scale)
    result = []
    for low, high in PARTS_M:
        total, count = 0.0, 0
        for row, height in enumerate(HEIGHTS):
            if not low <= float(height) < high:
                continue
            for column in TOP_COLUMNS:
                hidden = patch.difference[row, column] > patch.tolerance  # not so for NaN
                if patch.inside[row, column] and not hidden:
                    u, v = float(patch.u[row, column]), float(patch.v[row, column])
                    cell = scale / CELL_PX
                    total += value_at(shown, (u + 0.5) * cell - 0.5, (v + 0.5) * cell - 0.5)
                    count += 1
        result.append(total / (count + SILENT_SAMPLES))
    return sorted(result)[1]


@functools.lru_cache(maxsize=64)
def _map_of(grey: bytes, shape: tuple[int, int], scale: float) -> Float:
    """The map of an image."""
    image: Any = np.frombuffer(grey, dtype=np.uint8).reshape(shape)
    if scale < 1.0:
        size = round(shape[1] * scale), round(shape[0] * scale)
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    levels = []
    values = channels_of(np.asarray(image))
    for layers in DOWN:
        for name, stride in layers:
            values = np.maximum(_convolved(values, name, stride), 0.0)
        levels.append(values)
    values = _convolved(levels.pop(), "of_last", 1)
    for across, after in BACK:
        if after is not None:
            values = np.maximum(_convolved(values, after, 1), 0.0)
        larger = values.repeat(2, axis=1).repeat(2, axis=2)
        values = np.maximum(_convolved(levels.pop(), across, 1) + larger, 0.0)
    return _convolved(values, "log_odds", 1)[0]


def channels_of(image: Gray) -> Float:
    """What the network takes: shape (2, rows, columns), sides multiples of `SIDE_MULTIPLE`."""
    root = np.sqrt(image.astype(np.float64) + 1.0)
    rows, columns = root.shape
    result = np.zeros((2, *(side + -side % SIDE_MULTIPLE for side in root.shape)))
    result[0, :rows, :columns] = (root - root.mean()) / (root.std() + LEAST_DEVIATION)
    half = SQUARE_PX // 2
    padded = np.pad(root, half, mode="reflect")
    for row, column in np.ndindex(root.shape):
        square = padded[row : row + SQUARE_PX, column : column + SQUARE_PX]
        deviation = square.std() + LEAST_DEVIATION
        result[1, row, column] = (root[row, column] - square.mean()) / deviation
    return result


def _convolved(values: Float, name: str, stride: int) -> Float:
    """A convolution with a border of zeros."""
    of = weights_of("person_map.onnx")
    weights, bias = of[f"{name}.weight"], of[f"{name}.bias"]
    side = weights.shape[2]
    border = side // 2
    _, rows, columns = values.shape
    padded = np.pad(values, ((0, 0), (border, border), (border, border)))
    result = np.zeros((len(weights), rows // stride, columns // stride)) + bias[:, None, None]
    for i, j in np.ndindex(side, side):
        part = padded[:, i : i + rows : stride, j : j + columns : stride]
        result += np.tensordot(weights[:, :, i, j], part, axes=1)
    return result
