"""Poses of robots over time."""

from __future__ import annotations

import bisect
import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float
from mrs_people_loc.clocks import RESET_NS, Order, StampOrder
from mrs_people_loc.errors import ConfigError, PoseError
from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.uncertainty import pose_effect


@dataclass(frozen=True)
class PoseTuning:
    """Constants of poses over time, chosen by hand for robots at a walking pace.

    Attributes:
        speeds: How fast a robot of unknown speed moves and turns, standard deviations of x, y [m/s]
            and yaw [rad/s].
        speed_changes: By how much a known speed changes in a second, likewise [m/s^2, rad/s^2].
        speed_span_ns: The speed past a pose is the mean over this last stretch before it [ns].
            Poses that are no farther apart leave no gap: in half of it `speed_changes` make a
            millimetre.
        jump: A pose jumps where it is farther from the one before than this [m] ...
        jump_speed: ... and this speed [m/s] explain.
    """

    speeds: tuple[float, float, float] = (1.0, 1.0, 1.0)
    speed_changes: tuple[float, float, float] = (1.0, 1.0, 1.0)
    speed_span_ns: int = 100_000_000
    jump: float = 1.0
    jump_speed: float = 3.0


_TUNING = PoseTuning()
#: A covariance relative to the team is one of poses within this time [ns].
IN_TEAM_NS = 1_000_000_000


def _no_uncertainty() -> Float:
    return np.zeros((3, 3))


