"""The planner: from the robots' scans and poses to people, one interval at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import starmap
from typing import TypeVar

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.bodies import detector as bodies
from mrs_people_loc.bodies.joining import JOINING_TUNING, JoiningTuning
from mrs_people_loc.bodies.places import PLACES_TUNING, PlaceMemory, PlacesTuning
from mrs_people_loc.cells import detector as cells
from mrs_people_loc.cells.splitting import SPLITTING_TUNING, SplittingTuning
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import PoseError, ScanError
from mrs_people_loc.following.groups import GROUPS_TUNING, Groups, GroupsTuning
from mrs_people_loc.following.tracks import TRACKS_TUNING, Off, Tracker, TracksTuning, anywhere
from mrs_people_loc.people import NOBODY, Group, Person, combine, gather
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import ShortTermMap, allow_for_walking, fuse, place_bodies
from mrs_people_loc.team.masking import (
    MASKING_TUNING,
    MaskingTuning,
    OccupancyGrid,
    Walls,
    mask,
)
from mrs_people_loc.team.poses import Pose, shared_effect
from mrs_people_loc.team.visibility import FieldsOfView
from mrs_people_loc.timing import StageTimes


@dataclass(frozen=True)
class PlannerTuning:
    """Constants of the planner's stages, beside the configuration."""

    masking: MaskingTuning = MASKING_TUNING
    joining: JoiningTuning = JOINING_TUNING
    places: PlacesTuning = PLACES_TUNING
    splitting: SplittingTuning = SPLITTING_TUNING
    tracks: TracksTuning = TRACKS_TUNING
    groups: GroupsTuning = GROUPS_TUNING


PLANNER_TUNING = PlannerTuning()

_Found = TypeVar("_Found", Person, Group)


