"""People: as detected, as expected, as followed, and the groups they walk in."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Float, Int, StructOfArrays
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.geometry import squared_mahalanobis
from mrs_people_loc.neighbours import pairs_between
from mrs_people_loc.team.fusion import ShortTermMap

#: Log-odds of being a person of a plain cluster of human size, for which nobody gives any.
PLAIN_SCORE = 6.0


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


@dataclass(frozen=True)
class Expected(StructOfArrays):
    """Where people are expected, a struct of arrays of one length (n,).

    Attributes:
        xy: Predicted places [m], shape (n, 2).
        covariance: Of the places [m^2], shape (n, 2, 2).
    """

    xy: Float
    covariance: Float

    def near(self, xy: Float, covariance: Float, *, gate: float, reach: float) -> Int:
        """Which of them something at a place may be, the nearest in sigmas; -1: none of them.

        Args:
            xy: Places [m], shape (m, 2).
            covariance: Of the places [m^2], shape (m, 2, 2).
            gate: No farther than this [sigmas],
            reach: ... and this [m].

        Returns:
            Indices, shape (m,).
        """
        if not len(self) or not len(xy):
            return np.full(len(xy), -1, dtype=np.intp)
        one, other, _ = pairs_between(xy, self.xy, reach)
        offset = xy[one] - self.xy[other]
        squared = squared_mahalanobis(offset, covariance[one] + self.covariance[other])
        nearest = np.full(len(xy), -1, dtype=np.intp)
        farthest_first = np.argsort(-squared, kind="stable")
        farthest_first = farthest_first[squared[farthest_first] <= gate**2]
        nearest[one[farthest_first]] = other[farthest_first]  # the last one stays
        return nearest


NOBODY = Expected(np.empty((0, 2)), np.empty((0, 2, 2)))


@dataclass(frozen=True)
class Detections:
    """What a detector found in some cells of a map.

    Attributes:
        cells: Indices of these cells, ascending, shape (n,).
        clusters: What they are clusters of; its labels are of these cells.
        persons: The people among the clusters.
        too_wide: How many clusters are wider than a person and could not be split: each may hold
            more people than were found.
    """

    cells: Int
    clusters: Clusters
    persons: tuple[Person, ...]
    too_wide: int = 0

    @classmethod
    def nothing(cls, fused: ShortTermMap) -> Detections:
        """Nothing, in no cell."""
        return cls(np.empty(0, dtype=np.intp), Clusters.none(len(fused.robots)), ())

    def unite(self, others: Detections, *, apart: float) -> Detections:
        """These and what another detector found in the other cells of the map.

        Where some robots seek bodies and others do not, both may see the same person.

        Args:
            others: They come first, and whoever is near to one of them is left out.
            apart: Two people are at least this far apart [m].
        """
        if not len(others.cells):
            return self
        if not len(self.cells):
            return others
        mine = np.array([person.position for person in self.persons]).reshape(-1, 2)
        theirs = np.array([person.position for person in others.persons]).reshape(-1, 2)
        near, _, away = pairs_between(mine, theirs, apart)
        same = set(near[away < apart].tolist())
        first = len(self.clusters)
        moved = [dataclasses.replace(one, label=first + one.label) for one in others.persons]
        alone = [one for number, one in enumerate(self.persons) if number not in same]
        cells = np.concatenate([self.cells, others.cells])
        label = np.concatenate([self.clusters.label, first + others.clusters.label])
        order = np.argsort(cells)
        return Detections(
            cells=cells[order],
            clusters=self.clusters.unite(others.clusters, label[order]),
            persons=(*moved, *alone),
            too_wide=self.too_wide + others.too_wide,
        )
