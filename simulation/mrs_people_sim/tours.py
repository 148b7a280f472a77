"""Tours without rendering: where a group, its team and the walls are, in a moment.

The scene files are those of `mrs simulate`: the way of the group, the posts of the team, walls and
the errors of odometry. Nobody evades anybody, people and robots wander about their places in the
formation; what robots see of walls and people is in `sensing`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from mrs_people_loc.errors import ConfigError
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.localization.walls import Walls
from mrs_people_sim.layouts import expand
from mrs_people_sim.scene import Robot, Scene
from mrs_people_sim.sensors.odometry import dead_reckoned, seen_steps, step_sigmas
from mrs_people_sim.walking.walks import Boxes, way_of

Rng = np.random.Generator

#: Time between samples of a tour [s].
STEP_S = 0.05
#: Pieces of walls are looked for in such steps [m]; shorter ones are left out.
_GRAIN, _SHORTEST = 0.05, 0.3
#: A robot that was turned looks at the group again after this time [s].
_TURNS_BACK_S = 5.0
#: Positions are smoothed over so many samples: the way has corners of centimetres.
_SMOOTH = 13


@dataclass(frozen=True)
class Tour:
    """Where everybody is.

    Attributes:
        times: From 0 on, every `STEP_S` [s], shape (n,).
        robots: By name, true x, y [m] and yaw [rad] in the map, shape (n, 3).
        odometry: By name, what its odometry says, in a frame of its own, shape (n, 3).
        people: Positions in the map [m], shape (n, people, 2).
        walls: Both ends of the walls [m], shape (m, 2, 2); the free space is to the left of each.
        start: By name, where odometry's frame is in the map as far as is known, shape (3,).
        scene: The scene, expanded.
    """

    times: NDArray
    robots: dict[str, NDArray]
    odometry: dict[str, NDArray]
    people: NDArray
    walls: NDArray
    start: dict[str, NDArray]
    scene: Scene


def tour_of(scene: Scene, seed: int) -> Tour:
    """A tour through a scene with a walking group.

    Args:
        scene: The scene, its layout not expanded.
        seed: Of everything that is left to chance, in place of the scene's.

    Raises:
        ConfigError: Nobody walks, or robots have no post.
    """
    rng = np.random.default_rng([seed, 31])
    way, walls = way_of(scene), walls_of(scene)
    expanded = expand(dataclasses.replace(scene, seed=seed))
    posts = expanded.robots
    if not (posts and expanded.people and all(robot.post for robot in posts.values())):
        raise ConfigError(
            f"{scene.name}: {len(expanded.people)} people, robots with a post: "
            f"{', '.join(name for name, r in posts.items() if r.post) or 'none'}; wanted: people, "
            "such as layout: {people: 5, activity: group}, and robots that have a post each"
        )
    lead = max(robot.post[0] for robot in posts.values())
    spots = np.array([(person.x, person.y) for person in expanded.people])
    along = way.nearest(spots)
    first, last = float(along.mean()), way.length - lead - 0.5
    duration = (scene.timing.frames - 1) / scene.timing.rate
    times = np.arange(0.0, duration, STEP_S)
    pace = scene.walk.speed * (1.0 + 0.15 * _wander(times, 15.0, rng))
    middle = first + np.cumsum(np.maximum(pace, 0.0)) * STEP_S
    going = middle < last
    times, middle = times[going], middle[going]
    ahead = way.ahead(along)
    offset = ((spots - way.at(along)) * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)).sum(axis=1)
    people = np.stack(
        [
            _places(way, middle + a - first, o, scene.walk.wander * 0.15, times, rng)
            for a, o in zip(along, offset, strict=True)
        ],
        axis=1,
    )
    robots = {name: _robot(way, middle, robot, people, times, rng) for name, robot in posts.items()}
    settings = scene.odometry
    odometry, start = {}, {}
    for name, truth in robots.items():
        steps = seen_steps(times, truth, posts[name], rng)
        noise = step_sigmas(steps, settings) * rng.normal(size=steps.shape)
        odometry[name] = dead_reckoned(steps + noise)
        sigmas = [settings.sigma, settings.sigma, settings.sigma_yaw]
        start[name] = truth[0] + rng.normal(size=3) * sigmas
    return Tour(times, robots, odometry, people, walls, start, expanded)


def _wander(times: NDArray, period: float, rng: Rng) -> NDArray:
    """A number of mean 0 and deviation 1 that changes slowly [period in s], shape (n,)."""
    rate = 2 * math.pi / (period * rng.uniform(0.6, 2.0, 4))
    phase = rng.uniform(0, 2 * math.pi, 4)
    found: NDArray = np.sin(rate * times[:, None] + phase).sum(axis=1) / math.sqrt(2.0)
    return found


def _places(
    way: Way, along: NDArray, left: float, wander: float, times: NDArray, rng: Rng
) -> NDArray:
    """Places about one that goes along a way, shape (n, 2)."""
    along = along + wander * _wander(times, 12.0, rng)
    aside = left + 0.6 * wander * _wander(times, 12.0, rng)
    return np.asarray(uniform_filter1d(way.at(along, aside), _SMOOTH, axis=0, mode="nearest"))


def _robot(
    way: Way, middle: NDArray, robot: Robot, people: NDArray, times: NDArray, rng: Rng
) -> NDArray:
    """A robot on its post that looks at the group, more or less, shape (n, 3).

    One that is turned while it is carried turns back to the group.
    """
    ahead, left = robot.post
    places = _places(way, middle + ahead, left, 0.08, times, rng)
    x, y = (people.mean(axis=1) - places).T
    yaw = np.unwrap(np.arctan2(y, x)) + 0.06 * _wander(times, 6.0, rng)
    if robot.carried:
        time, forth, aside, turn = robot.carried
        later = times > time
        cos, sin = np.cos(yaw[later]), np.sin(yaw[later])
        places[later] += np.stack([cos * forth - sin * aside, sin * forth + cos * aside], axis=1)
        yaw = yaw + turn * later * np.clip(1.0 - (times - time) / _TURNS_BACK_S, 0.0, 1.0)
    return np.column_stack([places, yaw])


# ------------------------------------------------------------------------------------------ walls


def walls_of(scene: Scene) -> NDArray:
    """The walls of a scene's room, and those that stand in it, where free space is before them.

    Returns:
        Both ends of each [m], free space to the left, shape (m, 2, 2).
    """
    length, width = scene.room.length, scene.room.width
    corners = np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])
    sides = [*zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    pieces = [piece for piece in scene.furniture if piece.kind == "wall"]
    for piece in pieces:
        half = 0.5 * np.array((piece.size or (0.2, 3.0))[:2])
        cos, sin = math.cos(piece.yaw), math.sin(piece.yaw)
        around = half * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
        box = around @ np.array([[cos, sin], [-sin, cos]]) + [piece.x, piece.y]
        sides += [*zip(box, np.roll(box, -1, axis=0), strict=True)]
    solid = Boxes(dataclasses.replace(scene, furniture=tuple(pieces)))
    found = [part for side in sides for part in _free_parts(np.array(side), solid)]
    return np.array(found).reshape(-1, 2, 2)


def _free_parts(side: NDArray, solid: Boxes) -> list[NDArray]:
    """The parts of a side that have free space to their left."""
    span = side[1] - side[0]
    length = float(np.hypot(*span))
    ahead = span / length
    edges = np.linspace(0.0, length, max(2, math.ceil(length / _GRAIN) + 1))
    middles = 0.5 * (edges[1:] + edges[:-1])
    places = side[0] + middles[:, None] * ahead + 0.02 * np.array([-ahead[1], ahead[0]])
    free = np.concatenate([[False], (solid.clearances(places)[0] > 0.0).all(axis=1), [False]])
    begins, ends = np.flatnonzero(~free[:-1] & free[1:]), np.flatnonzero(free[:-1] & ~free[1:])
    return [
        side[0] + edges[[begin, end], None] * ahead
        for begin, end in zip(begins, ends, strict=True)
        if edges[end] - edges[begin] >= _SHORTEST
    ]


def known_walls(segments: NDArray, sigma: tuple[float, float]) -> Walls:
    """The walls as a map would state them.

    Args:
        segments: Both ends of each [m], shape (m, 2, 2).
        sigma: Standard deviations of distance [m] and bearing [rad].
    """
    span = segments[:, 1] - segments[:, 0]
    ahead = span / np.hypot(span[:, 0], span[:, 1])[:, None]
    normal = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    distance = (segments[:, 0] * normal).sum(axis=1)
    sign = np.where(distance < 0, -1.0, 1.0)
    normal = normal * sign[:, None]
    along = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    extent = np.sort((segments * along[:, None]).sum(axis=2), axis=1)
    return Walls(
        distance=np.abs(distance),
        bearing=np.arctan2(normal[:, 1], normal[:, 0]),
        covariance=np.tile(np.diag(np.square(sigma)), (len(segments), 1, 1)),
        extent=extent,
        is_end=np.ones((len(segments), 2), dtype=bool),
    )
