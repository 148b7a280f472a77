"""The robot's filters: zone discrimination, noise windows, and reduction to cells (eqs. 1-5).

Points are float32 arrays of shape (n, 3): x, y, z in the robot's base_link, metres, z the height
over the floor. The paper's XZ ground plane is our x-y plane.
"""

from __future__ import annotations

import numpy as np

from mrs_people_loc.arrays import Bool, Float32, Int
from mrs_people_loc.scan import Cells

#: In grids of up to this many tiles all are numbered, in larger ones the occupied tiles only.
_MAX_TABLE = 1 << 20
#: Side of a column's height bins [m].
_BIN = 0.05
#: Bins above the zone: 3 m.
_MAX_BINS = 60
#: Bin of what is higher: beyond any gap.
_OUT_OF_REACH = 126
#: Bin numbers per column.
_BINS = 128
#: Lower than any point [m].
_LOW = -10.0


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
    the ground plane from the robot's origin, and a point on a border belongs to the one with the
    greater coordinates. D_j is kept if |D_j| >= min_points.

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

    k = floor(h / cell) + 1 per axis, centre = (k - 1/2) * cell; borders as in `reduce_noise`. Each
    cell also carries its number of points and their lowest and highest z; `top` is set to the
    latter (see `measure_tops`).

    Args:
        points: Shape (n, 3).
        cell: hwin, the cell's side [m].

    Returns:
        The cells, ordered by x, then y.
    """
    if not len(points):
        return Cells.empty()
    tile, k = _tile(points.T[:2], cell)
    order = _argsort(tile)
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
    zone it goes up through the cloud to the first gap (a ceiling above a head is not part of the
    person). Its top is the `support`-th highest point of what was passed above the zone or,
    where these are fewer, of its points in the zone: a few mismatches raise no top.

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
    of_cell, of_point = tile[: len(cells)], tile[len(cells) :]
    of_zone, of_above = of_point[: len(points)], of_point[len(points) :]
    in_zone = np.bincount(of_zone, minlength=int(tile.max()) + 1)
    holds_cell, reaches_up = np.zeros((2, len(in_zone)), dtype=bool)
    holds_cell[of_cell] = True
    reaches_up[of_cell[cells.z >= zone_high - gap]] = True
    columns, near = np.flatnonzero(holds_cell), np.flatnonzero(reaches_up[of_above])
    place, mm = _from_below(
        np.concatenate([columns, of_zone, of_above[near]]),
        np.concatenate([np.full(len(columns), _LOW, np.float32), points[:, 2], above[near, 2]]),
        in_zone=len(columns) + len(points),
        zone_high=zone_high,
    )
    top = np.full(len(in_zone), -np.inf, dtype=np.float32)
    top[columns] = _tops_of_columns(place, mm, columns, in_zone[columns], support=support, gap=gap)
    top = top[of_cell]
    return np.where(top > -np.inf, top, cells.z)


def _from_below(column: Int, height: Float32, *, in_zone: int, zone_high: float) -> tuple[Int, Int]:
    """Sorts the points of all columns by column, then height.

    Args:
        column: Of each point, shape (n,).
        height: Of each point [m], shape (n,).
        in_zone: So many of them, the first ones, are in the zone or begin a column.
        zone_high: Upper end of the zone [m].

    Returns:
        place: Column times `_BINS` plus the bin, which is 0 in the zone, shape (n,).
        mm: Height [mm], shape (n,).
    """
    bins = np.zeros(len(column), dtype=np.intp)
    up = ((height[in_zone:] - np.float32(zone_high)) / np.float32(_BIN)).astype(np.intp) + 1
    up[up > _MAX_BINS] = _OUT_OF_REACH
    bins[in_zone:] = up
    mm = (height * np.float32(1000.0)).astype(np.intp)
    order = _argsort(mm + bins)  # the sum is in the order of both
    order = order[_argsort(column[order])]
    return (column * _BINS + bins)[order], mm[order]


def _tops_of_columns(
    place: Int, mm: Int, columns: Int, in_zone: Int, *, support: int, gap: float
) -> Float32:
    """Top of each column [m], shape (k,); -inf where too few points support one.

    Args:
        place: From `_from_below`, shape (n,).
        mm: From `_from_below`, shape (n,).
        columns: The columns, ascending; each has a beginning among the points, shape (k,).
        in_zone: How many points each has in the zone, shape (k,).
        support: See `measure_tops`.
        gap: See `measure_tops`.
    """
    # A column runs from its beginning to where more than `gap` lies empty; the next one is farther.
    far = place[1:] - place[:-1] > round(gap / _BIN) + 1
    ends = np.flatnonzero(np.concatenate([far, [True]])) + 1
    first = np.searchsorted(place, columns * _BINS) + 1
    end = ends[np.searchsorted(ends, first - 1, side="right")]
    zone_end = first + in_zone
    kth = np.where(end - zone_end >= support, end, zone_end) - support
    supported = kth >= first
    top = np.full(len(columns), -np.inf, dtype=np.float32)
    top[supported] = mm[kth[supported]] / np.float32(1000.0)
    return top


def _select(points: Float32, keep: Bool) -> Float32:
    """Rows of `points`, each coordinate contiguous in memory."""
    # "clip" leaves out the check of the indices, which are good.
    return np.take(points.T, np.flatnonzero(keep), axis=1, mode="clip").T


def _argsort(numbers: Int) -> Int:
    """Stable order of whole numbers; NumPy sorts 16-bit ones by radix, several times faster."""
    low = numbers.min()
    small = numbers.max() - low < 1 << 16
    return np.argsort((numbers - low).astype(np.uint16) if small else numbers, kind="stable")


def _tile(xy: Float32, side: float) -> tuple[Int, Float32]:
    """Tiles the ground plane from its origin, and finds the tile of each point.

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
