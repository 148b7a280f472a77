"""The robot's filters: zone discrimination, noise windows, and reduction to cells (eqs. 1-5).

Points are float32 arrays of shape (n, 3): x, y, z in the robot's base_link, metres, z the height
over the floor. The paper's XZ ground plane is our x-y plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.scan import Cells

Float32 = NDArray[np.float32]
Int = NDArray[np.intp]

#: Grids up to this many cells are counted in a table, larger ones by sorting.
_MAX_TABLE = 1 << 20


def discriminate_zones(points: Float32, *, low: float, high: float) -> Float32:
    """Keeps the points between knees and shoulders (eq. 1).

    V = {p in RAW : low <= height <= high}.

    Args:
        points: Shape (n, 3).
        low: th1 [m].
        high: th2 [m].

    Returns:
        The points that are kept, in their order, shape (m, 3).
    """
    height = points[:, 2]
    return _take(points, (height >= np.float32(low)) & (height <= np.float32(high)))


def reduce_noise(points: Float32, *, window: float, min_points: int) -> Float32:
    """Empties the noise windows that hold few points (eqs. 2-3).

    Window j holds D_j = {v : x_j <= v_x < x_j + window, y_j <= v_y < y_j + window}; windows tile
    the ground plane from the robot's origin. D_j is kept if |D_j| >= min_points.

    Args:
        points: Shape (n, 3).
        window: fwin, the window's side [m].
        min_points: th_n.

    Returns:
        The points that are kept, in their order, shape (m, 3).
    """
    ids, _, counts = _tile(points[:, 0], points[:, 1], window)
    return _take(points, (counts >= min_points)[ids])


def quantize(points: Float32, *, cell: float) -> Cells:
    """Makes one point of every occupied cell of the ground plane: its centre (eqs. 4-5).

    k = floor(h / cell) + 1 per axis, centre = (k - 1/2) * cell. Each cell also carries its number
    of points and their lowest and highest z; `top` is set to the latter (see `measure_tops`).

    Args:
        points: Shape (n, 3).
        cell: hwin, the cell's side [m].

    Returns:
        The cells, ordered by x, then y.
    """
    if not len(points):
        return Cells.empty()
    ids, tiles, counts = _tile(points[:, 0], points[:, 1], cell)
    first = np.cumsum(counts) - counts
    height = points[np.argsort(ids, kind="stable"), 2]
    highest = np.maximum.reduceat(height, first)
    centres = ((tiles + 0.5) * cell).astype(np.float32)
    return Cells(
        x=centres[0],
        y=centres[1],
        z=highest,
        z_min=np.minimum.reduceat(height, first),
        top=highest,
        count=counts.astype(np.uint32),
    )


def measure_tops(
    cells: Cells, cloud: Float32, *, zone_high: float, window: float, support: int, gap: float
) -> Float32:
    """Height of the column above each cell, measured before the zone cut.

    The column is the noise window that holds the cell's centre. From its highest point in the
    zone it goes up through the cloud until it meets a gap (a ceiling above a head is not the
    person's). Its top is the `support`-th highest point of what was passed, so that a few
    mismatches make no one taller, but not less than the cell's own highest point.

    Args:
        cells: Cells from `quantize`.
        cloud: All points, before the zones, shape (n, 3).
        zone_high: Upper end of the zone [m].
        window: Side of a noise window [m].
        support: So many points at or above it make a top.
        gap: The column ends where no point follows within this [m], to `_BIN`.

    Returns:
        Top of each cell's column [m], float32, shape (len(cells),), to the millimetre.
    """
    above = _take(cloud, cloud[:, 2] > np.float32(zone_high))
    if not len(cells) or not len(above):
        return cells.z
    ids, tiles, _ = _tile(
        np.concatenate([cells.x, above[:, 0]]), np.concatenate([cells.y, above[:, 1]]), window
    )
    column_of_cell, ids = ids[: len(cells)], ids[len(cells) :]
    zone_top = np.full(tiles.shape[1], -np.inf, dtype=np.float32)
    np.maximum.at(zone_top, column_of_cell, cells.z)

    # How far each column goes up without a gap, in bins above the zone.
    bins = ((above[:, 2] - np.float32(zone_high)) / np.float32(_BIN)).astype(np.intp)
    relevant = np.flatnonzero((zone_top[ids] >= zone_high - gap) & (bins < _MAX_BINS))
    ids, bins, height = ids[relevant], bins[relevant], above[relevant, 2]
    filled = np.zeros((tiles.shape[1], _MAX_BINS + 1), dtype=bool)
    filled[:, 0] = True  # the zone itself
    filled[ids, bins + 1] = True
    reach = np.arange(1, _MAX_BINS + 2) + round(gap / _BIN)
    last_filled = np.maximum.accumulate(np.where(filled, reach, 0), axis=1)
    broken = last_filled < np.arange(1, _MAX_BINS + 2)
    end = np.where(broken.any(axis=1), broken.argmax(axis=1), _MAX_BINS + 1)

    # The k-th highest of each column by one sort of whole numbers: column, then millimetres down.
    passed = bins + 1 < end[ids]
    ids, height = ids[passed], height[passed]
    down = _MM - 1 - (height * np.float32(1000.0)).astype(np.int64)
    keys = np.sort(ids * _MM + down)
    counts = np.bincount(ids, minlength=tiles.shape[1])
    supported = counts >= support
    kth = keys[(np.cumsum(counts) - counts)[supported] + support - 1]
    top = np.zeros(tiles.shape[1], dtype=np.float32)
    top[supported] = (_MM - 1 - kth % _MM) / np.float32(1000.0)
    return np.maximum(top[column_of_cell], cells.z)


_BIN = 0.05  # height bins of a column [m]
_MAX_BINS = 60  # 3 m above the zone
_MM = 1 << 15  # millimetres; heights stay below 10 m + 3 m


def _take(points: Float32, keep: NDArray[np.bool_]) -> Float32:
    """Rows of `points`, each coordinate contiguous in memory."""
    return np.take(points.T, np.flatnonzero(keep), axis=1).T


def _tile(x: Float32, y: Float32, side: float) -> tuple[Int, Int, Int]:
    """Tiles the ground plane from its origin and says which tile holds each point.

    Returns:
        ids: Which of the occupied tiles holds the point, shape (n,).
        tiles: Occupied tiles as (floor(x / side), floor(y / side)), ordered, shape (2, m).
        counts: Points in each, shape (m,).
    """
    if not len(x):
        return np.empty(0, np.intp), np.empty((2, 0), np.intp), np.empty(0, np.intp)
    i = np.floor(x / np.float32(side)).astype(np.intp)
    j = np.floor(y / np.float32(side)).astype(np.intp)
    i_low, j_low = int(i.min()), int(j.min())
    columns = int(j.max()) - j_low + 1
    number = (i - i_low) * columns + (j - j_low)
    size = (int(i.max()) - i_low + 1) * columns
    if size <= _MAX_TABLE:
        table = np.bincount(number, minlength=size)
        occupied = np.flatnonzero(table)
        counts = table[occupied]
        table[occupied] = np.arange(len(occupied))
        ids = table[number]
    else:  # a far outlier: sorting needs no table of the whole extent
        occupied, ids, counts = np.unique(number, return_inverse=True, return_counts=True)
    tiles = np.stack([occupied // columns + i_low, occupied % columns + j_low])
    return ids, tiles, counts
