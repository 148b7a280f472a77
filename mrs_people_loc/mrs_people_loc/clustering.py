"""Clustering based segmentation of the map (eqs. 8-10, section 5.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import Float

Int = NDArray[np.intp]

#: Cell centres travel as float32; two that are exactly `distance` apart arrive up to 8 um off when
#: they are 100 m from their robot.
_ROUNDING = 1e-5


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
    root = _join(*_pairs_within(xy[order], distance + _ROUNDING), count)
    number = np.cumsum(root == np.arange(count)) - 1
    labels = np.empty(count, dtype=np.intp)
    labels[order] = number[root]
    return labels


def _pairs_within(xy: Float, reach: float) -> tuple[Int, Int]:
    """Pairs of points at most `reach` apart, each once: their indices, shapes (m,).

    The plane is cut into stripes along y that are `reach` wide. What is near a point lies in its
    own stripe or the next ones, not farther than `reach` along y: a stretch of the points sorted by
    stripe and y.
    """
    wide = 1.001 * reach  # what rounding does to the sums below must hide no pair
    # Stretches where nothing is are cut short, so that a far outlier costs no precision.
    stripe = _closed_up(np.floor(xy[:, 0] / wide), 2.0)
    y = _closed_up(xy[:, 1], 2.0 * wide)
    length = y.max() + 3.0 * wide
    place = stripe * length + y  # the stripes laid end to end
    order = np.argsort(place)
    place = place[order]

    # In the own stripe what follows, in the next one all; the one before finds this point itself.
    index = np.arange(len(xy))
    begin = np.concatenate([index + 1, np.searchsorted(place, place + (length - wide))])
    until = np.concatenate([place + wide, place + (length + wide)])
    count = np.searchsorted(place, until, side="right") - begin
    one = np.repeat(np.concatenate([index, index]), count)
    other = np.arange(len(one)) + np.repeat(begin - (np.cumsum(count) - count), count)
    one, other = order[one], order[other]
    near = np.flatnonzero(((xy[one] - xy[other]) ** 2).sum(axis=1) <= reach**2)
    return one[near], other[near]


def _closed_up(values: Float, gap: float) -> Float:
    """The values from 0 on, with no gap between neighbours longer than `gap`."""
    order = np.argsort(values)
    steps = np.minimum(np.diff(values[order], prepend=values[order[0]]), gap)
    closed = np.empty_like(values)
    closed[order] = np.cumsum(steps)
    return closed


def _join(one: Int, other: Int, count: int) -> Int:
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
