"""Poses of robots over time."""

from __future__ import annotations

import bisect
import dataclasses
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.errors import PoseError
from mrs_people_loc.geometry import Float, rotation_2d, wrap_angle


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
    """

    stamp_ns: int
    x: float
    y: float
    yaw: float
    covariance: Float = field(default_factory=_no_uncertainty)

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            PoseError: A value is not finite, or the covariance is none.
        """
        if not np.isfinite([self.x, self.y, self.yaw]).all():
            raise PoseError(f"pose is x={self.x}, y={self.y}, yaw={self.yaw}; wanted: finite")
        cov = self.covariance
        if cov.shape != (3, 3) or not np.isfinite(cov).all() or (np.diag(cov) < 0).any():
            raise PoseError(
                "covariance of x, y, yaw is no covariance (finite, with variances of at least 0): "
                f"{cov.tolist()}"
            )

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


@dataclass
class PoseBuffer:
    """The last poses of one robot, to be read at any time between them.

    Attributes:
        span_ns: Poses older than the newest by more are forgotten [ns].
        resets: How often stamps jumped back by more than `RESET_NS`, so far.
    """

    span_ns: int = 5_000_000_000
    resets: int = 0
    _stamps: list[int] = field(default_factory=list)
    _poses: list[Pose] = field(default_factory=list)

    #: A stamp that jumps back by more than this is a new beginning (a bag that loops) [ns].
    RESET_NS = 1_000_000_000
    #: The speed past a pose is that over this last stretch before it [ns].
    _SPEED_SPAN_NS = 100_000_000

    def __len__(self) -> int:
        """Number of poses held."""
        return len(self._poses)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose [ns]; None: there is none."""
        return self._stamps[-1] if self._stamps else None

    def clear(self) -> None:
        """Forgets all poses."""
        self._stamps.clear()
        self._poses.clear()

    def add(self, pose: Pose) -> None:
        """Takes a pose; those that come late are put in their place.

        Raises:
            PoseError: A pose of this stamp is there already.
        """
        if self._stamps and pose.stamp_ns < self._stamps[-1] - self.RESET_NS:
            self.clear()
            self.resets += 1
        index = bisect.bisect_left(self._stamps, pose.stamp_ns)
        if index < len(self._stamps) and self._stamps[index] == pose.stamp_ns:
            raise PoseError(f"stamp {pose.stamp_ns} ns is repeated; wanted: one pose per stamp")
        self._stamps.insert(index, pose.stamp_ns)
        self._poses.insert(index, pose)
        first = bisect.bisect_left(self._stamps, self._stamps[-1] - self.span_ns)
        if first:
            del self._stamps[:first], self._poses[:first]

    def covers(self, stamp_ns: int) -> bool:
        """Whether there are poses on both sides of a time, or one at it."""
        return bool(self._stamps) and self._stamps[0] <= stamp_ns <= self._stamps[-1]

    def at(self, stamp_ns: int, max_age_ns: int) -> Pose:
        """The pose at a time: interpolated, or past the last one near it carried on at its speed.

        Position and covariance are interpolated linearly, the heading along the shorter arc. A
        pose that is carried on gets, in each variance, the square of the distance it was carried.

        Args:
            stamp_ns: Time [ns].
            max_age_ns: The poses used are no farther from it than this [ns].

        Raises:
            PoseError: No pose is near enough; says how near.
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
            return _between(near[0], near[1], stamp_ns)
        if near[0] is after:
            return dataclasses.replace(near[0], stamp_ns=stamp_ns)
        return self._carried_on(near[0], stamp_ns)

    def _carried_on(self, last: Pose, stamp_ns: int) -> Pose:
        index = bisect.bisect_left(self._stamps, last.stamp_ns - self._SPEED_SPAN_NS)
        earlier = self._poses[index]
        if earlier is last:
            return dataclasses.replace(last, stamp_ns=stamp_ns)
        ahead = _between(earlier, last, stamp_ns)
        moved = np.array([ahead.x - last.x, ahead.y - last.y, wrap_angle(ahead.yaw - last.yaw)])
        return dataclasses.replace(ahead, covariance=last.covariance + np.diag(moved**2))


def _between(one: Pose, other: Pose, stamp_ns: int) -> Pose:
    """Linear in time between two poses (or past them; the covariance stays within them)."""
    part = (stamp_ns - one.stamp_ns) / (other.stamp_ns - one.stamp_ns)
    weight = min(max(part, 0.0), 1.0)
    return Pose(
        stamp_ns,
        one.x + part * (other.x - one.x),
        one.y + part * (other.y - one.y),
        wrap_angle(one.yaw + part * wrap_angle(other.yaw - one.yaw)),
        (1.0 - weight) * one.covariance + weight * other.covariance,
    )


@dataclass
class PoseIntake:
    """Which of the poses that a robot hears go out: in the map, in order, at most so many a second.

    Attributes:
        config: What brings them to the map, and their rate.
        last: The last pose that went out, in the map; None before the first.
    """

    config: cfg.PoseInput
    last: Pose | None = None
    _due_ns: int = 0

    def __call__(self, pose: Pose, frame_id: str) -> Pose | None:
        """Takes a pose.

        Args:
            pose: The pose as it came.
            frame_id: Its frame.

        Returns:
            The pose in the map; None if it is too early after the last one.

        Raises:
            PoseError: Its frame is not known in the map, or it is not newer than the last one.
        """
        pose = self._in_map(pose, frame_id.lstrip("/"))
        stamp_ns, period_ns = pose.stamp_ns, round(1e9 / self.config.max_rate)
        if self.last is None or self.last.stamp_ns - stamp_ns > PoseBuffer.RESET_NS:
            due_ns = stamp_ns  # the first, or a new beginning
        else:
            if stamp_ns <= self.last.stamp_ns:
                raise PoseError(
                    f"stamp is {stamp_ns} ns; wanted: newer than {self.last.stamp_ns} ns"
                )
            # A tenth of the period is allowed for jitter, so 100 Hz stay 100 Hz; the next is due a
            # period after this one was, so that the rate holds in the long run.
            due_ns = self._due_ns
            if due_ns - stamp_ns > period_ns // 10:
                return None
            if stamp_ns - due_ns >= period_ns:
                due_ns = stamp_ns
        self._due_ns = due_ns + period_ns
        self.last = pose
        return pose

    def _in_map(self, pose: Pose, frame_id: str) -> Pose:
        if frame_id == self.config.map_frame:
            return pose
        if not self.config.map_from_odom:
            raise PoseError(
                f"frame_id is {frame_id!r}; wanted: {self.config.map_frame!r}, or the parameter "
                "pose.map_from_odom (x, y, yaw of that frame in the map)"
            )
        x, y, yaw = self.config.map_from_odom
        return Pose(pose.stamp_ns, x, y, yaw) @ pose


def pose_effect(pose: Pose, positions: Float) -> Float:
    """Covariance of places that were measured from an uncertain pose [m^2].

    Args:
        pose: The pose.
        positions: The places [m], shape (m, 2).

    Returns:
        Shape (m, 2, 2).
    """
    lever = np.zeros((len(positions), 2, 3))
    lever[:, 0, 0] = lever[:, 1, 1] = 1.0
    lever[:, 0, 2], lever[:, 1, 2] = pose.y - positions[:, 1], positions[:, 0] - pose.x
    with np.errstate(over="ignore", invalid="ignore"):  # DBL_MAX may stand for "unknown"
        effect: Float = lever @ pose.covariance @ lever.transpose(0, 2, 1)
    return effect