@dataclass(frozen=True)
class Pose:
    """Planar pose of a robot's base_link in some frame: the paper's (x, z, theta).

    Attributes:
        stamp_ns: Time [ns].
        x: Position [m].
        y: Position [m].
        yaw: Heading [rad].
        covariance: Of x, y, yaw [m, m, rad], shape (3, 3); zero: exact.
        in_team: The same relative to the robot's team, for robots whose errors are shared in part;
            None: their errors are independent.
    """

    stamp_ns: int
    x: float
    y: float
    yaw: float
    covariance: Float = field(default_factory=_no_uncertainty)
    in_team: Float | None = None

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            PoseError: A value is not finite, or the covariance is none.
        """
        if not all(map(math.isfinite, (self.x, self.y, self.yaw))):
            raise PoseError(f"pose is x={self.x}, y={self.y}, yaw={self.yaw}; wanted: finite")
        cov = self.covariance
        numbers = cov.ravel().tolist()  # NumPy takes longer for so few
        if cov.shape != (3, 3) or not all(map(math.isfinite, numbers)) or min(numbers[::4]) < 0:
            raise PoseError(
                "covariance of x, y, yaw is no covariance (finite, with variances of at least 0): "
                f"{cov.tolist()}"
            )

    def relative_to_team(self) -> Pose:
        """The pose with its covariance relative to the team, where that is known."""
        if self.in_team is None:
            return self
        return dataclasses.replace(self, covariance=self.in_team, in_team=None)

    def __matmul__(self, other: Pose) -> Pose:
        """The pose `other`, given in this pose's frame, in the frame that this one is given in.

        Stamp is that of `other`; both covariances enter, to first order.
        """
        rotation = rotation_2d(self.yaw)
        dx, dy = rotation @ (other.x, other.y)
        of_self = np.eye(3)
        of_self[0, 2], of_self[1, 2] = -dy, dx
        of_other = np.eye(3)
        of_other[:2, :2] = rotation
        return Pose(
            other.stamp_ns,
            self.x + float(dx),
            self.y + float(dy),
            wrap_angle(self.yaw + other.yaw),
            of_self @ self.covariance @ of_self.T + of_other @ other.covariance @ of_other.T,
        )


def frame_of(pose: Pose, local: Pose) -> Pose:
    """Where a frame is, in which something has the pose `local`.

    Args:
        pose: Its pose in the frame that the result is given in.
        local: Its pose in the frame that is asked for.

    Returns:
        The exact frame F with F @ local = pose, at the stamp of `pose`.
    """
    yaw = wrap_angle(pose.yaw - local.yaw)
    dx, dy = rotation_2d(yaw) @ (local.x, local.y)
    return Pose(pose.stamp_ns, pose.x - float(dx), pose.y - float(dy), yaw)


def is_jump(before: Pose, pose: Pose, tuning: PoseTuning = _TUNING) -> bool:
    """Whether a pose is farther from the one before than a robot drives."""
    seconds = (pose.stamp_ns - before.stamp_ns) / 1e9
    allowed = tuning.jump + tuning.jump_speed * seconds
    return math.hypot(pose.x - before.x, pose.y - before.y) > allowed


@dataclass
class PoseBuffer:
    """The last poses of one robot, to be read at any time between them.

    Attributes:
        span_ns: Poses older than the newest by more are forgotten [ns].
        in_team: The newest covariance relative to the team, see `Pose`, and its stamp [ns].
        jumps: How often a pose was farther from the one before than a robot drives, so far.
        last_jump: From where to where it was last.
        tuning: Constants.
    """

    span_ns: int = 5_000_000_000
    in_team: tuple[int, Float] | None = None
    jumps: int = 0
    last_jump: tuple[Pose, Pose] | None = None
    tuning: PoseTuning = _TUNING
    _stamps: list[int] = field(default_factory=list)
    _poses: list[Pose] = field(default_factory=list)
    _order: StampOrder = field(default_factory=StampOrder)

    def __len__(self) -> int:
        """Number of poses held."""
        return len(self._poses)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose [ns]; None: there is none."""
        return self._stamps[-1] if self._stamps else None

    @property
    def newest(self) -> Pose | None:
        """The newest pose; None: there is none."""
        return self._poses[-1] if self._poses else None

    @property
    def resets(self) -> int:
        """How often stamps jumped back and went on from there, so far."""
        return self._order.resets

    def clear(self) -> None:
        """Forgets all poses."""
        self._stamps.clear()
        self._poses.clear()
        self._order.reset()
        self.in_team = None

    def add(self, pose: Pose) -> None:
        """Takes a pose; those that come late are put in their place.

        Raises:
            PoseError: A pose of this stamp is there already, or it comes later than `RESET_NS`.
        """
        if self.in_team is not None and abs(pose.stamp_ns - self.in_team[0]) < IN_TEAM_NS:
            pose = dataclasses.replace(pose, in_team=self.in_team[1])
        newest_ns, newest = self._order.newest_ns, self.newest
        order = self._order.take(pose.stamp_ns)
        if order is Order.RESTART:
            self._stamps.clear()
            self._poses.clear()
        elif order is Order.LATE and newest_ns is not None:
            late_ns = newest_ns - pose.stamp_ns
            if late_ns > RESET_NS:
                raise PoseError(
                    f"stamp is {late_ns / 1e9:.3f} s older than the newest; "
                    f"allowed: {RESET_NS / 1e9:g} s"
                )
        index = bisect.bisect_left(self._stamps, pose.stamp_ns)
        if index < len(self._stamps) and self._stamps[index] == pose.stamp_ns:
            raise PoseError(f"stamp {pose.stamp_ns} ns is repeated; wanted: one pose per stamp")
        if order is Order.NEWER and newest is not None and is_jump(newest, pose, self.tuning):
            self.jumps += 1
            self.last_jump = newest, pose
        self._stamps.insert(index, pose.stamp_ns)
        self._poses.insert(index, pose)
        first = bisect.bisect_left(self._stamps, self._stamps[-1] - self.span_ns)
        if first:
            del self._stamps[:first], self._poses[:first]

    def covers(self, stamp_ns: int) -> bool:
        """Whether there are poses on both sides of a time, or one at it."""
        return bool(self._stamps) and self._stamps[0] <= stamp_ns <= self._stamps[-1]

    def at(self, stamp_ns: int, max_age_ns: int) -> Pose:
        """The pose at a time: interpolated, or extrapolated from the nearest one at its speed.

        Position and covariance are interpolated linearly, the heading along the shorter arc. In
        gaps of more than `tuning.speed_span_ns` each variance grows, with v = `tuning.speeds` and
        a = `tuning.speed_changes`, by the square of

        - a t1 t2 / 2 between poses that are t1 and t2 away: so far is the straight way off where
          the speed changes by a in a second;
        - the extrapolated way and a t^2 / 2, t from the last pose before a gap or the first one
          after it, where another pose within `tuning.speed_span_ns` tells the speed;
        - v t, where none does, and the pose stays where it is.

        Args:
            stamp_ns: Time [ns].
            max_age_ns: The poses used are no farther from it than this [ns].

        Raises:
            PoseError: No pose is near enough.
        """
        if not self._stamps:
            raise PoseError("no pose has arrived")
        index = bisect.bisect_left(self._stamps, stamp_ns)
        if index < len(self._stamps) and self._stamps[index] == stamp_ns:
            return self._poses[index]
        before = self._poses[index - 1] if index else None
        after = self._poses[index] if index < len(self._poses) else None
        near = [p for p in (before, after) if p and abs(p.stamp_ns - stamp_ns) <= max_age_ns]
        if not near:
            ages = [abs(p.stamp_ns - stamp_ns) / 1e9 for p in (before, after) if p]
            raise PoseError(
                f"the nearest pose is {min(ages):.3f} s from the scan's stamp; "
                f"allowed: {max_age_ns / 1e9:g} s"
            )
        if len(near) == 2:
            made = _between(near[0], near[1], stamp_ns)
            if near[1].stamp_ns - near[0].stamp_ns <= self.tuning.speed_span_ns:
                return made
            s1, s2 = (abs(pose.stamp_ns - stamp_ns) / 1e9 for pose in near)
            return _less_sure(made, 0.5 * s1 * s2 * np.array(self.tuning.speed_changes))
        return self._extrapolated(near[0], stamp_ns)

    def near(self, stamp_ns: int, max_age_ns: int, max_distance_ns: int) -> Pose:
        """The pose at a time as `at` gives it, or the one nearest to it, less sure by v t.

        Args:
            stamp_ns: Time [ns].
            max_age_ns: As for `at`.
            max_distance_ns: The nearest is no farther from the time than this [ns].

        Raises:
            PoseError: No pose is so near.
        """
        try:
            return self.at(stamp_ns, max_age_ns)
        except PoseError:
            if not self._poses:
                raise
        nearest = min(self._poses, key=lambda pose: abs(pose.stamp_ns - stamp_ns))
        away_ns = abs(nearest.stamp_ns - stamp_ns)
        if away_ns > max_distance_ns:
            raise PoseError(
                f"the nearest pose is {away_ns / 1e9:.3f} s away; "
                f"allowed: {max_distance_ns / 1e9:g} s"
            )
        drift = away_ns / 1e9 * np.array(self.tuning.speeds)
        return _less_sure(dataclasses.replace(nearest, stamp_ns=stamp_ns), drift)

    def _extrapolated(self, end: Pose, stamp_ns: int) -> Pose:
        """A pose at the border of a gap, carried on to a time in that gap."""
        tuning = self.tuning
        seconds = abs(stamp_ns - end.stamp_ns) / 1e9
        if stamp_ns > end.stamp_ns:
            index = bisect.bisect_left(self._stamps, end.stamp_ns - tuning.speed_span_ns)
        else:
            index = bisect.bisect_right(self._stamps, end.stamp_ns + tuning.speed_span_ns) - 1
        other = self._poses[index]
        if other is end:
            drift = seconds * np.array(tuning.speeds)
            return _less_sure(dataclasses.replace(end, stamp_ns=stamp_ns), drift)
        made = _between(other, end, stamp_ns)
        carried = np.array([made.x - end.x, made.y - end.y, wrap_angle(made.yaw - end.yaw)])
        return _less_sure(made, carried, 0.5 * seconds**2 * np.array(tuning.speed_changes))


