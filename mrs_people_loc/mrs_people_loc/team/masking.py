"""Masking: the team's robots, walls and furniture, which stand at known places and are no people.

A robot's place is that of its pose; walls and furniture are those of an occupancy grid. Plain cells
of these are left out before clustering, so that a person beside them stays a cluster of their own
size. A body is masked as a whole, by its place and the covariance of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Float32, Int
from mrs_people_loc.errors import GridError
from mrs_people_loc.geometry import rotation_2d, unit_vectors
from mrs_people_loc.neighbours import pairs_between
from mrs_people_loc.team.fusion import BodiesOnMap, ShortTermMap
from mrs_people_loc.team.poses import Pose, places_and_covariances, places_of
from mrs_people_loc.uncertainty import covariance_of_places


@dataclass(frozen=True)
class MaskingTuning:
    """Constants of masking, chosen by hand.

    Attributes:
        gate: What is within so many standard deviations of a robot may be it.
        reach_along: ... and no farther from it than this along the line of sight [m].
        reach_across: Likewise across it [m].
        clearly_a_person: A body with these log-odds is a person, unless it is within a robot's
            radius.
        cell_sigma_across: Standard deviation of plain cells across the line of sight [m]: about
            half a cell of 5 cm.
        wall_reach: A wall's cells are no farther from it than this along the line of sight [m].
        inside: Unknown cells of a grid nearer than this to an occupied one are its inside [m].
        beside: Nearer than this to a wall or furniture is beside it [m]: arm's length.
    """

    gate: float = 2.5
    reach_along: float = 0.8
    reach_across: float = 0.4
    clearly_a_person: float = 5.0
    cell_sigma_across: float = 0.03
    wall_reach: float = 0.3
    inside: float = 0.5
    beside: float = 0.6


MASKING_TUNING = MaskingTuning()


# ----------------------------------------------------------------------------------- robots ----


def are_robots(
    xy: Float,
    covariance: Float,
    robot: Int,
    names: Sequence[str],
    poses: Mapping[str, Pose],
    *,
    radius: float,
    score: Float | None = None,
    tuning: MaskingTuning = MASKING_TUNING,
) -> Bool:
    """What stands where another robot of the team stands, shape (n,).

    A robot is what is within its radius or, where that is more, within `tuning.gate` standard
    deviations; both along the line of sight and across it. Beyond the radius, what clearly looks
    like a person is somebody beside it.

    Args:
        xy: Places of what was seen, in the common frame [m], shape (n, 2).
        covariance: Of the places [m^2], shape (n, 2, 2).
        robot: Which of the names saw it, shape (n,).
        names: Names of robots.
        poses: By robot, its pose in the common frame; also of those that saw nothing.
        radius: Of a robot [m]; 0: robots are not told from people.
        score: Log-odds that it is a person, where they are known, shape (n,).
        tuning: Constants.
    """
    masked = np.zeros(len(xy), dtype=bool)
    if not len(xy) or radius <= 0:
        return masked
    place, index = places_of(poses.values()), {name: k for k, name in enumerate(poses)}
    own = np.array([index[name] for name in names], dtype=np.intp)[robot]
    what, which, away = pairs_between(xy, place, _farthest(radius, tuning))
    others = which != own[what]
    what, which, away = what[others], which[others], away[others]
    there = np.ones(len(what), dtype=bool)
    along = unit_vectors(xy[what] - place[own[what]])
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    offset = place[which] - xy[what]
    of_robots = np.array([pose.covariance[:2, :2] for pose in poses.values()])
    with np.errstate(over="ignore", invalid="ignore"):  # DBL_MAX may stand for "unknown"
        total = covariance[what] + of_robots[which]
        for axis, most in ((along, tuning.reach_along), (across, tuning.reach_across)):
            sigma = np.sqrt(np.einsum("nj,njk,nk->n", axis, total, axis))
            reach = np.maximum(radius, np.fmin(tuning.gate * sigma, most))
            there &= np.abs(np.einsum("nj,nj->n", offset, axis)) < reach
    if score is not None:
        there &= (away < radius) | (score[what] < tuning.clearly_a_person)
    masked[what[there]] = True
    return masked


def bodies_of_robots(
    bodies: BodiesOnMap,
    names: Sequence[str],
    poses: Mapping[str, Pose],
    config: cfg.Masking,
    *,
    tuning: MaskingTuning = MASKING_TUNING,
) -> Bool:
    """Which bodies are robots of the team, shape (n,).

    Args:
        bodies: The bodies.
        names: Names of the robots that saw them.
        poses: By robot, its pose in the common frame; also of those that saw nothing.
        config: Parameters.
        tuning: Constants.
    """
    return are_robots(
        bodies.xy,
        bodies.covariance,
        bodies.robot,
        names,
        poses,
        radius=config.robot_radius,
        score=bodies.score,
        tuning=tuning,
    )


def _farthest(radius: float, tuning: MaskingTuning) -> float:
    """How far from a robot what is taken for it may be [m]."""
    return math.hypot(max(radius, tuning.reach_along), max(radius, tuning.reach_across))


# ------------------------------------------------------------------------------------ walls ----

#: Limits of a grid's resolution [m].
_FINEST, _COARSEST = 0.005, 1.0
#: Distances so many cells ahead and behind tell the direction off a wall.
_GRADIENT_CELLS = 2.0
#: Distances are exact up to this: the largest `wall_margin` [m].
_NEEDED = 1.0
#: They are computed in tiles of so many cells a side, at least; of so many new cells in one call,
#: at most; and so many cells are kept.
_TILE, _CELLS_AT_ONCE, _CELLS_KEPT = 256, 2_000_000, 16_000_000
#: Places about one, in standard deviations along the two axes of its covariance, and their weights.
_STEPS = np.linspace(-2.4, 2.4, 9)
_DRAWS: Float = np.stack(np.meshgrid(_STEPS, _STEPS), axis=-1).reshape(-1, 2)
_WEIGHTS: Float = np.exp(-0.5 * (_DRAWS**2).sum(axis=1))
_WEIGHTS /= _WEIGHTS.sum()
#: Least share of the draws, so that the log-odds are finite.
_TINY = 1e-9


@dataclass(frozen=True)
class OccupancyGrid:
    """What is known of a floor, cell by cell (nav_msgs/OccupancyGrid, REP 103 axes).

    Attributes:
        resolution: Side of a cell [m].
        x: Of the outer corner of cell (0, 0) in the common frame [m].
        y: Likewise [m].
        yaw: How far the grid is turned about that corner [rad].
        data: 0 free ... 100 occupied, -1 unknown; int8, rows along the grid's y, shape (height,
            width).

    Raises:
        GridError: Naming what cannot be used, what it is and what is wanted.
    """

    resolution: float
    x: float
    y: float
    yaw: float
    data: NDArray[np.int8]

    def __post_init__(self) -> None:
        """Checks all values."""
        if not _FINEST <= self.resolution <= _COARSEST:  # NaN compares false
            raise GridError(
                f"resolution is {self.resolution} m; allowed: {_FINEST:g} to {_COARSEST:g} m"
            )
        if not np.isfinite([self.x, self.y, self.yaw]).all():
            raise GridError(
                f"origin is ({self.x}, {self.y}, {self.yaw}); wanted: finite x, y [m], yaw [rad]"
            )
        if self.data.ndim != 2 or self.data.dtype != np.int8 or not self.data.size:
            raise GridError(
                f"data is {self.data.dtype} of shape {self.data.shape}; wanted: int8 of shape "
                "(height, width), one cell at least"
            )
        low, high = int(self.data.min()), int(self.data.max())
        if low < -1 or high > 100:
            raise GridError(f"data goes from {low} to {high}; wanted: -1, or 0 to 100")


class Walls:
    """Distances to walls and furniture.

    Unknown cells just behind occupied ones are their inside: a range that is too long puts what was
    seen of a wall there.

    Distances are computed on demand, tile by tile, so a grid may be of a whole factory. Places in
    more new tiles than one call computes get their distances in later calls.

    Args:
        grid: The grid.
        occupied_from: Its cells from this value on are occupied.
        tuning: Constants.
    """

    def __init__(
        self, grid: OccupancyGrid, *, occupied_from: int, tuning: MaskingTuning = MASKING_TUNING
    ) -> None:
        self._grid = grid
        self._occupied_from = occupied_from
        self._tuning = tuning
        self._border = math.ceil(tuning.inside / grid.resolution)
        height, width = grid.data.shape
        self._shape = height + 2 * self._border, width + 2 * self._border
        # What is farther from a tile than this changes no distance up to `_NEEDED` in it.
        self._around = math.ceil((_NEEDED + tuning.inside) / grid.resolution) + 1
        self._side = min(max(_TILE, 2 * self._around), max(self._shape))
        rows, columns = (-(-size // self._side) for size in self._shape)
        self._slot = np.full((rows, columns), -1)  # of each tile, where it is kept
        kept = max(1, min(rows * columns, _CELLS_KEPT // self._side**2))
        self._kept = np.empty((kept, self._side, self._side), dtype=np.float32)
        self._tile_in = np.full(kept, -1)  # of each slot, which tile is in it
        self._next = 0

    def _compute(self, tile: int) -> None:
        """Computes a tile, in the place of the one that was computed first."""
        row, column = (k * self._side for k in divmod(tile, self._slot.shape[1]))
        top, left = max(row - self._around, 0), max(column - self._around, 0)
        bottom = min(row + self._side + self._around, self._shape[0])
        right = min(column + self._side + self._around, self._shape[1])
        border, (height, width) = self._border, self._grid.data.shape
        data = np.full((bottom - top, right - left), -1, dtype=np.int8)
        on = self._grid.data[
            max(top - border, 0) : max(min(bottom - border, height), 0),
            max(left - border, 0) : max(min(right - border, width), 0),
        ]
        first = max(border - top, 0), max(border - left, 0)
        data[first[0] : first[0] + on.shape[0], first[1] : first[1] + on.shape[1]] = on
        occupied: Bool = data >= self._occupied_from
        inside: Bool = (data < 0) & (self._to_nearest(occupied) < self._tuning.inside)
        distance = self._to_nearest(occupied | inside)[
            row - top : row - top + self._side, column - left : column - left + self._side
        ]
        slot, self._next = self._next, (self._next + 1) % len(self._kept)
        if self._tile_in[slot] >= 0:
            self._slot.flat[self._tile_in[slot]] = -1
        self._slot.flat[tile], self._tile_in[slot] = slot, tile
        self._kept[slot, : distance.shape[0], : distance.shape[1]] = distance

    def _to_nearest(self, occupied: Bool) -> Float32:
        """Distance of each cell's centre to the border of the nearest occupied cell [m]."""
        if not occupied.any():
            return np.full(occupied.shape, np.inf, dtype=np.float32)
        import cv2  # here: most planners do without it, and are there sooner

        free = (~occupied).view(np.uint8)
        cells = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        resolution = np.float32(self._grid.resolution)
        return np.asarray(np.maximum(cells - np.float32(0.5), 0) * resolution)

    def distance(self, xy: Float) -> Float:
        """Distance to the nearest wall or furniture [m], to half a cell; inf far off the grid.

        Where it is more than 1 m it may be given as more than it is.

        Args:
            xy: Places in the common frame [m], shape (..., 2).

        Returns:
            Shape (...).
        """
        grid, side = self._grid, self._side
        with np.errstate(over="ignore", invalid="ignore"):  # places as far away as float64 goes
            place = (xy - (grid.x, grid.y)) @ rotation_2d(grid.yaw) / grid.resolution
            place += self._border
        height, width = self._shape
        on = np.asarray(((place >= 0) & (place < (width, height))).all(axis=-1))
        column, row = np.moveaxis(np.where(on[..., np.newaxis], place, 0).astype(np.intp), -1, 0)
        slot = self._slot[row // side, column // side]
        missing = on & (slot < 0)
        if missing.any():
            tile = (row // side) * self._slot.shape[1] + column // side
            most = max(1, _CELLS_AT_ONCE // (side + 2 * self._around) ** 2)
            for number in np.unique(tile[missing])[:most].tolist():
                self._compute(number)
            slot = self._slot[row // side, column // side]
            on &= slot >= 0
        found = self._kept[np.where(on, slot, 0), row % side, column % side]
        return np.where(on, found, np.inf).astype(np.float64)

    def off(self, xy: Float, least: float) -> Float:
        """Places, those nearer to walls and furniture than some distance moved straight off them.

        Deep inside, where all directions are alike, they stay.

        Args:
            xy: Places in the common frame [m], shape (n, 2).
            least: The distance [m].

        Returns:
            Shape (n, 2).
        """
        away = self.distance(xy)
        near = np.flatnonzero(away < least)
        if not len(near):
            return xy
        step = _GRADIENT_CELLS * self._grid.resolution * np.eye(2)
        here = away[near, np.newaxis]
        around = [self.distance(xy[near, np.newaxis] + way) for way in (step, -step)]
        # It is inf off the grid, and where nothing is known yet.
        ahead, behind = (np.where(np.isinf(one), here, one) for one in around)
        gradient = ahead - behind
        length = np.hypot(gradient[:, 0], gradient[:, 1])
        unit = gradient / np.maximum(length, 1e-9)[:, np.newaxis]
        moved = xy.copy()
        moved[near] += (least - away[near])[:, np.newaxis] * unit
        return moved

    def near(self, xy: Float, reach: Float, margin: float) -> Bool:
        """Whether any place from xy - reach to xy + reach is nearer to them than `margin`.

        Args:
            xy: Places in the common frame [m], shape (n, 2).
            reach: Vectors [m], shape (n, 2).
            margin: [m].

        Returns:
            Shape (n,).
        """
        steps = (-1.0, -0.5, 0.0, 0.5, 1.0)
        return np.asarray(np.any([self.distance(xy + k * reach) < margin for k in steps], axis=0))

    def log_odds(self, xy: Float, covariance: Float, config: cfg.Masking) -> Float:
        """Log-odds by the grid that somebody is at a place, shape (n,).

        At least `-config.wall_score`: as the share of the place's distribution that is in a wall or
        in furniture, or too near to them for a person's axis. At most `config.beside_score` beside
        them and 0 elsewhere: a wall close behind a body counts against a person in the robot's
        view, and the grid explains it.

        Args:
            xy: Places in the common frame [m], shape (n, 2).
            covariance: Of them [m^2], shape (n, 2, 2).
            config: Parameters.
        """
        values, vectors = np.linalg.eigh(covariance)
        axes = vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis]
        places = xy[:, np.newaxis] + _DRAWS @ axes.transpose(0, 2, 1)
        inside = (self.distance(places) < config.wall_margin) @ _WEIGHTS
        gain = np.where(self.distance(xy) < self._tuning.beside, config.beside_score, 0.0)
        odds = np.log((1.0 - inside + _TINY) / (inside + _TINY))
        return np.asarray(np.clip(odds, -config.wall_score, gain))


# ------------------------------------------------------------------------------------- cells ----

#: Pairs of a cell and a robot that are compared at once.
_PAIRS_AT_ONCE = 500_000


def are_masked(
    fused: ShortTermMap,
    cells: Int,
    poses: Mapping[str, Pose],
    walls: Walls | None,
    config: cfg.Masking,
    *,
    tuning: MaskingTuning = MASKING_TUNING,
) -> Bool:
    """Which plain cells are of robots, walls or furniture, shape (n,).

    Args:
        fused: The map.
        cells: Indices of cells, shape (n,).
        poses: By robot, its pose in the common frame; also of those without cells.
        walls: What is known of walls and furniture.
        config: Parameters.
        tuning: Constants.
    """
    xy, robot, radius = fused.xy[cells], fused.robot[cells], config.robot_radius
    masked = np.zeros(len(xy), dtype=bool)
    if not len(xy) or (walls is None and radius <= 0):
        return masked
    origin, of_poses = places_and_covariances(poses[name] for name in fused.robots)
    away = xy - origin[robot]
    with np.errstate(over="ignore"):
        sigma = config.cell_range_sigma * (away**2).sum(axis=1)
    places, at_once = places_of(poses.values()), max(1, _PAIRS_AT_ONCE // len(poses))
    farthest = _farthest(radius, tuning)
    for start in range(0, len(xy), at_once):
        near = start + np.unique(pairs_between(xy[start : start + at_once], places, farthest)[0])
        covariance = covariance_of_places(
            xy[near],
            origin[robot[near]],
            of_poses[robot[near]],
            along=sigma[near] ** 2,
            across=np.full(len(near), tuning.cell_sigma_across**2),
        )
        masked[near] = are_robots(
            xy[near], covariance, robot[near], fused.robots, poses, radius=radius, tuning=tuning
        )
    if walls is not None:
        reach = unit_vectors(away) * np.minimum(sigma, tuning.wall_reach)[:, np.newaxis]
        masked |= walls.near(xy, reach, config.wall_margin)
    return masked


# --------------------------------------------------------------------------------------- all ----


@dataclass(frozen=True)
class Known:
    """What of a map stands at known places and is no person.

    Attributes:
        plain: Indices of the cells that belong to no body, shape (p,).
        cells: Which of them are of robots, walls or furniture, shape (p,).
        bodies: Which bodies are robots, shape (n,).
    """

    plain: Int
    cells: Bool
    bodies: Bool


def mask(
    fused: ShortTermMap,
    bodies: BodiesOnMap,
    poses: Mapping[str, Pose],
    walls: Walls | None,
    config: cfg.Masking,
    *,
    tuning: MaskingTuning = MASKING_TUNING,
) -> Known:
    """Finds the team's robots, walls and furniture on a map.

    Args:
        fused: The map.
        bodies: Its bodies.
        poses: By robot, its pose in the common frame; also of those that saw nothing.
        walls: What is known of walls and furniture.
        config: Parameters.
        tuning: Constants.
    """
    plain = np.flatnonzero(bodies.of_cell < 0)
    return Known(
        plain=plain,
        cells=are_masked(fused, plain, poses, walls, config, tuning=tuning),
        bodies=bodies_of_robots(bodies, fused.robots, poses, config, tuning=tuning),
    )
