"""The planner: from the robots' scans and poses to people, one interval at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.bodies.joining import are_people, join, place_bodies
from mrs_people_loc.cells.clustering import cluster
from mrs_people_loc.cells.splitting import split, split_at
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import PoseError, ScanError
from mrs_people_loc.following.groups import Groups
from mrs_people_loc.following.tracks import NOBODY, Tracker
from mrs_people_loc.neighbours import pairs_between
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
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import ShortTermMap, fuse
from mrs_people_loc.team.masking import OccupancyGrid, Walls, are_masked, bodies_of_robots
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.timing import StageTimes


@dataclass(frozen=True)
class People:
    """What one interval gave.

    Attributes:
        stamp_ns: Time of the interval, the stamp of its newest scan [ns].
        poses: By robot, the pose at its scan's stamp (`Pose.stamp_ns`): what it was made from.
        persons: The people.
        groups: Who belongs together, the largest group first; all of them are one where they are
            not followed, none where nobody is there.
        events: What has happened to the groups, in sentences.
        fused: The short-term map.
        clusters: Measures of its clusters.
        too_wide: How many clusters are wider than a person and could not be split: each may hold
            more people than were found.
        times_ms: What each stage took, by name [ms].
    """

    stamp_ns: int
    poses: Mapping[str, Pose]
    persons: tuple[Person, ...]
    groups: tuple[Group, ...]
    fused: ShortTermMap
    clusters: Clusters
    too_wide: int = 0
    events: tuple[str, ...] = ()
    times_ms: dict[str, float] = field(default_factory=dict)

    @property
    def group(self) -> Group | None:
        """The largest group; None if nobody is there."""
        return self.groups[0] if self.groups else None


class Planner:
    """Finds the people in the scans of all robots, and follows them.

    Args:
        config: Its configuration; may be replaced at any time.

    Attributes:
        config: Likewise.
        tracker: Follows people.
        groups: Follows who belongs together.
    """

    def __init__(self, config: PlannerConfig) -> None:
        self.config = config
        self.tracker = Tracker(config.tracking)
        self.groups = Groups(config.groups)
        self._walls: Walls | None = None

    def begin_anew(self) -> None:
        """Forgets everybody: the time jumped back. Ids of people and groups go on."""
        self.tracker.begin_anew()
        self.groups.begin_anew()

    def take_grid(self, grid: OccupancyGrid | None) -> None:
        """Takes what is known of walls and furniture, for the intervals that follow.

        Args:
            grid: In the common frame; None: nothing is known.
        """
        occupied_from = self.config.masking.occupied_from
        self._walls = None if grid is None else Walls(grid, occupied_from=occupied_from)

    def step(self, scans: Sequence[Scan], poses: Mapping[str, Pose], time_ns: int) -> People:
        """The people of one interval.

        Args:
            scans: At most one per robot.
            poses: By robot, its pose in the common frame at its scan's stamp; also of robots
                without a scan, which others may see.
            time_ns: Time of the interval [ns]. Where it is older than the last one by more than
                `clocks.RESET_NS`, everybody is new.

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
        tracking = config.tracking
        self.tracker.config, self.groups.config = tracking, config.groups
        expected = self.tracker.expect(time_ns) if tracking.enabled else NOBODY
        placed = _at_one_time(scans, poses, time_ns, config.interval.walking_speed)
        fused = fuse(scans, placed)
        times.mark("fusion")
        # Cells of bodies are joined body by body, all others cluster by cluster.
        bodies = place_bodies(fused, placed, line_of_sight=config.joining.line_of_sight)
        robots = bodies_of_robots(bodies, fused.robots, poses, config.masking)
        plain = np.flatnonzero(bodies.of_cell < 0)
        masked = are_masked(fused, plain, poses, self._walls, config.masking)
        times.mark("masking")
        joined = join(bodies, ~robots, config.joining)
        if self._walls is not None:
            said = self._walls.log_odds(joined.xy, joined.covariance, config.masking)
            joined = dataclasses.replace(joined, score=joined.score + said)
        nearby = {"gate": tracking.gate, "reach": tracking.max_distance}
        who = expected.near(joined.xy, joined.covariance, **nearby)
        times.mark("joining")
        # First the clusters that may be people, then joined bodies, then all that is masked.
        label = np.full(len(fused), -1, dtype=np.intp)
        distance = config.clustering.distance
        possible = plain[~masked]
        pieces = cluster(fused.xy[possible], distance=distance)
        pieces = split_at(expected.xy, fused, possible, pieces, config.human)
        label[possible], too_wide = split(
            fused, possible, pieces, poses, config.splitting, config.human
        )
        first = int(label.max(initial=-1)) + 1
        none = joined.of_body < 0  # robots, and what is one too many in its place
        of_body = np.where(none, len(joined) + np.cumsum(none) - 1, joined.of_body)
        of_bodies = bodies.of_cell >= 0
        label[of_bodies] = first + of_body[bodies.of_cell[of_bodies]]
        beyond = first + len(joined) + int(none.sum())
        label[plain[masked]] = beyond + cluster(fused.xy[plain[masked]], distance=distance)
        times.mark("clustering")
        clusters = measure(fused, label)
        human = strong = is_human(clusters, config.human)
        if len(expected):
            fewer = round(config.human.min_points * tracking.expected_points)
            weak = is_human(clusters, dataclasses.replace(config.human, min_points=max(1, fewer)))
            near_one = expected.near(clusters.centroid, clusters.scatter, **nearby) >= 0
            human = strong | (weak & near_one)
        human = human & (np.arange(len(clusters)) < first)
        said = np.where(who >= 0, tracking.expected_score, 0.0)
        likely = are_people(
            dataclasses.replace(joined, score=joined.score + said),
            bodies,
            config.joining,
            expected=who,
        )
        persons = people_of_bodies(fused, clusters, joined, likely, first + np.arange(len(joined)))
        # Where some robots seek bodies and others do not, both may see the same person.
        centroids = clusters.centroid[human]
        alone = np.ones(len(centroids), dtype=bool)
        near, _, away = pairs_between(centroids, joined.xy[likely], config.joining.apart)
        alone[near[away < config.joining.apart]] = False
        human[human] = alone
        persons += tuple(
            person if strong[person.label] else dataclasses.replace(person, score=0.0)
            for person in locate(fused, clusters, human, placed)
        )
        times.mark("people")
        if tracking.enabled:
            persons = self.tracker.step(persons, time_ns)
            times.mark("tracking")
            groups, events = self.groups.step(persons, time_ns)
            times.mark("groups")
        else:
            everybody = gather(persons)
            groups, events = (everybody,) if everybody else (), ()
        used = {name: poses[name] for name in names}
        return People(time_ns, used, persons, groups, fused, clusters, too_wide, events, times.ms)


def _at_one_time(
    scans: Sequence[Scan], poses: Mapping[str, Pose], time_ns: int, walking_speed: float
) -> dict[str, Pose]:
    """The poses that place the scans, less sure by what people walk from a scan to the interval."""
    placed = dict(poses)
    for scan in scans:
        walked = walking_speed * (time_ns - scan.stamp_ns) / 1e9
        if walked:
            spread = np.diag([walked**2, walked**2, 0.0])
            pose = poses[scan.robot]
            placed[scan.robot] = dataclasses.replace(pose, covariance=pose.covariance + spread)
    return placed
