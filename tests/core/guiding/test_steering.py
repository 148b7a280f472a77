"""Velocities between messages: ages, what is extrapolated, what is avoided."""

from __future__ import annotations

import numpy as np
import pytest

from mrs_people_loc.config import GuideConfig
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Post, Role
from mrs_people_loc.guiding.steering import Steering
from mrs_people_loc.people import Person
from mrs_people_loc.team.poses import Pose

MS = 1_000_000
#: A moment [ns].
T0 = 1_700_000_000_000 * MS
TICK = 50 * MS
CONFIG = GuideConfig()
TIMEOUT = round(CONFIG.safety.people_timeout * 1e9)
AHEAD = Post(Role.LEADER, np.array([10.0, 0.0]), 0.0, 0.6)


def person(x: float, y: float, velocity: tuple[float, float] | None = None) -> Person:
    moving = None if velocity is None else np.array(velocity)
    return Person(np.array([x, y]), 0.01 * np.eye(2), 1.7, 0.1, (), -1, id=1, velocity=moving)


def steering(*robots: str) -> Steering:
    """At T0, each robot at its own place on the y axis, with a post 10 m ahead."""
    made = Steering(CONFIG, FreeSpace.unbounded(), robots)
    for number, robot in enumerate(robots):
        made.take_pose(robot, Pose(T0, 0.0, 3.0 * number, 0.0), T0)
    made.take_people([person(-2.0, 0.0)], T0, T0)
    made.take_posts(
        {r: Post(Role.REAR, AHEAD.xy + [0.0, 3.0 * k], 0.0, 0.6) for k, r in enumerate(robots)}
    )
    return made


def run(made: Steering, until_ns: int, *, poses: bool = True, people: bool = True) -> int:
    """Ticks until a time, with what is fresh at each; the time of the last tick."""
    now = T0
    while now + TICK <= until_ns:
        now += TICK
        if poses:
            for robot, pose in made.poses().items():
                made.take_pose(robot, Pose(now, pose.x, pose.y, pose.yaw), now)
        if people:
            made.take_people([person(-2.0, 0.0)], now, now)
        made.step(now)
    return now


def test_robots_drive_to_their_posts_while_everything_is_fresh() -> None:
    made = steering("robot_a", "robot_b")
    now = run(made, T0 + 1000 * MS)
    for v, w in made.step(now + TICK).values():
        assert v > 0.3
        assert abs(w) < 0.2


@pytest.mark.parametrize("late", [{"poses": False}, {"people": False}])
def test_what_is_outdated_slows_robots_down_and_stops_them(late: dict[str, bool]) -> None:
    made = steering("robot_a")
    run(made, T0 + 1000 * MS)
    v, _ = made.step(T0 + 1000 * MS)["robot_a"]
    assert v == pytest.approx(0.6)
    began = T0 + 1000 * MS
    speeds = {}
    for age in range(50, 700, 50):
        now = began + age * MS
        if late.get("poses", True):
            made.take_pose("robot_a", Pose(now, 0.0, 0.0, 0.0), now)
        if late.get("people", True):
            made.take_people([person(-2.0, 0.0)], now, now)
        speeds[age], _ = made.step(now)["robot_a"]
    # As shipped, 0.5 s and 2 m/s^2: a velocity is driven until the next step.
    assert speeds[100] == pytest.approx(0.6)
    assert speeds[250] == pytest.approx(0.4)
    assert speeds[400] == pytest.approx(0.1)
    assert {speeds[age] for age in speeds if age >= 450} == {0.0}


def test_stamps_of_the_future_do_not_keep_robots_going() -> None:
    """A sender whose clock is ahead: the arrival counts."""
    made = steering("robot_a")
    made.take_people([person(-2.0, 0.0)], T0 + 10_000 * MS, T0)
    assert made.people_age_s(T0 + 500 * MS) == pytest.approx(0.5)
    made.take_pose("robot_a", Pose(T0 + 10_000 * MS, 0.0, 0.0, 0.0), T0)
    assert made.pose_age_s("robot_a", T0 + 500 * MS) == pytest.approx(0.5)
    assert made.step(T0 + TIMEOUT)["robot_a"] == (0.0, 0.0)