def _less_sure(pose: Pose, *sigmas: Float) -> Pose:
    """A pose with more variance of x, y and yaw: the squares of these [m, m, rad]."""
    more = np.diag(np.sum(np.square(sigmas), axis=0))
    in_team = None if pose.in_team is None else pose.in_team + more
    return dataclasses.replace(pose, covariance=pose.covariance + more, in_team=in_team)


def _between(one: Pose, other: Pose, stamp_ns: int) -> Pose:
    """Linear in time between two poses (or past them; the covariance stays within them)."""
    part = (stamp_ns - one.stamp_ns) / (other.stamp_ns - one.stamp_ns)
    weight = min(max(part, 0.0), 1.0)
    in_team = None
    if one.in_team is not None and other.in_team is not None:
        in_team = (1.0 - weight) * one.in_team + weight * other.in_team
    return Pose(
        stamp_ns,
        one.x + part * (other.x - one.x),
        one.y + part * (other.y - one.y),
        wrap_angle(one.yaw + part * wrap_angle(other.yaw - one.yaw)),
        (1.0 - weight) * one.covariance + weight * other.covariance,
        in_team,
    )


def static_pose(config: cfg.PoseInput, stamp_ns: int) -> Pose:
    """The pose of a robot that stands at its configured place, at any time.

    Raises:
        ConfigError: `pose.static` is empty.
    """
    if not config.static:
        raise ConfigError(
            "pose.source is static but pose.static is empty; allowed: x, y [m] and yaw [rad] of "
            "base_link in the map"
        )
    x, y, yaw = config.static
    return Pose(stamp_ns, x, y, wrap_angle(yaw), np.diag(np.square(config.sigmas or (0.0,) * 3)))


def places_of(poses: Iterable[Pose]) -> Float:
    """Places of poses [m], shape (n, 2)."""
    return np.array([(pose.x, pose.y) for pose in poses]).reshape(-1, 2)


def places_and_covariances(poses: Iterable[Pose]) -> tuple[Float, Float]:
    """Places [m], shape (n, 2), and covariances of poses, shape (n, 3, 3)."""
    all_of_them = list(poses)
    places = places_of(all_of_them)
    return places, np.array([pose.covariance for pose in all_of_them]).reshape(-1, 3, 3)


def shared_effect(poses: Iterable[Pose], positions: Float) -> Float:
    """Covariance that places have because the robots' team is not sure where it is as a whole.

    It is that of the robot that is surest of its place in the map: the part of its covariance that
    is not relative to the team.

    Args:
        poses: The robots that measured; those without `in_team` are sure.
        positions: The places [m], shape (m, 2).

    Returns:
        Positive semidefinite [m^2], shape (m, 2, 2).
    """
    none: Float = np.zeros((len(positions), 2, 2))
    shared = []
    for pose in poses:
        if pose.in_team is None:
            return none
        values, vectors = np.linalg.eigh(pose.covariance - pose.in_team)
        shared.append((pose, (vectors * np.maximum(values, 0.0)) @ vectors.T))
    if not shared:
        return none
    pose, covariance = min(shared, key=lambda one: float(np.trace(one[1])))
    places = np.tile([pose.x, pose.y], (len(positions), 1))
    return pose_effect(places, np.tile(covariance, (len(positions), 1, 1)), positions)
