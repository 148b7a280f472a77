"""Walls of a map: from a file of lines, or from an occupancy grid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.config import load_yaml
from mrs_people_loc.errors import ConfigError, GridError
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.team.masking import OccupancyGrid


@dataclass(frozen=True)
class WallFileTuning:
    """Limits and constants of a file of walls, chosen by hand.

    Attributes:
        sigma: Of the ends of the lines, unless the file says otherwise [m].
        largest_sigma: A larger one is a mistake [m].
        most: No file has more walls.
        farthest: Greatest coordinate [m], as that of poses (`messages.poses`).
        shortest: Shorter lines are mistakes [m].
        corner: A wall ends in a corner if another one is this near to its end [m] ...
        corner_angle: ... at an angle of more than this [rad].
    """

    sigma: float = 0.01
    largest_sigma: float = 10.0
    most: int = 10_000
    farthest: float = 2.1e7
    shortest: float = 0.1
    corner: float = 0.05
    corner_angle: float = 0.5


_FILE = WallFileTuning()


@dataclass(frozen=True)
class _Segments(StructOfArrays):
    """Pieces of lines.

    Attributes:
        begin: [m], shape (n, 2).
        end: [m], shape (n, 2).
    """

    begin: Float
    end: Float


def read_walls(path: str | Path) -> Walls:
    """Reads the known walls of a building, in the map, from a YAML file.

    The file holds the faces of the walls as lines from one point to another, and how well their
    ends are known::

        walls: [[0.0, 0.0, 20.0, 0.0], [20.0, 0.0, 20.0, 8.0]]  # x0, y0, x1, y1 [m]
        sigma: 0.02                       # [m]; 0.01 if it is left out

    A wall ends (`Walls.is_end`) where another one of the file meets it at an angle; elsewhere it
    may go on.

    Args:
        path: The file; `~` is the home folder.

    Raises:
        ConfigError: It cannot be read, or holds something else; the wall and what is wanted are
            named.
    """
    path = Path(path).expanduser()
    document = load_yaml(path)
    try:
        lines, sigma = _checked(document)
    except ConfigError as err:
        raise ConfigError(f"{path}: {err}") from err
    return _walls(_Segments(lines[:, :2], lines[:, 2:]), sigma)


def _checked(document: object) -> tuple[Float, float]:
    """Lines, shape (n, 4), and the standard deviation of a file that holds these."""
    if not isinstance(document, Mapping) or "walls" not in document:
        raise ConfigError("is no file of walls; wanted: `walls:` with [x0, y0, x1, y1] for each")
    unknown = [key for key in document if key not in ("walls", "sigma")]
    if unknown:
        raise ConfigError(f"unknown key {unknown[0]}; known: walls, sigma")
    rows = document["walls"]
    if not isinstance(rows, list) or not 0 < len(rows) <= _FILE.most:
        raise ConfigError(f"walls is no list of 1 to {_FILE.most} lines [x0, y0, x1, y1]")
    for k, row in enumerate(rows):
        if not (isinstance(row, list) and len(row) == 4 and all(map(_is_coordinate, row))):
            raise ConfigError(
                f"walls[{k}] is {row!r}; wanted: [x0, y0, x1, y1], numbers within "
                f"{_FILE.farthest:g} m"
            )
    sigma = document.get("sigma", _FILE.sigma)
    if isinstance(sigma, bool) or not isinstance(sigma, int | float):
        raise ConfigError(f"sigma is {sigma!r}; wanted: a number [m]")
    largest, shortest = _FILE.largest_sigma, _FILE.shortest
    if not 0.0 < sigma <= largest:  # NaN compares false
        raise ConfigError(f"sigma is {sigma} m; allowed: more than 0, at most {largest:g}")
    lines = np.array(rows, dtype=np.float64)
    length = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
    if (length < shortest).any():
        k = int(np.argmin(length))
        raise ConfigError(f"walls[{k}] is {length[k]:.3g} m long; wanted: at least {shortest} m")
    return lines, float(sigma)


def _is_coordinate(value: object) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= _FILE.farthest  # type: ignore[arg-type]


def _walls(segments: _Segments, sigma: float) -> Walls:
    """Segments in normal form.

    Args:
        segments: The walls.
        sigma: Standard deviation of each end, across [m].
    """
    way = segments.end - segments.begin
    length = np.hypot(way[:, 0], way[:, 1])
    along = way / length[:, np.newaxis]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)  # along is that, turned by pi/2
    distance = np.einsum("nj,nj->n", segments.begin, normal)
    behind = distance < 0
    sign = np.where(behind, -1.0, 1.0)
    normal, along = normal * sign[:, np.newaxis], along * sign[:, np.newaxis]
    extent = np.stack(
        [np.einsum("nj,nj->n", p, along) for p in (segments.begin, segments.end)], axis=1
    )
    is_end = _are_corners(segments, along)
    extent[behind], is_end[behind] = extent[behind, ::-1], is_end[behind, ::-1]
    # Across, at the middle, and of the bearing; carried to the foot.
    middle = extent.mean(axis=1)
    covariance = np.zeros((len(length), 2, 2))
    covariance[:, 1, 1] = 2.0 * (sigma / length) ** 2
    covariance[:, 0, 1] = covariance[:, 1, 0] = middle * covariance[:, 1, 1]
    covariance[:, 0, 0] = 0.5 * sigma**2 + middle**2 * covariance[:, 1, 1]
    bearing = np.arctan2(normal[:, 1], normal[:, 0])
    bearing[bearing == -math.pi] = math.pi
    return Walls(distance * sign, bearing, covariance, extent, is_end)


def _are_corners(segments: _Segments, along: Float) -> Bool:
    """Whether another segment is at each one's begin and end, at an angle, shape (n, 2)."""
    way = segments.end - segments.begin
    squared = (way**2).sum(axis=1)
    turned = np.abs(along[:, :1] * along[:, 1] - along[:, 1:] * along[:, 0])
    at_angle = turned > math.sin(_FILE.corner_angle)
    corners = []
    for point in (segments.begin, segments.end):
        offset = point[:, np.newaxis] - segments.begin
        share = np.clip((offset * way).sum(axis=2) / squared, 0.0, 1.0)
        away = offset - share[:, :, np.newaxis] * way
        corners.append(
            (at_angle & (np.hypot(away[..., 0], away[..., 1]) < _FILE.corner)).any(axis=1)
        )
    return np.stack(corners, axis=1)


