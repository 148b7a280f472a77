"""People as detected, expected and followed, and their groups."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.geometry import squared_mahalanobis
from mrs_people_loc.neighbours import pairs_between
from mrs_people_loc.team.fusion import ShortTermMap

#: Log-odds of being a person of a cluster of human size: the paper's test gives none.
PLAIN_SCORE = 6.0


@dataclass(frozen=True)
class Person:
    """One person in one interval, detected or followed.

    Attributes:
        position: In the common frame [m], shape (2,).
        covariance: Of the position [m^2], shape (2, 2).
        height: Highest supported point over the floor [m].
        sigma: Of the cluster, see `Clusters` [m].
        robots: Names of the robots that saw the person.
        label: The cluster; -1: none, they are not seen.
        score: Log-odds that it is a person.
        stamp_ns: When they were last seen, the mean of the robots' stamps [ns].
        id: Of the track, from 1; 0: not followed.
        velocity: In the common frame [m/s], shape (2,); None: unknown.
        velocity_covariance: Of the velocity [m^2/s^2], shape (2, 2); None: unknown.
        age_s: Time since they were first seen [s].
        coasting: Whether they are predicted, not seen.
        seen_at: Where they were last seen, of those whom nobody has seen for longer than
            `tracking.in_view_time` [m], shape (2,); None: in view.
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
    seen_at: Float | None = None


def persons_of(
    fused: ShortTermMap,
    clusters: Clusters,
    labels: Int,
    positions: Float,
    covariances: Float,
    scores: Float | None = None,
) -> tuple[Person, ...]:
    """Clusters that are people, as persons.

    Args:
        fused: The map.
        clusters: Measures of its clusters.
        labels: Which of them are people, shape (p,).
        positions: Where these are [m], shape (p, 2).
        covariances: Of the positions [m^2], shape (p, 2, 2).
        scores: Log-odds of each; None: the paper's test gives none.
    """
    seen_by = clusters.seen_by[labels]
    robots = [fused.robots[by] for by in np.nonzero(seen_by)[1].tolist()]
    count = seen_by.sum(axis=1)
    ends = np.cumsum(count)
    first_ns = min(fused.stamps_ns, default=0)
    later_ns = np.array(fused.stamps_ns, dtype=np.int64) - first_ns
    columns = [labels, clusters.height[labels], clusters.sigma[labels]]
    columns += [ends - count, ends, (seen_by @ later_ns) // count]
    scores = np.full(len(labels), PLAIN_SCORE) if scores is None else scores
    each = zip(*(column.tolist() for column in (*columns, scores)), strict=True)
    return tuple(
        Person(
            position=positions[who],
            covariance=covariances[who],
            height=height,
            sigma=sigma,
            robots=tuple(robots[begin:end]),
            label=label,
            score=score,
            stamp_ns=first_ns + after_ns,
        )
        for who, (label, height, sigma, begin, end, after_ns, score) in enumerate(each)
    )


@dataclass(frozen=True)
class Group:
    """People who walk together.

    Attributes:
        centre: Centre of gravity of their positions [m], shape (2,).
        covariance: Of the centre [m^2], shape (2, 2).
        radius: Distance to the farthest of them [m].
        rms_spread: Root mean square distance to them [m].
        size: How many they are.
        velocity: Of the centre [m/s], shape (2,); None: unknown.
        velocity_covariance: Of the velocity [m^2/s^2], shape (2, 2); None: unknown.
        members: Their ids, ascending; none if they are not followed.
        id: From 1; 0: groups are not followed.
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
    """All people as one group, about their centre of gravity; None if there are none."""
    one = np.zeros(len(people), dtype=np.intp)
    return next(iter(gather_each(people, one)), None)


def gather_each(people: Sequence[Person], number: Int) -> list[Group]:
    """People as groups, each about its centre of gravity.

    Args:
        people: Members of all groups.
        number: The group of each, from 0 on; each has a member, shape (n,).
    """
    if not people:
        return []
    size = np.bincount(number)

    def sums(values: Sequence[Float | None], *shape: int) -> Float:
        """Sums of the groups; NaN where a value is unknown."""
        made = np.zeros((len(size), *shape))
        unknown = np.full(shape, np.nan)
        np.add.at(made, number, np.array([unknown if one is None else one for one in values]))
        return made

    xy = np.array([p.position for p in people])
    centre = sums([*xy], 2) / size[:, np.newaxis]
    away = np.hypot(*(xy - centre[number]).T)
    radius = np.zeros(len(size))
    np.maximum.at(radius, number, away)
    rms_spread = np.sqrt(np.bincount(number, away**2) / size)
    squared = size[:, np.newaxis, np.newaxis] ** 2
    covariance = sums([p.covariance for p in people], 2, 2) / squared
    velocity = sums([p.velocity for p in people], 2) / size[:, np.newaxis]
    of_velocity = sums([p.velocity_covariance for p in people], 2, 2) / squared
    members: list[list[int]] = [[] for _ in size]
    for person, group in zip(people, number.tolist(), strict=True):
        if person.id:
            members[group].append(person.id)
    return [
        Group(
            centre=centre[k],
            covariance=covariance[k],
            radius=float(radius[k]),
            rms_spread=float(rms_spread[k]),
            size=int(size[k]),
            velocity=None if np.isnan(velocity[k]).any() else velocity[k],
            velocity_covariance=None if np.isnan(of_velocity[k]).any() else of_velocity[k],
            members=tuple(sorted(ids)),
        )
        for k, ids in enumerate(members)
    ]


@dataclass(frozen=True)
class Expected(StructOfArrays):
    """Where people are expected, a struct of arrays of one length (n,).

    Attributes:
        xy: Predicted places [m], shape (n, 2).
        covariance: Of the places [m^2], shape (n, 2, 2).
        id: Of their tracks.
        travelled: Whether they are elsewhere than where they were first seen.
    """

    xy: Float
    covariance: Float
    id: Int
    travelled: Bool

    def near(self, xy: Float, covariance: Float, *, gate: float, reach: float) -> Int:
        """Of each place, which expected person may be there, the nearest in sigmas; -1: none.

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


NOBODY = Expected(
    np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0, dtype=np.intp), np.empty(0, dtype=bool)
)


