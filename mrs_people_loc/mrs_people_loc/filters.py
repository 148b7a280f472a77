"""The robot's filters: zone discrimination, noise windows, and reduction to cells (eqs. 1-5).

Points are float32 arrays of shape (n, 3): x, y, z in the robot's base_link, metres, z the height
over the floor. The paper's XZ ground plane is our x-y plane.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.scan import Cells

Float32 = NDArray[np.float32]
Int = NDArray[np.intp]
Bool = NDArray[np.bool_]

#: Grids up to this many tiles are numbered as they are, larger ones by sorting.
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
    return _select(points, (height >= np.float32(low)) & (height <= np.float32(high)))


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
    tile, _ = _tile(points.T[:2], window)
    return _select(points, (np.bincount(tile) >= min_points)[tile])


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
    tile, k = _tile(points.T[:2], cell)
    # NumPy sorts 16-bit numbers by radix, several times faster.
    order = np.argsort(tile.astype(np.uint16) if tile.max() < 1 << 16 else tile, kind="stable")
    tile = tile[order]
    edges = np.flatnonzero(np.concatenate([[True], tile[1:] != tile[:-1], [True]]))
    first = edges[:-1]
    height = points[order, 2]
    highest = np.maximum.reduceat(height, first)
    centres = ((k[:, order[first]].astype(np.float64) + 0.5) * cell).astype(np.float32)
    return Cells(
        x=centres[0],
        y=centres[1],
        z=highest,
        z_min=np.minimum.reduceat(height, first),
        top=highest,
        count=(edges[1:] - first).astype(np.uint32),
    )


def measure_tops(
    cells: Cells,
    points: Float32,
    cloud: Float32,
    *,
    zone_high: float,
    window: float,
    support: int,
    gap: float,
) -> Float32:
    """Height of the column above each cell, measured before the zone cut.

    The column is the noise window that holds the cell's centre. From its highest point in the
    zone it goes up through the cloud until it meets a gap (a ceiling above a head is not the
    person's). Its top is the `support`-th highest point of what was passed above the zone or,
    where these are fewer, of its points in the zone: a few mismatches make no one taller.

    Args:
        cells: Cells from `quantize`.
        points: The points in the zone that they were made of, shape (m, 3).
        cloud: All points, before the zones, shape (n, 3).
        zone_high: Upper end of the zone [m].
        window: Side of a noise window [m].
        support: So many points at or above it make a top.
        gap: The column ends where no point follows within this [m], to `_BIN`.

    Returns:
        Top of each cell's column [m], float32, shape (len(cells),), to the millimetre.
    """
    if not len(cells):
        return cells.z
    above = _select(cloud, cloud[:, 2] > np.float32(zone_high))
    tile, _ = _tile(np.concatenate([[cells.x, cells.y], points.T[:2], above.T[:2]], axis=1), window)
    of_cell, of_zone, of_point = np.split(tile, [len(cells), len(cells) + len(points)])
    top = _kth_highest(of_zone, points[:, 2], support, int(tile.max()) + 1)
    reaches_up = np.zeros(len(top), dtype=bool)
    reaches_up[of_cell[cells.z >= zone_high - gap]] = True

    # Where each point is, as one whole number: column, bin in it (0 is the zone), millimetres.
    near = np.flatnonzero(reaches_up[of_point])
    height = above[near, 2]
    bins = ((height - np.float32(zone_high)) / np.float32(_BIN)).astype(np.intp)
    low_mm = math.floor(zone_high * 1000.0) - 1
    mm = (height * np.float32(1000.0)).astype(np.intp) - low_mm
    place = ((of_point[near] * _BINS + bins + 1) << _MM_BITS) | mm
    columns = np.flatnonzero(reaches_up)
    zones = columns * _BINS << _MM_BITS
    place = np.sort(np.concatenate([zones, place[bins < _MAX_BINS]]))

    # A column runs from its zone to where more than `gap` lies empty; the next one is farther.
    bins = place >> _MM_BITS
    far = bins[1:] - bins[:-1] > round(gap / _BIN) + 1
    ends = np.flatnonzero(np.concatenate([far, [True]])) + 1
    start = np.searchsorted(place, zones)
    end = ends[np.searchsorted(ends, start, side="right")]
    supported = end - start > support  # the zone itself is no point
    mm = (place[(end - support)[supported]] & ((1 << _MM_BITS) - 1)) + low_mm
    top[columns[supported]] = mm / np.float32(1000.0)
    top = top[of_cell]
    return np.where(top > -np.inf, top, cells.z)


def _kth_highest(column: Int, height: Float32, k: int, columns: int) -> Float32:
    """The k-th highest of each column's heights, to the millimetre; -inf where there are fewer."""
    result = np.full(columns, -np.inf, dtype=np.float32)
    counts = np.bincount(column, minlength=columns)
    # One sort of whole numbers: column, then millimetres.
    mm = (height * np.float32(1000.0)).astype(np.intp) + _MM_OFFSET
    order = np.sort((column << _MM_ALL_BITS) | mm)
    enough = counts >= k
    kth = order[np.cumsum(counts)[enough] - k] & ((1 << _MM_ALL_BITS) - 1)
    result[enough] = (kth - _MM_OFFSET) / np.float32(1000.0)
    return result


_BIN = 0.05  # height bins of a column [m]
_MAX_BINS = 60  # 3 m above the zone
_BINS = 128  # numbers of bins per column: `_MAX_BINS`, and more than any gap to the next column
_MM_BITS = 12  # bits that hold 3 m in millimetres
_MM_ALL_BITS, _MM_OFFSET = (
    15,
    4000,
)  # bits that hold every height of a zone, from 4 m below the floor


def _select(points: Float32, keep: Bool) -> Float32:
    """Rows of `points`, each coordinate contiguous in memory."""
    # "clip" leaves out the check of the indices, which are good.
    return np.take(points.T, np.flatnonzero(keep), axis=1, mode="clip").T


def _tile(xy: Float32, side: float) -> tuple[Int, Float32]:
    """Tiles the ground plane from its origin and says which tile holds each point.

    Args:
        xy: Shape (2, n).
        side: Side of a tile [m].

    Returns:
        tile: Number of the tile, from 0, ordered by x, then y, shape (n,).
        k: floor(xy / side), shape (2, n).
    """
    k = np.floor(xy / np.float32(side))
    if not k.size:
        return np.empty(0, np.intp), k
    low, high = k.min(axis=1), k.max(axis=1)
    rows, columns = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
    if rows * columns <= _MAX_TABLE:  # whole numbers that float32 holds
        return ((k[0] - low[0]) * np.float32(columns) + (k[1] - low[1])).astype(np.intp), k
    # A far outlier: numbers of occupied tiles only, so that they count up to n.
    i, j = k.astype(np.intp)
    return np.unique((i - int(low[0])) * columns + (j - int(low[1])), return_inverse=True)[1], k
