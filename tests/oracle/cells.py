"""Points to the cells of the paper's scan, in float32 as the points are (eqs. 1-5)."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrs_people_loc.config import RobotConfig
from oracle.arrays import Float32
from oracle.numbers import COLUMN_BIN_M, COLUMN_BINS

Point = tuple[np.float32, np.float32, np.float32]


@dataclass(frozen=True)
class Cell:
    """One occupied cell; fields as in `Cells`."""

    x: np.float32
    y: np.float32
    z: np.float32
    z_min: np.float32
    top: np.float32
    count: int


def zones_of(cloud: Float32, config: RobotConfig) -> list[Point]:
    """Eq. 1."""
    low, high = np.float32(config.zones.low), np.float32(config.zones.high)
    return [(x, y, z) for x, y, z in cloud if low <= z <= high]


def noise_of(points: Sequence[Point], config: RobotConfig) -> list[Point]:
    """Eqs. 2-3, in the order of the points."""
    held = _tiled(points, config.noise.window)
    return [
        p
        for p in points
        if len(held[_tile(p[0], p[1], config.noise.window)]) >= config.noise.min_points
    ]


def cells_of(cloud: Float32, config: RobotConfig) -> list[Cell]:
    """Eqs. 1-5, and the top of each cell's column."""
    kept = noise_of(zones_of(cloud, config), config)
    side = config.quantization.cell
    cells = []
    for (i, j), points in sorted(_tiled(kept, side).items()):
        heights = [z for _, _, z in points]
        x, y = np.float32((i + 0.5) * side), np.float32((j + 0.5) * side)
        cells.append(Cell(x, y, max(heights), min(heights), max(heights), len(points)))
    high = np.float32(config.zones.high)
    above = _tiled([(x, y, z) for x, y, z in cloud if z > high], config.noise.window)
    in_zone = _tiled(kept, config.noise.window)
    cells_in = defaultdict(list)
    for cell in cells:
        cells_in[_tile(cell.x, cell.y, config.noise.window)].append(cell)
    topped = {}
    for column, inside in cells_in.items():
        highest = max(c.z for c in inside)
        heights = [z for _, _, z in in_zone.get(column, [])]
        top = _top_of(highest, heights, [z for _, _, z in above.get(column, [])], config)
        topped.update({c: replace(c, top=c.z if top is None else top) for c in inside})
    return [topped[c] for c in cells]


def _top_of(
    highest: np.float32,
    zone: Sequence[np.float32],
    above: Sequence[np.float32],
    config: RobotConfig,
) -> np.float32 | None:
    """Top of a column of the noise window: up from the zone until a gap; None: not supported.

    Args:
        highest: Highest z of its cells.
        zone: Heights of its points in the zone.
        above: Heights of its points above the zone.
        config: The robot's configuration.
    """
    high = np.float32(config.zones.high)
    gap, support = config.quantization.top_gap, config.quantization.top_support
    passed: list[np.float32] = []
    if highest >= np.float32(config.zones.high - gap):
        last = 0  # the zone; the bins above it count from 1
        for z in sorted(above):
            now = int((z - high) / np.float32(COLUMN_BIN_M)) + 1
            if now > COLUMN_BINS or now - last > round(gap / COLUMN_BIN_M) + 1:
                break
            passed.append(z)
            last = now
    for heights in (passed, sorted(zone)):
        if len(heights) >= support:
            # To the millimetre below, also for heights below the floor.
            return np.float32((int(heights[-support] * np.float32(1000.0))) / np.float32(1000.0))
    return None


def _tile(x: np.float32, y: np.float32, side: float) -> tuple[int, int]:
    return math.floor(x / np.float32(side)), math.floor(y / np.float32(side))


def _tiled(points: Sequence[Point], side: float) -> dict[tuple[int, int], list[Point]]:
    """The points of each occupied tile of the ground plane."""
    tiles: defaultdict[tuple[int, int], list[Point]] = defaultdict(list)
    for point in points:
        tiles[_tile(point[0], point[1], side)].append(point)
    return tiles