# --------------------------------------------------------------------------- occupancy grid ----


@dataclass(frozen=True)
class GridTuning:
    """Constants of the walls of a grid, chosen by hand.

    Attributes:
        least_length: Shorter lines are no walls [m].
        tolerance: The faces of a wall's cells are this near to its line [cells], or ...
        tolerance_m: ... this [m], if that is more.
        facing: Sides of cells count whose normal has this cosine, at least, to the wall's.
        bow: The middle of a wall is nearer than this to the line through its ends [cells]; one step
            of the cells of a wall that is turned by less than a degree may look like 0.72.
        gap: A wall goes on behind a gap (a door) of at most this [m].
        covered: Faces are along at least this share of a wall.
        most: At most so many walls; the longest.
        sigma: Standard deviation of each of a wall's ends, across [cells]: where in a cell a wall
            is differs from map to map.
    """

    least_length: float = 0.8
    tolerance: float = 1.0
    tolerance_m: float = 0.05
    facing: float = 0.2
    bow: float = 0.9
    gap: float = 1.5
    covered: float = 0.5
    most: int = 300
    sigma: float = 0.5


GRID_TUNING = GridTuning()


@dataclass(frozen=True)
class _Faces(StructOfArrays):
    """Sides of occupied cells towards free ones.

    Attributes:
        xy: Their middles [cells], shape (n, 2).
        normal: Towards the free cell, shape (n, 2).
    """

    xy: Float
    normal: Float


def walls_of_grid(
    grid: OccupancyGrid, *, occupied_from: int, tuning: GridTuning = GRID_TUNING
) -> Walls:
    """Straight walls of an occupancy grid, in the map: where occupied cells border on free ones.

    The outlines of the free cells are simplified to polygons (Douglas and Peucker 1973). Lines are
    fitted to the cells' sides near the longer edges by least squares, longest edge first; each side
    counts for one wall.

    Args:
        grid: The grid.
        occupied_from: Its cells from this value on are occupied; others are free unless unknown.
        tuning: Constants.

    Raises:
        GridError: It is farther from the origin of the map than anything on earth.
    """
    if max(abs(grid.x), abs(grid.y)) > _FILE.farthest:
        raise GridError(f"origin is ({grid.x:g}, {grid.y:g}) m; wanted: within {_FILE.farthest:g}")
    occupied = grid.data >= occupied_from
    free = (grid.data >= 0) & ~occupied
    faces = _faces(occupied, free)
    tolerance = max(tuning.tolerance, tuning.tolerance_m / grid.resolution)
    found: list[tuple[Float, Float]] = []
    left: Bool = np.ones(len(faces), dtype=bool)
    for begin, end in _edges(free, tolerance, 0.5 * tuning.least_length / grid.resolution):
        fitted = _fitted(faces, left, begin, end, tolerance, tuning, grid.resolution)
        if fitted is not None:
            *line, of = fitted
            left[of] = False
            found.append((line[0], line[1]))
    found.sort(key=lambda line: -float(np.hypot(*(line[1] - line[0]))))
    ends = np.array(found[: tuning.most]).reshape(-1, 2, 2) * grid.resolution
    ends = ends @ rotation_2d(grid.yaw).T + (grid.x, grid.y)
    return _walls(_Segments(ends[:, 0], ends[:, 1]), tuning.sigma * grid.resolution)


