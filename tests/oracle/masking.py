"""What on the map is no person: other robots of the team, walls and furniture."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from mrs_people_loc.config import Masking
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose
from oracle.arrays import Float
from oracle.fusion import covariance_seen
from oracle.numbers import (
    BESIDE_M,
    CELL_SIGMA_ACROSS_M,
    CLEARLY_A_PERSON,
    DRAWS,
    INSIDE_M,
    REACH_ACROSS_M,
    REACH_ALONG_M,
    ROBOT_SIGMAS,
    TINY_SHARE,
    WALL_REACH_M,
)


def is_robot(
    robot: str, xy: Float, covariance: Float, poses: Mapping[str, Pose], radius: float, score: float
) -> bool:
    """Whether what a robot saw somewhere is another robot of the team."""
    own = poses[robot]
    angle = math.atan2(xy[1] - own.y, xy[0] - own.x)
    sight = np.array([math.cos(angle), math.sin(angle)])
    for name, pose in poses.items():
        offset = xy - (pose.x, pose.y)
        total = covariance + pose.covariance[:2, :2]
        there = name != robot and radius > 0
        for axis, most in (
            (sight, REACH_ALONG_M),
            (np.array([-sight[1], sight[0]]), REACH_ACROSS_M),
        ):
            reach = max(radius, min(ROBOT_SIGMAS * math.sqrt(axis @ total @ axis), most))
            there = there and bool(abs(axis @ offset) < reach)
        if there and (math.hypot(*offset) < radius or score < CLEARLY_A_PERSON):
            return True
    return False


def is_masked(
    robot: str, xy: Float, poses: Mapping[str, Pose], config: Masking, walls: Walls | None = None
) -> bool:
    """Whether a plain cell that a robot saw is of another robot, of a wall or of furniture."""
    own = poses[robot]
    x, y = xy[0] - own.x, xy[1] - own.y
    sigma = config.cell_range_sigma * (x * x + y * y)
    covariance = covariance_seen(own, xy, sigma**2, CELL_SIGMA_ACROSS_M**2)
    if is_robot(robot, xy, covariance, poses, config.robot_radius, -math.inf):
        return True
    if walls is None:
        return False
    angle, reach = math.atan2(y, x), min(sigma, WALL_REACH_M)
    return any(
        walls.distance(
            xy[0] + part * reach * math.cos(angle), xy[1] + part * reach * math.sin(angle)
        )
        < config.wall_margin
        for part in (-1.0, -0.5, 0.0, 0.5, 1.0)
    )


class Walls:
    """Walls and furniture of a grid, each occupied cell by itself.

    Args:
        grid: The grid.
        occupied_from: Its cells from this value on are occupied.
    """

    def __init__(self, grid: OccupancyGrid, *, occupied_from: int) -> None:
        self.grid = grid
        # Around the grid nothing is known: that may be the inside of its outer walls.
        self.border = math.ceil(INSIDE_M / grid.resolution)
        data = np.pad(grid.data, self.border, constant_values=-1)
        self.shape = data.shape
        self.occupied = np.argwhere(data >= occupied_from)
        inside = [at for at in np.argwhere(data < 0) if self._to_nearest(*at) < INSIDE_M]
        self.occupied = np.vstack([self.occupied, np.array(inside, dtype=int).reshape(-1, 2)])

    def _to_nearest(self, row: float, column: float) -> float:
        """From the middle of a cell to the border of the nearest that is occupied [m]."""
        if not len(self.occupied):
            return math.inf
        nearest = np.hypot(self.occupied[:, 0] - row, self.occupied[:, 1] - column).min()
        return max(float(nearest) - 0.5, 0.0) * self.grid.resolution

    def distance(self, x: float, y: float) -> float:
        """From the cell of a place to the nearest that is occupied [m]; inf off the grid."""
        grid = self.grid
        dx, dy = x - grid.x, y - grid.y
        cos, sin = math.cos(grid.yaw), math.sin(grid.yaw)
        column = math.floor((cos * dx + sin * dy) / grid.resolution) + self.border
        row = math.floor((cos * dy - sin * dx) / grid.resolution) + self.border
        if not (0 <= row < self.shape[0] and 0 <= column < self.shape[1]):
            return math.inf
        return self._to_nearest(row, column)

    def log_odds(self, xy: Float, covariance: Float, config: Masking) -> float:
        """What the grid says for and against a person at an unsure place."""
        values, vectors = np.linalg.eigh(covariance)
        weights, inside = 0.0, 0.0
        for i in DRAWS:
            for j in DRAWS:
                place = xy + vectors @ (np.sqrt(np.maximum(values, 0.0)) * (i, j))
                weight = math.exp(-0.5 * (i * i + j * j))
                weights += weight
                inside += weight * (self.distance(*place) < config.wall_margin)
        share = inside / weights
        odds = math.log((1.0 - share + TINY_SHARE) / (share + TINY_SHARE))
        gain = config.beside_score if self.distance(*xy) < BESIDE_M else 0.0
        return min(max(odds, -config.wall_score), gain)
