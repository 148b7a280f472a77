"""Flat walls as lines on the ground plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float, StructOfArrays

#: Where people and team-mates are: x, y in base_link, and how far that may be off [m], (n, 3).
NOBODY: Float = np.empty((0, 3))


@dataclass(frozen=True)
class Walls(StructOfArrays):
    """Flat vertical walls in one frame, as lines in normal form.

    A point (x, y) is on a wall's line where x cos(bearing) + y sin(bearing) = distance. The foot of
    the perpendicular from the frame's origin is `distance` away in the direction `bearing`.

    Attributes:
        distance: From the origin to the line [m], at least 0, shape (n,).
        bearing: Direction of the perpendicular foot [rad], in (-pi, pi], shape (n,).
        covariance: Of distance and bearing [m, rad], shape (n, 2, 2).
        extent: Where the part of the line that is known begins and ends [m], measured from the foot
            in the direction bearing + pi/2, shape (n, 2), ascending.
        is_end: Whether the wall itself, and not only its view, ends there, shape (n, 2).
    """

    distance: Float
    bearing: Float
    covariance: Float
    extent: Float
    is_end: Bool


@dataclass(frozen=True)
class SeenWalls:
    """Walls that a robot sees at one time.

    Attributes:
        stamp_ns: Time of the measurement [ns].
        walls: In the robot's base_link.
    """

    stamp_ns: int
    walls: Walls


def moved(walls: Walls, x: float | Float, y: float | Float, yaw: float) -> Walls:
    """Walls of a frame at x, y [m], turned by yaw [rad], in the frame around it.

    Distances become at least 0, bearings those in (-pi, pi]. `x` and `y` may differ from wall to
    wall, shape (n,).
    """
    bearing = walls.bearing + yaw
    cos, sin = np.cos(bearing), np.sin(bearing)
    along = y * cos - x * sin
    distance = walls.distance + x * cos + y * sin
    covariance = walls.covariance.copy()
    if along.any():
        jacobian = np.zeros((len(walls), 2, 2))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
        jacobian[:, 0, 1] = along
        covariance = jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    extent, is_end = walls.extent + along[:, np.newaxis], walls.is_end.copy()
    flip = np.flatnonzero(distance < 0.0)
    if len(flip):
        distance[flip] *= -1.0
        bearing[flip] += np.pi
        covariance[flip, 0, 1] *= -1.0
        covariance[flip, 1, 0] *= -1.0
        extent[flip], is_end[flip] = -extent[flip, ::-1], is_end[flip, ::-1]
    bearing = np.pi - np.mod(np.pi - bearing, 2.0 * np.pi)
    return Walls(distance, bearing, covariance, extent, is_end)
