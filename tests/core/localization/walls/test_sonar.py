from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.walls import NOBODY, SeenWalls
from mrs_people_loc.localization.walls.ranges import SonarRange
from mrs_people_loc.localization.walls.sonar import SonarWalls
from mrs_people_sim.scene import Sonar
from mrs_people_sim.sensors.range_sensors import people_circles, sonar_ranges

HZ, STEP_NS = 20, 50_000_000
#: Left and right, in the middle of the robot.
LEFT, RIGHT = (0.0, 0.2, math.pi / 2), (0.0, -0.2, -math.pi / 2)
CONE = 0.52

#: From a sonar's place, its axis and the time [s] to its range [m].
Measure = Callable[[np.ndarray, float, float], float]


def wall(distance: float, bearing: float) -> Measure:
    """A mirror without ends: an echo where the foot is in the cone."""

    def measure(xy: np.ndarray, axis: float, _: float) -> float:
        if abs(wrap_angle(bearing - axis)) > CONE / 2:
            return math.inf
        return distance - float(xy @ [math.cos(bearing), math.sin(bearing)])

    return measure


def post(x: float, y: float, radius: float, vx: float = 0.0, vy: float = 0.0) -> Measure:
    """A person, who may walk."""

    def measure(xy: np.ndarray, axis: float, time: float) -> float:
        offset = np.array([x + vx * time, y + vy * time]) - xy
        if abs(wrap_angle(math.atan2(offset[1], offset[0]) - axis)) > CONE / 2:
            return math.inf
        return float(np.hypot(*offset)) - radius

    return measure


def nearest(*things: Measure) -> Measure:
    return lambda xy, axis, time: min(thing(xy, axis, time) for thing in things)


def straight(way: float, speed: float = 0.5, yaw: float = 0.0) -> np.ndarray:
    """Poses along x, shape (n, 3)."""
    along = np.arange(0.0, way, speed / HZ)
    return np.stack([along * math.cos(yaw), along * math.sin(yaw), np.full(len(along), yaw)], 1)


def drive(
    world: Measure,
    poses: np.ndarray,
    sonars=(LEFT, RIGHT),
    *,
    rng: np.random.Generator | None = None,
    noise: tuple[float, float] = (0.005, 0.01),
    finder: SonarWalls | None = None,
    start_ns: int = 10**18,
) -> list[tuple[SeenWalls, np.ndarray]]:
    """What is reported, each with the robot's true pose at its stamp. Without rng: no noise."""
    finder = finder or SonarWalls()
    found, at = [], {}
    for k, pose in enumerate(poses):
        stamp_ns = start_ns + k * STEP_NS
        at[stamp_ns] = pose
        x, y, yaw = pose.tolist()
        odometry = Odometry(stamp_ns, x, y, yaw, 0.0, 0.0)
        for x, y, yaw in sonars:
            xy = pose[:2] + rotation_2d(pose[2]) @ (x, y)
            value = world(xy, pose[2] + yaw, k / HZ)
            if rng is not None:
                value += rng.normal() * math.hypot(noise[0], noise[1] * min(value, 10.0))
            measured = SonarRange(stamp_ns, "sonar", CONE, 0.1, 5.0, value)
            seen = finder.take(measured, (x, y, yaw), odometry)
            if seen is not None:
                found.append((seen, at[seen.stamp_ns]))
    return found


