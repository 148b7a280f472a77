"""How an unsure pose widens what a robot keeps clear of, and slows it down."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from mrs_people_loc.config import GuideConfig
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class MarginTuning:
    """Constants of margins; chosen.

    Attributes:
        sigmas: Distances to people, robots and walls grow by so many standard deviations of the
            robot's position, ...
        most: ... by no more than this [m].
        sure: A robot whose standard deviation is no greater than this is as fast as its base [m];
            ...
        unsure: ... from this one on [m] ...
        slowest: ... at this share of that.
    """

    sigmas: float = 2.0
    most: float = 0.25
    sure: float = 0.10
    unsure: float = 0.30
    slowest: float = 0.5


MARGIN_TUNING = MarginTuning()


def sigma_of(pose: Pose) -> float:
    """The largest standard deviation of a position in any direction [m]."""
    (xx, xy), (_, yy) = pose.covariance[:2, :2]
    return math.sqrt(max(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy), 0.0))


def widened(
    config: GuideConfig, sigma: float, spare: float, tuning: MarginTuning = MARGIN_TUNING
) -> GuideConfig:
    """The parameters for a robot whose position has a standard deviation.

    Args:
        config: Those of a robot that knows exactly where it is.
        sigma: [m].
        spare: The distance to walls grows by no more than this [m].
        tuning: Constants.
    """
    margin = min(tuning.sigmas * sigma, tuning.most)
    if margin <= 0.0:
        return config
    part = min(max((sigma - tuning.sure) / (tuning.unsure - tuning.sure), 0.0), 1.0)
    share = 1.0 - (1.0 - tuning.slowest) * part
    safety, base = config.safety, config.base
    safety = dataclasses.replace(
        safety,
        person_distance=safety.person_distance + margin,
        robot_distance=safety.robot_distance + margin,
        wall_distance=safety.wall_distance + min(margin, max(spare, 0.0)),
    )
    base = dataclasses.replace(
        base, max_speed=share * base.max_speed, max_reverse=share * base.max_reverse
    )
    return dataclasses.replace(config, safety=safety, base=base)
