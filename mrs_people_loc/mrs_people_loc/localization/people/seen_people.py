"""The people that each robot of an interval sees by itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.cells.clustering import cluster
from mrs_people_loc.cells.human import is_human
from mrs_people_loc.clusters import measure
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.team.fusion import ShortTermMap, place_bodies
from mrs_people_loc.team.masking import are_masked, bodies_of_robots
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.uncertainty import bounded


@dataclass(frozen=True)
class SeenPeople:
    """People that one robot sees at one time.

    Attributes:
        stamp_ns: Time of the measurement [ns].
        xy: Places in the robot's base_link [m], shape (n, 2).
        covariance: Of the places, without that of the robot's pose [m^2], shape (n, 2, 2).
    """

    stamp_ns: int
    xy: Float
    covariance: Float


def people_by_robot(
    fused: ShortTermMap, poses: Mapping[str, Pose], config: cfg.PlannerConfig
) -> dict[str, SeenPeople]:
    """By robot, the people that it sees by itself, bodies and human-sized clusters of plain cells.

    Args:
        fused: The map of the interval.
        poses: By robot, the pose that its cells were placed with; robots at these are left out.
        config: What is human.
    """
    exact = {
        name: dataclasses.replace(poses[name], covariance=np.zeros((3, 3))) for name in fused.robots
    }
    bodies = place_bodies(fused, exact, line_of_sight=config.joining.line_of_sight)
    robots = bodies_of_robots(bodies, fused.robots, poses, config.masking)
    likely = (bodies.score >= config.joining.min_score) & ~robots
    all_plain = np.flatnonzero(bodies.of_cell < 0)
    if len(all_plain):
        all_plain = all_plain[~are_masked(fused, all_plain, poses, None, config.masking)]
    people = {}
    for index, name in enumerate(fused.robots):
        mine = (bodies.robot == index) & likely
        xy, covariance = bodies.xy[mine], bodies.covariance[mine]
        plain = all_plain[fused.robot[all_plain] == index]
        if len(plain):
            centroid, scatter = _human_clusters(fused, name, plain, config)
            xy, covariance = np.concatenate([xy, centroid]), np.concatenate([covariance, scatter])
        pose, rotation = exact[name], rotation_2d(exact[name].yaw)
        people[name] = SeenPeople(
            fused.stamps_ns[index],
            (xy - (pose.x, pose.y)) @ rotation,
            rotation.T @ covariance @ rotation,
        )
    return people


def _human_clusters(
    fused: ShortTermMap, robot: str, cells: Int, config: cfg.PlannerConfig
) -> tuple[Float, Float]:
    """Places of human-sized clusters of some cells of a robot, and covariances, on the map."""
    seen_by = np.zeros(len(cells), np.intp)
    part = ShortTermMap((robot,), seen_by, fused.xy[cells], fused.cells.select(cells), (0,))
    clusters = measure(part, cluster(part.xy, distance=config.clustering.distance))
    human = is_human(clusters, config.human)
    return clusters.centroid[human], bounded(clusters.scatter[human])
