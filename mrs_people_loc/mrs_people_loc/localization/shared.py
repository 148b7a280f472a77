"""What robots of a team tell each other about where they are."""

from __future__ import annotations

from dataclasses import dataclass

from mrs_people_loc.arrays import Float
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.walls import SeenWalls
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class TeamPose:
    """What a robot tells its team: message TeamPose on `team_poses`.

    Attributes:
        robot: Its name.
        pose: Of its base_link in the map, with covariance, at the stamp of `odometry`.
        odometry: Its dead reckoning.
        walls: What it saw lately; the same may come several times, so that a lost message costs
            nothing.
        absolute: Poses in the map that it measured lately (not from walls or team-mates), likewise.
    """

    robot: str
    pose: Pose
    odometry: Odometry
    walls: tuple[SeenWalls, ...] = ()
    absolute: tuple[Pose, ...] = ()


@dataclass(frozen=True)
class RelativePose:
    """Where one robot is in the base_link of another, measured with people whom both see.

    Attributes:
        robot: The robot whose base_link is the frame.
        stamp_ns: Time of that base_link [ns].
        other: The other robot.
        other_stamp_ns: Time of the other's base_link [ns].
        pose: x, y [m] and yaw [rad] of the other's base_link in the robot's, shape (3,).
        covariance: Of `pose`, shape (3, 3).
    """

    robot: str
    stamp_ns: int
    other: str
    other_stamp_ns: int
    pose: Float
    covariance: Float
