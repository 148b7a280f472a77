"""Whether a robot that drives by itself, such as by Nav2, goes to its goal."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class ProgressTuning:
    """When a robot does not go to its goal; chosen.

    Attributes:
        near: Nearer to its goal than this a robot may stand [m].
        moved: A robot has moved if it is so far from where it was [m].
        stuck_s: Who has not for longer than this is stuck [s].
    """

    near: float = 0.6
    moved: float = 0.1
    stuck_s: float = 5.0


PROGRESS_TUNING = ProgressTuning()


class Progress:
    """Watches a robot that has got a goal; where it is stuck, it has to get it again.

    Nav2, for one, may have refused the goal, given up, or restarted.

    Args:
        pose: Where it was when it got its goal.
        now_ns: Time then [ns].
        tuning: Constants.
    """

    def __init__(self, pose: Pose, now_ns: int, tuning: ProgressTuning = PROGRESS_TUNING) -> None:
        self._pose, self._since_ns, self._tuning = pose, now_ns, tuning

    def is_stuck(self, goal: Pose, pose: Pose, now_ns: int) -> bool:
        """Whether the robot does not go to its goal; said once, and again if it stays so.

        Args:
            goal: Where it is to go now.
            pose: Where it is.
            now_ns: Time [ns].
        """
        tuning, here = self._tuning, (pose.x, pose.y)
        moved = math.dist((self._pose.x, self._pose.y), here) >= tuning.moved
        goes = moved or math.dist((goal.x, goal.y), here) <= tuning.near
        if not goes and now_ns - self._since_ns <= tuning.stuck_s * 1e9:
            return False
        self._pose, self._since_ns = pose, now_ns
        return not goes
