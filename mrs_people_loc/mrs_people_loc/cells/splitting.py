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

from mrs_people_loc import config as cfg
from mrs_people_loc.anthropometry import CLOSEST
from mrs_people_loc.arrays import Bool, Float, Float32, Int, StructOfArrays
from mrs_people_loc.geometry import unit_vectors
from mrs_people_loc.neighbours import pairs_between, pairs_within
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose

#: Standard deviation of what is spread evenly over a width of 1.
_EVEN = 1.0 / math.sqrt(12.0)


@dataclass(frozen=True)
class SplittingTuning:
    """Constants of splitting, chosen by hand.

    Attributes:
        most_people: More people than this in one cluster are not told apart; bounds the work.
        rounds: Rounds of k-means, at most.
        expected_within: An expected person belongs to the cluster of the nearest cell, if that is
            no farther than this [m]: about a body's width.
        least_apart: Centres of parts at expected people are no nearer to each other than this [m].
    """

    most_people: int = 8
    rounds: int = 8
    expected_within: float = 0.3
    least_apart: float = CLOSEST


SPLITTING_TUNING = SplittingTuning()

_NOWHERE: Float = np.empty((0, 2))


def split(
    fused: ShortTermMap,
    cells: Int,
    label: Int,
    poses: Mapping[str, Pose],
    config: cfg.Splitting,
    human: cfg.Human,
    *,
    expected: Float = _NOWHERE,
    cell_range_sigma: float = cfg.Masking.cell_range_sigma,
    tuning: SplittingTuning = SPLITTING_TUNING,
) -> tuple[Int, int]:
    """Cuts clusters of several expected people, and those that are wider than a body.

    Each cell is weighted with the area that its points cover, so that the nearer of two people has
    no more weight than the farther one. Widths are standard deviations along the line of sight and
    across it, as of an even surface; along it, the variance of the range is subtracted.

    Args:
        fused: The map.
        cells: Indices of the cells that were clustered, shape (n,).
        label: Their clusters, from 0 without gaps, shape (n,).
        poses: By robot, the pose that its cells were placed with.
        config: Parameters.
        human: Of these, the height and the points of a person.
        expected: Where people are expected [m], shape (k, 2); see `split_at`.
        cell_range_sigma: See `config.Masking` [1/m].
        tuning: Constants.

    Returns:
        New labels, shape (n,): the first part keeps the cluster's, the others follow all clusters,
        without gaps; and how many clusters are too wide but stay whole.
    """
    label = split_at(expected, fused, cells, label, human, tuning=tuning)
    if not len(cells) or config.max_width <= 0:
        return label, 0
    seen = _SeenCells.of(fused, cells, poses, cell_range_sigma)
    limit = config.max_width * _EVEN
    fresh = int(label.max()) + 1
    spread = seen.spreads(label, fresh)
    label, whole = label.copy(), 0
    for number in np.flatnonzero((spread > limit) & _may_be_several(seen, label, human)):
        mine = np.flatnonzero(label == number)
        some = seen.select(mine)
        first = max(2, int(spread[number] / limit))
        part = _parts(some, limit, first=first, least_points=human.min_points, tuning=tuning)
        if part is None or not _are_tall_enough(part, some.top, some.points, human):
            whole += 1
            continue
        beyond = part > 0
        label[mine[beyond]] = fresh + part[beyond] - 1
        fresh += int(part.max())
    return label, whole


def split_at(
    expected: Float,
    fused: ShortTermMap,
    cells: Int,
    label: Int,
    human: cfg.Human,
    *,
    tuning: SplittingTuning = SPLITTING_TUNING,
) -> Int:
    """Cuts clusters in which several people are expected: each cell goes to the nearest of them.

    A cluster stays whole where a part would not have the height and the points of a person, or
    where parts would be too near to each other for two.

    Args:
        expected: Places [m], shape (k, 2).
        fused: The map.
        cells: Indices of the cells that were clustered, shape (n,).
        label: Their clusters, from 0 without gaps, shape (n,).
        human: Of these, the height and the points of a person.
        tuning: Constants.

    Returns:
        New labels, as those of `split`.
    """
    if len(expected) < 2:
        return label
    one, cell, away = pairs_between(expected, fused.xy[cells], tuning.expected_within)
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
        top = fused.cells.top[cells[mine]]
        if not held.all() or not _are_tall_enough(part, top, points, human):
            continue
        # The halves of one person are nearer to each other than two people.
        middles = np.stack([np.bincount(part, axis) for axis in xy.T], axis=1) / held[:, np.newaxis]
        if len(pairs_within(middles, tuning.least_apart)[0]):
            continue
        label[mine[part > 0]] = fresh + part[part > 0] - 1
        fresh += len(within) - 1
    return label


