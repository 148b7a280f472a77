"""Neighbours: which points of the plane are near each other, without comparing all with all.

Where people and robots are spread over the floor, each has so many neighbours and no more, however
many there are in all: what looks at neighbours only grows no faster than the team.
"""

from __future__ import annotations

import itertools

import numpy as np

from mrs_people_loc.arrays import Float, Int

#: So many pairs are looked at faster than points are sorted.
_FEW = 4096
#: The plane is cut into columns as wide as the reach, and these into so many cells per reach: where
#: these are smaller, fewer pairs are looked at that are too far apart.
_FINE = 8
#: So many pairs are looked at at once.
_BLOCK = 200_000
#: Beyond so many columns from the origin all points are near each other at first: the number of a
#: cell is below 2^63.
_FAR = 1 << 27
_COLUMN = _FAR * _FINE * 4
#: Least width of a column [m].
_LEAST = 1e-6


def pairs_within(xy: Float, reach: float) -> tuple[Int, Int, Float]:
    """Pairs of points at most `reach` apart, each once, in no order.

    Args:
        xy: Points [m], shape (n, 2); those with a NaN are near none.
        reach: The distance [m], inclusive.

    Returns:
        Indices of both, the smaller one first, and their distance [m], shapes (m,).
    """
    if len(xy) < 2:
        return _nobody()
    return _pairs(xy, xy, reach, once=True)


def pairs_between(xy: Float, others: Float, reach: float) -> tuple[Int, Int, Float]:
    """Pairs of a point and another one at most `reach` from it, in no order.

    Args:
        xy: Points [m], shape (n, 2); those with a NaN are near none.
        others: Likewise, shape (k, 2).
        reach: The distance [m], inclusive.

    Returns:
        Index of the one, of the other, and their distance [m], shapes (m,).
    """
    if not len(xy) or not len(others):
        return _nobody()
    if len(xy) * len(others) <= _FEW:
        one, other = np.indices((len(xy), len(others))).reshape(2, -1)
        return _near(xy, others, one, other, reach)
    return _pairs(xy, others, reach)


def nearest_to(places: Float, xy: Float, most: int) -> Int:
    """Which points are nearest to places, in their order.

    Args:
        places: [m], shape (k, 2).
        xy: Points [m], shape (n, 2).
        most: So many are taken.

    Returns:
        Indices, shape (min(n, most),).
    """
    if len(xy) <= most:
        return np.arange(len(xy))
    away = np.hypot(*(xy[:, np.newaxis] - places).T).min(axis=0, initial=np.inf)
    return np.sort(np.argpartition(away, most - 1)[:most])


def _nobody() -> tuple[Int, Int, Float]:
    return np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0)


def _pairs(xy: Float, others: Float, reach: float, *, once: bool = False) -> tuple[Int, Int, Float]:
    """Pairs of a point and another one within the reach, out of those in the cells around it.

    Args:
        xy: Points [m], shape (n, 2).
        others: Likewise, shape (k, 2).
        reach: The distance [m].
        once: Both are the same points, and each pair is wanted once.
    """
    cell = _cells(others, reach)
    order = np.argsort(cell)
    cell = cell[order]
    middle = (_cells(xy, reach) + _COLUMN * np.arange(-1, 2)[:, np.newaxis]).ravel()
    begin = np.searchsorted(cell, middle - _FINE, side="left")
    count = np.searchsorted(cell, middle + _FINE, side="right") - begin
    point, total = np.tile(np.arange(len(xy)), 3), np.cumsum(count)
    ends = np.searchsorted(total, np.arange(_BLOCK, total[-1], _BLOCK)).tolist()
    found = []
    for start, end in itertools.pairwise([0, *ends, len(count)]):
        counts = count[start:end]
        one = np.repeat(point[start:end], counts)
        skipped = np.repeat(begin[start:end] - (np.cumsum(counts) - counts), counts)
        other = order[np.arange(len(one)) + skipped]
        if once:
            first = one < other
            one, other = one[first], other[first]
        found.append(_near(xy, others, one, other, reach))
    if len(found) == 1:
        return found[0]
    ones, nearby, away = zip(*found, strict=True)
    return np.concatenate(ones), np.concatenate(nearby), np.concatenate(away)


def _cells(xy: Float, reach: float) -> Int:
    """Numbers of the cells of points: those along y follow one another, column by column."""
    wide = max(1.001 * reach, _LEAST)  # rounding hides no pair
    numbers = np.fmin(np.fmax(xy, -_FAR * wide), _FAR * wide)  # of NaN and a number, the number
    x, y = numbers.T / wide
    column, row = (np.floor(of).astype(np.intp) for of in (x, _FINE * y))
    return np.asarray(column * _COLUMN + row)


def _near(xy: Float, others: Float, one: Int, other: Int, reach: float) -> tuple[Int, Int, Float]:
    # Most pairs are far apart; the square around a point is cheaper than the circle.
    side = reach * (1.0 + 1e-9)
    near = np.flatnonzero(np.abs(xy[one, 0] - others[other, 0]) <= side)
    near = near[np.abs(xy[one[near], 1] - others[other[near], 1]) <= side]
    one, other = one[near], other[near]
    offset = xy[one] - others[other]
    away = np.hypot(offset[:, 0], offset[:, 1])
    near = np.flatnonzero(away <= reach)
    return one[near], other[near], away[near]


def connected(one: Int, other: Int, count: int) -> Int:
    """Connected components: of each of `count` points, the least index in its component.

    Args:
        one: One end of each edge, shape (m,).
        other: The other end, shape (m,).
        count: Number of points.
    """
    root = np.arange(count)
    while len(one):
        np.minimum.at(root, np.maximum(one, other), np.minimum(one, other))
        up = root[root]
        while not np.array_equal(up, root):
            root, up = up, up[up]
        one, other = root[one], root[other]
        apart = one != other
        one, other = one[apart], other[apart]
    return root
