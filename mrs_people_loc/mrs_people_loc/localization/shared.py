"""What robots of a team tell each other about where they are."""

from __future__ import annotations

from dataclasses import dataclass

from mrs_people_loc.arrays import Float
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.walls import SeenWalls
from mrs_people_loc.team.poses import Pose

#: The variance of a heading that nothing is known of [rad^2], and of what is not known, at least.
YAW_UNKNOWN = 100.0


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
        lost: Whether it does not know where it is.
        doubted: Team-mates whose poses do not fit what it knows.
    """

    robot: str
    pose: Pose
    odometry: Odometry
    walls: tuple[SeenWalls, ...] = ()
    absolute: tuple[Pose, ...] = ()
    lost: bool = False
    doubted: tuple[str, ...] = ()


@dataclass(frozen=True)
class RelativePose:
    """Where one robot is in the base_link of another: by people whom both see, or by sight.

    Attributes:
        robot: The robot whose base_link is the frame.
        stamp_ns: Time of that base_link [ns].
        other: The other robot.
        other_stamp_ns: Time of the other's base_link [ns].
        pose: x, y [m] and yaw [rad] of the other's base_link in the robot's, shape (3,).
        covariance: Of `pose`, shape (3, 3); where the variance of yaw is `YAW_UNKNOWN` or more,
            yaw is not measured.
        inflated: The covariance is so many times that of a single measurement, as errors last.
    """

    robot: str
    stamp_ns: int
    other: str
    other_stamp_ns: int
    pose: Float
    covariance: Float
    inflated: float = 1.0


@dataclass(frozen=True)
class StandingPeople:
    """People who do not walk, as one robot sees them: landmarks for a while.

    Attributes:
        robot: The robot.
        stamp_ns: Time [ns].
        xy: Places in its base_link [m], shape (n, 2).
        covariance: Of the places, shape (n, 2, 2).
        inflated: As for `RelativePose`.
    """

    robot: str
    stamp_ns: int
    xy: Float
    covariance: Float
    inflated: float = 1.0


#: What the planner measures of robots.
TeamMeasurement = RelativePose | StandingPeople
