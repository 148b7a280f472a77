"""Intervals: which scans, placed with which poses, make one run of the planner.

An interval closes when every live robot has delivered a scan newer than the one last used and the
poses to place it, or `max_wait` after the first of those scans, whichever comes first. A scan is
used once. What is older than the newest, of this interval or of the last one, by more than
`max_scan_age` is not used: it would put people back to where they were. Time is an argument
everywhere, so that live nodes and tests do the same.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float
from mrs_people_loc.clocks import RESET_NS, ClockOffset, Order, StampOrder, right_offset
from mrs_people_loc.errors import PoseError, ScanError
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.poses import Pose, PoseBuffer

#: A robot that was not named at the beginning, and is silent for so long, is forgotten [ns].
_FORGET_NS = 600_000_000_000
#: No message is so late [ns]: what is so much older than what silent robots saw is of another time.
_LATEST_NS = 60_000_000_000


@dataclass(frozen=True)
class Closed:
    """One closed interval: what `Planner.step` takes.

    Attributes:
        scans: One per robot that takes part.
        poses: By robot, its pose at its scan's stamp.
        time_ns: Stamp of the newest scan [ns], of this interval or of the last one: it never goes
            back, unless time itself does.
        left_out: By robot, why its scan takes no part.
        others: By robot whose scan takes no part, its pose at `time_ns`, or the one nearest to it
            within `robot_timeout`: it may be in view of those that do. Where a robot is whose poses
            are older is not known; those in quarantine are in `apart_poses`.
        quarantined: Robots in quarantine, sorted.
        apart: Their scans, which find no people but tell where they are.
        apart_poses: By robot in quarantine, its pose at the stamp of that; without one as in
            `others`.
    """

    scans: tuple[Scan, ...]
    poses: Mapping[str, Pose]
    time_ns: int
    left_out: Mapping[str, str]
    others: Mapping[str, Pose]
    quarantined: tuple[str, ...] = ()
    apart: tuple[Scan, ...] = ()
    apart_poses: Mapping[str, Pose] = field(default_factory=dict)

    @property
    def all_poses(self) -> dict[str, Pose]:
        """Every pose that is known, for `Planner.step`."""
        return {**self.others, **self.poses}

    @property
    def everywhere(self) -> dict[str, Pose]:
        """Those of robots in quarantine, too: any of them may be what another one sees."""
        return {**self.all_poses, **self.apart_poses}


@dataclass
class RobotState:
    """What the collector knows of one robot.

    Attributes:
        poses: Its poses over time.
        pending: Its scan that waits for the interval to close.
        ahead_ns: What the stamp of that scan was ahead of the planner's clock by on arrival [ns].
        used_ns: Stamp of the scan last used or left out [ns].
        seen_ns: Stamp of the scan last used, less what its clock is ahead [ns]; None since its
            stamps jumped back.
        restarted: Whether its stamps jumped back since a scan of it was used.
        heard_ns: When its last scan arrived [ns]; for a robot that is known to take part and was
            not heard yet, when the first scan of any robot did.
        dropped: Scans that were not used, by reason: superseded, too_old, no_pose, clock_offset.
        order: Of its scans' stamps.
        clock: Its clock against the planner's.
        apart: Whether it is in quarantine.
    """

    poses: PoseBuffer = field(default_factory=PoseBuffer)
    pending: Scan | None = None
    ahead_ns: int = 0
    used_ns: int | None = None
    seen_ns: int | None = None
    restarted: bool = False
    heard_ns: int | None = None
    dropped: Counter[str] = field(default_factory=Counter)
    order: StampOrder = field(default_factory=StampOrder)
    clock: ClockOffset = field(default_factory=ClockOffset)
    apart: bool = False

    @property
    def ready(self) -> bool:
        """Whether its scan is there, and the poses on both sides of it."""
        return self.pending is not None and self.poses.covers(self.pending.stamp_ns)

    def reset(self) -> None:
        """Forgets everything but the counts."""
        self.poses.clear()
        self.order.reset()
        self.clock.reset()
        self.pending = self.used_ns = self.seen_ns = None
        self.restarted = False


class IntervalCollector:
    """Gathers scans and poses until an interval closes.

    Where time jumps back by more than `RESET_NS`, as where a bag loops, it begins again: where the
    time that it is given does, or the stamps of every robot that is heard. One robot whose stamps
    jump back alone has a clock that is wrong: its scans are too old. So are those of one that is
    late, also where it is the only one left, until they are newer than the last interval.

    Args:
        config: When it closes.
        robots: Robots that are known to take part: at the beginning they are waited for, too.
    """

    def __init__(self, config: cfg.Interval, robots: Iterable[str] = ()) -> None:
        self.config = config
        self.robots: dict[str, RobotState] = {name: RobotState() for name in robots}
        self._named = frozenset(self.robots)
        self._began = False
        self._opened_ns: int | None = None
        self._now_ns: int | None = None
        self._last_ns = 0  # time of the last interval
        self._awaited: RobotState | None = None

    def reset(self) -> None:
        """Forgets everything but the robots and the counts: the time jumped back."""
        self._opened_ns, self._last_ns = None, 0
        for state in self.robots.values():
            state.reset()

    def robot(self, name: str) -> RobotState:
        """The state of a robot, which is made when it is first asked for."""
        return self.robots.setdefault(name, RobotState())

    def add_pose(self, robot: str, pose: Pose, now_ns: int) -> None:
        """Takes a pose of a robot in the common frame that arrives now [ns].

        Raises:
            PoseError: Its stamp is repeated, or it comes too late to be of use.
        """
        self._at(now_ns)
        state = self.robot(robot)
        resets = state.poses.resets
        state.clock.add(pose.stamp_ns, now_ns)
        state.poses.add(pose)
        if state.poses.resets > resets:
            state.clock.add(pose.stamp_ns, now_ns, restarted=True)

    def add_covariance_in_team(self, robot: str, stamp_ns: int, covariance: Float) -> None:
        """Takes the covariance of a robot's poses relative to its team, see `Pose.in_team`.

        Args:
            robot: Its name; one that has no poses is left out.
            stamp_ns: Of the covariance [ns].
            covariance: Of x, y, yaw, shape (3, 3).
        """
        if robot in self.robots:
            self.robots[robot].poses.in_team = stamp_ns, covariance

    def add_scan(self, scan: Scan, now_ns: int) -> None:
        """Takes a scan that arrives now [ns].

        Raises:
            ScanError: It is not newer than the robot's last one.
        """
        self._at(now_ns)
        if not self._began:
            self._began = True
            for known in self.robots.values():
                known.heard_ns = now_ns
        state = self.robot(scan.robot)
        state.heard_ns = now_ns
        state.clock.add(scan.stamp_ns, now_ns)
        newest = state.order.newest_ns
        order = state.order.take(scan.stamp_ns)
        if order is Order.LATE:
            raise ScanError(f"stamp is {scan.stamp_ns} ns; wanted: newer than {newest} ns")
        if order is Order.RESTART:
            state.clock.add(scan.stamp_ns, now_ns, restarted=True)
            state.seen_ns, state.restarted = None, True
        first = not state.apart and all(one.pending is None for one in self._taking_part)
        if state.pending is not None:
            state.dropped["superseded"] += 1
        state.pending, state.ahead_ns = scan, scan.stamp_ns - now_ns
        if self._opened_ns is None or first:
            # What is too old is counted with the next interval, and makes none by itself.
            last_ns = self._last_seen_ns(now_ns, scan.stamp_ns)
            if last_ns is None or last_ns - scan.stamp_ns <= self._max_age_ns:
                self._opened_ns = now_ns

    def close(self, now_ns: int, quarantined: Collection[str] = ()) -> Closed | None:
        """Closes the interval if its time has come.

        Args:
            now_ns: The time [ns].
            quarantined: Robots in quarantine: their scans open no interval while others are heard,
                and none waits for them.

        Returns:
            The interval (without scans if none of them can be used); None if it stays open.
        """
        self._at(now_ns)
        for name, state in self.robots.items():
            state.apart = name in quarantined
        if self._opened_ns is None:
            return None
        if quarantined:
            others = self._taking_part
            heard = any(self._is_heard(state.heard_ns, now_ns) for state in others)
            if heard and all(state.pending is None for state in others):
                return None
        waited = now_ns - self._opened_ns >= self.config.max_wait * 1e9
        if not waited and self._awaits(now_ns):
            return None
        self._opened_ns = None
        return self._take(now_ns)

    def clock_offsets(self, now_ns: int) -> dict[str, int]:
        """By robot that is heard, what its clock is ahead of the planner's by [ns]."""
        offsets = {name: state.clock.at(now_ns) for name, state in self.robots.items()}
        return {name: offset for name, offset in offsets.items() if offset is not None}

    def clocks_astray(self, now_ns: int) -> dict[str, int]:
        """By robot whose clock does not agree with the others', what it is ahead by [ns]."""
        return self._astray(self.clock_offsets(now_ns), now_ns)

    def _astray(self, offsets: Mapping[str, int], now_ns: int) -> dict[str, int]:
        right_ns, allowed_ns = self._right_ns(offsets, now_ns), self._allowed_offset_ns
        return {
            name: offset - right_ns
            for name, offset in offsets.items()
            if offset - right_ns > allowed_ns
            or (right_ns - offset > allowed_ns and self.robots[name].clock.is_settled(now_ns))
        }

    def _right_ns(self, offsets: Mapping[str, int], now_ns: int) -> int:
        """What the right clock is ahead by [ns]: that of a robot that is not silent, if one is."""
        heard = (
            offset
            for name, offset in offsets.items()
            if self._is_heard(self.robots[name].clock.heard_ns, now_ns)
        )
        return right_offset(list(heard) or offsets.values())

    def apart_m(self, name: str) -> float | None:
        """How far a robot's last pose is from the nearest other robot's [m]; None: it is alone."""
        places = {other: state.poses.newest for other, state in self.robots.items()}
        mine = places.pop(name, None)
        if mine is None:
            return None
        away = (math.hypot(mine.x - o.x, mine.y - o.y) for o in places.values() if o is not None)
        return min(away, default=None)

    @property
    def _allowed_offset_ns(self) -> int:
        return round(self.config.max_clock_offset * 1e9)

    @property
    def _max_age_ns(self) -> int:
        return round(self.config.max_scan_age * 1e9)

    def _last_seen_ns(self, now_ns: int, stamp_ns: int) -> int | None:
        """When the newest scan was made that had a part, as far as it counts for a stamp [ns].

        A robot whose stamps have jumped back has had none since. Where those of all that are heard
        have (a recording that loops) there is none (None), also of those that are silent: it was
        another time. One that is late, while others go on or fall silent, is just late.
        """
        heard: list[RobotState] = []
        silent: list[RobotState] = []
        for state in self.robots.values():
            (heard if self._is_heard(state.heard_ns, now_ns) else silent).append(state)
        seen_ns = [state.seen_ns for state in heard if state.seen_ns is not None]
        if seen_ns or not any(state.restarted for state in heard):
            seen_ns += [
                state.seen_ns
                for state in silent
                if state.seen_ns is not None and state.seen_ns - stamp_ns <= _LATEST_NS
            ]
        return max(seen_ns, default=None)

    def _is_heard(self, last_ns: int | None, now_ns: int) -> bool:
        """Whether a robot that was heard last at a time [ns] is not silent now."""
        return last_ns is not None and now_ns - last_ns <= self.config.robot_timeout * 1e9

    def _at(self, now_ns: int) -> None:
        """Follows the time, where it is set back, too."""
        back_ns = 0 if self._now_ns is None else self._now_ns - now_ns
        self._now_ns = now_ns
        if back_ns <= 0:
            return
        if back_ns > RESET_NS:
            self.reset()
        elif self._opened_ns is not None:
            self._opened_ns = min(self._opened_ns, now_ns)
        for state in self.robots.values():
            if state.heard_ns is not None:
                state.heard_ns = min(state.heard_ns, now_ns)

    @property
    def _taking_part(self) -> list[RobotState]:
        """The robots that are not in quarantine."""
        return [state for state in self.robots.values() if not state.apart]

    def _awaits(self, now_ns: int) -> bool:
        """Whether a live robot is not ready; the one last waited for is looked at first."""

        def awaited(state: RobotState) -> bool:
            is_heard = self._is_heard(state.heard_ns, now_ns)
            return is_heard and not state.ready and not state.apart

        if self._awaited is None or not awaited(self._awaited):
            self._awaited = next(filter(awaited, self.robots.values()), None)
        return self._awaited is not None

    def _take(self, now_ns: int) -> Closed:
        """Makes the interval of the scans that wait."""
        left_out: dict[str, str] = {}
        # No delay makes a stamp seem ahead, so that is known of each scan by itself.
        offsets = self.clock_offsets(now_ns)
        for name, state in self.robots.items():
            if state.pending is not None:
                offsets[name] = max(offsets.get(name, state.ahead_ns), state.ahead_ns)
        off_ns, right_ns = self._astray(offsets, now_ns), self._right_ns(offsets, now_ns)
        pending, stamp_ns = self._take_pending(off_ns, left_out)
        apart = {name: pending.pop(name) for name in list(pending) if self.robots[name].apart}
        # When each was made by the right clock: one that is a little ahead does not make the
        # others' scans old.
        made_ns = {
            name: scan.stamp_ns - max(self.robots[name].ahead_ns - right_ns, 0)
            for name, scan in pending.items()
        }
        seen_ns = self._last_seen_ns(now_ns, max(made_ns.values(), default=stamp_ns))
        newest_ns = max(*made_ns.values(), seen_ns or 0, 0)
        scans, poses = self._place(pending, newest_ns, left_out)
        apart_scans, apart_poses = self._place(apart, newest_ns, left_out)
        for name in poses:
            self.robots[name].seen_ns, self.robots[name].restarted = made_ns[name], False
        time_ns = max((scan.stamp_ns for scan in scans), default=stamp_ns)
        if scans:
            time_ns = self._follow(time_ns, seen_ns, newest_ns, poses)
        others: dict[str, Pose] = {}
        for name, state in self.robots.items():
            pose = self._standing(state, time_ns + off_ns.get(name, 0))
            if pose is not None and name not in poses and name not in apart_poses:
                (apart_poses if state.apart else others)[name] = pose
        quarantined = tuple(sorted(name for name, state in self.robots.items() if state.apart))
        self._forget(now_ns)
        return Closed(
            tuple(scans), poses, time_ns, left_out, others,
            quarantined, tuple(apart_scans), apart_poses,
        )  # fmt: skip

    def _take_pending(
        self, off_ns: Mapping[str, int], left_out: dict[str, str]
    ) -> tuple[dict[str, Scan], int]:
        """Takes the scans that wait, by robot, and the stamp of the last of them [ns].

        Args:
            off_ns: By robot whose clock is wrong, what it is ahead by [ns]: its scan is left out.
            left_out: Gets the reasons.
        """
        pending: dict[str, Scan] = {}
        stamp_ns = 0
        for name, state in self.robots.items():
            if state.pending is None:
                continue
            scan, state.pending = state.pending, None
            state.used_ns = stamp_ns = scan.stamp_ns
            if name not in off_ns:
                pending[name] = scan
                continue
            state.dropped["clock_offset"] += 1
            state.seen_ns = None  # nor do the stamps count of what was used before
            left_out[name] = (
                f"its clock is {offset_text(off_ns[name])} the others'; "
                f"allowed: {self.config.max_clock_offset:g} s"
            )
        return pending, stamp_ns

    def _place(
        self, pending: Mapping[str, Scan], newest_ns: int, left_out: dict[str, str]
    ) -> tuple[list[Scan], dict[str, Pose]]:
        """The scans that are new enough and have a pose, and these poses by robot.

        Args:
            pending: Scans by robot.
            newest_ns: Time of the newest one, of the last interval, too [ns].
            left_out: Gets the reasons for those that are left out.
        """
        max_pose_age_ns = round(self.config.max_pose_age * 1e9)
        scans: list[Scan] = []
        poses: dict[str, Pose] = {}
        for name, scan in pending.items():
            state, age_ns = self.robots[name], newest_ns - scan.stamp_ns
            if age_ns > self._max_age_ns:
                state.dropped["too_old"] += 1
                left_out[name] = (
                    f"scan is {age_ns / 1e9:.3f} s older than the newest; "
                    f"allowed: {self.config.max_scan_age:g} s"
                )
                continue
            try:
                poses[name] = state.poses.at(scan.stamp_ns, max_pose_age_ns)
            except PoseError as err:
                state.dropped["no_pose"] += 1
                left_out[name] = str(err)
                continue
            scans.append(scan)
        return scans, poses

    def _follow(
        self, time_ns: int, seen_ns: int | None, newest_ns: int, poses: Mapping[str, Pose]
    ) -> int:
        """Time of the interval [ns]: no earlier than the last one's, unless time jumped back.

        Args:
            time_ns: Stamp of its newest scan [ns].
            seen_ns: When the newest scan of earlier intervals was made [ns]; None: of this time
                there was none.
            newest_ns: Time of the newest scan, of both [ns].
            poses: By robot that takes part, its pose.
        """
        back_ns = self._last_ns - time_ns
        # So much older its scans may be, and the last one's clock ahead.
        may_be_ns = max(RESET_NS, self._max_age_ns + self._allowed_offset_ns)
        if seen_ns is not None and 0 < back_ns <= may_be_ns:
            time_ns = self._last_ns
        elif back_ns > RESET_NS:  # where the others were is of another time
            for name in self.robots.keys() - poses.keys():
                self.robots[name].poses.clear()
        for state in self.robots.values():  # and what they saw
            if state.seen_ns is not None and state.seen_ns > newest_ns:
                state.seen_ns = None
        self._last_ns = time_ns
        return time_ns

    def _standing(self, state: RobotState, time_ns: int) -> Pose | None:
        """Pose of a robot without a scan; None where it is not known."""
        try:
            return state.poses.near(
                time_ns,
                round(self.config.max_pose_age * 1e9),
                round(self.config.robot_timeout * 1e9),
            )
        except PoseError:
            return None

    def _forget(self, now_ns: int) -> None:
        """Forgets robots that were not named at the beginning and are silent for long."""
        for name, state in list(self.robots.items()):
            silent = state.heard_ns is not None and now_ns - state.heard_ns > _FORGET_NS
            if silent and name not in self._named:
                del self.robots[name]


def offset_text(ahead_ns: int) -> str:
    """An offset of clocks [ns] in words."""
    return f"{abs(ahead_ns) / 1e9:.3f} s {'ahead of' if ahead_ns > 0 else 'behind'}"
