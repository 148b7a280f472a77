"""The common map: cells and bodies of all robots, and how sure their places are (eq. 6)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrs_people_loc.config import Joining
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose
from oracle.arrays import Float
from oracle.numbers import LARGEST_SIGMA_M, LEAST_SIGMA_M

XY = tuple[float, float]


def in_order(scans: Sequence[Scan]) -> list[Scan]:
    """Scans by the names of their robots."""
    return sorted(scans, key=lambda scan: scan.robot)


def placed_of(
    scans: Sequence[Scan], poses: Mapping[str, Pose], time_ns: int, walking_speed: float
) -> dict[str, Pose]:
    """The poses, less sure by what people walk between a scan and the interval."""
    placed = {}
    for scan in scans:
        pose = poses[scan.robot]
        walked = walking_speed * (time_ns - scan.stamp_ns) / 1e9
        covariance = pose.covariance.copy()
        covariance[0, 0] += walked**2
        covariance[1, 1] += walked**2
        placed[scan.robot] = replace(pose, covariance=covariance)
    return placed


def fused_of(scans: Sequence[Scan], poses: Mapping[str, Pose]) -> list[XY]:
    """Eq. 6: every cell turned by its robot's heading and moved by its position."""
    places = []
    for scan in in_order(scans):
        pose = poses[scan.robot]
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        for x, y in zip(scan.cells.x.tolist(), scan.cells.y.tolist(), strict=True):
            places.append((cos * x - sin * y + pose.x, sin * x + cos * y + pose.y))
    return places


@dataclass(frozen=True)
class Seen:
    """A body on the map, as one robot sees it.

    Attributes:
        robot: That robot.
        cells: Its cells on the map.
        xy: Its place [m].
        covariance: Of the place [m^2].
        score: Log-odds that it is a person.
    """

    robot: str
    cells: tuple[int, ...]
    xy: Float
    covariance: Float
    score: float


def of_pose(pose: Pose, xy: Float) -> Float:
    """Covariance that a pose's makes at a place [m^2]: the robot turns about its own position."""
    lever = np.array([[1.0, 0.0, pose.y - xy[1]], [0.0, 1.0, xy[0] - pose.x]])
    return np.asarray(lever @ pose.covariance @ lever.T)


def covariance_seen(pose: Pose, xy: Float, along: float, across: float) -> Float:
    """Covariance of a place that was seen from a pose, of variances along and across the sight."""
    angle = math.atan2(xy[1] - pose.y, xy[0] - pose.x)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(turn @ np.diag([along, across]) @ turn.T + of_pose(pose, xy))


def bodies_seen(fused: ShortTermMap, placed: Mapping[str, Pose], config: Joining) -> list[Seen]:
    """The bodies on a map, by robot and number: each is where its cells' centre of gravity is."""
    cells_of: dict[tuple[int, int], list[int]] = {}
    for i in range(len(fused.xy)):
        if fused.cells.body[i]:
            key = int(fused.robot[i]), int(fused.cells.body[i])
            cells_of.setdefault(key, []).append(i)
    seen = []
    for (robot, _), inside in sorted(cells_of.items()):
        pose, first = placed[fused.robots[robot]], inside[0]
        weights = [max(float(fused.cells.count[i]), 1.0) for i in inside]
        xy = sum(w * fused.xy[i] for w, i in zip(weights, inside, strict=True)) / sum(weights)
        along, across = (
            min(max(float(sigma[first]), LEAST_SIGMA_M), LARGEST_SIGMA_M) ** 2
            for sigma in (fused.cells.sigma_range, fused.cells.sigma_across)
        )
        if not config.line_of_sight:
            along = across = math.sqrt(along * across)
        covariance = _bounded(covariance_seen(pose, xy, along, across))
        score = float(fused.cells.score[first])
        seen.append(Seen(fused.robots[robot], tuple(inside), np.array(xy), covariance, score))
    return seen


def _bounded(covariance: Float) -> Float:
    """A covariance with no axis shorter or longer than what counts."""
    values, vectors = np.linalg.eigh(covariance)
    within = [min(max(value, LEAST_SIGMA_M**2), LARGEST_SIGMA_M**2) for value in values]
    return np.asarray(vectors @ np.diag(within) @ vectors.T)
