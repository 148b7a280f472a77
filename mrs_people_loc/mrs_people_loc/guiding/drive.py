"""Velocity of a differential drive on its way to a post."""

from __future__ import annotations

import math

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Post
from mrs_people_loc.team.poses import Pose


def limit(age_s: float, timeout_s: float) -> float:
    """Share of its speed at which a robot drives by information of some age.

    1 up to half of the timeout, from there on less, 0 from the timeout on.

    Args:
        age_s: Age of the people or of the pose [s].
        timeout_s: The robot stands by then [s].
    """
    return min(max(2.0 - 2.0 * age_s / timeout_s, 0.0), 1.0)


class Drive:
    """Drives one robot to its post.

    Args:
        config: Limits of its base and what it keeps off.
    """

    def __init__(self, config: GuideConfig) -> None:
        self._config = config

    def step(
        self,
        pose: Pose,
        twist: tuple[float, float],
        post: Post | None,
        *,
        people: Float,
        people_velocity: Float,
        people_age: float = 0.0,
        robots: Float,
        robots_velocity: Float | None = None,
        space: FreeSpace,
        path: Float | None = None,
        limit: float = 1.0,
        dt: float = 0.05,
    ) -> tuple[float, float]:
        """The velocity to drive with.

        Args:
            pose: Of base_link in the common frame, now.
            twist: Speed ahead [m/s] and rate of turn [rad/s], now.
            post: Where it goes; None: it stops.
            people: Where they were seen last, in the common frame [m], shape (n, 2).
            people_velocity: [m/s], 0 where unknown, shape (n, 2).
            people_age: Time since then [s].
            robots: Where its team-mates are [m], shape (m, 2).
            robots_velocity: [m/s], shape (m, 2); None: they stand.
            space: Free floor.
            path: To the post, from `FreeSpace.path`, shape (k, 2); None: straight on.
            limit: Share of its speed that it may use, see `limit`.
            dt: Until the next step [s].

        Returns:
            Speed ahead [m/s] and rate of turn [rad/s].
        """
        base, (v, w) = self._config.base, twist
        if post is None:
            return _towards(v, 0.0, base.deceleration * dt), _towards(
                w, 0.0, base.turn_acceleration * dt
            )
        offset = np.asarray(post.xy) - (pose.x, pose.y)
        away = float(np.linalg.norm(offset))
        error = wrap_angle(math.atan2(offset[1], offset[0]) - pose.yaw)
        wanted = 0.0
        turn = wrap_angle(post.yaw - pose.yaw)
        if away > 0.1:
            back = abs(error) > math.pi / 2
            turn = wrap_angle(error - math.pi) if back else error
            wanted = min(post.speed, away) * max(math.cos(turn), 0.0) * (-1 if back else 1) * limit
        near = np.linalg.norm(people - (pose.x, pose.y), axis=1)
        if len(near) and near.min() < self._config.safety.person_distance + 0.2:
            wanted = 0.0
        rate = max(-base.max_turn, min(base.max_turn, 1.5 * turn)) * limit
        return (
            _towards(v, wanted, base.acceleration * dt),
            _towards(w, rate, base.turn_acceleration * dt),
        )


def _towards(value: float, wanted: float, step: float) -> float:
    return value + max(-step, min(step, wanted - value))
