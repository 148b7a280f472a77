import math

import numpy as np
import pytest

from mrs_people_sim.scene import Odometry, Robot
from mrs_people_sim.sensors.wheels import LIMITS, Wheels

DT = 0.05


def made(mode="exact", start=(0.0, 0.0, 0.0), seed=1, robot=Robot(), **settings):  # noqa: B008
    return Wheels(start, Odometry(mode=mode, **settings), np.random.default_rng(seed), robot)


def drive(wheels, seconds, speed, turn_rate, dt=DT):
    for _ in range(round(seconds / dt)):
        wheels.command(speed, turn_rate)
        wheels.step(dt)


def test_it_speeds_up_at_its_limit_and_drives_straight_ahead():
    wheels = made(start=(1.0, 2.0, math.pi / 2))
    drive(wheels, 2.0, 5.0, 0.0)  # 1 m/s after 0.5 s at 2 m/s^2: 0.25 m, then 1.5 m
    assert wheels.speed == pytest.approx(LIMITS.speed)
    assert wheels.pose == pytest.approx([1.0, 3.75, math.pi / 2])
    assert wheels.velocity == pytest.approx([0.0, 1.0])


def test_it_drives_a_circle():
    wheels = made()
    drive(wheels, 1.0, 0.5, 0.5)  # at full speed by then
    middle = wheels.pose[:2] + 1.0 * np.array([-math.sin(wheels.pose[2]), math.cos(wheels.pose[2])])
    drive(wheels, 4 * math.pi, 0.5, 0.5, dt=0.02)
    assert np.linalg.norm(wheels.pose[:2] - middle) == pytest.approx(1.0, abs=1e-3)


def test_it_stops_when_commands_stop_or_are_not_finite():
    wheels = made()
    drive(wheels, 2.0, 0.6, 0.3)
    for _ in range(round(0.4 / DT)):
        wheels.step(DT)
    assert wheels.speed == pytest.approx(0.6)
    for _ in range(round(0.5 / DT)):
        wheels.step(DT)
    assert (wheels.speed, wheels.turn_rate) == (0.0, 0.0)
    drive(wheels, 1.0, math.nan, 1.0)
    assert (wheels.speed, wheels.turn_rate) == (0.0, 0.0)


@pytest.mark.parametrize("mode", ["exact", "localized", "drift"])
def test_errors_of_odometry_are_as_large_as_it_says(mode):
    errors = []
    for seed in range(40):
        wheels = made(mode, seed=seed, sigma=0.05, sigma_yaw=0.02, drift=0.05, drift_yaw=0.03)
        drive(wheels, 12.0, 0.8, 0.1, dt=0.1)
        said = wheels.odometry()
        place = np.array([said.x, said.y])
        yaw = said.yaw
        if wheels.map_from_odom is not None:
            x, y, turn = wheels.map_from_odom
            cos, sin = math.cos(turn), math.sin(turn)
            place = np.array([[cos, -sin], [sin, cos]]) @ place + [x, y]
            yaw += turn
        off = np.array([*(place - wheels.pose[:2]), math.remainder(yaw - wheels.pose[2], math.tau)])
        errors.append(off / np.sqrt(np.diag(said.covariance)))
    assert wheels.frame == ("odom" if mode == "drift" else "map")
    spread = np.sqrt(np.mean(np.square(errors)))
    assert spread == 0.0 if mode == "exact" else 0.6 < spread < 1.6


def test_a_base_that_is_held_stays_while_its_odometry_goes_on():
    wheels = made("drift", sigma=0.0, sigma_yaw=0.0, drift=0.0, drift_yaw=0.0)
    drive(wheels, 2.0, 0.5, 0.0)
    before = wheels.pose[:2].copy()
    wheels.step(DT)
    wheels.block(before)
    assert wheels.pose[:2] == pytest.approx(before)
    assert wheels.speed == 0.0
    assert wheels.odometry().x > before[0]


EXACT = {"sigma": 0.0, "sigma_yaw": 0.0, "drift": 0.0, "drift_yaw": 0.0}


def test_odometry_of_uneven_wheels_is_too_short_and_turns():
    wheels = made("drift", robot=Robot(wheels=(0.03, 0.002, 0.0)), **EXACT)
    drive(wheels, 10.0, 0.5, 0.0)
    said, way = wheels.odometry(), float(wheels.pose[0])
    assert way > 4.0
    assert said.x == pytest.approx(way / 1.03, rel=1e-4)
    assert said.yaw == pytest.approx(-0.002 * way / 1.03)


@pytest.mark.parametrize("catches_up", [False, True])
def test_odometry_that_hangs_repeats_and_goes_on(catches_up):
    wheels = made("drift", robot=Robot(frozen=(2.02, 1.0), catches_up=catches_up), **EXACT)
    drive(wheels, 2.0, 0.5, 0.0)
    before = wheels.odometry().x
    drive(wheels, 1.0, 0.5, 0.0)
    assert wheels.odometry().x == before
    drive(wheels, 1.0, 0.5, 0.0)
    assert wheels.odometry().x == pytest.approx(before + (1.0 if catches_up else 0.5))
