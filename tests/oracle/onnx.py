"""The weights of a network, from its ONNX file."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from importlib import resources
from typing import Any

import numpy as np

from oracle.arrays import Float


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