@dataclass(frozen=True)
class _SeenCells(StructOfArrays):
    """Cells as the robots saw them, a struct of arrays of one length (n,).

    Attributes:
        xy: Places [m], shape (n, 2).
        bearing: Unit vectors from the robots that saw them, shape (n, 2).
        range_variance: Of their ranges [m^2].
        top: Top of each cell's column [m].
        points: Number of 3D points in each.
        weight: Likewise, times the area that each covers.
    """

    xy: Float
    bearing: Float
    range_variance: Float
    top: Float32
    points: Float
    weight: Float

    @classmethod
    def of(
        cls, fused: ShortTermMap, cells: Int, poses: Mapping[str, Pose], range_sigma: float
    ) -> _SeenCells:
        """Cells of a map; their ranges r err by `range_sigma` r^2."""
        seen_from = np.array([(poses[name].x, poses[name].y) for name in fused.robots])
        away = fused.xy[cells] - seen_from[fused.robot[cells]]
        squared_range = np.maximum((away**2).sum(axis=1), 1e-6)
        points = np.maximum(fused.cells.count[cells].astype(np.float64), 1.0)
        return cls(
            xy=fused.xy[cells],
            bearing=unit_vectors(away),
            range_variance=(range_sigma * squared_range) ** 2,
            top=fused.cells.top[cells],
            points=points,
            weight=points * squared_range,
        )

    def centres(self, part: Int, count: int) -> Float:
        """Centres of gravity of the parts, shape (count, 2)."""
        total = np.bincount(part, self.weight, minlength=count)
        sums = [np.bincount(part, self.weight * axis, minlength=count) for axis in self.xy.T]
        return np.asarray(np.stack(sums, axis=1) / total[:, np.newaxis])

    def spreads(self, part: Int, count: int) -> Float:
        """Standard deviation of each part, the larger of along and across the bearing [m]."""
        offset = self.xy - self.centres(part, count)[part]
        along = (offset * self.bearing).sum(axis=1)
        across = offset[:, 0] * self.bearing[:, 1] - offset[:, 1] * self.bearing[:, 0]
        total = np.bincount(part, self.weight, minlength=count)
        variances = [
            np.bincount(part, self.weight * square, minlength=count) / total
            for square in (along**2 - self.range_variance, across**2)
        ]
        return np.sqrt(np.maximum(np.maximum(*variances), 0.0))


def _may_be_several(seen: _SeenCells, label: Int, human: cfg.Human) -> Bool:
    """Which clusters have the height of a person and the points of two, shape (clusters,)."""
    count = int(label.max()) + 1
    tall = np.full(count, -np.inf)
    np.maximum.at(tall, label, seen.top)
    points = np.bincount(label, seen.points, minlength=count)
    several: Bool = points >= 2 * human.min_points
    return several & (tall >= human.min_height) & (tall <= human.max_height)


def _parts(
    seen: _SeenCells, limit: float, *, first: int, least_points: int, tuning: SplittingTuning
) -> Int | None:
    """Part of each cell, as few parts as are no wider than the limit; None if these are too many.

    k-means, initialized with parts of equal weight along the long axis.

    Args:
        seen: The cells.
        limit: Greatest standard deviation of a part [m].
        first: The fewest parts that are tried.
        least_points: 3D points of a part on average, at least.
        tuning: Constants.
    """
    weight = seen.weight
    offset = seen.xy - weight @ seen.xy / weight.sum()
    seen = dataclasses.replace(seen, xy=offset)
    _, axes = np.linalg.eigh((offset.T * weight) @ offset)
    order = np.argsort(offset @ axes[:, -1], kind="stable")
    share = np.empty(len(weight))
    share[order] = (np.cumsum(weight[order]) - 0.5 * weight[order]) / weight.sum()
    most = min(tuning.most_people, int(seen.points.sum() / least_points))
    for count in range(first, most + 1):
        part = np.minimum((share * count).astype(np.intp), count - 1)
        if not np.bincount(part, minlength=count).all():
            continue  # one cell is most of it
        for _ in range(tuning.rounds):
            centres = seen.centres(part, count)
            # Nearest centre: |p - c|^2 without |p|^2, which is the same for all.
            nearest = ((centres**2).sum(axis=1) - 2.0 * (offset @ centres.T)).argmin(axis=1)
            if np.array_equal(nearest, part):
                break
            part = nearest
            if not np.bincount(part, minlength=count).all():
                return None  # one of them has lost all its cells
        if (seen.spreads(part, count) <= limit).all():
            return part
    return None


def _are_tall_enough(part: Int, top: Float32, points: Float, human: cfg.Human) -> bool:
    """Whether every part has the height and the points of a person."""
    tall = np.full(int(part.max()) + 1, -np.inf)
    np.maximum.at(tall, part, top)
    return bool(
        (np.bincount(part, points) >= human.min_points).all()
        and (tall >= human.min_height).all()
        and (tall <= human.max_height).all()
    )
