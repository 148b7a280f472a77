"""The people that each robot of an interval sees by itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.cells.clustering import cluster
from mrs_people_loc.cells.human import is_human
from mrs_people_loc.clusters import measure
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.people import Person
from mrs_people_loc.team.fusion import ShortTermMap, fuse, place_bodies
from mrs_people_loc.team.intervals import Closed
from mrs_people_loc.team.masking import are_masked, bodies_of_robots
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.uncertainty import bounded

#: Who is slower than this [m/s], or than so many standard deviations, may stand.
_STANDS_M_S, _SURE_SIGMAS = 0.2, 2.0
#: Somebody seen within this of somebody found may be them [m].
_SAME_M = 0.6


@dataclass(frozen=True)
class SeenPeople:
    """People that one robot sees at one time.

    Attributes:
        stamp_ns: Time of the measurement [ns].
        xy: Places in the robot's base_link [m], shape (n, 2).
        covariance: Of the places, without that of the robot's pose [m^2], shape (n, 2, 2).
        stands: Who of them may stand, shape (n,); empty: that is not known.
        others: Places of bodies that are nobody for sure, and may be robots: likewise, shape (m,
            2).
        others_covariance: Likewise of these, shape (m, 2, 2).
    """

    stamp_ns: int
    xy: Float
    covariance: Float
    stands: Bool = field(default_factory=lambda: np.zeros(0, dtype=bool))
    others: Float = field(default_factory=lambda: np.empty((0, 2)))
    others_covariance: Float = field(default_factory=lambda: np.empty((0, 2, 2)))


def people_by_robot(
    fused: ShortTermMap,
    poses: Mapping[str, Pose],
    config: cfg.PlannerConfig,
    persons: Sequence[Person] = (),
) -> dict[str, SeenPeople]:
    """By robot, the people that it sees by itself, bodies and human-sized clusters of plain cells.

    Args:
        fused: The map of the interval.
        poses: By robot, the pose that its cells were placed with; robots at these are left out.
        config: What is human.
        persons: Those who were found, with their velocities.
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
        others = (bodies.robot == index) & ~likely
        people[name] = SeenPeople(
            fused.stamps_ns[index],
            (xy - (pose.x, pose.y)) @ rotation,
            rotation.T @ covariance @ rotation,
            _may_stand(xy, persons),
            (bodies.xy[others] - (pose.x, pose.y)) @ rotation,
            rotation.T @ bodies.covariance[others] @ rotation,
        )
    return people


def people_in(
    closed: Closed, persons: Sequence[Person], config: cfg.PlannerConfig
) -> dict[str, SeenPeople]:
    """By robot of an interval, the people that it sees by itself, also by those in quarantine.

    Where these are is not known: they mask nobody of the others', and whether those whom they see
    stand is not known.

    Args:
        closed: The interval.
        persons: Those who were found, with their velocities.
        config: What is human.
    """
    fused = fuse(closed.scans, closed.poses)
    found = people_by_robot(fused, closed.poses, config, persons)
    if closed.apart:
        fused = fuse(closed.apart, closed.apart_poses)
        apart = people_by_robot(fused, closed.apart_poses, config)
        unknown = np.zeros(0, dtype=bool)
        found |= {name: dataclasses.replace(one, stands=unknown) for name, one in apart.items()}
    return found


def _may_stand(xy: Float, persons: Sequence[Person]) -> Bool:
    """Who of those at some places on the map is not known to walk, shape (n,)."""
    known = [person for person in persons if person.velocity is not None]
    if not known:
        return np.ones(len(xy), dtype=bool)
    places = np.array([person.position for person in known])
    speed = np.hypot(*np.array([person.velocity for person in known]).T)
    sigma = np.sqrt([
        0.5 * np.trace(p.velocity_covariance) if p.velocity_covariance is not None else 0.0
        for p in known
    ])  # fmt: skip
    walks = speed > np.maximum(_STANDS_M_S, _SURE_SIGMAS * sigma)
    near = np.hypot(*np.moveaxis(xy[:, np.newaxis] - places, -1, 0)) < _SAME_M
    return np.asarray(~(near & walks).any(axis=1))


def _human_clusters(
    fused: ShortTermMap, robot: str, cells: Int, config: cfg.PlannerConfig
) -> tuple[Float, Float]:
    """Places of human-sized clusters of some cells of a robot, and covariances, on the map."""
    seen_by = np.zeros(len(cells), np.intp)
    part = ShortTermMap((robot,), seen_by, fused.xy[cells], fused.cells.select(cells), (0,))
    clusters = measure(part, cluster(part.xy, distance=config.clustering.distance))
    human = is_human(clusters, config.human)
    return clusters.centroid[human], bounded(clusters.scatter[human])
