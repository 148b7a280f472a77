"""What finding walls costs, in drawn disparities of a head and in drawn laser scans."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.arrays import Float
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.localization.walls.laser import walls_of_laser
from mrs_people_loc.localization.walls.stereo import StereoWalls
from mrs_people_loc.team.poses import Pose
from mrs_studies.bench.samples import Samples, blocks
from mrs_studies.bench.scenes import CAMERA, drawn_disparity

#: A small room and where people stand in it [m]; a robot looks from its middle all around.
_ROOM, _PEOPLE = (4.5, 3.6), [(0.9, 0.8), (3.4, 2.9), (1.2, 2.6)]
_VIEWS = 12
#: Rays of a laser scanner, all around, and the standard deviation of a range [m].
_RAYS, _SIGMA = 720, 0.01


def time_walls(count: int) -> list[dict[str, Any]]:
    """Times `StereoWalls` and `walls_of_laser`.

    Args:
        count: Views and scans to time.

    Returns:
        For each sensor: what it is, median and 99th percentile [ms], and walls found, on average.
    """
    poses = [Pose(0, 2.2, 1.8, 2.0 * math.pi * k / _VIEWS) for k in range(_VIEWS)]
    people = [_in_base_link(pose) for pose in poses]
    disparities = [drawn_disparity(pose, k, _PEOPLE, _ROOM) for k, pose in enumerate(poses)]
    stereo = StereoWalls(CAMERA)
    angles = np.linspace(-math.pi, math.pi, _RAYS, endpoint=False)
    scans = [_scan(pose, angles, k) for k, pose in enumerate(poses)]

    def of_head(k: int) -> Walls:
        return stereo.step(disparities[k], 0, people[k]).walls

    def of_laser(k: int) -> Walls:
        return walls_of_laser(
            scans[k], angles, sigma=_SIGMA, max_range=12.0, mounting=(0.0, 0.0, 0.0),
            bodies=people[k],
        )  # fmt: skip

    return [
        _timed(f"stereo head, {CAMERA.width}x{CAMERA.height}", of_head, count),
        _timed(f"laser, {_RAYS} rays", of_laser, count),
    ]


def _timed(sensor: str, find: Callable[[int], Walls], count: int) -> dict[str, Any]:
    sample, walls = Samples(), []
    for turns in blocks(count):
        for turn, counts in turns:
            began = timing.now_ns()
            found = find(turn % _VIEWS)
            took = (timing.now_ns() - began) / 1e6
            if counts:
                sample.add({"walls": took})
                walls.append(len(found))
    return {"sensor": sensor, "found": float(np.mean(walls)), **sample.report()["walls"]}


def _in_base_link(pose: Pose) -> Float:
    """The people, as `walls.NOBODY`."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    offset = np.array(_PEOPLE) - (pose.x, pose.y)
    return np.column_stack([offset @ np.array([[cos, -sin], [sin, cos]]), np.zeros(len(offset))])


def _scan(pose: Pose, angles: Float, seed: int) -> Float:
    """Ranges to the walls of the room [m]."""
    rng = np.random.default_rng(seed)
    ray = np.stack([np.cos(angles + pose.yaw), np.sin(angles + pose.yaw)], axis=1)
    here = np.array([pose.x, pose.y])
    with np.errstate(divide="ignore"):
        away = np.maximum(-here / ray, (np.array(_ROOM) - here) / ray).min(axis=1)
    return np.asarray(away + rng.normal(0.0, _SIGMA, len(angles)))