@dataclass(frozen=True)
class People:
    """The result of one interval.

    Attributes:
        stamp_ns: Time of the interval, the stamp of its newest scan [ns].
        poses: By robot, the pose at its scan's stamp (`Pose.stamp_ns`) that was used.
        persons: The people in view, or out of it for at most `tracking.in_view_time`.
        groups: The largest first, with members who are hidden; one of all people where they are
            not followed.
        events: What has happened to the groups, in sentences.
        fused: The short-term map.
        clusters: Measures of its clusters.
        too_wide: How many clusters are wider than a person and could not be split: each may hold
            more people than were found.
        times_ms: Duration of each stage, by name [ms].
        quarantined: Robots that were left out (`team.quarantine`), sorted: the caller's part.
        hidden: The others who are followed (`Person.seen_at`).
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
    quarantined: tuple[str, ...] = ()
    hidden: tuple[Person, ...] = ()

    @property
    def everybody(self) -> tuple[Person, ...]:
        """Who is in view, and who is hidden, by id."""
        return tuple(sorted((*self.persons, *self.hidden), key=lambda person: person.id))

    @property
    def group(self) -> Group | None:
        """The largest group; None if nobody is there."""
        return self.groups[0] if self.groups else None


class Planner:
    """Detects people in the scans of all robots, and follows them.

    Args:
        config: Its configuration; may be replaced at any time.
        tuning: Its constants.

    Attributes:
        config: Likewise.
        tuning: Its constants.
        places: Remembers what stands where.
        tracker: Follows people.
        groups: Follows their groups.
        views: What robots have in view.
        walls: Of the map; None: there is no map.
    """

    def __init__(self, config: PlannerConfig, tuning: PlannerTuning = PLANNER_TUNING) -> None:
        self.config = config
        self.tuning = tuning
        self.places = PlaceMemory(tuning.places)
        self.tracker = Tracker(config.tracking, tuning.tracks)
        self.groups = Groups(config.groups, tuning.groups)
        self.views = FieldsOfView()
        self.walls: Walls | None = None

    def reset(self) -> None:
        """Forgets all people and places: the time jumped back. Ids of people and groups go on."""
        self.places.reset()
        self.tracker.reset()
        self.groups.reset()

    def take_grid(self, grid: OccupancyGrid | None) -> None:
        """Takes a map of walls and furniture, for the intervals that follow.

        Args:
            grid: In the common frame; None: there is no map.
        """
        if grid is None:
            self.walls = None
            return
        occupied_from = self.config.masking.occupied_from
        self.walls = Walls(grid, occupied_from=occupied_from, tuning=self.tuning.masking)

    def step(self, scans: Sequence[Scan], poses: Mapping[str, Pose], time_ns: int) -> People:
        """The people of one interval.

        Args:
            scans: At most one per robot.
            poses: By robot, its pose in the common frame at its scan's stamp; also of robots
                without a scan, which others may see. Detection and tracking use `Pose.in_team`
                where all have one; the people's covariances are in the map all the same.
            time_ns: Time of the interval [ns]. Where it is older than the last one by more than
                `clocks.RESET_NS`, all people are new.

        Raises:
            ScanError: A robot has two scans.
            PoseError: A robot has no pose.
        """
        scans = _by_robot(scans, poses)
        given = poses
        if all(pose.in_team is not None for pose in given.values()):
            poses = {name: pose.relative_to_team() for name, pose in given.items()}
        config, tuning, times = self.config, self.tuning, StageTimes()
        self.tracker.config, self.groups.config = config.tracking, config.groups
        expected = self.tracker.expect(time_ns) if config.tracking.enabled else NOBODY
        placed = allow_for_walking(scans, poses, time_ns, config.interval.walking_speed)
        fused = fuse(scans, placed)
        times.mark("fusion")
        seen = place_bodies(fused, placed, line_of_sight=config.joining.line_of_sight)
        masked = mask(fused, seen, poses, self.walls, config.masking, tuning=tuning.masking)
        times.mark("masking")
        # The default method detects in bodies, the paper's in cells that belong to no body.
        of_bodies = bodies.detect(
            fused, seen, masked, self.walls, expected, config, tuning.joining,
            places=self.places if config.tracking.enabled else None, time_ns=time_ns,
        )  # fmt: skip
        times.mark("joining")
        of_cells = cells.detect(fused, masked, placed, expected, config, tuning.splitting)
        found = combine(of_cells, of_bodies, min_distance=config.joining.apart)
        times.mark("clustering")
        looking = {name: poses[name] for name in fused.robots}
        persons, groups, events = self._follow(found.persons, looking, poses, time_ns, times)
        used = {scan.robot: given[scan.robot] for scan in scans}
        persons, groups = _in_map(persons, groups, used)
        return People(
            stamp_ns=time_ns,
            poses=used,
            persons=tuple(person for person in persons if person.seen_at is None),
            groups=groups,
            fused=fused,
            clusters=found.clusters,
            too_wide=found.too_wide,
            events=events,
            times_ms=times.ms,
            hidden=tuple(person for person in persons if person.seen_at is not None),
        )

    def _follow(
        self,
        persons: tuple[Person, ...],
        looking: Mapping[str, Pose],
        poses: Mapping[str, Pose],
        time_ns: int,
        times: StageTimes,
    ) -> tuple[tuple[Person, ...], tuple[Group, ...], tuple[str, ...]]:
        """Tracked people, their groups, and events of the groups."""
        if not self.config.tracking.enabled:
            everybody = gather(persons)
            return persons, (everybody,) if everybody else (), ()
        seen = [(name, person.position) for person in persons for name in person.robots]
        places = np.reshape([place for _, place in seen], (-1, 2))
        self.views.learn([name for name, _ in seen], places, looking)
        sees = partial(self.views.are_seen, looking=looking, robots=poses, walls=self.walls)
        off_walls: Off = anywhere
        if self.walls is not None:
            off_walls = partial(self.walls.off, least=self.config.masking.wall_margin)
        persons = self.tracker.step(persons, time_ns, sees, off_walls)
        times.mark("tracking")
        groups, events = self.groups.step(persons, time_ns)
        self.tracker.group_of = self.groups.group_of()
        times.mark("groups")
        return persons, groups, events


def _in_map(
    persons: Sequence[Person], groups: Sequence[Group], poses: Mapping[str, Pose]
) -> tuple[tuple[Person, ...], tuple[Group, ...]]:
    """With covariances in the map: those in the team's frame, and those of the team in the map."""
    places = [*(person.position for person in persons), *(group.centre for group in groups)]
    shared = shared_effect(poses.values(), np.reshape(places, (-1, 2)))
    if not shared.any():
        return tuple(persons), tuple(groups)
    return (
        tuple(starmap(_with, zip(persons, shared, strict=False))),
        tuple(starmap(_with, zip(groups, shared[len(persons) :], strict=True))),
    )


def _with(one: _Found, more: Float) -> _Found:
    """A person or a group with more covariance [m^2], shape (2, 2)."""
    return dataclasses.replace(one, covariance=one.covariance + more)


def _by_robot(scans: Sequence[Scan], poses: Mapping[str, Pose]) -> list[Scan]:
    """The scans in the order of their robots' names; checks that each has one, and a pose."""
    scans = sorted(scans, key=lambda scan: scan.robot)
    names = [scan.robot for scan in scans]
    if len(set(names)) < len(names):
        raise ScanError(f"two scans of one robot in an interval: {', '.join(names)}")
    missing = [name for name in names if name not in poses]
    if missing:
        raise PoseError(f"no pose for the scan of {', '.join(missing)}")
    return scans