@dataclass(frozen=True)
class Detections:
    """What a detector found in some cells of a map.

    Attributes:
        cells: Indices of these cells, ascending, shape (n,).
        clusters: Their clusters; the labels are of these cells.
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
        number, value = np.empty(0, dtype=np.intp), np.empty(0)
        clusters = Clusters(
            label=number, centroid=np.empty((0, 2)), scatter=np.empty((0, 2, 2)), sigma=value,
            width=value, depth=value, height=value, bottom=value, cells=number, points=number,
            seen_by=np.empty((0, len(fused.robots)), dtype=bool),
        )  # fmt: skip
        return cls(number, clusters, ())


def combine(detections: Detections, preferred: Detections, *, min_distance: float) -> Detections:
    """Detections of two detectors in different cells of one map.

    Where some robots seek bodies and others do not, both detectors may see the same person.

    Args:
        detections: Their clusters come first.
        preferred: Their people come first, and those of the others that are nearer than the
            distance to one of them are left out.
        min_distance: Of two people [m].
    """
    if not len(preferred.cells):
        return detections
    if not len(detections.cells):
        return preferred
    xy, preferred_xy = (
        np.array([person.position for person in of.persons]).reshape(-1, 2)
        for of in (detections, preferred)
    )
    near, _, away = pairs_between(xy, preferred_xy, min_distance)
    same = set(near[away < min_distance].tolist())
    first = len(detections.clusters)
    moved = [dataclasses.replace(one, label=first + one.label) for one in preferred.persons]
    others = [one for number, one in enumerate(detections.persons) if number not in same]
    cells = np.concatenate([detections.cells, preferred.cells])
    label = np.concatenate([detections.clusters.label, first + preferred.clusters.label])
    order = np.argsort(cells)
    return Detections(
        cells=cells[order],
        clusters=detections.clusters.followed_by(preferred.clusters, label[order]),
        persons=(*moved, *others),
        too_wide=detections.too_wide + preferred.too_wide,
    )
