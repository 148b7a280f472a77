import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from core.guiding.driving import CONFIG, DT, Robot, World, post, standing
from core.guiding.test_free_space import ROOMS, grid_of
from mrs_people_loc.guiding.free_space import FreeSpace

SAFETY = CONFIG.safety
angles = st.floats(-math.pi, math.pi)


def is_at_post(robot: Robot) -> bool:
    assert robot.post is not None
    turned = abs(math.remainder(robot.yaw - robot.post.yaw, 2 * math.pi))
    return bool(np.linalg.norm(robot.xy - robot.post.xy) < 0.13) and turned < 0.16


# ----------------------------------------------------------------------------------- alone ----


@pytest.mark.slow
@settings(max_examples=7, deadline=None)
@given(st.floats(0.3, 3.0), angles, angles)
def test_post_is_reached_and_stood_on(away: float, bearing: float, yaw: float) -> None:
    robot = Robot(0.0, 0.0, 0.0, post(away * math.cos(bearing), away * math.sin(bearing), yaw))
    World([robot]).run(13.0)
    assert is_at_post(robot)
    assert (robot.track[-20:, 3:] == 0.0).all()


def test_small_changes_of_the_post_move_nobody() -> None:
    robot = Robot(0.0, 0.0, 0.0, post(0.0, 0.0))
    world, rng = World([robot]), np.random.default_rng(1)
    for _ in range(20):
        x, y, yaw = rng.uniform(-1.0, 1.0, 3) * (0.06, 0.12, 0.1)
        robot.post = post(float(x), float(y), float(yaw))
        world.run(0.2)
    assert robot.xy == pytest.approx([0.0, 0.0], abs=0.07)
    assert (robot.track[-60:, 3:] == 0.0).all()
    robot.post = post(0.2, 0.0)
    world.run(2.0)
    assert is_at_post(robot)


@pytest.mark.parametrize("turned", [0.0, math.pi])
def test_moving_post_is_followed_closely_also_backwards(turned: float) -> None:
    robot = Robot(0.0, 0.0, turned, post(0.3, 0.0, turned))
    world = World([robot])
    for k in range(40):
        robot.post = post(0.3 + 0.1 * k, 0.0, turned, speed=0.7)
        world.run(0.2)
        if k > 10:
            assert abs(robot.post.xy[0] - robot.x) < 0.3
    assert (np.cos(robot.track[:, 2] - turned) > 0.99).all()


def test_robot_that_is_told_to_stop_brakes_at_once() -> None:
    robot = Robot(0.0, 0.0, 0.0, post(5.0, 0.0))
    world = World([robot])
    world.run(2.0)
    assert robot.v > 0.5
    for robot.post in (None, dataclasses.replace(post(5.0, 0.0), speed=0.0)):
        braking = math.ceil(robot.v / (CONFIG.base.deceleration * DT)) * DT
        world.run(braking + DT)
        assert robot.v == pytest.approx(0.0, abs=1e-9)


def test_robot_is_no_faster_than_it_can_stop_in_the_time_it_has() -> None:
    # From 0.4 m/s at 2 m/s^2, and from 0.6 rad/s at 3 rad/s^2, it stands after 0.2 s.
    for speed, kept in ((0.6, 0.4), (0.3, 0.3)):
        robot = Robot(0.0, 0.0, 0.0, post(5.0, 0.0, speed=speed))
        World([robot], stands_within=0.2).run(3.0)
        assert robot.track[:, 3].max() == pytest.approx(kept, abs=0.01)
    robot = Robot(0.0, 0.0, 0.0, post(0.0, 0.0, math.pi / 2))
    World([robot], stands_within=0.2).run(1.5)
    assert robot.track[:, 4].max() == pytest.approx(0.6, abs=0.01)


def test_robot_that_cannot_reverse_turns() -> None:
    base = dataclasses.replace(CONFIG.base, max_reverse=0.0)
    robot = Robot(0.0, 0.0, 0.0, post(-1.0, 0.0), dataclasses.replace(CONFIG, base=base))
    World([robot]).run(10.0)
    assert is_at_post(robot)


# ---------------------------------------------------------------------------------- people ----


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@example(628)  # somebody comes from aside, and is seen too far on by 0.2 m
@given(st.integers(0, 10_000))
def test_robot_comes_near_nobody_by_its_own_motion(seed: int) -> None:
    """People who walk across its way, and some who stop there; seen late and not exactly."""
    rng = np.random.default_rng(seed)
    where = np.stack([rng.uniform(0.0, 3.5, 3), rng.uniform(-0.6, 0.6, 3)], axis=1)
    when, speed, yaw = rng.uniform(1, 6, 3), rng.uniform(0.5, 1.3, 3), rng.uniform(-3.2, 3.2, 3)
    stops = np.where(rng.random(3) < 0.4, when - rng.uniform(0.0, 1.5, 3), np.inf)
    velocity = speed[:, np.newaxis] * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    robot = Robot(0.0, 0.0, 0.0, post(4.0, 0.0, rng.uniform(-3.0, 3.0)))
    world = World(
        [robot],
        people=lambda t: where + velocity * (np.minimum(t, stops) - when)[:, np.newaxis],
        age=0.25,
        sigma=0.07,
        seed=seed,
    )
    world.run(7.0)
    assert world.closest > SAFETY.person_distance - 0.12


