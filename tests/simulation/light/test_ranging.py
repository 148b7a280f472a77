"""Walls in the sonars and lasers of robots on a tour without rendering."""

import math

import numpy as np
import pytest

from mrs_people_loc.localization.odometry import Odometry
from mrs_people_sim.light.ranging import RangeSensors
from mrs_people_sim.light.sensing import scan_of, seen_people
from mrs_people_sim.scene import Laser, Robot, Scene, Sonar

#: A corridor along x, 3 m wide; the free space is to the left of each wall.
WALLS = np.array([[[-20.0, -1.5], [20.0, -1.5]], [[20.0, 1.5], [-20.0, 1.5]]])
NOBODY = np.empty((0, 2))
SIDES = tuple(Sonar(y=0.2 * side, yaw=side * math.pi / 2) for side in (1, -1))


def sensors(**has):
    scene = Scene(robots={"robot_a": Robot()}, **has)
    return RangeSensors(scene, "robot_a", WALLS, np.random.default_rng(1))


def test_sonars_find_both_walls_after_some_way():
    one, found, first = sensors(sonars={"robot_a": SIDES}), [], math.inf
    for k in range(80):
        x = 0.1 * k
        odometry = Odometry(10**12 + k * 10**8, x, 0.0, 0.0, 1e-4 * x, 1e-5 * x)
        for seen in one.by_sonar(np.array([x, 0.0, 0.0]), NOBODY, odometry):
            found += [*zip(seen.walls.distance, seen.walls.bearing, strict=True)]
            first = min(first, x)
    assert 1.0 < first < 4.0
    distances, bearings = np.array(found).T
    assert set(np.sign(bearings)) == {1.0, -1.0}
    assert np.abs(distances - 1.5).max() < 0.05
    assert np.abs(np.abs(bearings) - math.pi / 2).max() < 0.15


def test_a_laser_shows_both_walls_at_once_and_none_where_there_is_none():
    pose, odometry = np.array([1.0, 0.0, 0.0]), Odometry(10**12, 1.0, 0.0, 0.0, 0.0, 0.0)
    (view,) = seen_people(np.zeros(1), pose[None], NOBODY[None], np.random.default_rng(1))
    people = scan_of("robot_a", 10**12, view)
    one = sensors(lasers={"robot_a": Laser()})
    one.take_people(people)
    (seen,) = one.by_laser(pose, NOBODY, odometry)
    assert seen.walls.distance == pytest.approx([1.5, 1.5], abs=0.03)
    assert sorted(seen.walls.bearing) == pytest.approx([-math.pi / 2, math.pi / 2], abs=0.02)
    assert not [*sensors().by_laser(pose, NOBODY, odometry)]
