"""Where a view may hold a body: upright extent by bearing and inverse range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.sensing.camera import StereoCamera
from oracle.arrays import Float, Float32
from oracle.head import axes_of, lens_of, scale_of
from oracle.numbers import (
    BODY_DEPTH_M,
    CANDIDATES_APART_M,
    HALF_WIDTH_M,
    HIGHEST_M,
    LEAST_LEVEL,
    LOWEST_M,
    MATCHING_ERROR_PX,
    SEARCH_BIN_PX,
    SEARCH_SHARE,
)


def tolerance_px(inverse_range: float, scale: float) -> float:
    """How far apart in inverse range pixels of one body may lie [px]."""
    return max(MATCHING_ERROR_PX, BODY_DEPTH_M * inverse_range * inverse_range / scale)


@dataclass(frozen=True)
class Bins:
    """Bins of the histogram: rows of inverse range, far first, and columns of bearing.

    Attributes:
        first: Bearing where column 0 begins [rad].
        step: Width of a column [rad].
        columns: Number of columns.
        least: Inverse range where row 0 begins [px].
        rows: Number of rows.
        scale: Inverse range times range [px m].
    """

    first: float
    step: float
    columns: int
    least: float
    rows: int
    scale: float

    def inverse_range(self, row: int) -> float:
        """Inverse range of the middle of a row [px]."""
        return self.least + (row + 0.5) * SEARCH_BIN_PX

    def reach(self, row: int) -> int:
        """How many rows a body takes to each side."""
        tolerance = tolerance_px(self.inverse_range(row), self.scale)
        return max(1, round(SEARCH_SHARE * tolerance / SEARCH_BIN_PX))

    def columns_of(self, width_m: float, row: int) -> int:
        """How many columns something of a width takes at a row's range."""
        return round(width_m * self.inverse_range(row) / self.scale / self.step)


@dataclass(frozen=True)
class _Rays:
    """Of each pixel: bearing from the middle [rad], horizontal part and slope of its ray."""

    ahead: float
    turns: list[list[float]]
    slopes: list[list[float]]
    levels: list[list[float]]

    @classmethod
    def of(cls, camera: StereoCamera) -> _Rays:
        axes = axes_of(camera)
        rays = [
            [
                tuple(
                    float(a[0] * (u - camera.cx) / camera.fx + a[1] * (v - camera.cy) / camera.fy)
                    + float(a[2])
                    for a in axes
                )
                for u in range(camera.width)
            ]
            for v in range(camera.height)
        ]
        middle = rays[camera.height // 2][camera.width // 2]
        ahead = math.atan2(middle[1], middle[0])
        return cls(
            ahead,
            [
                [math.remainder(math.atan2(r[1], r[0]) - ahead, 2.0 * math.pi) for r in row]
                for row in rays
            ],
            [[r[2] / max(math.hypot(r[0], r[1]), 1e-6) for r in row] for row in rays],
            [[math.hypot(r[0], r[1]) for r in row] for row in rays],
        )

    def least_turn(self) -> float:
        return min(self._usable())

    def _usable(self) -> list[float]:
        return [
            turn
            for turns, levels in zip(self.turns, self.levels, strict=True)
            for turn, level in zip(turns, levels, strict=True)
            if level > LEAST_LEVEL
        ]

    def bins(self, camera: StereoCamera, min_range: float, max_range: float) -> Bins:
        usable, scale, step = self._usable(), scale_of(camera), 1.0 / camera.fx
        return Bins(
            first=self.ahead + min(usable),
            step=step,
            columns=int((max(usable) - min(usable)) / step) + 1,
            least=scale / max_range,
            rows=max(1, math.ceil((scale / min_range - scale / max_range) / SEARCH_BIN_PX)),
            scale=scale,
        )

    def area(self, v: int, u: int) -> float:
        """What a pixel covers of an upright surface 1 m away [rad m]."""
        turns, slopes = ([line[u] for line in of] for of in (self.turns, self.slopes))
        return abs(
            _derivative(self.turns[v], u) * _derivative(slopes, v)
            - _derivative(turns, v) * _derivative(self.slopes[v], u)
        )


def _derivative(values: Sequence[float], i: int) -> float:
    """By central differences, one-sided at the ends."""
    before, after = max(i - 1, 0), min(i + 1, len(values) - 1)
    return (values[after] - values[before]) / (after - before)


def histogram_of(
    disparity: Float32, camera: StereoCamera, *, min_range: float, max_range: float
) -> tuple[Bins, Float]:
    """Metres of vertical extent in each bin: a pixel counts with what it covers in its column."""
    rays = _Rays.of(camera)
    bins = rays.bins(camera, min_range, max_range)
    least_turn, lens = rays.least_turn(), lens_of(camera)
    low, high = (np.float32(z - lens[2]) for z in (LOWEST_M, HIGHEST_M))
    result = np.zeros((bins.rows, bins.columns))
    for v, u in np.ndindex(disparity.shape):
        value = disparity[v, u]
        level = rays.levels[v][u]
        if not value > camera.disparity_offset_px or level <= LEAST_LEVEL:
            continue
        # Which bin it is in is a matter of float32, as disparities are.
        inverse = (value - np.float32(camera.disparity_offset_px)) / np.float32(level)
        away = np.float32(bins.scale) / inverse
        row = (inverse - np.float32(bins.least)) * np.float32(1.0 / SEARCH_BIN_PX)
        if not (low < np.float32(rays.slopes[v][u]) * away < high and 0 <= row < bins.rows):
            continue
        column = min(max(int((rays.turns[v][u] - least_turn) / bins.step), 0), bins.columns - 1)
        result[int(row), column] += float(away) * rays.area(v, u) / bins.step
    return bins, result


def extents_of(histogram: Float, bins: Bins) -> Float:
    """Of a body about each bin: the sum over its depth, the mean over its width.

    One that the border cuts is judged by the columns that are there, but by half of it at least.
    """
    result = np.zeros_like(histogram)
    for row, column in np.ndindex(histogram.shape):
        reach, half = bins.reach(row), max(1, bins.columns_of(HALF_WIDTH_M, row))
        begin, end = max(column - half, 0), min(column + half + 1, bins.columns)
        deep = histogram[max(row - reach, 0) : row + reach, begin:end]
        result[row, column] = deep.sum() / max(end - begin, half + 1)
    return result


def cross_out(extents: Float, bins: Bins, row: int, column: int) -> None:
    """Leaves no second candidate about one that was taken."""
    near, apart = 2 * bins.reach(row), bins.columns_of(CANDIDATES_APART_M, row)
    extents[max(0, row - near) : row + near + 1, max(0, column - apart) : column + apart + 1] = 0.0
