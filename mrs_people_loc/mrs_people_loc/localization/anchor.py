"""What a robot tells its team whose pose is not estimated: it holds the team in its place."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mrs_people_loc.clocks import Order, RateLimit, StampOrder
from mrs_people_loc.localization.mailbox import Outbox
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.shared import TeamPose
from mrs_people_loc.team.poses import Pose

#: Standard deviations of its pose count as these, at least [m, m, rad].
_LEAST = (0.01, 0.01, math.radians(0.5))
#: It measures its pose at this rate [Hz].
_RATE_HZ = 1.0
#: Errors of its pose last for about so many measurements.
_LAST = 10.0


class Anchor:
    """Makes messages to the team from poses of another source, such as `pose.static` or TF.

    They are the robot's dead reckoning, and once a second its measured pose in the map. As errors
    last, many measurements must not count as independent: each has `_LAST` times the covariance of
    the pose, and dead reckoning loses 1 / (`_LAST` - 1) of it from one to the next. In the filters
    of its team-mates, the variance is then always that of the pose.

    Args:
        robot: The robot's name.
    """

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._order = StampOrder()
        self._begin()

    def _begin(self) -> None:
        self._outbox = Outbox()
        self._measured, self._shared = RateLimit(), RateLimit()
        self._last: Odometry | None = None

    def tell(self, pose: Pose, rate_hz: float) -> TeamPose | None:
        """What the team is to hear of a pose in the map; None: nothing, by that rate [Hz]."""
        order = self._order.take(pose.stamp_ns)
        if order is Order.LATE:
            return None
        if order is Order.RESTART:
            self._begin()
        short = np.square(_LEAST) - np.diag(pose.covariance)
        covariance = pose.covariance + np.diag(np.maximum(short, 0.0))
        pose = dataclasses.replace(pose, covariance=covariance)
        odometry = self._last = self._reckoned(pose)
        if self._measured.lets_through(pose.stamp_ns, _RATE_HZ):
            measured = dataclasses.replace(pose, covariance=_LAST * covariance)
            self._outbox.add(measured, pose.stamp_ns)
        if not self._shared.lets_through(pose.stamp_ns, rate_hz):
            return None
        return self._outbox.message(self._robot, pose, odometry)

    def _reckoned(self, pose: Pose) -> Odometry:
        last, position, heading = self._last, 0.0, 0.0
        if last is not None:
            part = (pose.stamp_ns - last.stamp_ns) / 1e9 * _RATE_HZ / (_LAST - 1.0)
            xx, yy, yaw = (part * np.diag(pose.covariance)).tolist()
            position, heading = last.position_variance + max(xx, yy), last.heading_variance + yaw
        return Odometry(pose.stamp_ns, pose.x, pose.y, pose.yaw, position, heading)
