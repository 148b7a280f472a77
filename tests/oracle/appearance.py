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
from oracle.network import log_odds_of, window_of
from oracle.numbers import (
    CELL_SAMPLES,
    CUT_AT,
    DETECTOR_WINDOWS,
    LEAST_BLOCKS,
    LEAST_DEPTH_M,
    LEAST_HUMAN,
    MOST_HUMAN,
    NEAREST_SAMPLED_M,
    NORM_ADDED,
    NORM_ADDED_AFTER,
    ORIENTATIONS,
    RULED_OUT,
    SMOOTHED_ABOVE,
)
from oracle.votes import STEPS, smoothed

#: Lower, upper, left and right edge [m], rows and columns.
Window = tuple[float, float, float, float, int, int]


def with_appearance(
    human: float, left: Gray, camera: StereoCamera, bearing: float, away: float
) -> float:
    """The log-odds of a person whose axis is at this bearing [rad] and range [m]."""
    if human < RULED_OUT:
        return human
    of = model()["appearance"]
    numbers = resources.files("mrs_people_loc.bodies").joinpath("people_detector.npy")
    with resources.as_file(numbers) as file:
        detector = np.load(file)[:-1].reshape(-1, 4 * ORIENTATIONS)
    at = left, camera, bearing, away
    return (
        float(of["human"]) * min(max(human, LEAST_HUMAN), MOST_HUMAN)
        + float(of["above"]) * max(human - MOST_HUMAN, 0.0)
        + float(of["detector"])
        * max(score_of(of_it, *at, detector, of["detector_middle"]) for of_it in DETECTOR_WINDOWS)
        + float(of["network"]) * log_odds_of(*window_of(*at))
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
    low, high, leftmost, rightmost, rows, columns = window
    tall, wide = (high - low) / rows, (leftmost - rightmost) / columns
    votes = _gradients(_grey(window, left, camera, bearing, away))
    total, inside, blocks = 0.0, 0, _blocks(rows, columns)
    for k, (row, column) in enumerate(blocks):
        middle_z = np.array(high - (row + CELL_SAMPLES) * tall)
        middle_across = np.array(leftmost - (column + CELL_SAMPLES) * wide)
        u, v = _pixels(camera, bearing, away, middle_z, middle_across)
        if not (0 < u < camera.width - 1 and 0 < v < camera.height - 1):
            continue
        part = votes[:, row : row + 2 * CELL_SAMPLES, column : column + 2 * CELL_SAMPLES]
        inside += 1
        total += float(np.dot(_histograms(part), weights[k]) - middle[k])
    return total / math.sqrt(max(inside / len(blocks), LEAST_BLOCKS))


def _blocks(rows: int, columns: int) -> list[tuple[int, int]]:
    """Upper left samples of the blocks, column by column."""
    return [
        (row, column)
        for column in range(0, columns - CELL_SAMPLES, CELL_SAMPLES)
        for row in range(0, rows - CELL_SAMPLES, CELL_SAMPLES)
    ]


def _pixels(
    camera: StereoCamera, bearing: float, away: float, z: Float, across: Float
) -> tuple[Float, Float]:
    """Where points of an upright window are in the image [px]; -1 where they are not ahead."""
    rays = (
        away * math.cos(bearing) - across * math.sin(bearing),
        away * math.sin(bearing) + across * math.cos(bearing),
        z - lens_of(camera)[2],
    )
    axes = axes_of(camera)
    x, y, depth = (sum(axes[k, i] * rays[k] for k in range(3)) for i in range(3))
    ahead = depth > LEAST_DEPTH_M
    depth = np.where(ahead, depth, 1.0)
    u, v = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
    return np.where(ahead, u, -1.0), np.where(ahead, v, -1.0)


def _grey(window: Window, left: Gray, camera: StereoCamera, bearing: float, away: float) -> Float:
    """Grey values of a window's samples, with those around them."""
    low, high, leftmost, rightmost, rows, columns = window
    tall, wide = (high - low) / rows, (leftmost - rightmost) / columns
    covered = camera.fx * tall / max(away, NEAREST_SAMPLED_M)
    sigma = next((sigma for above, sigma in SMOOTHED_ABOVE if covered > above), None)
    image = left.astype(np.float64) if sigma is None else smoothed(left, sigma)
    row, column = np.indices((rows + 2, columns + 2), dtype=np.float64)
    z, across = high - (row - 0.5) * tall, leftmost - (column - 0.5) * wide
    return _values_at(image, *_pixels(camera, bearing, away, z, across))


def _values_at(image: Float, u: Float, v: Float) -> Float:
    """An image between its pixels, bilinear; beyond its border that goes on."""
    if STEPS:
        u, v = np.round(u * STEPS) / STEPS, np.round(v * STEPS) / STEPS
    left, top = np.floor(u).astype(int), np.floor(v).astype(int)
    result = np.zeros(u.shape)
    for row, of_row in ((top, 1.0 - (v - top)), (top + 1, v - top)):
        for column, of_column in ((left, 1.0 - (u - left)), (left + 1, u - left)):
            inside = np.clip(row, 0, len(image) - 1), np.clip(column, 0, image.shape[1] - 1)
            result += of_row * of_column * image[inside]
    return result


def _gradients(grey: Float) -> Float:
    """Their sizes, shared by orientations: shape (orientations, rows, columns)."""
    root = np.sqrt(grey)
    right, down = root[1:-1, 2:] - root[1:-1, :-2], root[2:, 1:-1] - root[:-2, 1:-1]
    angle = np.arctan2(down, right) * (ORIENTATIONS / math.pi) - 0.5
    apart = np.abs(angle % ORIENTATIONS - np.arange(ORIENTATIONS)[:, np.newaxis, np.newaxis])
    share = 1.0 - np.minimum(apart, ORIENTATIONS - apart)
    return np.hypot(right, down) * np.maximum(share, 0.0)


def _histograms(votes: Float) -> Float:
    """The histograms of a block's four cells, normalized."""
    block = np.array(
        [
            float(np.sum(weight * of_orientation))
            for weight in _weights()
            for of_orientation in votes
        ]
    )
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