def test_people_count_from_their_arrival_unless_they_come_late() -> None:
    made = steering("robot_a")
    made.take_people([], T0 - 150 * MS, T0)
    assert made.people_age_s(T0 + 100 * MS) == pytest.approx(0.1)
    made.take_people([], T0 - 500 * MS, T0)
    assert made.people_age_s(T0 + 100 * MS) == pytest.approx(0.4)


def test_clock_that_was_set_back_lets_robots_stand() -> None:
    made = steering("robot_a")
    assert made.people_age_s(T0 - 20 * MS) == pytest.approx(-0.02)
    assert made.people_age_s(T0 - 300 * MS) == made.pose_age_s("robot_a", T0 - 300 * MS) == np.inf


def test_robot_outside_the_tour_is_forgotten_after_two_minutes() -> None:
    made = steering("robot_a")
    made.take_pose("ghost", Pose(T0, 3.0, 0.0, 0.0), T0)
    made.take_people([], T0 + 119_000 * MS, T0 + 119_000 * MS)
    assert made.avoided == ("ghost",)
    made.take_people([], T0 + 121_000 * MS, T0 + 121_000 * MS)
    assert set(made.poses()) == {"robot_a"}


def test_robot_without_a_pose_a_post_or_people_stands() -> None:
    assert Steering(CONFIG, FreeSpace.unbounded(), ["robot_a"]).step(T0) == {"robot_a": (0.0, 0.0)}
    without_people = Steering(CONFIG, FreeSpace.unbounded(), ["robot_a"])
    without_people.take_pose("robot_a", Pose(T0, 0.0, 0.0, 0.0), T0)
    without_people.take_posts({"robot_a": AHEAD})
    assert without_people.step(T0) == {"robot_a": (0.0, 0.0)}
    without_post = steering("robot_a")
    without_post.take_posts({})
    assert without_post.step(T0) == {"robot_a": (0.0, 0.0)}


def test_only_the_robots_of_the_tour_are_driven_and_others_are_avoided() -> None:
    free, blocked = steering("robot_a"), steering("robot_a")
    gap = CONFIG.safety.robot_distance + 0.02
    for made in (free, blocked):
        if made is blocked:
            made.take_pose("stranger", Pose(T0, gap, 0.0, 0.0), T0)
        velocities = {}
        for tick in range(1, 8):
            now = T0 + tick * TICK
            made.take_pose("robot_a", Pose(now, 0.0, 0.0, 0.0), now)
            made.take_people([person(-2.0, 0.0)], now, now)
            velocities = made.step(now)
        assert set(velocities) == {"robot_a"}
        assert (velocities["robot_a"][0] > 0.1) == (made is free)


def test_poses_are_no_newer_than_their_arrival() -> None:
    """A robot whose clock is ahead is missed as soon as another one."""
    made = steering("robot_a")
    made.take_pose("robot_a", Pose(T0 + 30_000 * MS, 0.0, 0.0, 0.0), T0 + MS)
    assert made.poses()["robot_a"].stamp_ns == T0 + MS


@pytest.mark.parametrize(
    ("x", "silent_ms", "is_kept"),
    [(0.65, 1000, True), (0.65, 5000, False), (2.0, 400, True), (2.0, 1000, False)],
)
def test_who_vanished_is_avoided_unless_their_place_is_seen_empty(
    x: float, silent_ms: int, is_kept: bool
) -> None:
    """The robot sees people from 1 m on; nearer ones it cannot see to be gone."""
    made = steering("robot_a")
    made.take_people([person(x, 0.0)], T0, T0)
    for age in range(200, silent_ms + 1, 200):
        made.take_people([], T0 + age * MS, T0 + age * MS)
    now = T0 + silent_ms * MS
    made.take_pose("robot_a", Pose(now, x - CONFIG.safety.person_distance - 0.02, 0.0, 0.0), now)
    for _ in range(5):
        velocity, _ = made.step(now)["robot_a"]
    assert (velocity < 0.05) == is_kept
