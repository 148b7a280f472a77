"""Odometry that slips, and robots that are carried."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrs_people_sim.motion import along
from mrs_people_sim.scene import Odometry, Robot
from mrs_people_sim.sensors.odometry import believe, by_wheels, dead_reckoned, seen_steps

RNG = np.random.default_rng(1)
EXACT = Odometry(mode="drift", sigma=0.0, sigma_yaw=0.0, drift=0.0, drift_yaw=0.0)


def ends(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Where a robot that drives 8 m along x is and believes that it is, from its start."""
    track = along((0.0, 0.0, 20.0, 0.0), 0.8, 10.0)
    if robot.carried:
        track = track.carried(*robot.carried)
    belief = believe(track, EXACT, 10.0, np.random.default_rng(1), robot)
    first, last = (track.at(belief.samples[k].time) for k in (0, -1))
    sample = belief.samples[-1]
    way = np.array([last.x - first.x, last.y - first.y, last.yaw - first.yaw])
    return way, np.array([sample.x, sample.y, sample.yaw])


def test_without_errors_odometry_is_the_way():
    true, believed = ends(Robot())
    np.testing.assert_allclose(believed, true, atol=1e-9)


def test_wheels_that_slip_add_to_odometry_only():
    # The way from 5 s on is turned by a right angle.
    true, believed = ends(Robot(slip=(5.0, 0.3, -0.1, math.pi / 2)))
    plain, _ = ends(Robot())
    np.testing.assert_allclose(true, plain, atol=1e-9)
    assert believed[2] == pytest.approx(math.pi / 2)
    assert believed[0] + believed[1] == pytest.approx(true[0] + 0.3 - 0.1, abs=1e-6)
    assert believed[0] == pytest.approx(0.8 * 5.1 + 0.3, abs=0.05)


def test_a_carried_robot_is_elsewhere_and_its_odometry_does_not_see_it():
    true, believed = ends(Robot(carried=(5.0, 0.0, 0.5, 0.0)))
    plain, _ = ends(Robot())
    np.testing.assert_allclose(true - plain, [0.0, 0.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(believed, plain, atol=1e-6)


def test_a_carried_robot_that_is_turned_goes_on_relative_to_itself():
    at = np.arange(0.0, 2.0, 0.1)
    truth = np.column_stack([at, np.zeros_like(at), np.zeros_like(at)])
    carried = truth + np.where(at[:, None] > 0.95, [0.0, 2.0, math.pi / 2], 0.0)
    steps = seen_steps(at, carried, Robot(carried=(0.95, 0.0, 2.0, math.pi / 2)), RNG)
    # It goes on along x, which is to its right now.
    np.testing.assert_allclose(steps[:10], np.tile([0.1, 0.0, 0.0], (10, 1)), atol=1e-12)
    np.testing.assert_allclose(steps[10:], np.tile([0.0, -0.1, 0.0], (9, 1)), atol=1e-12)


def test_uneven_wheels_are_wrong_by_exactly_what_is_said():
    # A metre ahead, a metre back, and a radian on the spot, by a robot that is not carried.
    steps = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    seen = by_wheels(steps, Robot(wheels=(0.03, 0.002, 0.01)), RNG)
    np.testing.assert_allclose(seen[:, 0], [1.0 / 1.03, -1.0 / 1.03, 0.0])
    # Where odometry corrected by the same errors is the truth.
    np.testing.assert_allclose(seen[:, 2] * 1.01 + 0.002 * seen[:, 0], steps[:, 2], atol=1e-12)
    true, believed = ends(Robot(wheels=(0.03, 0.002, 0.0)))
    assert believed[2] == pytest.approx(-0.002 * true[0] / 1.03)
    assert np.hypot(*believed[:2]) == pytest.approx(true[0] / 1.03, rel=1e-4)


def test_bumps_come_with_the_way_and_are_as_large_as_stated():
    steps = np.array([[0.05, 0.0, 0.0], [0.0, 0.0, 0.3]] * 20_000)  # a kilometre
    off = by_wheels(steps, Robot(bumps=(10.0, 0.01, 0.02)), np.random.default_rng(1)) - steps
    bumped = off.any(axis=1)
    assert bumped.sum() == pytest.approx(100, abs=30)
    assert not bumped[1::2].any()
    np.testing.assert_allclose(off[bumped].std(axis=0), [0.01, 0.01, 0.02], rtol=0.25)


@pytest.mark.parametrize("catches_up", [False, True])
def test_frozen_odometry_repeats_and_goes_on(catches_up):
    at = np.arange(0.0, 4.0, 0.1)
    truth = np.column_stack([np.sin(at), 1.0 - np.cos(at), at])  # a circle
    robot = Robot(frozen=(0.95, 2.0), catches_up=catches_up)
    places = dead_reckoned(seen_steps(at, truth, robot, RNG))
    np.testing.assert_allclose(places[:10], truth[:10], atol=1e-12)
    np.testing.assert_array_equal(places[10:30], np.tile(places[9], (20, 1)))
    # Forgotten: from 2.9 s on, it drives the same piece of the circle as from 0.9 s on.
    expected = truth[30:] if catches_up else truth[10:20]
    np.testing.assert_allclose(places[30:], expected, atol=1e-9)


def test_dead_reckoning_of_a_square():
    steps = np.array([[1.0, 0.0, math.pi / 2]] * 4)
    places = dead_reckoned(steps)
    corners = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
    np.testing.assert_allclose(places[:, :2], corners, atol=1e-12)
    assert places[-1, 2] == pytest.approx(2 * math.pi)


def test_drift_grows_as_stated():
    track = along((0.0, 0.0, 20.0, 0.0), 0.8, 10.0)
    settings = Odometry(mode="drift", sigma=0.0, sigma_yaw=0.0, drift=0.05, drift_yaw=0.02)
    squares = []
    for seed in range(60):
        belief = believe(track, settings, 10.0, np.random.default_rng(seed))
        first, last, sample = track.at(belief.samples[0].time), *(
            track.at(belief.samples[-1].time), belief.samples[-1]
        )  # fmt: skip
        error = np.array([sample.x - (last.x - first.x), sample.y, sample.yaw])
        squares.append(error @ np.linalg.solve(sample.covariance, error))
    # The mean of 60 chi-squares with 3 degrees of freedom: 99.9 % are in 2 to 4.2.
    assert 2.0 < np.mean(squares) < 4.2
