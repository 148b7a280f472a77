"""Splitting: people so close to each other that their cells are one cluster.

A cluster that is wider than a body is cut into as few parts as are no wider than one: shoulder to
shoulder or one behind the other. It stays whole, and is counted, where the parts do not all have
the height and the points of a person: then it may hold more people than it shows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float, Int, StructOfArrays
from mrs_people_loc.neighbours import pairs_between, pairs_within
from mrs_people_loc.team.fusion import CELL_SIGMA_RANGE, ShortTermMap, sights
from mrs_people_loc.team.poses import Pose

#: More people than this in one cluster are not told apart.
_MOST = 8
#: Somebody who is expected is in the cluster of the nearest cell, no farther than this [m].
_EXPECTED_WITHIN = 0.3
#: ... and two people are no nearer to each other than this [m].
_LEAST_APART = 0.25
#: Rounds of the k-means.
_ROUNDS = 8
#: Standard deviation of what is spread evenly over a width of 1.
_EVEN = 1.0 / math.sqrt(12.0)


def split(
    fused: ShortTermMap,
    cells: Int,
    label: Int,
    poses: Mapping[str, Pose],
    config: cfg.Splitting,
    human: cfg.Human,
) -> tuple[Int, int]:
    """Cuts clusters that are wider than a body into parts that are not.

    Cells count with the area that their points cover, so that the near one of two people draws no
    more than the far one. Widths are standard deviations along the line of sight and across it,
    as of an even surface; along it, what ranges err by is taken off.

    Args:
        fused: The map.
        cells: Indices of the cells that were clustered, shape (n,).
        label: Their clusters, from 0 without gaps, shape (n,).
        poses: By robot, the pose that its cells were placed with.
        config: Parameters.
        human: Of these, the height and the points of a person.

    Returns:
        New labels, shape (n,): the first part keeps the cluster's, the others follow all clusters,
        without gaps; and how many clusters are too wide but stay whole.
    """
    if not len(cells) or config.max_width <= 0:
        return label, 0
    seen_from = np.array([(poses[name].x, poses[name].y) for name in fused.robots])
    away = fused.xy[cells] - seen_from[fused.robot[cells]]
    squared_range = np.maximum((away**2).sum(axis=1), 1e-6)
    points_of_cells = np.maximum(fused.cells.count[cells].astype(np.float64), 1.0)
    view = _View(
        xy=fused.xy[cells],
        sight=sights(away),
        smear=(CELL_SIGMA_RANGE * squared_range) ** 2,
        points=points_of_cells,
        weight=points_of_cells * squared_range,
    )
    top = fused.cells.top[cells]
    limit = config.max_width * _EVEN
    fresh = int(label.max()) + 1
    spread = view.spreads(label, fresh)
    tall = np.full(fresh, -np.inf)
    np.maximum.at(tall, label, top)
    points = np.bincount(label, view.points, minlength=fresh)
    too_wide = (
        (spread > limit)
        & (points >= 2 * human.min_points)
        & (tall >= human.min_height)
        & (tall <= human.max_height)
    )
    label, whole = label.copy(), 0
    for number in np.flatnonzero(too_wide):
        mine = np.flatnonzero(label == number)
        part = _parts(
            view.select(mine),
            limit,
            first=max(2, int(spread[number] / limit)),
            least_points=human.min_points,
        )
        if part is None or not _are_tall_enough(part, top[mine], view.points[mine], human):
            whole += 1
            continue
        beyond = part > 0
        label[mine[beyond]] = fresh + part[beyond] - 1
        fresh += int(part.max())
    return label, whole


def split_at(expected: Float, fused: ShortTermMap, cells: Int, label: Int, human: cfg.Human) -> Int:
    """Cuts clusters in which several people are expected: each cell goes to the nearest of them.

    A cluster stays whole where a part would not have the height and the points of a person, or
    where parts would be too near to each other for two.

    Args:
        expected: Places [m], shape (k, 2).
        fused: The map.
        cells: Indices of the cells that were clustered, shape (n,).
        label: Their clusters, from 0 without gaps, shape (n,).
        human: Of these, the height and the points of a person.

    Returns:
        New labels, as those of `split`.
    """
    if len(expected) < 2:
        return label
    one, cell, away = pairs_between(expected, fused.xy[cells], _EXPECTED_WITHIN)
    nearest_first = np.argsort(away, kind="stable")
    one, cell = one[nearest_first], cell[nearest_first]
    whose, at = np.unique(one, return_index=True)  # the first is the nearest cell
    clusters, counts = np.unique(label[cell[at]], return_counts=True)
    label, fresh = label.copy(), int(label.max(initial=-1)) + 1
    for number in clusters[counts > 1]:
        mine = np.flatnonzero(label == number)
        within = expected[whose[label[cell[at]] == number]]
        xy, points = fused.xy[cells[mine]], fused.cells.count[cells[mine]].astype(np.float64)
        part = np.hypot(*(xy[:, np.newaxis] - within).T).T.argmin(axis=1)
        held = np.bincount(part, minlength=len(within))
        if not held.all() or not _are_tall_enough(
            part, fused.cells.top[cells[mine]], points, human
        ):
            continue
        # The halves of one person are nearer to each other than two people.
        middles = np.stack([np.bincount(part, axis) for axis in xy.T], axis=1) / held[:, np.newaxis]
        if len(pairs_within(middles, _LEAST_APART)[0]):
            continue
        label[mine[part > 0]] = fresh + part[part > 0] - 1
        fresh += len(within) - 1
    return label


@dataclass(frozen=True)
class _View(StructOfArrays):
    """Cells as they were seen, a struct of arrays of one length (n,).

    Attributes:
        xy: Places [m], shape (n, 2).
        sight: Directions from the robots that saw them, shape (n, 2).
        smear: Variance of their ranges [m^2].
        points: Number of 3D points in each.
        weight: Likewise, times the area that each covers.
    """

    xy: Float
    sight: Float
    smear: Float
    points: Float
    weight: Float

    def centres(self, part: Int, count: int) -> Float:
        """Centres of gravity of the parts, shape (count, 2)."""
        total = np.bincount(part, self.weight, minlength=count)
        sums = [np.bincount(part, self.weight * axis, minlength=count) for axis in self.xy.T]
        return np.asarray(np.stack(sums, axis=1) / total[:, np.newaxis])

    def spreads(self, part: Int, count: int) -> Float:
        """Standard deviation of each part, the larger one of along and across the sight [m]."""
        offset = self.xy - self.centres(part, count)[part]
        along = (offset * self.sight).sum(axis=1)
        across = offset[:, 0] * self.sight[:, 1] - offset[:, 1] * self.sight[:, 0]
        total = np.bincount(part, self.weight, minlength=count)
        variances = [
            np.bincount(part, self.weight * square, minlength=count) / total
            for square in (along**2 - self.smear, across**2)
        ]
        return np.sqrt(np.maximum(np.maximum(*variances), 0.0))


def _parts(view: _View, limit: float, *, first: int, least_points: int) -> Int | None:
    """Part of each cell, as few parts as are no wider than the limit; None if these are too many.

    k-means, which begins with parts of equal weight along the long axis.
    """
    weight = view.weight
    offset = view.xy - weight @ view.xy / weight.sum()
    view = dataclasses.replace(view, xy=offset)
    _, axes = np.linalg.eigh((offset.T * weight) @ offset)
    order = np.argsort(offset @ axes[:, -1], kind="stable")
    share = np.empty(len(weight))
    share[order] = (np.cumsum(weight[order]) - 0.5 * weight[order]) / weight.sum()
    most = min(_MOST, int(view.points.sum() / least_points))
    for count in range(first, most + 1):
        part = np.minimum((share * count).astype(np.intp), count - 1)
        if not np.bincount(part, minlength=count).all():
            continue  # one cell is most of it
        for _ in range(_ROUNDS):
            centres = view.centres(part, count)
            # Nearest centre: |p - c|^2 without |p|^2, which is the same for all.
            nearest = ((centres**2).sum(axis=1) - 2.0 * (offset @ centres.T)).argmin(axis=1)
            if np.array_equal(nearest, part):
                break
            part = nearest
            if not np.bincount(part, minlength=count).all():
                return None  # one of them has lost all its cells
        if (view.spreads(part, count) <= limit).all():
            return part
    return None


def _are_tall_enough(part: Int, top: NDArray[np.float32], points: Float, human: cfg.Human) -> bool:
    """Whether every part has the height and the points of a person."""
    tall = np.full(int(part.max()) + 1, -np.inf)
    np.maximum.at(tall, part, top)
    return bool(
        (np.bincount(part, points) >= human.min_points).all()
        and (tall >= human.min_height).all()
        and (tall <= human.max_height).all()
    )
