"""Teams that drive past walls, as observations: no images, no ROS."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.config import Localization
from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.shared import RelativePose
from mrs_people_loc.localization.walls import SeenWalls, Walls
from mrs_people_loc.team.poses import Pose

START = (0.02, 0.02, 0.01)
#: Wheels without systematic errors, and known to be so.
CONFIG = Localization(start_sigmas=START, wheel_sigmas=(0.0, 0.0, 0.0))
#: Standard deviations of a wall's distance and bearing, and of a relative pose.
WALL_SIGMAS = (0.02, 0.01)
MET_SIGMAS = (0.04, 0.04, 0.025)


@dataclass
class World:
    """A path and walls from (x, y) to (x, y), shape (n, 4)."""

    path: np.ndarray
    walls: np.ndarray
    _way: np.ndarray = field(init=False)

    def __post_init__(self):
        steps = np.hypot(*np.diff(self.path, axis=0).T)
        self._way = np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self):
        return float(self._way[-1])

    def place(self, way, aside):
        """x, y, yaw of a robot `aside` metres to the left of the path, at a way along it."""
        here, there = (self._point(way + d) for d in (-0.05, 0.05))
        yaw = math.atan2(there[1] - here[1], there[0] - here[0])
        x, y = self._point(way) + aside * np.array([-math.sin(yaw), math.cos(yaw)])
        return np.array([x, y, yaw])

    def _point(self, way):
        # Past either end straight on.
        if way < 0:
            begin = self.path[1] - self.path[0]
            return self.path[0] + way * begin / np.hypot(*begin)
        return np.array([np.interp(way, self._way, self.path[:, k]) for k in range(2)])


def rounded(points: Sequence[tuple[float, float]], radius: float = 1.0) -> np.ndarray:
    """A path through points whose corners are cut in arcs, a point every 5 cm or so."""
    at = [np.array(point, dtype=float) for point in points]
    path = [at[0]]
    for before, corner, after in zip(at, at[1:], at[2:], strict=False):
        to, away = corner - before, after - corner
        to, away = to / np.hypot(*to), away / np.hypot(*away)
        for t in np.linspace(0.0, math.pi / 2, 20):
            path.append(
                corner - radius * to + radius * (math.sin(t) * to + (1 - math.cos(t)) * away)
            )
    return np.array([*path, at[-1]])


def l_corridor(leg=55.0, half=1.25) -> World:
    walls = [
        (-4, -half, leg + half, -half), (leg + half, -half, leg + half, leg + 2),
        (leg - half, leg + 2, leg - half, half), (leg - half, half, -4, half),
        (leg + half, leg + 2, leg - half, leg + 2),
    ]  # fmt: skip
    return World(rounded([(0, 0), (leg, 0), (leg, leg)]), np.array(walls, dtype=float))


def straight_corridor(length=110.0, half=1.25) -> World:
    walls = np.array([(-9, -half, length + 9, -half), (length + 9, half, -9, half)])
    return World(np.array([(0.0, 0.0), (length, 0.0)]), walls)


def hall(side=28.0) -> World:
    return World(rounded([(0, 0), (side, 0), (side, side), (0, side), (0, 0)]), np.zeros((0, 4)))


def as_walls(segments: np.ndarray, sigmas=(1e-3, 1e-3)) -> Walls:
    """Walls from (x, y) to (x, y), shape (n, 4), in normal form."""
    segments = np.asarray(segments, dtype=float).reshape(-1, 4)
    along = segments[:, 2:] - segments[:, :2]
    along /= np.hypot(*along.T)[:, None]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    distance = (normal * segments[:, :2]).sum(axis=1)
    normal[distance < 0] *= -1
    distance = np.abs(distance)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    ends = np.stack([(tangent * segments[:, k : k + 2]).sum(axis=1) for k in (0, 2)], axis=1)
    return Walls(
        distance=distance,
        bearing=np.arctan2(normal[:, 1], normal[:, 0]),
        covariance=np.tile(np.diag(np.square(sigmas)), (len(segments), 1, 1)),
        extent=np.sort(ends, axis=1),
        is_end=np.zeros((len(segments), 2), dtype=bool),
    )


def view(place, walls, rng, max_range=5.0, half_angle=0.8, sigmas=WALL_SIGMAS) -> Walls | None:
    """What a robot sees of walls: the visible stretch of each, with errors."""
    rotation = rotation_2d(-place[2])
    seen = []
    for k, (x0, y0, x1, y1) in enumerate(walls):
        length = math.hypot(x1 - x0, y1 - y0)
        near = (place[0] - x0) * (x1 - x0) + (place[1] - y0) * (y1 - y0)
        near = np.clip(near / length + np.linspace(-max_range, max_range, 41), 0, length)
        points = np.stack([x0 + near * (x1 - x0) / length, y0 + near * (y1 - y0) / length], 1)
        local = (points - place[:2]) @ rotation.T
        ranges = np.hypot(*local.T)
        ok = (ranges < max_range) & (np.abs(np.arctan2(local[:, 1], local[:, 0])) < half_angle)
        for other in np.delete(walls, k, axis=0):
            ok &= ~_crosses(place[:2], points, other)
        if ok.sum() >= 3 and len(set(map(tuple, points[ok]))) >= 3:
            seen.append(local[ok][[0, -1]].ravel())
    if not seen:
        return None
    made = as_walls(np.array(seen), sigmas)
    errors = rng.normal(size=(len(made), 2)) * sigmas
    return dataclasses.replace(
        made, distance=np.abs(made.distance + errors[:, 0]), bearing=made.bearing + errors[:, 1]
    )


def _crosses(eye, points, segment):
    """Whether a wall is between an eye and each point."""
    p, q = segment[:2], segment[2:]

    def side(a, b, c):
        return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
            c[..., 0] - a[..., 0]
        )

    apart = side(p, q, eye) * side(p, q, points) < -1e-9
    return apart & (side(eye, points, p) * side(eye, points, q) < -1e-9)


@dataclass
class Robot:
    """A robot of a tour: where it is, what its odometry says, and its estimate."""

    name: str
    behind: float
    aside: float
    localizer: Localizer
    truth: np.ndarray
    odometry: np.ndarray
    #: Where it is beside its place in the formation: x, y, yaw.
    beside: np.ndarray = field(default_factory=lambda: np.zeros(3))
    #: Systematic errors of its wheels (`Wheels`).
    wheels: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def carry(self, beside):
        """Moves it; its odometry does not notice."""
        self.beside = self.beside + beside
        self.truth = _moved(self.truth, beside)

    def drive(self, place, rng, config=CONFIG, noise=1.0):
        """Drives it there; the noise of its odometry is so many times what the model says."""
        rotation = rotation_2d(-self.truth[2])
        moved = rotation @ (place[:2] - self.truth[:2])
        turn = wrap_angle(place[2] - self.truth[2])
        longer, per_metre, per_radian = self.wheels
        moved = moved / (1.0 + longer)
        way = math.hypot(*moved)
        more = turn - (turn - per_metre * way) / (1.0 + per_radian)
        # An arc's chord has half of its turn.
        moved, turn = rotation_2d(-0.5 * more) @ moved, turn - more
        moved = moved + noise * rng.normal(size=2) * config.position_noise * math.sqrt(way)
        turn += (
            noise
            * rng.normal()
            * math.hypot(
                config.heading_noise * math.sqrt(way), config.turn_noise * math.sqrt(abs(turn))
            )
        )
        self.odometry[:2] += rotation_2d(self.odometry[2]) @ moved
        self.odometry[2] += turn
        self.truth = place


def _moved(place, by):
    x, y = rotation_2d(place[2]) @ by[:2]
    return place + np.array([x, y, by[2]])


@dataclass
class Record:
    """Where robots were and where they said they were, shape (steps, robots, ...)."""

    truth: np.ndarray
    estimate: np.ndarray
    covariance: np.ndarray
    odometry: np.ndarray

    def errors(self, of=None):
        made = (self.estimate if of is None else of) - self.truth
        made[..., 2] = np.arctan2(np.sin(made[..., 2]), np.cos(made[..., 2]))
        return made

    def nees(self):
        """Normalized squared error of each pose, shape (steps, robots)."""
        errors = self.errors()
        return np.einsum("tri,trij,trj->tr", errors, np.linalg.inv(self.covariance), errors)

    def relative(self, of=None):
        """Error of each robot's pose in the frame of the first, shape (steps, robots - 1, 3)."""
        of = self.estimate if of is None else of
        return _relative(of) - _relative(self.truth) if len(of) else of

    def across(self, of=None):
        """Position error across the true heading, shape (steps, robots)."""
        errors, yaw = self.errors(of), self.truth[..., 2]
        return errors[..., 1] * np.cos(yaw) - errors[..., 0] * np.sin(yaw)

    def along(self, of=None):
        errors, yaw = self.errors(of), self.truth[..., 2]
        return errors[..., 0] * np.cos(yaw) + errors[..., 1] * np.sin(yaw)


