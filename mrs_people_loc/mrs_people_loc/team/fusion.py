"""Fusion: the cells of all robots on the common map, for one interval (eq. 6, section 5.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import Float, rotation_2d
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.team.poses import Pose, pose_effect, stack

#: Plain cells carry no uncertainty. Standard deviation of their range, per square of it [1/m]: a
#: quarter of a pixel of disparity at the paper's 10.5 px m.
CELL_SIGMA_RANGE = 0.25 / 10.5


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
    robot: NDArray[np.intp]
    xy: Float
    cells: Cells
    stamps_ns: tuple[int, ...]

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.xy)


def map_from_robot(points: Float, pose: Pose) -> Float:
    """Turns points by a robot's heading and moves them by its position (eq. 6).

    Args:
        points: x, y in the robot's base_link [m], shape (n, 2).
        pose: The robot's pose in the common frame.

    Returns:
        x, y in the common frame [m], shape (n, 2).
    """
    return points @ rotation_2d(pose.yaw).T + (pose.x, pose.y)


def fuse(scans: Sequence[Scan], poses: Mapping[str, Pose]) -> ShortTermMap:
    """Puts the scans on one map: K = [W]a | [W]b | [W]c.

    Args:
        scans: One per robot.
        poses: By robot, its pose in the common frame at its scan's stamp.
    """
    parts = [
        map_from_robot(
            np.stack([scan.cells.x, scan.cells.y], axis=1).astype(np.float64), poses[scan.robot]
        )
        for scan in scans
    ]
    return ShortTermMap(
        robots=tuple(scan.robot for scan in scans),
        robot=np.repeat(np.arange(len(scans)), [len(scan.cells) for scan in scans]),
        xy=np.concatenate([np.empty((0, 2)), *parts]),
        cells=Cells.concatenate([scan.cells for scan in scans]),
        stamps_ns=tuple(scan.stamp_ns for scan in scans),
    )


def sights(vectors: Float) -> Float:
    """Vectors of length 1 in the same directions; (1, 0) where there is none, shape (n, 2)."""
    length = np.hypot(vectors[:, 0], vectors[:, 1])[:, np.newaxis]
    ahead = np.zeros_like(vectors)
    ahead[:, 0] = 1.0
    return np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), ahead)


def covariance_of_places(
    xy: Float,
    robot: NDArray[np.intp],
    poses: Sequence[Pose],
    *,
    along: Float,
    across: Float,
) -> Float:
    """Covariance of places that robots saw: of what they measured, and of their poses.

    Args:
        xy: Places in the common frame [m], shape (n, 2).
        robot: Which of the poses each was seen from, shape (n,).
        poses: Poses of robots.
        along: Variance along the line of sight [m^2], shape (n,).
        across: Variance across it [m^2], shape (n,).

    Returns:
        In the common frame [m^2], shape (n, 2, 2); NaN or infinite where a pose's is too large.
    """
    origin, of_poses = stack(poses)
    sight = sights(xy - origin[robot])
    outer = sight[:, :, np.newaxis] * sight[:, np.newaxis]
    covariance = across[:, np.newaxis, np.newaxis] * (np.eye(2) - outer)
    covariance += along[:, np.newaxis, np.newaxis] * outer
    return covariance + pose_effect(origin[robot], of_poses[robot], xy)
