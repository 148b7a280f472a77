"""Fusion: the cells and the bodies of all robots on the common map, for one interval (eq. 6)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.team.poses import Pose, places_and_covariances
from mrs_people_loc.uncertainty import LARGEST_SIGMA, LEAST_SIGMA, bounded, covariance_of_places

#: Which elements of the covariance of a pose grow with the variance of its place.
_OF_PLACE = np.diag([1.0, 1.0, 0.0])


@dataclass(frozen=True)
class ShortTermMap:
    """The union of all robots' cells in the common frame: the paper's K.

    Attributes:
        robots: Names of the robots, in the order of their scans.
        robot: Which of them each cell comes from, shape (n,).
        xy: Cell centres in the common frame [m], float64, shape (n, 2).
        cells: The cells as the robots sent them; x and y are in each robot's base_link.
        stamps_ns: Stamps of the robots' scans [ns], in the same order.
    """

    robots: tuple[str, ...]
    robot: Int
    xy: Float
    cells: Cells
    stamps_ns: tuple[int, ...]

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.xy)


def map_from_robot(points: Float, pose: Pose) -> Float:
    """Rotates points by a robot's heading and translates them by its position (eq. 6).

    Args:
        points: x, y in the robot's base_link [m], shape (n, 2).
        pose: The robot's pose in the common frame.

    Returns:
        x, y in the common frame [m], shape (n, 2).
    """
    return points @ rotation_2d(pose.yaw).T + (pose.x, pose.y)


def allow_for_walking(
    scans: Sequence[Scan], poses: Mapping[str, Pose], time_ns: int, walking_speed: float
) -> dict[str, Pose]:
    """The poses of the scans, with more variance for what people walk until the interval's time.

    Args:
        scans: One per robot.
        poses: By robot, its pose in the common frame at its scan's stamp.
        time_ns: Time of the interval [ns].
        walking_speed: Standard deviation of what people walk in a second [m/s].
    """
    placed = dict(poses)
    for scan in scans:
        walked = walking_speed * (time_ns - scan.stamp_ns) / 1e9
        if walked:
            pose = poses[scan.robot]
            covariance = pose.covariance + walked**2 * _OF_PLACE
            placed[scan.robot] = dataclasses.replace(pose, covariance=covariance)
    return placed


def fuse(scans: Sequence[Scan], poses: Mapping[str, Pose]) -> ShortTermMap:
    """Puts the scans on one map: K = [W]a | [W]b | [W]c.

    Args:
        scans: One per robot.
        poses: By robot, its pose in the common frame at its scan's stamp.
    """
    cells = Cells.union([scan.cells for scan in scans])
    xy = np.stack([cells.x, cells.y], axis=1).astype(np.float64)
    sizes = [len(scan.cells) for scan in scans]
    end = 0
    for scan, size in zip(scans, sizes, strict=True):
        begin, end = end, end + size
        xy[begin:end] = map_from_robot(xy[begin:end], poses[scan.robot])
    return ShortTermMap(
        robots=tuple(scan.robot for scan in scans),
        robot=np.repeat(np.arange(len(scans)), sizes),
        xy=xy,
        cells=cells,
        stamps_ns=tuple(scan.stamp_ns for scan in scans),
    )


@dataclass(frozen=True)
class BodiesOnMap:
    """Bodies in the common frame, a struct of arrays of one length (n,).

    Attributes:
        of_cell: Body of each cell of the map; -1: of none, shape (cells,).
        robot: Which robot of the map saw it.
        xy: Its place [m], shape (n, 2).
        covariance: Of its place, the pose's part included [m^2], shape (n, 2, 2).
        score: Log-odds that it is a person.
    """

    of_cell: Int
    robot: Int
    xy: Float
    covariance: Float
    score: Float

    def __len__(self) -> int:
        """Number of bodies."""
        return len(self.robot)


def place_bodies(
    fused: ShortTermMap, poses: Mapping[str, Pose], *, line_of_sight: bool
) -> BodiesOnMap:
    """The bodies whose cells are on a map: each is where its cells' centre of gravity is.

    Args:
        fused: The map.
        poses: By robot, the pose that its cells were placed with.
        line_of_sight: Whether covariances are long along the line of sight; if not, they are
            isotropic, of the same area.
    """
    cells = fused.cells
    of_cell = np.full(len(fused), -1, dtype=np.intp)
    mine = np.flatnonzero(cells.body)
    if not len(mine):
        places = np.empty((0, 2)), np.empty((0, 2, 2))
        return BodiesOnMap(of_cell, np.empty(0, np.intp), *places, np.empty(0))
    key = fused.robot[mine].astype(np.int64) << 32 | cells.body[mine].astype(np.int64)
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    of_cell[mine] = number
    count = len(first)
    weight = np.maximum(cells.count[mine].astype(np.float64), 1.0)
    total = np.bincount(number, weight, minlength=count)
    xy = np.stack(
        [np.bincount(number, weight * fused.xy[mine, k], minlength=count) / total for k in (0, 1)],
        axis=1,
    )
    first = mine[first]
    robot = fused.robot[first]
    along, across = (
        np.clip(sigma[first].astype(np.float64), LEAST_SIGMA, LARGEST_SIGMA) ** 2
        for sigma in (cells.sigma_range, cells.sigma_across)
    )
    if not line_of_sight:
        along = across = np.sqrt(along * across)
    origin, of_poses = places_and_covariances(poses[name] for name in fused.robots)
    covariance = covariance_of_places(
        xy, origin[robot], of_poses[robot], along=along, across=across
    )
    return BodiesOnMap(
        of_cell, robot, xy, bounded(covariance), cells.score[first].astype(np.float64)
    )