def _faces(occupied: Bool, free: Bool) -> _Faces:
    """Sides of occupied cells towards free ones, in cells from the grid's corner."""
    places, normals = [], []
    for normal in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        dx, dy = normal
        towards = np.zeros_like(free)
        rows, columns = free.shape
        towards[max(-dy, 0) : rows - max(dy, 0), max(-dx, 0) : columns - max(dx, 0)] = free[
            max(dy, 0) : rows - max(-dy, 0), max(dx, 0) : columns - max(-dx, 0)
        ]
        row, column = np.nonzero(occupied & towards)
        places.append(np.stack([column + 0.5 + 0.5 * dx, row + 0.5 + 0.5 * dy], axis=1))
        normals.append(np.tile(np.array(normal, dtype=np.float64), (len(row), 1)))
    return _Faces(np.concatenate(places), np.concatenate(normals))


def _edges(free: Bool, tolerance: float, least: float) -> list[tuple[Float, Float]]:
    """Edges of polygons about the free cells, in cells, the longest first."""
    outlines, _ = cv2.findContours(free.view(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    edges: list[Float] = []
    for outline in outlines:
        corners = cv2.approxPolyDP(outline, tolerance, True)[:, 0].astype(np.float64) + 0.5
        edges.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    if not edges:
        return []
    both = np.concatenate(edges)
    length = np.hypot(*(both[:, 1] - both[:, 0]).T)
    order = np.argsort(-length, kind="stable")
    return [(one[0], one[1]) for one in both[order[length[order] >= least]]]


def _fitted(
    faces: _Faces,
    left: Bool,
    begin: Float,
    end: Float,
    tolerance: float,
    tuning: GridTuning,
    resolution: float,
) -> tuple[Float, Float, Int] | None:
    """A line's ends [cells], fitted to faces near it, and which; None: it is no wall."""
    along = (end - begin) / np.hypot(*(end - begin))
    centre = 0.5 * (begin + end)
    reach = tolerance + 1.0  # outlines are in the middle of cells
    of = np.arange(0)
    facing = 0.0
    for _ in range(4):
        normal = np.array([-along[1], along[0]])
        offset = faces.xy - centre
        near = left & (np.abs(offset @ normal) < reach)
        facings = faces.normal @ normal
        if not facing:  # which side is free, as most faces near the edge say
            place = offset @ along
            beside = near & (np.abs(place) < 0.5 * np.hypot(*(end - begin)))
            facing = float(np.sign(facings[beside].sum()))
        of = np.flatnonzero(near & (facings * facing > tuning.facing))
        of = _run(of, offset @ along, 0.0, tuning.gap / resolution)
        if len(of) < 3:
            return None
        centre = faces.xy[of].mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((faces.xy[of] - centre).T))
        along = vectors[:, 1] * math.copysign(1.0, float(vectors[:, 1] @ along))
        reach = tolerance
    place = (faces.xy[of] - centre) @ along
    low, high = float(place.min()) - 0.5, float(place.max()) + 0.5
    covered = len(np.unique(np.floor(place)))
    if (high - low) * resolution < tuning.least_length or covered < tuning.covered * (high - low):
        return None
    curvature = np.polyfit(place, (faces.xy[of] - centre) @ (-along[1], along[0]), 2)[0]
    if abs(curvature) * (0.5 * (high - low)) ** 2 > tuning.bow:
        return None
    return centre + low * along, centre + high * along, of


def _run(of: Int, place: Float, about: float, gap: float) -> Int:
    """Those about a place along a line that have no larger gap between them."""
    order = of[np.argsort(place[of], kind="stable")]
    if not len(order):
        return order
    runs = np.split(order, np.flatnonzero(np.diff(place[order]) > gap) + 1)
    away = [max(place[r[0]] - about, about - place[r[-1]], 0.0) for r in runs]
    return runs[int(np.argmin(away))]