@pytest.mark.slow
def test_base_with_weak_brakes_stops_in_time() -> None:
    base = dataclasses.replace(CONFIG.base, deceleration=0.15, acceleration=0.15)
    config = dataclasses.replace(CONFIG, base=base)
    for people in (np.array([[3.0, 1.0]]), np.zeros((0, 2))):
        robot = Robot(1.0, 1.0, 0.0, post(9.0, 1.0), config)
        world = World([robot], people=standing(people), space=ROOMS)
        world.run(20.0)
        assert robot.x > 1.5
        assert world.closest > SAFETY.person_distance
        assert world.least_clearance > SAFETY.wall_distance


def test_person_on_the_very_spot_is_left() -> None:
    robot = Robot(0.0, 0.0, 0.0, post(1.0, 0.0))
    world = World([robot], people=standing(np.zeros((1, 2))))
    world.run(5.0)
    assert is_at_post(robot)


def test_robot_waits_before_somebody_who_stands_and_goes_round_by_a_path() -> None:
    stands = np.array([[2.5, 0.0]])
    for plan in (False, True):
        robot = Robot(0.0, 0.0, 0.0, post(5.0, 0.0))
        world = World([robot], people=standing(stands))
        world.run(13.0, plan=plan)
        assert is_at_post(robot) == plan
        assert world.closest > SAFETY.person_distance
        assert robot.x > 1.3


def test_robot_makes_room_for_somebody_who_comes_close_and_returns() -> None:
    robot = Robot(0.0, 0.0, 0.0, post(0.0, 0.0))
    others = np.array([[-1.6, 0.0]])
    world = World(
        [robot],
        people=lambda t: np.concatenate(
            [[[max(0.4, 2.0 - 0.5 * t) + 4.0 * (t > 8.0), 0.0]], others]
        ),
    )
    world.run(7.9)
    assert robot.x < -0.15
    assert np.linalg.norm(robot.xy - others[0]) > SAFETY.person_distance
    assert abs(robot.track[-20:, 3]).max() < 0.05
    world.run(4.0)
    assert is_at_post(robot)


# --------------------------------------------------------------------------- walls, robots ----


@pytest.mark.parametrize("y", [1.0, 5.0])
def test_robot_passes_a_door_of_a_metre(y: float) -> None:
    robot = Robot(1.0, y, 0.0, post(9.0, 1.0))
    world = World([robot], space=ROOMS)
    world.run(20.0, plan=True)
    assert is_at_post(robot)
    assert world.least_clearance > SAFETY.wall_distance


def test_robot_that_makes_room_keeps_off_walls() -> None:
    robot = Robot(0.6, 3.0, 0.0, post(0.6, 3.0))
    world = World([robot], people=lambda t: np.array([[max(0.8, 4.0 - t), 3.0]]), space=ROOMS)
    world.run(5.0)
    assert robot.x < 0.58
    assert world.least_clearance > SAFETY.wall_distance - 0.01


def test_robot_too_near_to_a_wall_gets_no_nearer_and_leaves() -> None:
    robot = Robot(4.75, 1.0, 0.0, post(9.0, 1.0))
    world = World([robot], space=ROOMS)
    world.run(3.0)
    assert world.least_clearance > 0.24
    robot.post = post(3.0, 1.0)
    world.run(6.0)
    assert is_at_post(robot)


@pytest.mark.slow
@pytest.mark.parametrize("plan", [True, False])
def test_team_mates_who_meet_pass_each_other(plan: bool) -> None:
    space = FreeSpace(grid_of((10.0, 2.0), [])) if plan else FreeSpace.unbounded()
    one = Robot(2.0, 1.0, 0.0, post(8.0, 1.0))
    other = Robot(8.0, 1.0, math.pi, post(2.0, 1.0, math.pi))
    world = World([one, other], space=space)
    world.run(15.0, plan=plan)
    assert is_at_post(one)
    assert is_at_post(other)
    assert world.closest_robots > SAFETY.robot_distance


def test_team_mates_stay_on_posts_beside_each_other() -> None:
    robots = [Robot(0.75 * k, 0.0, 0.0, post(0.75 * k + 0.15, 0.0)) for k in range(3)]
    World(robots).run(5.0)
    for robot in robots:
        assert (robot.track[-60:, 3:] == 0.0).all()
        assert is_at_post(robot)


@pytest.mark.slow
def test_one_of_two_that_meet_in_a_door_makes_room() -> None:
    one = Robot(2.5, 3.0, 0.0, post(7.5, 3.0))
    other = Robot(7.5, 3.0, math.pi, post(2.5, 3.0, math.pi))
    world = World([one, other], space=ROOMS)
    world.run(25.0, plan=True)
    assert is_at_post(one)
    assert is_at_post(other)
    assert world.closest_robots > SAFETY.robot_distance
