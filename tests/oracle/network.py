"""The network that sees people, layer by layer, and what it says of a body, sample by sample."""

from __future__ import annotations

import functools
import math
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray
from oracle.arrays import Float
from oracle.head import axes_of, lens_of
from oracle.numbers import (
    CELL_PX,
    LEAST_DEVIATION,
    MAP_FOCAL_PX,
    SIDE_MULTIPLE,
    SQUARE_PX,
    WINDOW_HALF_M,
    WINDOW_HIGH_M,
    WINDOW_LOW_M,
    WINDOW_SHAPE,
    WINDOW_SIZE_PX,
)
from oracle.onnx import weights_of
from oracle.votes import value_at

#: OpenCV looks between pixels of many channels in so many steps.
CHANNEL_STEPS = 32
#: Names of the layers with their strides, as they follow each other.
DOWN = [
    [("first.0", 2), ("quarter.0.0", 2), ("quarter.1.0", 1)],
    [("eighth.0.0", 2), ("eighth.1.0", 1)],
    [("sixteenth.0.0", 2), ("sixteenth.1.0", 1), ("sixteenth.2.0", 1)],
    [("last.0.0", 2), ("last.1.0", 1), ("last.2.0", 1)],
]
BACK = [("of_sixteenth", None), ("of_eighth", "to_eighth.0"), ("of_quarter", "to_quarter.0")]


def window_log_odds(left: Gray, camera: StereoCamera, bearing: float, away: float) -> float:
    """What the window at a place says."""
    scale = min(1.0, MAP_FOCAL_PX / camera.fx)
    features = _features_of(left.tobytes(), left.shape, scale)
    (rows, columns), values = WINDOW_SHAPE, []
    for row, column in np.ndindex(rows, columns):
        across = WINDOW_HALF_M - (column + 0.5) * 2.0 * WINDOW_HALF_M / columns
        height = WINDOW_HIGH_M - (row + 0.5) * (WINDOW_HIGH_M - WINDOW_LOW_M) / rows
        ray = (
            away * math.cos(bearing) - across * math.sin(bearing),
            away * math.sin(bearing) + across * math.cos(bearing),
            height - lens_of(camera)[2],
        )
        x, y, z = (float(np.dot(axis, ray)) for axis in axes_of(camera).T)
        u = camera.fx * x / max(z, 0.05) + camera.cx
        v = camera.fy * y / max(z, 0.05) + camera.cy
        inside = z > 0.1 and -0.5 < u < camera.width - 0.5 and -0.5 < v < camera.height - 0.5
        column, row = ((pixel + 0.5) * scale / CELL_PX - 0.5 for pixel in (u, v))
        for one in features:
            values.append(value_at(one, column, row, CHANNEL_STEPS) if inside else 0.0)
        values.append(float(inside))
    values.append(math.log(camera.fx * scale / away / WINDOW_SIZE_PX))
    of = weights_of("person_window.onnx")
    hidden = np.maximum(of["1.weight"] @ np.array(values) + of["1.bias"], 0.0)
    return float(of["4.weight"][0] @ hidden + of["4.bias"][0])


@functools.lru_cache(maxsize=64)
def _features_of(grey: bytes, shape: tuple[int, int], scale: float) -> Float:
    """The features of an image's cells, shape (channels, rows, columns)."""
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
    return np.maximum(_convolved(values, "features.0", 1), 0.0)


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
    of = weights_of("person_features.onnx")
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
