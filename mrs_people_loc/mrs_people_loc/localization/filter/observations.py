"""What is observed, as functions of the state: predictions and their Jacobians.

A pose is x, y [m], yaw [rad], shape (3,). A wall of the state is a line in the map beside a fixed
point, its anchor: a point p is on it where n (p - anchor) = distance, with n = (cos, sin) of the
bearing. Beside a point near them, lines stay nearly linear far from the map's origin, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.walls import Walls

Point = tuple[float, float]


@dataclass(frozen=True)
class Observation:
    """Something that concerns a robot at a time.

    Attributes:
        robot: The robot.
        odometry: Its dead reckoning at that time.
    """

    robot: str
    odometry: Odometry


@dataclass(frozen=True)
class Reached(Observation):
    """Nothing is observed but the way so far."""


@dataclass(frozen=True)
class Joined(Observation):
    """A robot begins, or begins again, at a place.

    Attributes:
        place: In the map, shape (3,).
        covariance: Shape (3, 3).
    """

    place: Float
    covariance: Float


@dataclass(frozen=True)
class Left(Observation):
    """A robot was not heard of for long."""


@dataclass(frozen=True)
class WallsSeen(Observation):
    """Walls in base_link."""

    walls: Walls


@dataclass(frozen=True)
class Placed(Observation):
    """A measured pose in the map (`place`, shape (3,); `covariance`, shape (3, 3))."""

    place: Float
    covariance: Float


@dataclass(frozen=True)
class Claimed(Placed):
    """What a team-mate's own filter says about its pose: correlated with the state."""


@dataclass(frozen=True)
class Met(Observation):
    """The pose of another robot in base_link.

    Attributes:
        other: The other robot.
        other_odometry: Its dead reckoning at the time of its base_link.
        place: Shape (3,).
        covariance: Shape (3, 3) ...
        inflated: ... which is so many times that of a single measurement.
    """

    other: str
    other_odometry: Odometry
    place: Float
    covariance: Float
    inflated: float = 1.0


@dataclass(frozen=True)
class PeopleStand(Observation):
    """People who do not walk, in base_link.

    Attributes:
        xy: Shape (n, 2).
        covariance: Shape (n, 2, 2) ...
        inflated: ... which is so many times that of a single measurement.
    """

    xy: Float
    covariance: Float
    inflated: float = 1.0


def wall_from(part: Float, anchor: Point, side: float = 1.0) -> tuple[Float, Float]:
    """A wall of the state as a robot sees it.

    Args:
        part: x, y, yaw of the robot, distance and bearing of the wall, shape (5,).
        anchor: The wall's anchor [m].
        side: 1: the robot is on the side where the normal comes from; -1: on the other one.

    Returns:
        Distance [m] and bearing [rad] in base_link, shape (2,), and the Jacobian, shape (2, 5).
    """
    x, y, yaw, distance, bearing = part.tolist()
    c, s = math.cos(bearing), math.sin(bearing)
    dx, dy = x - anchor[0], y - anchor[1]
    predicted = np.array(
        [side * (distance - c * dx - s * dy), bearing - yaw + (0.0 if side > 0 else math.pi)]
    )
    along = c * dy - s * dx
    jacobian = np.array(
        [[-side * c, -side * s, 0.0, side, -side * along], [0.0, 0.0, -1.0, 0.0, 1.0]]
    )
    return predicted, jacobian


def end_from(part: Float, anchor: Point, end: float, side: float = 1.0) -> tuple[Float, Float]:
    """A wall's end as a robot sees it: how far it is along the wall from the robot.

    Args:
        part: As for `wall_from`.
        anchor: The wall's anchor [m].
        end: Where the wall ends, along it from the anchor [m].
        side: As for `wall_from`.

    Returns:
        From the foot of the robot's perpendicular, in the direction bearing + pi/2 as the robot
        sees it [m], shape (1,), and the Jacobian, shape (1, 5).
    """
    x, y, _, _, bearing = part.tolist()
    c, s = math.cos(bearing), math.sin(bearing)
    dx, dy = x - anchor[0], y - anchor[1]
    predicted = np.array([side * (end + s * dx - c * dy)])
    return predicted, side * np.array([[s, -c, 0.0, 0.0, c * dx + s * dy]])


def wall_at(place: Float, seen: Float, anchor: Point) -> tuple[Float, Float, Float]:
    """A wall that a robot sees, in the map: what `wall_from` turns back.

    Args:
        place: The robot's pose, shape (3,).
        seen: Distance and bearing in base_link, shape (2,).
        anchor: The wall's anchor [m].

    Returns:
        Distance and bearing beside the anchor, shape (2,), and the Jacobians by the pose, shape
        (2, 3), and by what is seen, shape (2, 2).
    """
    bearing = float(place[2] + seen[1])
    c, s = math.cos(bearing), math.sin(bearing)
    dx, dy = float(place[0]) - anchor[0], float(place[1]) - anchor[1]
    along = c * dy - s * dx
    wall = np.array([seen[0] + c * dx + s * dy, bearing])
    by_pose = np.array([[c, s, along], [0.0, 0.0, 1.0]])
    return wall, by_pose, np.array([[1.0, along], [0.0, 1.0]])


def beside_anchor(distance: float, bearing: float, anchor: Point) -> tuple[Float, Float]:
    """A line in the map's normal form (`Walls`) beside an anchor.

    Returns:
        Distance and bearing beside the anchor, shape (2,), and the Jacobian, shape (2, 2).
    """
    c, s = math.cos(bearing), math.sin(bearing)
    line = np.array([distance - c * anchor[0] - s * anchor[1], bearing])
    return line, np.array([[1.0, s * anchor[0] - c * anchor[1]], [0.0, 1.0]])


def pose_from(part: Float, other: Float) -> tuple[Float, Float, Float]:
    """A robot's pose in the base_link of another robot.

    Args:
        part: The robot whose base_link it is, shape (3,).
        other: The other robot, shape (3,).

    Returns:
        x, y, yaw, shape (3,), and the Jacobians by each, shape (3, 3).
    """
    c, s = math.cos(part[2]), math.sin(part[2])
    east, north = float(other[0] - part[0]), float(other[1] - part[1])
    dx, dy = c * east + s * north, c * north - s * east
    by_robot = np.array([[-c, -s, dy], [s, -c, -dx], [0.0, 0.0, -1.0]])
    by_other = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.array([dx, dy, float(other[2] - part[2])]), by_robot, by_other
