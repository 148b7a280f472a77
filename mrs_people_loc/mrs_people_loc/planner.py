"""The planner: from the robots' scans and poses to people, one interval at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.clustering import cluster
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import PoseError, ScanError
from mrs_people_loc.fusion import ShortTermMap, fuse
from mrs_people_loc.joining import are_people, are_robots, join, place_bodies
from mrs_people_loc.people import (
    Clusters,
    Group,
    Person,
    gather,
    is_human,
    locate,
    measure,
    people_of_bodies,
)
from mrs_people_loc.poses import Pose
from mrs_people_loc.scan import Scan
from mrs_people_loc.timing import StageTimes


@dataclass(frozen=True)
class People:
    """What one interval gave.

    Attributes:
        stamp_ns: Time of the interval, the stamp of its newest scan [ns].
        poses: By robot, the pose at its scan's stamp (`Pose.stamp_ns`): what it was made from.
        persons: The people.
        group: All of them together; None if nobody is there.
        fused: The short-term map.
        clusters: Measures of its clusters.
        times_ms: What each stage took, by name [ms].
    """

    stamp_ns: int
    poses: Mapping[str, Pose]
    persons: tuple[Person, ...]
    group: Group | None
    fused: ShortTermMap
    clusters: Clusters
    times_ms: dict[str, float] = field(default_factory=dict)


class Planner:
    """Finds the people in the scans of all robots.

    Args:
        config: Its configuration.
    """

    def __init__(self, config: PlannerConfig) -> None:
        self.config = config

    def step(self, scans: Sequence[Scan], poses: Mapping[str, Pose], time_ns: int) -> People:
        """The people of one interval.

        Args:
            scans: At most one per robot.
            poses: By robot, its pose in the common frame at its scan's stamp; also of robots
                without a scan, which others may see.
            time_ns: Time of the interval [ns].

        Raises:
            ScanError: A robot has two scans.
            PoseError: A robot has no pose.
        """
        scans = sorted(scans, key=lambda scan: scan.robot)
        names = [scan.robot for scan in scans]
        if len(set(names)) < len(names):
            raise ScanError(f"two scans of one robot in an interval: {', '.join(names)}")
        missing = [name for name in names if name not in poses]
        if missing:
            raise PoseError(f"no pose for the scan of {', '.join(missing)}")
        config, times = self.config, StageTimes()
        fused = fuse(scans, poses)
        times.mark("fusion")
        # Cells of bodies are joined body by body, all others cluster by cluster.
        bodies = place_bodies(fused, poses, line_of_sight=config.joining.line_of_sight)
        robots = are_robots(bodies, fused, poses, radius=config.joining.robot_radius)
        joined = join(bodies, ~robots, config.joining)
        times.mark("joining")
        label = np.full(len(fused), -1, dtype=np.intp)
        plain = bodies.of_cell < 0
        label[plain] = cluster(fused.xy[plain], distance=config.clustering.distance)
        first = int(label.max(initial=-1)) + 1  # of the joined ones; those that are robots follow
        of_body = np.where(robots, len(joined) + np.cumsum(robots) - 1, joined.of_body)
        label[~plain] = first + of_body[bodies.of_cell[~plain]]
        times.mark("clustering")
        clusters = measure(fused, label)
        human = is_human(clusters, config.human)
        human[first:] = False
        likely = are_people(joined, bodies, config.joining)
        persons = people_of_bodies(fused, clusters, joined, likely, first + np.arange(len(joined)))
        # Where some robots seek bodies and others do not, both may see the same person.
        persons += tuple(
            person
            for person in locate(fused, clusters, human, poses)
            if not (np.hypot(*(joined.xy[likely] - person.position).T) < config.joining.apart).any()
        )
        group = gather(persons)
        times.mark("people")
        used = {name: poses[name] for name in names}
        return People(time_ns, used, persons, group, fused, clusters, times.ms)
