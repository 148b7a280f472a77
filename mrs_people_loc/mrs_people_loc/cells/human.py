"""Which clusters are people, and where these are (section 6.4)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.people import Person, persons_of
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose, places_and_covariances
from mrs_people_loc.uncertainty import pose_effect


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
    places, of_pose = places_and_covariances(poses[name] for name in fused.robots)
    person, robot = np.nonzero(seen_by)
    of_poses = np.zeros((len(labels), 2, 2))
    effect = pose_effect(places[robot], of_pose[robot], positions[person])
    np.add.at(of_poses, person, effect)
    robots = seen_by.sum(axis=1)[:, np.newaxis, np.newaxis]
    covariances = (clusters.scatter[labels] + of_poses / robots) / robots
    return persons_of(fused, clusters, labels, positions, covariances)
