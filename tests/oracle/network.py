"""The network that recognizes people, sample by sample and layer by layer."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from importlib import resources
from typing import Any

import numpy as np

from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray
from oracle.arrays import Float
from oracle.head import axes_of, lens_of
from oracle.votes import smoothed, value_at

#: Rows and columns of a window; its lower and upper edge and half of its width [m].
ROWS, COLUMNS, LOW_M, HIGH_M, HALF_M = 48, 24, -0.1, 2.1, 0.55
#: Sigma [px] by the least number of pixels that a row covers.
SMOOTHED_FROM = (2.5, 1.4), (1.25, 0.7)
#: Strides of the layers.
STRIDES = 2, 1, 2, 1, 2


def window_of(left: Gray, camera: StereoCamera, bearing: float, away: float) -> tuple[Float, Float]:
    """Grey values of the window at a place, and 1 where it is in the image."""
    tall, wide = (HIGH_M - LOW_M) / ROWS, 2.0 * HALF_M / COLUMNS
    covered = camera.fx * tall / max(away, 0.3)
    sigma = next((sigma for least, sigma in SMOOTHED_FROM if covered >= least), None)
    image = left.astype(np.float64) if sigma is None else smoothed(left, sigma)
    grey, inside = np.zeros((ROWS, COLUMNS)), np.zeros((ROWS, COLUMNS))
    for row, column in np.ndindex(ROWS, COLUMNS):
        across = HALF_M - (column + 0.5) * wide
        ray = (
            away * math.cos(bearing) - across * math.sin(bearing),
            away * math.sin(bearing) + across * math.cos(bearing),
            HIGH_M - (row + 0.5) * tall - lens_of(camera)[2],
        )
        x, y, z = (float(np.dot(axis, ray)) for axis in axes_of(camera).T)
        u = camera.fx * x / max(z, 0.05) + camera.cx
        v = camera.fy * y / max(z, 0.05) + camera.cy
        grey[row, column] = value_at(image, u, v)
        ahead = z > 0.05 and -0.5 < u < camera.width - 0.5 and -0.5 < v < camera.height - 0.5
        inside[row, column] = ahead
    return grey, inside


def log_odds_of(grey: Float, inside: Float) -> float:
    """What the network gives for a window."""
    seen = [math.sqrt(g + 1.0) for g, there in zip(grey.flat, inside.flat, strict=True) if there]
    mean = sum(seen) / max(len(seen), 1)
    deviation = math.sqrt(sum((s - mean) ** 2 for s in seen) / max(len(seen), 1))
    values = np.array([(np.sqrt(grey + 1.0) - mean) / (deviation + 0.5) * inside, inside])
    weights = weights_of("person_network.onnx")
    for k, stride in enumerate(STRIDES):
        values = _layer(values, weights[f"weights{k}"], weights[f"bias{k}"], stride)
    return float(np.dot(weights["weights"][0], values.ravel()) + weights["bias"][0])


def _layer(values: Float, weights: Float, bias: Float, stride: int) -> Float:
    """A convolution of 3 x 3 with a border of zeros; what is negative becomes 0."""
    _, rows, columns = values.shape
    padded = np.pad(values, ((0, 0), (1, 1), (1, 1)))
    result = np.zeros((len(weights), rows // stride, columns // stride))
    for k, row, column in np.ndindex(result.shape):
        i, j = row * stride, column * stride
        total = float((weights[k] * padded[:, i : i + 3, j : j + 3]).sum()) + float(bias[k])
        result[k, row, column] = max(total, 0.0)
    return result


@functools.cache
def weights_of(name: str) -> dict[str, Float]:
    """The weights by name, from an ONNX file (protocol buffers: model.graph.initializer)."""
    file = resources.files("mrs_people_loc.bodies").joinpath(name)
    model = dict(_fields(file.read_bytes()))
    weights = {}
    for key, tensor in _fields(model[7]):
        if key == 5:
            parts = list(_fields(tensor))
            shape = [value for key, value in parts if key == 1]
            values = dict(parts)
            numbers = np.frombuffer(values[9], dtype="<f4").astype(np.float64)
            weights[values[8].decode()] = numbers.reshape(shape)
    return weights


def _fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Keys and values of a message's fields: whole numbers, or bytes."""
    at = 0

    def number() -> int:
        nonlocal at
        result = shift = 0
        while True:
            byte, at = data[at], at + 1
            result, shift = result | (byte & 127) << shift, shift + 7
            if byte < 128:
                return result

    while at < len(data):
        key = number()
        if key & 7 == 0:
            yield key >> 3, number()
        else:
            assert key & 7 == 2
            size = number()
            at += size
            yield key >> 3, data[at - size : at]
