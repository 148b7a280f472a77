"""People: what each cluster measures, which are human-sized, where they are (section 6.4)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.bodies.joining import Joined
from mrs_people_loc.geometry import Float
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose, pose_effect, stack

Int = NDArray[np.intp]
Bool = NDArray[np.bool_]

#: Log-odds of being a person of a plain cluster of human size, for which nobody gives any.
PLAIN_SCORE = 6.0


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


@dataclass(frozen=True)
class Person:
    """One person in one interval: as found, or as followed from interval to interval.

    Attributes:
        position: In the common frame [m], shape (2,).
        covariance: Of the position [m^2], shape (2, 2).
        height: Highest supported point over the floor [m].
        sigma: Of the cluster, see `Clusters` [m].
        robots: Names of the robots that saw the person.
        label: The cluster; -1: none, he is not seen.
        score: Log-odds that it is a person.
        stamp_ns: When the robots looked at him last, the mean of their scans' stamps [ns].
        id: Who it is, from 1; 0: not followed.
        velocity: In the common frame [m/s], shape (2,); None: unknown.
        velocity_covariance: Of the velocity [m^2/s^2], shape (2, 2); None: unknown.
        age_s: Time since he was first seen [s].
        coasting: Whether he is predicted, not seen.
    """

    position: Float
    covariance: Float
    height: float
    sigma: float
    robots: tuple[str, ...]
    label: int
    score: float = PLAIN_SCORE
    stamp_ns: int = 0
    id: int = 0
    velocity: Float | None = None
    velocity_covariance: Float | None = None
    age_s: float = 0.0
    coasting: bool = False


@dataclass(frozen=True)
class Group:
    """People who belong together.

    Attributes:
        centre: Centre of gravity of their positions [m], shape (2,).
        covariance: Of the centre [m^2], shape (2, 2).
        radius: Distance to the farthest of them [m].
        rms_spread: Root mean square distance to them [m].
        size: How many they are.
        velocity: Of the centre [m/s], shape (2,); None: unknown.
        velocity_covariance: Of the velocity [m^2/s^2], shape (2, 2); None: unknown.
        members: Their ids, ascending; none if they are not followed.
        id: Which group it is, from 1; 0: groups are not followed.
        stragglers: Ids of members that have fallen behind or left, and for how long [s].
    """

    centre: Float
    covariance: Float
    radius: float
    rms_spread: float
    size: int
    velocity: Float | None = None
    velocity_covariance: Float | None = None
    members: tuple[int, ...] = ()
    id: int = 0
    stragglers: Mapping[int, float] = field(default_factory=dict)


def measure(fused: ShortTermMap, label: Int) -> Clusters:
    """Measures each cluster of a map.

    Args:
        fused: The map.
        label: Cluster of each cell, from 0 without gaps, shape (n,).
    """
    count = int(label.max()) + 1 if len(label) else 0
    cells = np.bincount(label, minlength=count)
    x, y = fused.xy[:, 0], fused.xy[:, 1]
    centroid = np.stack(
        [np.bincount(label, axis, minlength=count) / cells for axis in (x, y)], axis=1
    )
    offset = fused.xy - centroid[label]
    dx, dy = offset[:, 0], offset[:, 1]
    xx, xy, yy = (
        np.bincount(label, product, minlength=count) / cells
        for product in (dx * dx, dx * dy, dy * dy)
    )
    scatter = np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2)

    order = np.argsort(label, kind="stable")
    first = np.cumsum(cells) - cells
    angle = (0.5 * np.arctan2(2.0 * xy, xx - yy))[label]  # of the long axis
    cos, sin = np.cos(angle), np.sin(angle)
    distance = np.hypot(dx, dy)
    mean_distance = np.bincount(label, distance, minlength=count) / cells
    sigma = np.sqrt(
        np.bincount(label, (distance - mean_distance[label]) ** 2, minlength=count) / cells
    )
    seen_by = np.zeros((count, len(fused.robots)), dtype=bool)
    seen_by[label, fused.robot] = True
    return Clusters(
        label=label,
        centroid=centroid,
        scatter=scatter,
        sigma=sigma,
        width=_extent((cos * dx + sin * dy)[order], first),
        depth=_extent((cos * dy - sin * dx)[order], first),
        height=_reduce(np.maximum, fused.cells.top[order], first),
        bottom=_reduce(np.minimum, fused.cells.z_min[order], first),
        cells=cells,
        points=np.bincount(label, fused.cells.count, minlength=count).astype(np.intp),
        seen_by=seen_by,
    )


def _reduce(function: np.ufunc, values: NDArray[np.floating], first: Int) -> Float:
    if not len(first):
        return np.empty(0)
    return np.asarray(function.reduceat(values, first), dtype=np.float64)


def _extent(values: Float, first: Int) -> Float:
    return _reduce(np.maximum, values, first) - _reduce(np.minimum, values, first)


def is_human(clusters: Clusters, config: cfg.Human) -> Bool:
    """Whether each cluster has the size of a human, shape (m,).

    The paper names number of points, height, width and depth; the limits are configuration.
    """
    return (
        (clusters.height >= config.min_height)
        & (clusters.height <= config.max_height)
        & (clusters.width >= config.min_width)
        & (clusters.width <= config.max_width)
        & (clusters.depth <= config.max_depth)
        & (clusters.points >= config.min_points)
    )


def locate(
    fused: ShortTermMap,
    clusters: Clusters,
    human: Bool,
    poses: Mapping[str, Pose],
) -> tuple[Person, ...]:
    """The people: position is the centre of gravity of the cluster's cells.

    The covariance adds, to first order, two parts: the scatter of the cells, since each robot sees
    a near surface of the body and not its axis, divided by the number of robots that saw it; and
    the mean of what the poses of these robots are uncertain by at the person's place.

    Args:
        fused: The map.
        clusters: Measures of its clusters.
        human: Which of them are people, shape (m,).
        poses: By robot, the pose that its cells were placed with.
    """
    labels = np.flatnonzero(human)
    positions, seen_by = clusters.centroid[labels], clusters.seen_by[labels]
    places, of_pose = stack(poses[name] for name in fused.robots)
    person, robot = np.nonzero(seen_by)
    of_poses = np.zeros((len(labels), 2, 2))
    effect = pose_effect(places[robot], of_pose[robot], positions[person])
    np.add.at(of_poses, person, effect)
    robots = seen_by.sum(axis=1)[:, np.newaxis, np.newaxis]
    covariances = (clusters.scatter[labels] + of_poses / robots) / robots
    return tuple(
        Person(
            position=positions[i],
            covariance=covariances[i],
            height=float(clusters.height[label]),
            sigma=float(clusters.sigma[label]),
            robots=tuple(itertools.compress(fused.robots, seen_by[i])),
            label=int(label),
            stamp_ns=_mean_stamp(fused, seen_by[i]),
        )
        for i, label in enumerate(labels)
    )


def people_of_bodies(
    fused: ShortTermMap,
    clusters: Clusters,
    joined: Joined,
    people: Bool,
    label: Int,
) -> tuple[Person, ...]:
    """The people among joined bodies: place and covariance are those of the joining.

    Args:
        fused: The map.
        clusters: Measures of its clusters.
        joined: The joined bodies.
        people: Which of them are people, shape (m,).
        label: Cluster of each of them, shape (m,).
    """
    return tuple(
        Person(
            position=joined.xy[i],
            covariance=joined.covariance[i],
            height=float(clusters.height[label[i]]),
            sigma=float(clusters.sigma[label[i]]),
            robots=tuple(itertools.compress(fused.robots, clusters.seen_by[label[i]])),
            label=int(label[i]),
            score=float(joined.score[i]),
            stamp_ns=_mean_stamp(fused, clusters.seen_by[label[i]]),
        )
        for i in np.flatnonzero(people)
    )


def _mean_stamp(fused: ShortTermMap, seen_by: Bool) -> int:
    stamps = list(itertools.compress(fused.stamps_ns, seen_by))
    return sum(stamps) // len(stamps)


def gather(people: Sequence[Person]) -> Group | None:
    """People as one group, about the centre of gravity of their positions; None of nobody."""
    if not people:
        return None
    positions = np.array([person.position for person in people])
    centre = positions.mean(axis=0)
    distance = np.hypot(*(positions - centre).T)
    velocities = [p.velocity for p in people if p.velocity is not None]
    unsure = [p.velocity_covariance for p in people if p.velocity_covariance is not None]
    return Group(
        centre=centre,
        covariance=np.sum([p.covariance for p in people], axis=0) / len(people) ** 2,
        radius=float(distance.max()),
        rms_spread=float(np.sqrt(np.mean(distance**2))),
        size=len(people),
        velocity=np.mean(velocities, axis=0) if len(velocities) == len(people) else None,
        velocity_covariance=(
            np.sum(unsure, axis=0) / len(people) ** 2 if len(unsure) == len(people) else None
        ),
        members=tuple(sorted(person.id for person in people if person.id)),
    )
