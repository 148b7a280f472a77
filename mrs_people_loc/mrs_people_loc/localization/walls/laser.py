"""Walls in the scans of a laser scanner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.walls import Walls, moved
from mrs_people_loc.localization.walls.fit import WALL_FIT_TUNING, WallFitTuning, fit_walls
from mrs_people_loc.localization.walls.ranges import LaserScan


@dataclass(frozen=True)
class LaserWallTuning:
    """Constants of `walls_of_laser`, chosen by hand.

    Attributes:
        beam: Standard deviation of the direction of a ray [rad].
        body: Points this near to a person or a team-mate are left out [m].
        min_range: Nearer rays hit the robot itself [m].
        bias: Standard deviation of the error that ranges have in common [m],
        yaw: and of the scanner's mounting [rad].
        jump: Behind a wall's end the next rays go on for more than this [m].
        gap: A wall's end is in the middle between the last ray on the wall and the next one, if
            these are no farther apart on its line than this [m]; else nobody knows where it is.
        fit: Constants of the fit.
    """

    beam: float = 0.002
    body: float = 0.45
    min_range: float = 0.1
    bias: float = 0.01
    yaw: float = 0.004
    jump: float = 0.3
    gap: float = 0.15
    fit: WallFitTuning = WALL_FIT_TUNING


LASER_WALL_TUNING = LaserWallTuning()


def unskewed(
    scan: LaserScan, moved_by: Float, mounting: tuple[float, float, float]
) -> tuple[Float, Float]:
    """Ranges and angles of a scan as if the robot had stood still at its stamp.

    Args:
        scan: The scan.
        moved_by: x, y [m], yaw [rad] of base_link at the scan's last ray, in base_link at its
            first one, shape (3,); in between it moves evenly.
        mounting: Of the scanner in base_link: x, y [m], yaw [rad].

    Returns:
        Ranges [m] and angles [rad], each of shape (n,), as those of the scan.
    """
    part = np.linspace(0.0, 1.0, len(scan.angles))
    if scan.sweep_s < 0:
        part = part[::-1]
    x, y, yaw = mounting
    turn = part * moved_by[2]
    cos, sin = np.cos(turn), np.sin(turn)
    scanner = np.stack([cos * x - sin * y - x, sin * x + cos * y - y], axis=1)
    origin = (scanner + part[:, np.newaxis] * moved_by[:2]) @ rotation_2d(yaw)
    angles = scan.angles + turn
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    # In the direction of each ray, and across.
    along = scan.ranges + np.einsum("ij,ij->i", origin, ray)
    across = origin[:, 1] * ray[:, 0] - origin[:, 0] * ray[:, 1]
    return np.hypot(along, across), angles + np.nan_to_num(np.arctan2(across, along))


def walls_of_laser(
    ranges: Float,
    angles: Float,
    *,
    sigma: float,
    max_range: float,
    mounting: tuple[float, float, float],
    bodies: Float,
    tuning: LaserWallTuning = LASER_WALL_TUNING,
) -> Walls:
    """Walls of one scan, in base_link.

    Args:
        ranges: [m], shape (n,); NaN, infinite or not below `max_range`: nothing was hit.
        angles: From the scanner's x axis [rad], ascending, shape (n,).
        sigma: Standard deviation of a range [m].
        max_range: The scanner's [m].
        mounting: Of the scanner in base_link: x, y [m], yaw [rad].
        bodies: Where people and team-mates are (`walls.NOBODY`), shape (m, 3).
        tuning: Constants.

    Raises:
        ValueError: There are not as many angles as ranges.
    """
    if ranges.shape != angles.shape:
        raise ValueError(
            f"there are {ranges.size} ranges and {angles.size} angles; wanted: equal numbers"
        )
    hit = (ranges >= tuning.min_range) & (ranges < max_range)  # NaN compares false
    cos, sin = np.cos(angles[hit]), np.sin(angles[hit])
    xy = np.empty((len(cos), 2))
    xy[:, 0], xy[:, 1] = ranges[hit] * cos, ranges[hit] * sin
    kept = ~_near(xy, mounting, bodies, tuning.body)
    xy, cos, sin = xy[kept], cos[kept], sin[kept]
    along = sigma**2
    across = np.einsum("ij,ij->i", xy, xy) * tuning.beam**2
    covariance = np.empty((len(xy), 2, 2))
    covariance[:, 0, 0] = along * cos * cos + across * sin * sin
    covariance[:, 1, 1] = along * sin * sin + across * cos * cos
    covariance[:, 0, 1] = covariance[:, 1, 0] = (along - across) * cos * sin
    walls = fit_walls(xy, covariance, tuning=tuning.fit)
    walls.covariance[:, 0, 0] += tuning.bias**2
    walls.covariance[:, 1, 1] += tuning.yaw**2
    free = np.where(np.isnan(ranges), 0.0, np.minimum(ranges, max_range))
    spacing = (angles[-1] - angles[0]) / max(1, len(angles) - 1)
    gap = _gaps(walls, spacing)
    is_end = _jumps(walls, free, angles, spacing, tuning.jump) & (gap < tuning.gap) & ~walls.is_end
    walls.extent[:] += np.where(is_end, (-0.5, 0.5) * gap, 0.0)
    walls.is_end[:] |= is_end
    return moved(walls, *mounting)


def _near(xy: Float, mounting: tuple[float, float, float], bodies: Float, radius: float) -> Bool:
    """Which points of the scanner's frame may be of bodies, shape (n,)."""
    x, y, yaw = mounting
    points = xy @ rotation_2d(yaw).T + (x, y)
    dx, dy = points[:, 0] - bodies[:, :1], points[:, 1] - bodies[:, 1:2]
    return np.asarray((np.sqrt(dx * dx + dy * dy) < radius + bodies[:, 2:]).any(axis=0))


