"""What `mrs bench` runs the planner on: drawn rooms, and floors with as many teams as one likes.

A room is 8 x 7 m, with a robot in each corner that looks to the middle, and two rows of five
people. Bodies and walls are upright; no texture, no matching: the disparity is that of the true
depth, with noise, in sixteenths of a pixel. Without texture and shape nobody is a person for the
fitted model: where bodies are sought, the scans are made of bodies instead.

A floor is such rooms in rows: area and people grow with the robots, as they do in a building. They
lie apart (`in_rooms`), or there is nothing between them (`on_one_floor`): then each robot also sees
whom it can of the rooms around, and at all borders people and robots are near each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.robot import RobotPipeline
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.poses import Pose

#: Scans of one interval, and the robots' poses by name.
Scene = tuple[list[Scan], dict[str, Pose]]

#: Time between intervals, for people who are followed [ns].
INTERVAL_NS = 100_000_000
ROOM = (8.0, 7.0)
ROBOTS = {
    "robot_a": (1.2, 1.2, 0.72),
    "robot_b": (6.8, 1.2, math.pi - 0.72),
    "robot_c": (1.2, 5.8, -0.72),
    "robot_d": (6.8, 5.8, math.pi + 0.72),
}
PEOPLE = [(x, y) for y in (2.8, 4.2) for x in (2.2, 3.1, 4.0, 4.9, 5.8)]
#: Rooms of a floor stand in rows of so many, and where they lie apart, so far [m].
_ROW, _APART_M = 4, 6.0
#: On one floor each robot is turned by so much more [rad]: the golden angle, so none look alike.
_TURN = 2.4
_BODY_RADIUS_M, _BODY_HEIGHT_M = 0.2, 1.7
_NOISE_PX, _MISSING = 0.1, 0.15
#: Bodies in a scan, and how far they are sought [m]: as the defaults have it.
_MOST_BODIES, _RANGE_M = 16, 6.0
_COVARIANCE = np.diag([0.02**2, 0.02**2, 0.01**2])
CAMERA = StereoCamera(width=160, height=120, fx=105.46, fy=105.46, cx=79.5, cy=59.5, baseline=0.10)


def drawn_disparity(
    pose: Pose, seed: int, people: Sequence[tuple[float, float]], size: tuple[float, float]
) -> Float32:
    """What a robot would match [px], NaN where it would not.

    Args:
        pose: The robot's pose.
        seed: Of the noise.
        people: Where people stand [m].
        size: Of the room, from (0, 0) on [m].
    """
    camera, rng = CAMERA, np.random.default_rng(seed)
    left = -(np.arange(camera.width) - camera.cx) / camera.fx  # per metre ahead, per column
    up = -(np.arange(camera.height) - camera.cy)[:, np.newaxis] / camera.fy
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    ray = np.stack([cos - sin * left, sin + cos * left])  # in the map, per metre of depth
    start = np.array([pose.x, pose.y])
    with np.errstate(divide="ignore"):
        walls = np.maximum(-start[:, np.newaxis] / ray, (np.array(size) - start)[:, None] / ray)
    depth = np.broadcast_to(walls.min(axis=0), (camera.height, camera.width))
    for person in people:
        # |start + depth * ray - person| = radius
        away = start - person
        a, b = (ray**2).sum(axis=0), away @ ray
        inside = b**2 - a * (away @ away - _BODY_RADIUS_M**2)
        body = (-b - np.sqrt(np.where(inside >= 0, inside, np.nan))) / a
        height = camera.mounting.height + up * body
        hit = (body > 0) & (height >= 0) & (height <= _BODY_HEIGHT_M)
        depth = np.where(hit, np.fmin(depth, body), depth)
    disparity = camera.depth_disparity / depth + rng.normal(0.0, _NOISE_PX, depth.shape)
    disparity = np.round(disparity * 16.0) / 16.0
    disparity[rng.random(depth.shape) < _MISSING] = np.nan
    return np.asarray(disparity, dtype=np.float32)


def drawn_scans(config: RobotConfig, seed: int) -> Scene:
    """The scans of one room, and the robots' poses.

    By the real filters; where bodies are sought, made of bodies (`_made_bodies`).
    """
    poses = {robot: Pose(0, *place, _COVARIANCE) for robot, place in ROBOTS.items()}
    return _scans(config, seed, poses, PEOPLE, ROOM), poses


def in_rooms(config: RobotConfig, robots: int, seed: int, noises: int) -> Scene:
    """Teams of four, each with ten people in a room of its own.

    Args:
        config: Of the robots.
        robots: How many.
        seed: Of the noise.
        noises: So many rooms differ in their noise.
    """
    drawn = [drawn_scans(config, seed * noises + noise)[0] for noise in range(noises)]
    poses = _poses(robots, _APART_M)
    scans = [
        replace(drawn[index // len(ROBOTS) % noises][index % len(ROBOTS)], robot=robot)
        for index, robot in enumerate(poses)
    ]
    return scans, poses


def on_one_floor(config: RobotConfig, robots: int, seed: int) -> Scene:
    """The same without anything between the rooms, and the robots look in all directions.

    Args:
        config: Of the robots.
        robots: How many.
        seed: Of the noise.
    """
    poses = {
        robot: replace(pose, yaw=wrap_angle(pose.yaw + index * _TURN))
        for index, (robot, pose) in enumerate(_poses(robots, 0.0).items())
    }
    corners = [_corner(room, 0.0) for room in range(math.ceil(robots / len(ROBOTS)))]
    people = [(x + dx, y + dy) for dx, dy in corners for x, y in PEOPLE]
    far_corner = (max(x for x, _ in corners) + ROOM[0], max(y for _, y in corners) + ROOM[1])
    return _scans(config, seed, poses, people, far_corner), poses


def people_of(robots: int) -> int:
    """How many people there are on a floor of so many robots."""
    return math.ceil(robots / len(ROBOTS)) * len(PEOPLE)


def _corner(room: int, apart: float) -> tuple[float, float]:
    """Where a room of a floor begins [m]."""
    row, place = divmod(room, _ROW)
    return place * (ROOM[0] + apart), row * (ROOM[1] + apart)


def _poses(robots: int, apart: float) -> dict[str, Pose]:
    """The robots of a floor, room by room."""
    poses = {}
    places = list(ROBOTS.values())
    for index in range(robots):
        room, corner = divmod(index, len(places))
        (dx, dy), (x, y, yaw) = _corner(room, apart), places[corner]
        poses[f"robot_{index:04}"] = Pose(0, x + dx, y + dy, yaw, _COVARIANCE)
    return poses


def _scans(
    config: RobotConfig,
    seed: int,
    poses: dict[str, Pose],
    people: Sequence[tuple[float, float]],
    size: tuple[float, float],
) -> list[Scan]:
    rng = np.random.default_rng(seed)
    blank = np.zeros((CAMERA.height, CAMERA.width), dtype=np.uint8)
    scans = []
    for index, (robot, pose) in enumerate(poses.items()):
        near = [p for p in people if math.dist(p, (pose.x, pose.y)) < _RANGE_M]
        if config.bodies.search:
            scans.append(Scan(robot, 0, _made_bodies(pose, rng, near)))
            continue
        pipeline = RobotPipeline(robot, CAMERA, config)
        disparity = drawn_disparity(pose, seed * len(poses) + index, near, size)
        pipeline.matcher = lambda _, drawn=disparity: drawn  # type: ignore[assignment]
        scans.append(pipeline.step(StereoImages(0, blank, blank)))
    return scans


def _made_bodies(
    pose: Pose, rng: np.random.Generator, people: Sequence[tuple[float, float]]
) -> Cells:
    """Cells as a robot sends them that sees everybody, and as many other things as it may send.

    That is the most that there can be: nobody is hidden, and no candidate is refused.
    """
    here = np.array([pose.x, pose.y])
    nearest = sorted(people, key=lambda p: math.dist(p, here))[:_MOST_BODIES]
    corner = np.floor(here / ROOM) * ROOM
    others = corner + rng.uniform((0.0, 0.0), ROOM, (_MOST_BODIES - len(nearest), 2))
    places = np.concatenate([np.reshape(nearest, (-1, 2)), others])
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    offset = places - here
    away = np.hypot(*offset.T)
    sigma_range = 0.03 + 0.01 * away**2
    along = 1.0 + rng.normal(0.0, 1.0, len(places)) * sigma_range / away
    x, y = (offset * along[:, np.newaxis] @ np.array([[cos, -sin], [sin, cos]])).T
    columns = np.linspace(-_BODY_RADIUS_M, _BODY_RADIUS_M, 9)
    body = np.repeat(np.arange(len(places)), len(columns))
    left, angle = np.tile(columns, len(places)), np.arctan2(y, x)[body]

    def each(values: Float) -> Float32:
        return values[body].astype(np.float32)

    size = np.ones(len(places))
    return Cells(
        x=(x[body] - left * np.sin(angle)).astype(np.float32),
        y=(y[body] + left * np.cos(angle)).astype(np.float32),
        z=each(1.6 * size),
        z_min=each(0.25 * size),
        top=each(_BODY_HEIGHT_M * size),
        count=np.full(len(body), 15, dtype=np.uint32),
        body=(body + 1).astype(np.uint32),
        score=each(np.where(np.arange(len(places)) < len(nearest), 3.0, -2.5)),
        sigma_range=each(sigma_range),
        sigma_across=each(0.04 * size),
    )
