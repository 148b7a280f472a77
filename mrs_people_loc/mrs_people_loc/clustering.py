"""Clustering based segmentation of the map (eqs. 8-10, section 5.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mrs_people_loc.geometry import Float

Int = NDArray[np.intp]

#: Cell centres travel as float32; two that are exactly `distance` apart arrive up to 0.5 um off.
_ROUNDING = 1e-6


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
    pairs = cKDTree(xy).query_pairs(distance + _ROUNDING, output_type="ndarray")
    graph = coo_array(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count)
    )
    _, labels = connected_components(graph, directed=False)
    order = np.lexsort((xy[:, 1], xy[:, 0]))
    _, first = np.unique(labels[order], return_index=True)  # by label: where it appears first
    number = np.empty(len(first), dtype=np.intp)
    number[np.argsort(first)] = np.arange(len(first))
    result: Int = number[labels]
    return result
