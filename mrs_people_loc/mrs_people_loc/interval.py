"""Intervals: which scans, placed with which poses, make one run of the planner.

An interval closes when every live robot has delivered a scan newer than the one last used and the
poses to place it, or `max_wait` after the first of those scans, whichever comes first. A scan is
used once. Time is an argument everywhere, so that live nodes and tests do the same.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from mrs_people_loc import config as cfg
from mrs_people_loc.errors import PoseError, ScanError
from mrs_people_loc.poses import Pose, PoseBuffer
from mrs_people_loc.scan import Scan

#: A stamp that jumps back by more than this is a new beginning (a bag that loops) [ns].
RESET_NS = 1_000_000_000


@dataclass(frozen=True)
class Closed:
    """One closed interval: what `Planner.step` takes.

    Attributes:
        scans: One per robot that takes part.
        poses: By robot, its pose at its scan's stamp.
        time_ns: Stamp of the newest scan [ns].
        left_out: By robot, why its scan takes no part.
        others: By robot whose scan takes no part, its pose at `time_ns` where one is near enough:
            it may be in view of those that do.
    """

    scans: tuple[Scan, ...]
    poses: Mapping[str, Pose]
    time_ns: int
    left_out: Mapping[str, str]
    others: Mapping[str, Pose]

    @property
    def all_poses(self) -> dict[str, Pose]:
        """Every pose that is known, for `Planner.step`."""
        return {**self.others, **self.poses}


@dataclass
class RobotState:
    """What the collector knows of one robot.

    Attributes:
        poses: Its poses over time.
        pending: Its scan that waits for the interval to close.
        used_ns: Stamp of the scan last used or left out [ns].
        heard_ns: When its last scan arrived [ns]; for a robot that is known to take part and was
            not heard yet, when the first scan of any robot did.
        dropped: Scans that were not used, by reason: superseded, too_old, no_pose.
        resets: How often its stamps jumped back by more than `RESET_NS`.
    """

    poses: PoseBuffer = field(default_factory=PoseBuffer)
    pending: Scan | None = None
    used_ns: int | None = None
    heard_ns: int | None = None
    dropped: Counter[str] = field(default_factory=Counter)
    resets: int = 0


class IntervalCollector:
    """Gathers scans and poses until an interval closes.

    Args:
        config: When it closes.
        robots: Robots that are known to take part: at the beginning they are waited for, too.
    """

    def __init__(self, config: cfg.Interval, robots: Iterable[str] = ()) -> None:
        self.config = config
        self.robots: dict[str, RobotState] = {name: RobotState() for name in robots}
        self._began_ns: int | None = None
        self._opened_ns: int | None = None

    def robot(self, name: str) -> RobotState:
        """The state of a robot, which is made when it is first asked for."""
        return self.robots.setdefault(name, RobotState())

    def add_pose(self, robot: str, pose: Pose) -> None:
        """Takes a pose of a robot in the common frame.

        Raises:
            PoseError: Its stamp is repeated.
        """
        self.robot(robot).poses.add(pose)

    def add_scan(self, scan: Scan, now_ns: int) -> None:
        """Takes a scan.

        Args:
            scan: The scan.
            now_ns: When it arrived [ns].

        Raises:
            ScanError: It is not newer than the robot's last one.
        """
        if self._began_ns is None:
            self._began_ns = now_ns
            for known in self.robots.values():
                known.heard_ns = now_ns
        state = self.robot(scan.robot)
        state.heard_ns = now_ns
        newest = state.pending.stamp_ns if state.pending else state.used_ns
        if newest is not None and scan.stamp_ns <= newest:
            if newest - scan.stamp_ns <= RESET_NS:
                raise ScanError(f"stamp is {scan.stamp_ns} ns; wanted: newer than {newest} ns")
            state.resets += 1
        if state.pending is not None:
            state.dropped["superseded"] += 1
        state.pending = scan
        if self._opened_ns is None:
            self._opened_ns = now_ns

    def close(self, now_ns: int) -> Closed | None:
        """Closes the interval if its time has come.

        Args:
            now_ns: The time [ns].

        Returns:
            The interval (without scans if none of them can be used); None if it stays open.
        """
        if self._opened_ns is None:
            return None
        if now_ns < self._opened_ns:  # the clock was set back
            self._opened_ns = now_ns
        waited = now_ns - self._opened_ns >= self.config.max_wait * 1e9
        if not waited and not all(self._ready(s) for s in self._live(now_ns)):
            return None
        self._opened_ns = None
        return self._take()

    def _live(self, now_ns: int) -> list[RobotState]:
        timeout_ns = self.config.robot_timeout * 1e9
        live = []
        for state in self.robots.values():
            if state.heard_ns is not None:
                state.heard_ns = min(state.heard_ns, now_ns)  # the clock may be set back
                if now_ns - state.heard_ns <= timeout_ns:
                    live.append(state)
        return live

    @staticmethod
    def _ready(state: RobotState) -> bool:
        return state.pending is not None and state.poses.covers(state.pending.stamp_ns)

    def _take(self) -> Closed:
        pending = {name: s.pending for name, s in self.robots.items() if s.pending is not None}
        newest_ns = max(scan.stamp_ns for scan in pending.values())
        max_age_ns = self.config.max_scan_age * 1e9
        scans: list[Scan] = []
        poses: dict[str, Pose] = {}
        left_out: dict[str, str] = {}
        for name, scan in pending.items():
            state = self.robots[name]
            state.pending, state.used_ns = None, scan.stamp_ns
            age_ns = newest_ns - scan.stamp_ns
            if age_ns > max_age_ns:
                state.dropped["too_old"] += 1
                left_out[name] = (
                    f"scan is {age_ns / 1e9:.3f} s older than the newest; "
                    f"allowed: {self.config.max_scan_age:g} s"
                )
                continue
            try:
                poses[name] = state.poses.at(scan.stamp_ns, round(self.config.max_pose_age * 1e9))
            except PoseError as err:
                state.dropped["no_pose"] += 1
                left_out[name] = str(err)
                continue
            scans.append(scan)
        time_ns = max((scan.stamp_ns for scan in scans), default=newest_ns)
        others: dict[str, Pose] = {}
        for name, state in self.robots.items():
            if name not in poses:
                with contextlib.suppress(PoseError):
                    others[name] = state.poses.at(time_ns, round(self.config.max_pose_age * 1e9))
        return Closed(tuple(scans), poses, time_ns, left_out, others)
