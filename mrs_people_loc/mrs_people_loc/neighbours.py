"""Neighbours: which points of the plane are near each other, without comparing all with all.

Where people and robots are spread over the floor, each has so many neighbours and no more, however
many there are in all: what looks at neighbours only grows no faster than the team.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc.arrays import Float, Int

if TYPE_CHECKING:
    from scipy.spatial import KDTree


#: So many pairs are looked at faster than a tree is made.
_FEW = 4096
#: Points that are farther out are looked for here [m]; squares of it are still far from infinite.
_FAR = 1e9


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
    if len(xy) * (len(xy) - 1) <= 2 * _FEW:
        return _near(xy, xy, *each_pair(len(xy)), reach)
    pairs = _tree(xy).query_pairs(_a_little_more(reach), output_type="ndarray")
    return _near(xy, xy, pairs[:, 0], pairs[:, 1], reach)


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
        one, other = np.divmod(np.arange(len(xy) * len(others)), len(others))
        return _near(xy, others, one, other, reach)
    pairs = _tree(xy).sparse_distance_matrix(
        _tree(others), _a_little_more(reach), output_type="ndarray"
    )
    return _near(xy, others, pairs["i"], pairs["j"], reach)


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


@functools.lru_cache(maxsize=64)
def each_pair(count: int) -> tuple[Int, Int]:
    """Indices of each pair of a few points, the smaller one first; to be read only."""
    return np.triu_indices(count, 1)


def _nobody() -> tuple[Int, Int, Float]:
    return np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0)


def _tree(xy: Float) -> KDTree:
    """A tree of the points, which it wants to be finite. Clipping takes none of them apart."""
    from scipy.spatial import KDTree  # here: it takes long to load

    return KDTree(np.fmin(np.fmax(xy, -_FAR), _FAR))  # of NaN and a number, the number


def _a_little_more(reach: float) -> float:
    """What rounding does in the tree must hide no pair."""
    return reach * (1.0 + 1e-9)


def _near(xy: Float, others: Float, one: Int, other: Int, reach: float) -> tuple[Int, Int, Float]:
    # Most pairs are far apart; the square around a point is cheaper than the circle.
    side = _a_little_more(reach)
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
