"""People on a guided tour, and the robots that guide them, as they are at one time.

Nothing is rendered and nobody estimates anything here; robots obey velocity commands.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from string import ascii_lowercase

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.errors import ConfigError, TourError
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.guiding.tour import Tour, tour_of
from mrs_people_sim.layouts import expand
from mrs_people_sim.models.rooms import SIZES, floor_plan
from mrs_people_sim.motion import Place
from mrs_people_sim.scene import Person, Scene, load_scene
from mrs_people_sim.sensors.wheels import Wheels
from mrs_people_sim.tours import walls_of
from mrs_people_sim.walking.bystanders import Bystanders
from mrs_people_sim.walking.crowd import Crowd
from mrs_people_sim.walking.crowd_ground import Clearance
from mrs_people_sim.walking.stragglers import Straggling

#: Step of a guided world [s].
STEP_S = 0.05
#: Radius of a robot [m].
RADIUS = 0.22
#: What is taller hides people [m].
_TALL = 1.4
#: A robot that is so near to the axis of a person touches them [m].
_TOUCH = 0.40
#: A robot that touches something again within this time has not left it [s].
_AGAIN_S = 1.0
#: Robots that a scene does not have stand so far behind its last one [m].
_BEHIND = 0.9
#: Stragglers stop between these shares of the tour.
_STOPS = 0.2, 0.75


def guided_scene(
    path: str | Path, seed: int, *, people: int | None = None, robots: int | None = None
) -> Scene:
    """Reads the scene of a guided tour, everybody in their place: bystanders are the last people.

    Args:
        path: The scene file.
        seed: Of everything that is left to chance, in place of the scene's.
        people: How many are guided; None: as in the scene.
        robots: How many guide them: the first ones of the scene, and others behind its last one;
            None: as in the scene.

    Raises:
        ConfigError: It is no scene with a tour, people and robots.
    """
    scene = load_scene(path, seed=seed)
    if people is not None:
        layout = dataclasses.replace(scene.layout, people=people)
        scene = dataclasses.replace(scene, layout=layout)
    scene = expand(scene)
    for what, there in (
        ("tour", scene.tour), ("robots", scene.robots), ("people", scene.people),
    ):  # fmt: skip
        if not there:
            raise ConfigError(f"{path}: has no {what}; wanted: tour, robots, people")
    others = tuple(Person(x=one.path[0], y=one.path[1]) for one in scene.bystanders)
    scene = dataclasses.replace(scene, people=scene.people + others)
    return scene if robots is None else _with_robots(scene, robots)


def _with_robots(scene: Scene, count: int) -> Scene:
    """The scene with so many robots; those that it does not have are as its last one."""
    robots = dict(list(scene.robots.items())[:count])
    last = list(scene.robots)[-1]
    heads, sonars = dict(scene.heads), dict(scene.sonars)
    for number in range(len(robots), count):
        name, ahead = f"robot_{ascii_lowercase[number]}", list(robots.values())[-1]
        robots[name] = dataclasses.replace(
            ahead,
            x=ahead.x - _BEHIND * math.cos(ahead.yaw),
            y=ahead.y - _BEHIND * math.sin(ahead.yaw),
        )
        heads[name], sonars[name] = scene.heads[last], scene.sonars.get(last, ())
    return dataclasses.replace(scene, robots=robots, heads=heads, sonars=sonars)


class GuidedWorld:
    """A guided tour in a room.

    Args:
        scene: The scene, see `guided_scene`.

    Attributes:
        scene: The scene.
        tour: Where the team guides people.
        plan: The room's floor plan.
        walls: Both ends of its walls [m], free space to the left of each, shape (m, 2, 2).
        solid: Both ends of the sides of all that hides people [m], shape (k, 2, 2).
        names: Of the robots.
        wheels: By robot.
        crowd: The people.
        leader: Name of the robot that people follow; "": none, they stand.
        time: Since the start [s].
        bumps: How often a robot has run into a wall, a person or another robot.

    Raises:
        ConfigError: The scene's tour is none.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        try:
            self.tour: Tour = tour_of(scene.tour, scene.name)
        except TourError as err:
            raise ConfigError(f"{scene.name}: tour: {err}") from err
        self.plan = floor_plan(scene.room, scene.furniture)
        self.walls = walls_of(scene)
        self.solid = np.concatenate([self.walls, _sides_of(scene)])
        self.names = list(scene.robots)
        self.wheels = {
            name: Wheels(
                (robot.x, robot.y, robot.yaw), scene.odometry,
                np.random.default_rng([scene.seed, 5, k]), robot,
            )
            for k, (name, robot) in enumerate(scene.robots.items())
        }  # fmt: skip
        self._clearance = Clearance(self.plan)
        guided = len(scene.people) - len(scene.bystanders)
        spots = np.array([(person.x, person.y) for person in scene.people[:guided]])
        self.crowd = Crowd(
            spots, self._clearance, scene.seed, self._stragglers(guided),
            bystanders=Bystanders(scene.bystanders),
        )  # fmt: skip
        self.crowd.yaw = np.array([person.yaw for person in scene.people])
        self.leader, self.time, self.bumps = "", 0.0, 0
        self._bumped: dict[str, float] = {}

    def _stragglers(self, count: int) -> tuple[Straggling, ...]:
        """Who stays behind or leaves, and where: evenly along it, by chance within each part."""
        followers = self.scene.followers
        rng = np.random.default_rng([self.scene.seed, 92])
        number = min(followers.stragglers + followers.leavers, count)
        who = rng.permutation(count)[:number]
        shares = _STOPS[0] + (_STOPS[1] - _STOPS[0]) * (
            np.arange(number) + rng.uniform(0.0, 1.0, number)
        ) / max(number, 1)
        return tuple(
            Straggling(
                int(person),
                float(share * self.tour.way.length),
                followers.stay,
                leaves=k >= followers.stragglers,
            )
            for k, (person, share) in enumerate(zip(who, shares, strict=True))
        )

    @property
    def looks_back(self) -> tuple[str, ...]:
        """Names of the robots whose heads look back over base_link."""
        heads = self.scene.heads
        return tuple(name for name in self.names if math.cos(heads[name].yaw) < 0.0)

    @property
    def people(self) -> list[Place]:
        """Where the people are; their speed and way are those of their gait."""
        crowd = self.crowd
        speeds = np.linalg.norm(crowd.velocity, axis=1)
        return [
            Place(float(x), float(y), float(yaw), float(speed), float(way))
            for (x, y), yaw, speed, way in zip(
                crowd.xy, crowd.yaw, speeds, crowd.walked, strict=True
            )
        ]

    @property
    def groups(self) -> Int:
        """Number of each person's group, shape (people,): 1; 0: a bystander, who has none."""
        return np.asarray(np.arange(len(self.crowd.xy)) < self.crowd.guided, dtype=np.intp)

    def poses(self) -> Float:
        """The robots' true x, y [m] and yaw [rad], in the order of `names`, shape (m, 3)."""
        return np.array([self.wheels[name].pose for name in self.names])

    def step(self, dt: float = STEP_S) -> None:
        """Everybody goes on.

        Args:
            dt: For so long [s], 0.02 to 0.05.
        """
        for name in self.names:
            self._drive(name, dt)
        velocities = np.array([self.wheels[name].velocity for name in self.names])
        leader = self.names.index(self.leader) if self.leader in self.names else None
        self.crowd.step(dt, self.poses()[:, :2], velocities, leader)
        self.time += dt

    def _drive(self, name: str, dt: float) -> None:
        """A robot drives on, unless something solid is in its way."""
        wheels = self.wheels[name]
        before = wheels.pose[:2].copy()
        wheels.step(dt)
        others = [self.wheels[other].pose[:2] for other in self.names if other != name]
        solid = np.concatenate([np.array(others).reshape(-1, 2), self.crowd.xy])
        least = np.array([2 * RADIUS] * len(others) + [_TOUCH] * len(self.crowd.xy))
        was, now = (np.linalg.norm(solid - at, axis=1) for at in (before, wheels.pose[:2]))
        walls = self._clearance.at(np.stack([before, wheels.pose[:2]]))[0]
        if ((now < least) & (now < was)).any() or walls[1] < min(RADIUS, walls[0]):
            # One bump, however often it tries again.
            self.bumps += self.time - self._bumped.get(name, -math.inf) > _AGAIN_S
            self._bumped[name] = self.time
            wheels.block(before)


def _sides_of(scene: Scene) -> Float:
    """Both ends of the sides of furniture that is as tall as people [m], shape (k, 2, 2)."""
    sides = []
    for piece in scene.furniture:
        dx, dy, dz = piece.size or SIZES[piece.kind]
        if piece.kind != "wall" and piece.z + dz > _TALL:
            corners = 0.5 * np.array([[-dx, -dy], [dx, -dy], [dx, dy], [-dx, dy]])
            corners = corners @ rotation_2d(piece.yaw).T + [piece.x, piece.y]
            sides += [*zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return np.array(sides).reshape(-1, 2, 2)