def _relative(poses):
    first, others = poses[:, :1], poses[:, 1:]
    c, s = np.cos(first[..., 2]), np.sin(first[..., 2])
    offset = others - first
    x = c * offset[..., 0] + s * offset[..., 1]
    y = c * offset[..., 1] - s * offset[..., 0]
    yaw = np.arctan2(np.sin(offset[..., 2]), np.cos(offset[..., 2]))
    return np.stack([x, y, yaw], axis=-1)


@dataclass
class Tour:
    """How a team drives through a world and what it hears; every rate in Hz."""

    world: World
    seed: int = 0
    robots: tuple[tuple[str, float, float], ...] = (
        ("a", 0.0, 0.0), ("b", 2.0, 0.5), ("c", 2.0, -0.5),
    )  # fmt: skip
    speed: float = 1.0
    rate: float = 20.0
    walls_every: int = 4
    met_every: int = 10
    loss: float = 0.2
    start: tuple[float, float, float] = START
    config: Localization = CONFIG
    known: Walls | None = None
    duration: float | None = None
    #: Systematic errors of the wheels of each robot; empty: none.
    wheels: tuple[tuple[float, float, float], ...] = ()
    #: Noise of the odometry: so many times what the model says.
    noise: float = 1.0
    #: Changes what is told, by sender and receiver; None: it does not arrive.
    on_message: Callable | None = None
    #: Called before each step with it and the robots.
    on_step: Callable | None = None

    def run(self) -> Record:
        rng = np.random.default_rng(self.seed)
        robots = [self._robot(name, behind, aside, rng) for name, behind, aside in self.robots]
        for robot, wheels in zip(robots, self.wheels, strict=bool(self.wheels)):
            robot.wheels = wheels
        duration = self.duration or (self.world.length - 1.0) / self.speed
        record: list[list] = []
        for step in range(int(duration * self.rate)):
            stamp_ns = 1_000_000_000 + round(step * 1e9 / self.rate)
            record.append(self._step(step, stamp_ns, robots, rng))
        columns = [np.array([row[k] for row in record]) for k in range(4)]
        self.team = robots
        return Record(*columns)

    def _robot(self, name, behind, aside, rng):
        place = self.world.place(-behind, aside)
        believed = place + rng.normal(size=3) * self.start
        config = dataclasses.replace(self.config, start=tuple(believed))
        return Robot(
            name, behind, aside, Localizer(name, config, self.known), place, believed.copy()
        )

    def _step(self, step, stamp_ns, robots, rng):
        way = step * self.speed / self.rate
        poses = []
        if self.on_step is not None:
            self.on_step(step, robots)
        for k, robot in enumerate(robots):
            place = self.world.place(way - robot.behind, robot.aside)
            robot.drive(_moved(place, robot.beside), rng, self.config, self.noise)
            said = Pose(stamp_ns, *robot.odometry)
            poses.append(robot.localizer.take_odometry(said))
            if self.walls_every and (step + k) % self.walls_every == 0:
                seen = view(robot.truth, self.world.walls, rng)
                if seen is not None:
                    robot.localizer.take_walls(SeenWalls(stamp_ns, seen))
        if self.met_every and step % self.met_every == self.met_every - 1:
            self._meet(stamp_ns, robots, rng)
        for sender in robots:
            told = sender.localizer.share()
            for receiver in robots:
                self._tell(step, told, sender, receiver, rng)
        return (
            [robot.truth for robot in robots],
            [(p.x, p.y, p.yaw) for p in poses],
            [p.covariance for p in poses],
            [robot.odometry.copy() for robot in robots],
        )

    def _tell(self, step, told, sender, receiver, rng):
        if sender is receiver or rng.uniform() < self.loss:
            return
        if self.on_message is not None:
            told = self.on_message(step, told, sender, receiver)
        if told is not None:
            receiver.localizer.take_teammate(told)

    def _meet(self, stamp_ns, robots, rng):
        truth = np.array([robot.truth for robot in robots])
        for i in range(len(robots) - 1):
            relative = _relative(truth[None, i:])[0]
            for j, pose in enumerate(relative, i + 1):
                met = RelativePose(
                    robots[i].name, stamp_ns, robots[j].name, stamp_ns,
                    pose + rng.normal(size=3) * MET_SIGMAS, np.diag(np.square(MET_SIGMAS)),
                )  # fmt: skip
                for robot in robots:
                    robot.localizer.take_relative(met)
