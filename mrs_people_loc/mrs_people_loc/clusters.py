"""Clusters: measures of each cluster of cells on the map (section 6.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.team.fusion import ShortTermMap


@dataclass(frozen=True)
class Clusters:
    """Measures of the clusters of a map, a struct of arrays of one length (m,).

    Attributes:
        label: Of each cell of the map, shape (n,).
        centroid: Centre of gravity of the cells [m], shape (m, 2).
        scatter: Covariance of the cells about it, shape (m, 2, 2) [m^2].
        sigma: The paper's sigma_d [m]: standard deviation, about their mean and divided by their
            number, of the distances from the centroid to the cells.
        width: Extent along the long principal axis [m].
        depth: Extent along the short principal axis, likewise [m].
        height: Highest top of its cells [m].
        bottom: Lowest z of its cells [m].
        cells: Number of cells.
        points: Number of 3D points in its cells.
        seen_by: Whether a robot of the map contributed, shape (m, robots).
    """

    label: Int
    centroid: Float
    scatter: Float
    sigma: Float
    width: Float
    depth: Float
    height: Float
    bottom: Float
    cells: Int
    points: Int
    seen_by: Bool

    def __len__(self) -> int:
        """Number of clusters."""
        return len(self.cells)

    def followed_by(self, others: Clusters, label: Int) -> Clusters:
        """These clusters, then others.

        Args:
            others: The others, of other cells of the same map.
            label: Cluster of each cell of both, shape (n,).
        """
        one, other = vars(self), vars(others)
        both = {name: np.concatenate([one[name], other[name]]) for name in one}
        return Clusters(**{**both, "label": label})


def measure(fused: ShortTermMap, label: Int, of: Int | slice = slice(None)) -> Clusters:
    """Measures each cluster of a map.

    Args:
        fused: The map.
        label: Cluster of each cell, from 0 without gaps, shape (n,).
        of: Indices of these cells, shape (n,); all cells of the map if not given.
    """
    xy, of_map = fused.xy[of], fused.cells
    count = int(label.max()) + 1 if len(label) else 0
    cells = np.bincount(label, minlength=count)
    x, y = xy[:, 0], xy[:, 1]
    centroid = np.stack(
        [np.bincount(label, axis, minlength=count) / cells for axis in (x, y)], axis=1
    )
    offset = xy - centroid[label]
    dx, dy = offset[:, 0], offset[:, 1]
    xx, yx, yy = (
        np.bincount(label, product, minlength=count) / cells
        for product in (dx * dx, dx * dy, dy * dy)
    )
    scatter = np.stack([xx, yx, yx, yy], axis=1).reshape(-1, 2, 2)

    order = np.argsort(label, kind="stable")
    first = np.cumsum(cells) - cells
    angle = 0.5 * np.arctan2(2.0 * yx, xx - yy)  # of the long axis
    cos, sin = np.cos(angle)[label], np.sin(angle)[label]
    distance = np.hypot(dx, dy)
    mean_distance = np.bincount(label, distance, minlength=count) / cells
    sigma = np.sqrt(
        np.bincount(label, (distance - mean_distance[label]) ** 2, minlength=count) / cells
    )
    seen_by = np.zeros((count, len(fused.robots)), dtype=bool)
    seen_by[label, fused.robot[of]] = True
    return Clusters(
        label=label,
        centroid=centroid,
        scatter=scatter,
        sigma=sigma,
        width=_extent((cos * dx + sin * dy)[order], first),
        depth=_extent((cos * dy - sin * dx)[order], first),
        height=_reduce(np.maximum, of_map.top[of][order], first),
        bottom=_reduce(np.minimum, of_map.z_min[of][order], first),
        cells=cells,
        points=np.bincount(label, of_map.count[of], minlength=count).astype(np.intp),
        seen_by=seen_by,
    )


def _reduce(function: np.ufunc, values: NDArray[np.floating], first: Int) -> Float:
    if not len(first):
        return np.empty(0)
    return np.asarray(function.reduceat(values, first), dtype=np.float64)


def _extent(values: Float, first: Int) -> Float:
    return _reduce(np.maximum, values, first) - _reduce(np.minimum, values, first)