def errors(
    found: list[tuple[SeenWalls, np.ndarray]], distance: float, bearing: float
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of all that is reported, if it is this wall of the map, shape (n, 2), and NEES."""
    difference, nees = [], []
    for seen, (x, y, yaw) in found:
        true = distance - x * math.cos(bearing) - y * math.sin(bearing), bearing - yaw
        for k, covariance in enumerate(seen.walls.covariance):
            off = np.array(
                [seen.walls.distance[k] - true[0], wrap_angle(seen.walls.bearing[k] - true[1])]
            )
            difference.append(off)
            nees.append(off @ np.linalg.solve(covariance, off))
    return np.array(difference).reshape(-1, 2), np.array(nees)


def test_one_sonar_while_driving_gives_the_wall_beside() -> None:
    """Towards a wall at y = 1.5, at 0.1 rad; the sonar is 0.2 m to the left."""
    found = drive(wall(1.5, math.pi / 2), straight(4.0, yaw=0.1), [LEFT])
    assert len(found) >= 2
    seen, pose = found[0]
    # That the foot is in the cone is an observation, too, which pulls towards its axis.
    assert seen.walls.distance == pytest.approx([1.5 - pose[1]], abs=2e-4)
    assert seen.walls.bearing == pytest.approx([math.pi / 2 - 0.1], abs=2e-3)
    assert np.abs(errors(found, 1.5, math.pi / 2)[0]).max() < 2e-3
    assert not seen.walls.is_end.any()


def test_extent_is_where_the_wall_was_touched() -> None:
    """Of a wall parallel to the way, the feet of 0.5 to 1.5 m of it are beside the sonar."""
    for seen, pose in drive(wall(1.2, math.pi / 2), straight(4.0), [LEFT]):
        low, high = seen.walls.extent[0]
        # The direction bearing + pi/2 is -x.
        assert 0.0 <= pose[0] - high < pose[0] - low <= 4.0
        assert 0.3 < high - low <= 1.5


def test_corridor_gives_both_walls() -> None:
    world = nearest(wall(1.5, math.pi / 2), wall(1.0, -math.pi / 2))
    found = drive(world, straight(6.0))
    off = np.stack([errors(found, 1.5, math.pi / 2)[0], errors(found, 1.0, -math.pi / 2)[0]])
    which = np.abs(off).max(axis=2).argmin(axis=0)
    assert np.bincount(which, minlength=2).min() >= 3
    assert np.abs(off[which, np.arange(len(which))]).max() < 1e-3


def test_simultaneous_ranges_give_a_known_wall_to_a_robot_that_stands() -> None:
    """Two sonars 0.4 m apart, both to the left."""
    sonars = [(0.2, 0.2, math.pi / 2), (-0.2, 0.2, math.pi / 2)]
    finder, world = SonarWalls(), wall(1.2, math.pi / 2)
    way = straight(3.0, yaw=0.05)
    drive(world, way, sonars, finder=finder)
    turned = way[-1] - (0, 0, 0.1)
    stands = np.tile(turned, (100, 1))
    found = drive(world, stands, sonars, finder=finder, start_ns=10**18 + (len(way) + 60) * STEP_NS)
    assert len(found) >= 2
    assert np.abs(errors(found, 1.2, math.pi / 2)[0]).max() < 3e-3


@pytest.mark.parametrize("distance", [0.6, 1.2, 2.5])
def test_person_who_stands_is_no_wall(distance: float) -> None:
    """... also where a wall is behind them."""
    for seed in range(3):
        person = post(2.0, distance, 0.15)
        rng = np.random.default_rng(seed)
        assert not drive(person, straight(4.0), rng=rng)
        world = nearest(person, wall(distance + 0.7, math.pi / 2))
        _, nees = errors(drive(world, straight(4.0), rng=rng), distance + 0.7, math.pi / 2)
        assert (nees < 25).all()


@pytest.mark.parametrize("distance", [0.6, 1.5, 3.0])
def test_person_whom_the_robot_passes_again_and_again_is_no_wall(distance: float) -> None:
    there = straight(0.4, speed=0.1) + [0.4, 0.0, 0.0]
    poses = np.concatenate([there, there[::-1]] * 4)
    for seed in range(3):
        assert not drive(post(0.6, distance, 0.15), poses, rng=np.random.default_rng(seed))


@pytest.mark.slow
def test_what_is_not_flat_is_no_wall() -> None:
    """Waves of 4 cm, three standard deviations of a range, and 13 cm long."""
    flat = wall(1.2, math.pi / 2)

    def waves(xy: np.ndarray, axis: float, time: float) -> float:
        return flat(xy, axis, time) + 0.04 * math.sin(2 * math.pi / 0.13 * float(xy[0]))

    for seed in range(3):
        rng = np.random.default_rng(seed)
        right = len(drive(flat, straight(10.0), rng=rng))
        assert len(drive(waves, straight(10.0), rng=rng)) < 0.2 * right


@pytest.mark.parametrize("velocity", [(0.0, 1.0), (1.2, 0.3), (-0.8, 0.0)])
def test_person_who_walks_is_no_wall(velocity: tuple[float, float]) -> None:
    vx, vy = velocity
    for seed in range(3):
        person = post(2.0 - 2.0 * vx, 1.5 - 2.0 * vy, 0.15, vx, vy)
        assert not drive(person, straight(4.0), rng=np.random.default_rng(seed))


def test_random_ranges_are_no_wall() -> None:
    rng = np.random.default_rng(1)
    ring = [(0.2 * math.cos(a), 0.2 * math.sin(a), a) for a in np.arange(8) * math.pi / 4]
    assert not drive(lambda *_: rng.uniform(0.1, 4.9), straight(10.0), ring)


def test_cross_talk_and_dropouts_do_not_hide_a_wall() -> None:
    rng = np.random.default_rng(1)
    true = wall(1.5, math.pi / 2)

    def measure(xy: np.ndarray, axis: float, time: float) -> float:
        kind = rng.random()
        return rng.uniform(0.1, 1.3) if kind < 0.1 else math.inf if kind < 0.25 else true(
            xy, axis, time
        )  # fmt: skip

    _, nees = errors(drive(measure, straight(10.0), rng=rng), 1.5, math.pi / 2)
    assert len(nees) >= 5
    assert (nees < 25).all()


def test_each_range_is_used_once() -> None:
    """The information of all reports on the distance is at most that of all ranges."""
    way = straight(20.0)
    found = drive(wall(1.2, math.pi / 2), way, [LEFT])
    information = sum(1.0 / seen.walls.covariance[0, 0, 0] for seen, _ in found)
    of_ranges = len(way) / (0.005**2 + (0.01 * 1.0) ** 2)
    assert 0.5 * of_ranges < information <= of_ranges


def test_stamps_of_reports_ascend() -> None:
    world = nearest(wall(1.5, math.pi / 2), wall(1.0, -math.pi / 2))
    stamps = [seen.stamp_ns for seen, _ in drive(world, straight(8.0))]
    assert stamps == sorted(set(stamps))


def test_nothing_is_reported_without_echoes() -> None:
    assert not drive(lambda *_: math.inf, straight(4.0))


def test_reset_and_a_jump_back_of_time_forget_everything() -> None:
    world = wall(1.2, math.pi / 2)
    finder = SonarWalls()
    drive(world, straight(4.0), [LEFT], finder=finder)
    after_jump = drive(world, straight(4.0), [LEFT], finder=finder, start_ns=10**17)
    fresh = drive(world, straight(4.0), [LEFT], start_ns=10**17)
    assert [s.stamp_ns for s, _ in after_jump] == [s.stamp_ns for s, _ in fresh]
    finder.reset()
    again = drive(world, straight(4.0), [LEFT], finder=finder, start_ns=10**17)
    assert [s.stamp_ns for s, _ in again] == [s.stamp_ns for s, _ in fresh]


# ------------------------------------------------------------------- with the simulator's sensors


def tour(
    segments: np.ndarray,
    seed: int,
    people: Callable[[float], np.ndarray] | None = None,
    bodies: np.ndarray = NOBODY,
) -> list[tuple[SeenWalls, np.ndarray]]:
    """30 m along x at 0.8 m/s, a little to the left and right, with ordinary drift.

    `bodies` are known to be at these places in base_link.
    """
    rng = np.random.default_rng(seed)
    ring = [
        Sonar(x=0.2 * math.cos(a), y=0.2 * math.sin(a), yaw=a) for a in np.arange(8) * math.pi / 4
    ]
    finder, found, poses = SonarWalls(), [], {}
    pose, believed, position, heading = np.zeros(3), np.zeros(3), 0.0, 0.0
    step = 0.8 / HZ
    for k in range(round(30.0 / step)):
        turn = 0.05 * math.sin(1.3 * step * (k + 1)) - pose[2]
        added = 0.02**2 * step, 0.006**2 * step + 0.02**2 * abs(turn)
        error = rng.normal() * math.sqrt(added[1])
        slip = rng.normal(size=2) * math.sqrt(added[0])
        pose = pose + [*rotation_2d(pose[2]) @ (step, 0.0), turn]
        believed[:2] += rotation_2d(believed[2] + error / 2) @ ((step, 0.0) + slip)
        believed[2] += turn + error
        position, heading = position + added[0], heading + added[1]
        stamp_ns = 10**18 + k * STEP_NS
        poses[stamp_ns] = pose
        odometry = Odometry(
            stamp_ns, float(believed[0]), float(believed[1]), float(believed[2]), position, heading
        )
        circles = np.empty((0, 3)) if people is None else people(k / HZ)
        at_stamp = sonar_ranges(segments, circles, pose.tolist(), ring, rng)
        for sonar, value in zip(ring, at_stamp, strict=True):
            measured = SonarRange(
                stamp_ns, "sonar", sonar.field_of_view, sonar.min_range, sonar.max_range, value
            )
            seen = finder.take(measured, (sonar.x, sonar.y, sonar.yaw), odometry, bodies)
            if seen is not None:
                found.append((seen, poses[seen.stamp_ns]))
    return found


#: The tour is at y = 0.
CORRIDOR = np.array([[-5.0, 1.3, 40.0, 1.3], [-5.0, -1.2, 40.0, -1.2]])


def nees_in_corridor(found: list[tuple[SeenWalls, np.ndarray]]) -> np.ndarray:
    _, left = errors(found, 1.3, math.pi / 2)
    _, right = errors(found, 1.2, -math.pi / 2)
    return np.minimum(left, right)


@pytest.mark.slow
def test_covariance_is_that_of_the_errors() -> None:
    """Two degrees of freedom; walls of one window share the odometry's errors."""
    nees = np.concatenate([nees_in_corridor(tour(CORRIDOR, seed)) for seed in range(4)])
    assert len(nees) > 160
    assert nees.mean() == pytest.approx(2.0, abs=3 * math.sqrt(2 * 4 / len(nees)))
    assert (nees < 13.8).mean() > 0.98  # of 0.999


def companions(seed: int) -> Callable[[float], np.ndarray]:
    """Five people who walk along beside the robot, nearly as fast as it."""
    rng = np.random.default_rng(seed)
    beside = rng.choice([-1, 1], 5) * rng.uniform(0.7, 2.0, 5)
    ahead, phase = rng.uniform(-2.5, 1.0, 5), rng.uniform(0.0, 2 * math.pi, (2, 5))
    far, often = rng.uniform(0.05, 0.4, (2, 5)), rng.uniform(0.3, 1.2, (2, 5))

    def at(time: float) -> np.ndarray:
        sway = far * np.sin(often * time + phase)
        return people_circles(
            np.stack([0.8 * time + ahead + sway[0], beside + sway[1], np.zeros(5)], axis=1)
        )

    return at


@pytest.mark.slow
def test_people_who_walk_along_are_rarely_taken_for_walls() -> None:
    """The worst case: nothing but people, always near. A wall is reported twice per metre."""
    hall = np.empty((0, 4))
    wrong = [len(tour(hall, seed, companions(seed))) for seed in range(3)]
    assert sum(wrong) < 0.15 * 3 * 60


@pytest.mark.slow
def test_team_mate_that_drives_beside_is_a_wall_only_where_it_is_not_known() -> None:
    def mate(time: float) -> np.ndarray:
        return np.array([[0.8 * time, -1.1, 0.25]])

    hall = np.empty((0, 4))
    assert len(tour(hall, 1, mate)) > 10
    assert not tour(hall, 1, mate, np.array([[0.0, -1.1, 0.2]]))
    # The wall on the other side is seen as before.
    walls = tour(CORRIDOR, 1, mate, np.array([[0.0, -1.1, 0.2]]))
    left = [seen for seen, _ in walls if (seen.walls.bearing > 0.0).any()]
    assert len(left) > 15


@pytest.mark.slow
def test_people_who_walk_along_do_not_hide_the_walls() -> None:
    nees = nees_in_corridor(tour(CORRIDOR, 1, companions(1)))
    assert (nees < 25).sum() > 15
    assert (nees < 25).mean() > 0.9
