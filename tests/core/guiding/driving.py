"""Robots with wheels, and people who walk, for the tests of driving."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.config import GuideConfig
from mrs_people_loc.guiding.drive import Drive, Situation
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Post, Role
from mrs_people_loc.team.poses import Pose

DT = 0.05
CONFIG = GuideConfig()


def post(x: float, y: float, yaw: float = 0.0, speed: float = 0.6) -> Post:
    return Post(Role.REAR, np.array([x, y]), yaw, speed)


def standing(xy: np.ndarray) -> Callable[[float], np.ndarray]:
    """People who stand."""
    return lambda _: xy


@dataclass
class Robot:
    """Drives as it is told, within the limits of its base."""

    x: float
    y: float
    yaw: float
    post: Post | None
    config: GuideConfig = CONFIG
    v: float = 0.0
    w: float = 0.0
    path: np.ndarray | None = None
    log: list = field(default_factory=list)

    def __post_init__(self) -> None:
        self.drive = Drive()

    @property
    def xy(self) -> np.ndarray:
        return np.array([self.x, self.y])

    @property
    def velocity(self) -> np.ndarray:
        return self.v * np.array([math.cos(self.yaw), math.sin(self.yaw)])

    def move(self, v: float, w: float) -> None:
        base = self.config.base
        slower = abs(v) < abs(self.v) or v * self.v < 0
        assert abs(v - self.v) <= (base.deceleration if slower else base.acceleration) * DT + 1e-9
        assert abs(w - self.w) <= base.turn_acceleration * DT + 1e-9
        assert -base.max_reverse - 1e-9 <= v <= base.max_speed + 1e-9
        assert abs(w) <= base.max_turn + 1e-9
        self.v, self.w = v, w
        middle = self.yaw + 0.5 * w * DT
        self.x += v * DT * math.cos(middle)
        self.y += v * DT * math.sin(middle)
        self.yaw += w * DT
        self.log.append((self.x, self.y, self.yaw, v, w))

    @property
    def track(self) -> np.ndarray:
        return np.array(self.log)


@dataclass
class World:
    """Robots among people.

    Attributes:
        people: Where they are, by time: shape (n, 2).
        age: Of what robots know about people [s].
        sigma: ... and its error [m].
        closest: Least distance of a robot to a person towards whom it moved by more than 0.05 m/s.
        bumped: Who has walked into a robot, and is still there: they count no more.
    """

    robots: list[Robot]
    people: Callable[[float], object] | None = None
    space: FreeSpace = field(default_factory=FreeSpace.unbounded)
    age: float = 0.0
    sigma: float = 0.0
    stands_within: float = math.inf
    seed: int = 0
    time: float = 0.0
    closest: float = math.inf
    closest_robots: float = math.inf
    least_clearance: float = math.inf
    bumped: set = field(default_factory=set)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    def people_at(self, time: float) -> np.ndarray:
        return np.zeros((0, 2)) if self.people is None else np.asarray(self.people(time))

    def run(self, seconds: float, plan: bool = False) -> None:
        for step in range(round(seconds / DT)):
            if step % 4 == 0:  # people are found at 5 Hz
                then = self.time - self.age
                seen = self.people_at(then)
                velocity = (seen - self.people_at(then - 0.2)) / 0.2
                self.seen = seen + self.rng.normal(0.0, 1.0, seen.shape) * self.sigma
                self.seen_velocity = velocity + self.rng.normal(0.0, 1.0, seen.shape) * self.sigma
                self.since = 0.0
            if plan and step % 10 == 0:
                self.plan()
            self.step()

    def plan(self) -> None:
        for robot in self.robots:
            if robot.post is not None:
                others = [r.xy for r in self.robots if r is not robot]
                discs = [(*p, 0.8) for p in self.seen] + [(*p, 0.7) for p in others]
                robot.path = self.space.path(
                    robot.xy, robot.post.xy, 0.35, np.array(discs).reshape(-1, 3)
                )

    def step(self) -> None:
        commands = []
        for robot in self.robots:
            others = [r for r in self.robots if r is not robot]
            commands.append(
                robot.drive.step(
                    Situation(
                        robot.config,
                        Pose(0, robot.x, robot.y, robot.yaw), (robot.v, robot.w), robot.post,
                        people=self.seen, people_velocity=self.seen_velocity,
                        people_age=self.age + self.since,
                        robots=np.array([r.xy for r in others]).reshape(-1, 2),
                        robots_velocity=np.array([r.velocity for r in others]).reshape(-1, 2),
                        space=self.space, path=robot.path, dt=DT,
                        stands_within=self.stands_within,
                    )
                )
            )  # fmt: skip
        for robot, command in zip(self.robots, commands, strict=True):
            robot.move(*command)
        self.time, self.since = self.time + DT, self.since + DT
        self.measure()

    def measure(self) -> None:
        people = self.people_at(self.time)
        for robot in self.robots:
            self.least_clearance = min(self.least_clearance, float(self.space.clearance(robot.xy)))
            for number, where in enumerate(people):
                away = float(np.linalg.norm(where - robot.xy))
                if away > 0.6:
                    self.bumped.discard(number)
                if robot.velocity @ (where - robot.xy) > 0.05 * away:
                    if number not in self.bumped:
                        self.closest = min(self.closest, away)
                elif away < 0.35:
                    self.bumped.add(number)
            for other in self.robots:
                if other is not robot:
                    apart = float(np.linalg.norm(other.xy - robot.xy))
                    self.closest_robots = min(self.closest_robots, apart)