def _gaps(walls: Walls, spacing: float) -> Float:
    """How far beyond each end of walls the next ray is on their lines [m], shape (m, 2).

    Args:
        walls: In the scanner's frame.
        spacing: Of the rays [rad].
    """
    distance, outwards = walls.distance[:, np.newaxis], np.array([-1.0, 1.0]) * walls.extent
    following = np.arctan2(outwards, distance) + spacing
    beyond = np.where(following < 0.5 * np.pi - 1e-3, distance * np.tan(following), np.inf)
    return np.asarray(beyond - outwards)


def _jumps(walls: Walls, free: Float, angles: Float, spacing: float, jump: float) -> Bool:
    """Beyond which ends of walls the next rays go on behind them, shape (m, 2).

    Args:
        walls: In the scanner's frame.
        free: How far each ray goes freely [m], shape (n,).
        angles: Of the rays [rad], shape (n,).
        spacing: Between two [rad].
        jump: [m].
    """
    # Two and three rays beyond the end: one may hit the edge.
    step = np.array([-2, -3, 2, 3])
    ends = np.repeat(walls.extent, 2, axis=1)
    bearing = walls.bearing[:, np.newaxis] + np.arctan2(ends, walls.distance[:, np.newaxis])
    off = np.mod(bearing - angles[0] + np.pi, 2.0 * np.pi) - np.pi
    index = np.round(np.mod(off, 2.0 * np.pi) / spacing).astype(np.intp) + step
    inside = (index >= 0) & (index < len(angles))
    index = np.maximum(np.minimum(index, len(angles) - 1), 0)
    cosine = np.cos(angles[index] - walls.bearing[:, np.newaxis])
    with np.errstate(divide="ignore"):
        line = np.where(cosine > 1e-3, walls.distance[:, np.newaxis] / cosine, np.inf)
    beyond = inside & (free[index] > line + jump)
    return np.asarray(beyond.reshape(-1, 2, 2).all(axis=2))
