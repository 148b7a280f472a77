"""Clustering based segmentation of the map (eqs. 8-10, section 5.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import Float

Int = NDArray[np.intp]

#: Cell centres travel as float32; two that are exactly `distance` apart arrive up to 8 um off when
#: they are 100 m from their robot.
_ROUNDING = 1e-5
#: Points that are farther than this from the middle one, along y, are looked for together [m].
_FAR = 1e4
#: So many stretches of points are compared at once: memory that is new costs more than it is used.
_BLOCK = 4096


def cluster(xy: Float, *, distance: float) -> Int:
    """Labels points so that those within a distance, directly or over others, share a label.

    The paper's three rules (two free points, a free and a labelled one, two labelled ones: within
    d_th they belong together) say that clusters are the connected components of the graph whose
    edges join points at most d_th apart. It has one solution, whatever the order of the points.

    Args:
        xy: Points [m], shape (n, 2).
        distance: d_th [m], inclusive.

    Returns:
        Label of each point from 0, shape (n,). Clusters are numbered by their least point (x, then
        y), so the numbers do not depend on the order either.
    """
    count = len(xy)
    if count == 0:
        return np.empty(0, dtype=np.intp)
    order = np.lexsort((xy[:, 1], xy[:, 0]))
    root = connected(*_pairs_within(xy[order], distance + _ROUNDING), count)
    number = np.cumsum(root == np.arange(count)) - 1
    labels = np.empty(count, dtype=np.intp)
    labels[order] = number[root]
    return labels


def _pairs_within(xy: Float, reach: float) -> tuple[Int, Int]:
    """Pairs of points at most `reach` apart, each once: their indices, shapes (m,).

    The plane is cut into stripes along y that are `reach` wide. What is near a point lies in its
    own stripe or the next ones, not farther than `reach` along y: a stretch of the points sorted by
    stripe and y.

    Args:
        xy: Points in the order of x, shape (n, 2).
        reach: The distance, inclusive.
    """
    wide = 1.001 * reach  # what rounding does to the sums below must hide no pair
    x, y = xy[:, 0], xy[:, 1]
    # Stripes are numbered with no more than one empty one between, and y ends at `_FAR`: so a far
    # outlier costs no precision.
    steps = np.minimum(np.diff(np.floor(x / wide)), 2.0)
    stripe = np.concatenate([[0.0], np.cumsum(steps)])
    along = np.minimum(np.maximum(y - y[len(y) // 2], -_FAR), _FAR)
    length = 2.0 * _FAR + 3.0 * wide
    place = stripe * length + along  # the stripes laid end to end
    order = np.argsort(place)
    place, x, y = place[order], x[order], y[order]

    # In the own stripe what follows, in the next one all; the one before finds this point itself.
    index = np.arange(len(x))
    begin = np.concatenate([index + 1, np.searchsorted(place, place + (length - wide))])
    until = np.concatenate([place + wide, place + (length + wide)])
    count = np.searchsorted(place, until, side="right") - begin
    index = np.concatenate([index, index])
    found = []
    for first in range(0, len(index), _BLOCK):
        block = slice(first, first + _BLOCK)
        counts = count[block]
        one = np.repeat(index[block], counts)
        other = np.arange(len(one)) + np.repeat(begin[block] - (np.cumsum(counts) - counts), counts)
        near = np.flatnonzero((x[one] - x[other]) ** 2 + (y[one] - y[other]) ** 2 <= reach**2)
        found.append((order[one[near]], order[other[near]]))
    ones, others = zip(*found, strict=True)
    return np.concatenate(ones), np.concatenate(others)


def connected(one: Int, other: Int, count: int) -> Int:
    """Connected components: of each of `count` points, the least index that it is joined to.

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
