"""Clusters of cells, their measures, and which of them have the size of a human."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.config import Human
from mrs_people_loc.scan import Cells
from oracle.numbers import FLOAT32_ROUNDING_M

XY = tuple[float, float]


def clusters_of(places: Sequence[XY], distance: float) -> list[int]:
    """Eqs. 8-10: a label for each point, numbered by their least points (x, then y).

    From each point that has no label yet, to all within the distance of one that has got it.
    """
    xy, reach = np.reshape(places, (-1, 2)), distance + FLOAT32_ROUNDING_M
    label, number = np.full(len(places), -1), 0
    for first in sorted(range(len(places)), key=lambda i: tuple(places[i])):
        if label[first] >= 0:
            continue
        label[first] = number
        waiting = [first]
        while waiting:
            dx, dy = (xy - xy[waiting.pop()]).T
            near = np.flatnonzero((dx * dx + dy * dy <= reach**2) & (label < 0))
            label[near] = number
            waiting += near.tolist()
        number += 1
    return [int(of) for of in label]


@dataclass(frozen=True)
class Cluster:
    """Measures of one cluster; fields as in `Clusters`."""

    centroid: XY
    scatter: NDArray[np.float64]
    sigma: float
    width: float
    depth: float
    height: float
    bottom: float
    cells: int
    points: int
    robots: tuple[str, ...]
    has_axis: bool
    """Whether one direction is the longest; width and depth mean nothing where all are equal."""


def measured(
    places: Sequence[XY], label: Sequence[int], cells: Cells, robots: Sequence[str]
) -> list[Cluster]:
    """Measures each cluster.

    Args:
        places: Of the cells in the common frame.
        label: Cluster of each cell.
        cells: The cells.
        robots: Which robot each cell comes from.
    """
    found = []
    for cluster in range(max(label, default=-1) + 1):
        inside = [i for i, of in enumerate(label) if of == cluster]
        n = len(inside)
        cx, cy = (sum(places[i][axis] for i in inside) / n for axis in (0, 1))
        offsets = [(places[i][0] - cx, places[i][1] - cy) for i in inside]
        xx, xy, yy = (sum(o[a] * o[b] for o in offsets) / n for a, b in ((0, 0), (0, 1), (1, 1)))
        distances = [math.hypot(*o) for o in offsets]
        mean = sum(distances) / n
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
        cos, sin = math.cos(angle), math.sin(angle)
        along = [cos * dx + sin * dy for dx, dy in offsets]
        across = [cos * dy - sin * dx for dx, dy in offsets]
        found.append(
            Cluster(
                centroid=(cx, cy),
                scatter=np.array([[xx, xy], [xy, yy]]),
                sigma=math.sqrt(sum((d - mean) ** 2 for d in distances) / n),
                width=max(along) - min(along),
                depth=max(across) - min(across),
                height=max(float(cells.top[i]) for i in inside),
                bottom=min(float(cells.z_min[i]) for i in inside),
                cells=n,
                points=sum(int(cells.count[i]) for i in inside),
                robots=tuple(sorted({robots[i] for i in inside})),
                has_axis=math.hypot(2.0 * xy, xx - yy) > 1e-9,
            )
        )
    return found


def is_human(cluster: Cluster, config: Human) -> bool:
    """Whether a cluster has the size of a human (section 6.4)."""
    return (
        config.min_height <= cluster.height <= config.max_height
        and config.min_width <= cluster.width <= config.max_width
        and cluster.depth <= config.max_depth
        and cluster.points >= config.min_points
    )
