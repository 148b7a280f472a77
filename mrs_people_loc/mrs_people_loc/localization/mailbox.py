"""What a robot measured: kept until there is odometry for it, and repeated to the team."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable
from dataclasses import dataclass

from mrs_people_loc.localization.odometry import Odometry, OdometryTrack
from mrs_people_loc.localization.shared import (
    RelativePose,
    StandingPeople,
    TeamMeasurement,
    TeamPose,
)
from mrs_people_loc.localization.walls import SeenWalls
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class MailTuning:
    """Constants of what waits and what is repeated, chosen by hand.

    Attributes:
        waits_ns: A measurement waits for odometry for so long at most [ns] ...
        most_waiting: ... as one of so many.
        repeated_ns: It is repeated in messages for so long after it was taken [ns].
        most_walls: A message holds at most so many walls.
        remembered: So many stamps are recognized, at least.
    """

    waits_ns: int = 3_000_000_000
    most_waiting: int = 200
    repeated_ns: int = 300_000_000
    most_walls: int = 40
    remembered: int = 250


MAIL_TUNING = MailTuning()
Measured = SeenWalls | Pose | TeamMeasurement


class RecentSet:
    """The things that were added last: `MailTuning.remembered` of them, and at most twice that."""

    def __init__(self) -> None:
        self._items: dict[Hashable, None] = {}

    def __contains__(self, item: Hashable) -> bool:
        """Whether it was added lately."""
        return item in self._items

    def add(self, item: Hashable) -> None:
        """Adds one; it may drop those that came first."""
        self._items[item] = None
        if len(self._items) > 2 * MAIL_TUNING.remembered:
            self._items = dict.fromkeys(list(self._items)[MAIL_TUNING.remembered :])


class Inbox:
    """A robot's measurements, until there is odometry for their stamps.

    Args:
        robot: The robot's name.
        track_of: The odometry of a robot of the team.

    Attributes:
        late: How many came too late, or there was no odometry for their stamps, so far.
    """

    def __init__(self, robot: str, track_of: Callable[[str], OdometryTrack]) -> None:
        self.late = 0
        self._robot, self._track_of = robot, track_of
        self.clear()

    def clear(self) -> None:
        """Forgets everything that waits."""
        self._waiting: list[Measured] = []
        self._stamps = RecentSet()

    def add(self, seen: Measured) -> None:
        """Takes a measurement.

        A stamp of walls or poses that another measurement of this kind has is made a little newer:
        two sensors may measure at once.
        """
        if isinstance(seen, SeenWalls | Pose):
            stamp_ns = seen.stamp_ns
            while (type(seen), stamp_ns) in self._stamps:
                stamp_ns += 1
            self._stamps.add((type(seen), stamp_ns))
            seen = dataclasses.replace(seen, stamp_ns=stamp_ns)
        self._waiting.append(seen)
        if len(self._waiting) > MAIL_TUNING.most_waiting:
            del self._waiting[0]
            self.late += 1

    def due(self) -> list[Measured]:
        """Takes out what there is odometry for by now."""
        if not self._waiting:
            return []
        waiting, due = [], []
        own = self._track_of(self._robot).newest
        for seen in self._waiting:
            tracks = [(self._track_of(robot), t) for robot, t in self._needed_by(seen)]
            newest = [track.newest for track, _ in tracks]
            if own is not None and own.stamp_ns - seen.stamp_ns > MAIL_TUNING.waits_ns:
                self.late += 1
            elif any(n is None or n.stamp_ns < t for n, (_, t) in zip(newest, tracks, strict=True)):
                waiting.append(seen)
            elif all(track.covers(stamp_ns) for track, stamp_ns in tracks):
                due.append(seen)
            else:
                self.late += 1
        self._waiting = waiting
        return due

    def _needed_by(self, seen: Measured) -> list[tuple[str, int]]:
        """Whose odometry a measurement needs, and at which stamps [ns]."""
        if isinstance(seen, RelativePose):
            return [(seen.robot, seen.stamp_ns), (seen.other, seen.other_stamp_ns)]
        if isinstance(seen, StandingPeople):
            return [(seen.robot, seen.stamp_ns)]
        return [(self._robot, seen.stamp_ns)]


class Outbox:
    """What a robot measured lately: its messages repeat it, so that a lost one costs nothing."""

    def __init__(self) -> None:
        self._taken: list[tuple[int, SeenWalls | Pose]] = []

    def add(self, seen: SeenWalls | Pose, now_ns: int) -> None:
        """Takes a measurement at a time [ns]: walls of sonars come long after their stamps."""
        self._taken = [*self._since(now_ns), (now_ns, seen)]

    def message(self, robot: str, pose: Pose, odometry: Odometry) -> TeamPose:
        """A robot's message to its team."""
        recent = [seen for _, seen in self._since(odometry.stamp_ns)]
        walls = [seen for seen in recent if isinstance(seen, SeenWalls)]
        count, first = 0, len(walls)
        while first and count + len(walls[first - 1].walls) <= MAIL_TUNING.most_walls:
            first -= 1
            count += len(walls[first].walls)
        absolute = tuple(seen for seen in recent if isinstance(seen, Pose))
        return TeamPose(robot, pose, odometry, tuple(walls[first:]), absolute)

    def _since(self, now_ns: int) -> list[tuple[int, SeenWalls | Pose]]:
        return [one for one in self._taken if one[0] >= now_ns - MAIL_TUNING.repeated_ns]
