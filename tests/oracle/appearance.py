"""What a body looks like, in the left image: histograms of oriented gradients, block by block."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from importlib import resources

import numpy as np

from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray
from oracle.arrays import Float
from oracle.evidence import model
from oracle.head import axes_of, lens_of
from oracle.numbers import (
    CELL_SAMPLES,
    CUT_AT,
    DETECTOR_WINDOW,
    FITTED_WINDOW,
    LEAST_BLOCKS,
    LEAST_HUMAN,
    MOST_HUMAN,
    NEAREST_SAMPLED_M,
    NORM_ADDED,
    NORM_ADDED_AFTER,
    ORIENTATIONS,
    SMOOTHED_ABOVE,
)
from oracle.votes import smoothed, value_at

#: Lower and upper edge, half of the width [m], rows and columns.
Window = tuple[float, float, float, int, int]


def with_appearance(
    human: float, left: Gray, camera: StereoCamera, bearing: float, away: float
) -> float:
    """The log-odds of a person whose axis is at this bearing [rad] and range [m]."""
    of = model()["appearance"]
    numbers = resources.files("mrs_people_loc.bodies").joinpath("people_detector.npy")
    with resources.as_file(numbers) as file:
        detector = np.load(file)[:-1].reshape(-1, 4 * ORIENTATIONS)
    at = left, camera, bearing, away
    return (
        float(of["human"]) * min(max(human, LEAST_HUMAN), MOST_HUMAN)
        + float(of["above"]) * max(human - MOST_HUMAN, 0.0)
        + float(of["detector"]) * score_of(DETECTOR_WINDOW, *at, detector, of["detector_middle"])
        + float(of["fitted"])
        * score_of(FITTED_WINDOW, *at, of["fitted_weights"], of["fitted_middle"])
        + float(of["offset"])
    )


def score_of(
    window: Window,
    left: Gray,
    camera: StereoCamera,
    bearing: float,
    away: float,
    weights: Float,
    middle: Float,
) -> float:
    """What a classifier says of a window: the sum over its blocks in the image."""
    low, high, half, rows, columns = window
    tall, wide = (high - low) / rows, 2.0 * half / columns
    size, angle = _gradients(_grey(window, left, camera, bearing, away))
    total, inside, blocks = 0.0, 0, _blocks(rows, columns)
    for k, (row, column) in enumerate(blocks):
        z = high - (row + CELL_SAMPLES) * tall
        u, v = _pixel(camera, bearing, away, z, half - (column + CELL_SAMPLES) * wide)
        if not (0 < u < camera.width - 1 and 0 < v < camera.height - 1):
            continue
        part = slice(row, row + 2 * CELL_SAMPLES), slice(column, column + 2 * CELL_SAMPLES)
        inside += 1
        total += float(np.dot(_histograms(size[part], angle[part]), weights[k]) - middle[k])
    return total / math.sqrt(max(inside / len(blocks), LEAST_BLOCKS))


def _blocks(rows: int, columns: int) -> list[tuple[int, int]]:
    """Upper left samples of the blocks, column by column."""
    return [
        (row, column)
        for column in range(0, columns - CELL_SAMPLES, CELL_SAMPLES)
        for row in range(0, rows - CELL_SAMPLES, CELL_SAMPLES)
    ]


def _pixel(
    camera: StereoCamera, bearing: float, away: float, z: float, across: float
) -> tuple[float, float]:
    """Where a point of an upright window is in the image [px]; NaN behind the lens."""
    lens = lens_of(camera)
    ray = (
        away * math.cos(bearing) - across * math.sin(bearing),
        away * math.sin(bearing) + across * math.cos(bearing),
        z - lens[2],
    )
    x, y, depth = (float(np.dot(axis, ray)) for axis in axes_of(camera).T)
    if depth < 0.1:
        return math.nan, math.nan
    return camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy


def _grey(window: Window, left: Gray, camera: StereoCamera, bearing: float, away: float) -> Float:
    """Grey values of a window's samples, with those around them."""
    low, high, half, rows, columns = window
    tall, wide = (high - low) / rows, 2.0 * half / columns
    covered = camera.fx * tall / max(away, NEAREST_SAMPLED_M)
    sigma = next((sigma for above, sigma in SMOOTHED_ABOVE if covered > above), None)
    image = left.astype(np.float64) if sigma is None else smoothed(left, sigma)
    grey = np.zeros((rows + 2, columns + 2))
    for row, column in np.ndindex(grey.shape):
        z, across = high - (row - 0.5) * tall, half - (column - 0.5) * wide
        u, v = _pixel(camera, bearing, away, z, across)
        grey[row, column] = value_at(image, u, v)
    return grey


def _gradients(grey: Float) -> tuple[Float, Float]:
    """Their sizes, and their angles in steps of the orientations, from the first one."""
    root = np.sqrt(grey)
    right, down = root[1:-1, 2:] - root[1:-1, :-2], root[2:, 1:-1] - root[:-2, 1:-1]
    angle = np.arctan2(down, right) * (ORIENTATIONS / math.pi) - 0.5
    return np.hypot(right, down), angle % ORIENTATIONS


def _histograms(size: Float, angle: Float) -> Float:
    """The histograms of a block's four cells, normalized."""
    values = []
    for weight in _weights():
        for orientation in range(ORIENTATIONS):
            apart = np.abs(angle - orientation)
            share = 1.0 - np.minimum(apart, ORIENTATIONS - apart)
            values.append(float(np.sum(weight * size * np.maximum(share, 0.0))))
    block = np.array(values)
    block = np.minimum(block / (math.sqrt(float(block @ block)) + NORM_ADDED), CUT_AT)
    return block / (math.sqrt(float(block @ block)) + NORM_ADDED_AFTER)


@functools.cache
def _weights() -> list[Float]:
    """How much each sample of a block counts for each of its cells, column by column."""

    def along(cell: int) -> Iterator[float]:
        for k in range(2 * CELL_SAMPLES):
            gauss = math.exp(-0.5 * ((k - CELL_SAMPLES) / (0.5 * CELL_SAMPLES)) ** 2)
            apart = abs((k + 0.5) / CELL_SAMPLES - 0.5 - cell)
            yield gauss * max(1.0 - apart, 0.0)

    return [np.outer(list(along(row)), list(along(column))) for column in (0, 1) for row in (0, 1)]
