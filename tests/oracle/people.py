"""One interval: from the cells on the map to people and their group, without memory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose
from oracle.clusters import Cluster, clusters_of, is_human, measured
from oracle.fusion import bodies_seen, of_pose
from oracle.joining import One, are_people, joined_of
from oracle.masking import Walls, is_masked, is_robot
from oracle.numbers import PLAIN_SCORE
from oracle.splitting import split_of


@dataclass(frozen=True)
class Found:
    """What is on a map; fields as in the core's `People`.

    Attributes:
        label: Cluster of each cell.
        clusters: The clusters.
        persons: The people: first bodies, then clusters of cells.
        too_wide: How many clusters are too wide but stay whole.
    """

    label: list[int]
    clusters: list[Cluster]
    persons: list[Person]
    too_wide: int


def people_on(
    fused: ShortTermMap,
    poses: Mapping[str, Pose],
    placed: Mapping[str, Pose],
    config: PlannerConfig,
    walls: Walls | None = None,
) -> Found:
    """The people on a map, where nobody is expected.

    Args:
        fused: The map.
        poses: By robot, its pose.
        placed: Likewise, as unsure as what was placed with it.
        config: The planner's configuration.
        walls: What is known of walls and furniture.
    """
    names = [fused.robots[i] for i in fused.robot]
    plain = [i for i in range(len(fused.xy)) if not fused.cells.body[i]]
    is_known = {i: is_masked(names[i], fused.xy[i], poses, config.masking, walls) for i in plain}
    masked, kept = ([i for i in plain if is_known[i] == which] for which in (True, False))
    pieces = clusters_of(_places(fused, kept), config.clustering.distance)
    range_sigma = config.masking.cell_range_sigma
    pieces, too_wide = split_of(
        fused, kept, pieces, placed, config.splitting, config.human, range_sigma
    )
    # First clusters of cells, then those of masked cells, of joined bodies, and of what is no part
    # of these: robots, and bodies that took no part in the joining.
    of_cells = max(pieces, default=-1) + 1
    others = clusters_of(_places(fused, masked), config.clustering.distance)
    of_bodies = of_cells + max(others, default=-1) + 1
    joined, rest = _joined(fused, poses, placed, config, walls)
    label = [-1] * len(fused.xy)
    for i, of in zip(kept, pieces, strict=True):
        label[i] = of
    for i, of in zip(masked, others, strict=True):
        label[i] = of_cells + of
    for number, cells in enumerate([*(one.cells for one in joined), *rest], of_bodies):
        for cell in cells:
            label[cell] = number
    clusters = measured([(x, y) for x, y in fused.xy.tolist()], label, fused.cells, names)
    persons = [
        replace(
            person_of(clusters[number], number, fused, placed),
            position=one.xy,
            covariance=one.covariance,
            score=one.score,
        )
        for number, (one, is_person) in enumerate(
            zip(joined, are_people(joined, config.joining), strict=True), of_bodies
        )
        if is_person
    ]
    # Where some robots seek bodies and others do not, both may see the same person.
    persons += [
        person_of(cluster, number, fused, placed)
        for number, cluster in enumerate(clusters[:of_cells])
        if is_human(cluster, config.human)
        and not any(
            math.dist(cluster.centroid, one.position) < config.joining.apart for one in persons
        )
    ]
    return Found(label, clusters, persons, too_wide)


def _joined(
    fused: ShortTermMap,
    poses: Mapping[str, Pose],
    placed: Mapping[str, Pose],
    config: PlannerConfig,
    walls: Walls | None,
) -> tuple[list[One], list[list[int]]]:
    """The bodies of a map, joined, and the cells of each that is part of none."""
    seen = bodies_seen(fused, placed, config.joining)
    radius = config.masking.robot_radius
    alone = [
        body
        for body in seen
        if not is_robot(body.robot, body.xy, body.covariance, poses, radius, body.score)
    ]
    joined = joined_of(alone, config.joining)
    if walls is not None:
        joined = [
            replace(one, score=one.score + walls.log_odds(one.xy, one.covariance, config.masking))
            for one in joined
        ]
    in_one = {cell for one in joined for cell in one.cells}
    return joined, [list(body.cells) for body in seen if not in_one & set(body.cells)]


def _places(fused: ShortTermMap, cells: Sequence[int]) -> list[tuple[float, float]]:
    return [(float(fused.xy[i, 0]), float(fused.xy[i, 1])) for i in cells]


def person_of(
    cluster: Cluster, label: int, fused: ShortTermMap, placed: Mapping[str, Pose]
) -> Person:
    """Position: centre of gravity. Covariance: of the cells, and of the poses that placed them."""
    of_poses = sum(of_pose(placed[name], np.array(cluster.centroid)) for name in cluster.robots)
    seen = len(cluster.robots)
    stamps = [fused.stamps_ns[fused.robots.index(name)] for name in cluster.robots]
    return Person(
        position=np.array(cluster.centroid),
        covariance=(cluster.scatter + of_poses / seen) / seen,
        height=cluster.height,
        sigma=cluster.sigma,
        robots=cluster.robots,
        label=label,
        score=PLAIN_SCORE,
        stamp_ns=sum(stamps) // seen,
    )


def group_of(persons: Sequence[Person]) -> Group | None:
    """All people together; None if there are none."""
    if not persons:
        return None
    n = len(persons)
    centre = sum(p.position for p in persons) / n
    away = [math.hypot(*(p.position - centre)) for p in persons]
    return Group(
        centre=np.asarray(centre),
        covariance=np.asarray(sum(p.covariance for p in persons) / n**2),
        radius=max(away),
        rms_spread=math.sqrt(sum(d * d for d in away) / n),
        size=n,
    )
