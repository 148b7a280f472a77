"""What guiding costs: a group of ten follows three robots along corridors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.arrays import Float
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.guiding.drive import Velocity
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.tour import Tour, tour_from
from mrs_people_loc.people import Group, Person, gather
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose

#: Seconds that are timed, and before; steps of the drives per second, and of the guide.
_SECONDS, _BEFORE_S, _DRIVE_HZ, _GUIDE_HZ = 6, 2, 20, 5
#: Sides and resolution of the map, width of its corridor, which goes round inside [m].
_SIZE, _RESOLUTION, _CORRIDOR = 60.0, 0.05, 3.0
_PEOPLE, _SPEED = 10, 0.4
#: Robots and how far along the way they begin [m], the first one ahead of the group.
_ROBOTS = {"robot_a": 9.0, "robot_b": 2.0, "robot_c": 1.0}


class _TimedSpace(FreeSpace):
    """Free floor that adds up for how long paths were looked for [ns]."""

    took_ns = 0

    def path(self, *args: Any, **options: Any) -> Float | None:
        """As that of `FreeSpace`."""
        began = timing.now_ns()
        found = super().path(*args, **options)
        self.took_ns += timing.now_ns() - began
        return found


def time_guiding(on_step: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Times the guide and the drives, on the way round a corner.

    Args:
        on_step: Told what is done now.

    Returns:
        Numbers of `robots` and `people`, and medians [ms]: of a step of the guide (`guide_ms`), of
        the paths to its posts (`paths_ms`), and of a step of one robot's drive (`drive_ms`).
    """
    on_step(f"guiding {_PEOPLE} people")
    config = GuideConfig(robots=tuple(_ROBOTS), leader="robot_a")
    tour, grid = _tour(), _map()
    space = _TimedSpace(grid, occupied_from=config.safety.occupied_from, around=tour.points)
    guide = Guide(tour, config, space)
    poses = {name: _at(tour, along) for name, along in _ROBOTS.items()}
    took: dict[str, list[float]] = {"guide": [], "paths": [], "drive": []}
    for step in range((_BEFORE_S + _SECONDS) * _DRIVE_HZ):
        now_ns = 1_000_000_000 + step * 1_000_000_000 // _DRIVE_HZ
        if step == _BEFORE_S * _DRIVE_HZ:
            took = {what: [] for what in took}
        for name, pose in poses.items():
            guide.take_pose(name, replace(pose, stamp_ns=now_ns), now_ns)
        if step % (_DRIVE_HZ // _GUIDE_HZ) == 0:
            people, groups = _walking(tour, step / _DRIVE_HZ)
            space.took_ns, began = 0, timing.now_ns()
            guide.take_people(people, groups, now_ns, now_ns, config.robots)
            took["guide"].append((timing.now_ns() - began - space.took_ns) / 1e6)
            took["paths"].append(space.took_ns / 1e6)
        began = timing.now_ns()
        velocities = guide.velocities(now_ns)
        took["drive"].append((timing.now_ns() - began) / 1e6 / len(_ROBOTS))
        poses = {name: _moved(poses[name], velocities[name]) for name in poses}
    medians = {f"{what}_ms": float(np.median(ms)) for what, ms in took.items()}
    return {"robots": len(_ROBOTS), "people": _PEOPLE, **medians}


def _tour() -> Tour:
    low, high = 2.0 + _CORRIDOR / 2, _SIZE - 2.0 - _CORRIDOR / 2
    return tour_from([(low, 40.0), (low, high), (high, high), (high, low)])


def _map() -> OccupancyGrid:
    """Walls with a corridor that goes round."""
    cells = round(_SIZE / _RESOLUTION)
    data = np.full((cells, cells), 100, dtype=np.int8)
    outer, inner = (round(at / _RESOLUTION) for at in (2.0, 2.0 + _CORRIDOR))
    data[outer:-outer, outer:-outer] = 0
    data[inner:-inner, inner:-inner] = 100
    return OccupancyGrid(_RESOLUTION, 0.0, 0.0, 0.0, data)


def _at(tour: Tour, along: float) -> Pose:
    x, y = tour.way.at(along)
    ahead = tour.way.ahead(along)
    return Pose(0, float(x), float(y), math.atan2(ahead[1], ahead[0]))


def _walking(tour: Tour, time: float) -> tuple[list[Person], list[Group]]:
    """Ten who walk along the way two by two, and their group."""
    number = np.arange(_PEOPLE, dtype=np.float64)
    along = 3.5 + 0.35 * number + _SPEED * time
    left = 0.5 * (-1.0) ** number
    xy, velocity = tour.way.at(along, left), _SPEED * tour.way.ahead(along)
    people = [
        Person(
            position=xy[k], covariance=0.04**2 * np.eye(2), height=1.7, sigma=0.1,
            robots=("robot_a",), label=k, id=k + 1, velocity=velocity[k],
            velocity_covariance=0.1**2 * np.eye(2),
        )
        for k in range(_PEOPLE)
    ]  # fmt: skip
    group = gather(people)
    assert group is not None
    members = tuple(one.id for one in people)
    return people, [replace(group, id=1, members=members, velocity=velocity.mean(axis=0))]


def _moved(pose: Pose, velocity: Velocity) -> Pose:
    ahead, turn = velocity[0] / _DRIVE_HZ, velocity[1] / _DRIVE_HZ
    return pose @ Pose(0, ahead, 0.0, turn)
