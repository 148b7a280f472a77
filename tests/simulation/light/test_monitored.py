"""A base that is driven through a collision monitor among people who do not give way.

Nobody is touched by the robot's own motion: whoever touches it walks into a robot that stands, or
that does not come nearer to them.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrs_people_loc.config import CollisionMonitoring
from mrs_people_sim.light.monitored import MonitoredBase
from mrs_people_sim.light.sensing import BODY
from mrs_people_sim.scene import Laser, Odometry, Robot, Scene
from mrs_people_sim.sensors.wheels import Wheels

NOWHERE = np.empty((0, 2, 2))
RADIUS, STEP_S = 0.22, 0.05
#: Comes nearer by more than this [m/s].
OWN = 0.03
CRAWL = CollisionMonitoring().crawl


def scene_with(*, laser: bool, seed: int) -> Scene:
    robot = {"robot_a": Robot(0.0, 0.0)}
    return Scene(robots=robot, lasers={"robot_a": Laser()} if laser else {}, seed=seed)


def touched_by_own_motion(kind: str, speed: float, seed: int, *, laser: bool) -> float:
    """The robot's speed towards the person when they touch [m/s]; 0: they do not.

    Without a monitor they would meet, within 0.35 m, after 2.5 to 5 s; who crosses before a robot
    with a head alone meets it at its crawl.
    """
    rng = np.random.default_rng([seed, 7])
    base = MonitoredBase(scene_with(laser=laser, seed=seed), "robot_a", NOWHERE, looks_back=False)
    wheels = Wheels((0.0, 0.0, 0.0), Odometry(mode="exact"), rng)
    meets_s, aside = rng.uniform(2.5, 5.0), rng.uniform(-0.35, 0.35)
    side, slant = rng.choice([-1.0, 1.0]), rng.uniform(-0.5, 0.5)
    ways = {"stands": None, "crosses": side * math.pi / 2 + slant, "towards": math.pi + 0.6 * slant}
    way = ways[kind]
    velocity = np.zeros(2) if way is None else np.array([math.cos(way), math.sin(way)])
    fastest = speed if laser or kind != "crosses" else CRAWL
    person = np.array([fastest * meets_s, aside]) - meets_s * velocity
    for _ in range(round(8.0 / STEP_S)):
        base.drive((speed, 0.0), wheels, person[np.newaxis])
        wheels.step(STEP_S)
        person = person + STEP_S * velocity
        off = person - wheels.pose[:2]
        away = float(np.hypot(*off))
        if away < RADIUS + BODY:
            return float(max(wheels.velocity @ off / away, 0.0))
    return 0.0


@pytest.mark.parametrize("speed", [0.5, 0.8])
@pytest.mark.parametrize("kind", ["stands", "crosses", "towards"])
def test_nobody_is_touched_by_a_robot_with_a_laser_scanner(kind: str, speed: float) -> None:
    found = [touched_by_own_motion(kind, speed, seed, laser=True) for seed in range(25)]
    assert sum(one > OWN for one in found) == 0, found


@pytest.mark.parametrize(("kind", "most"), [("stands", OWN), ("crosses", CRAWL), ("towards", OWN)])
def test_robot_with_a_head_alone_touches_nobody_whom_it_sees_and_else_at_its_crawl(
    kind: str, most: float
) -> None:
    """It does not see who comes from aside; whom it sees it stands for."""
    found = [touched_by_own_motion(kind, 0.5, seed, laser=False) for seed in range(25)]
    assert max(found) <= most + 1e-9, found
