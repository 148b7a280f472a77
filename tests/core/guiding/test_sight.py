"""Which robots of a tour see anything."""

from __future__ import annotations

import numpy as np
import pytest

from mrs_people_loc.config import GuideConfig
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.sight import Sights
from mrs_people_loc.people import Person
from mrs_people_loc.team.poses import Pose

CONFIG = GuideConfig(looks_back=("robot_a",))
ROBOTS = {"robot_a": Pose(0, 4.0, 0.0, 0.0), "robot_b": Pose(0, 0.0, 0.0, 0.0)}
BOTH = ("robot_a", "robot_b")


def person(x: float, *robots: str) -> Person:
    return Person(np.array([x, 0.0]), 0.01 * np.eye(2), 1.7, 0.1, robots, 1, id=1)


def run(sights: Sights, seconds: float, people, scans=BOTH, start: float = 0.0) -> list[str]:
    """Intervals of 0.2 s from a time on [s]; what is said."""
    said = []
    for k in range(round(seconds / 0.2)):
        now_s = start + 0.2 * k
        sights.step(scans, people, ROBOTS, CONFIG, FreeSpace.unbounded(), now_s)
        said += sights.events
    return said


def test_robots_that_see_somebody_see() -> None:
    sights = Sights()
    assert run(sights, 10.0, [person(2.0, *BOTH)]) == []
    assert sights.seeing == set(BOTH)


def test_robot_without_scans_sees_nothing_at_once_and_it_is_told_once() -> None:
    sights = Sights()
    run(sights, 1.0, [person(2.0, *BOTH)])
    assert run(sights, 0.4, [person(2.0, "robot_a")], ("robot_a",), 1.0) == []
    assert sights.seeing == {"robot_a"}
    said = run(sights, 5.0, [person(2.0, "robot_a")], ("robot_a",), 1.4)
    assert said == ["robot_b sees nothing: none of its scans has been used for 1.5 s"]
    assert run(sights, 1.0, [person(2.0, *BOTH)], BOTH, 6.4) == ["robot_b sees again"]
    assert sights.seeing == set(BOTH)


@pytest.mark.parametrize("x", [2.0, 1.5])
def test_robot_that_never_sees_who_is_in_its_view_is_blind(x: float) -> None:
    sights = Sights()
    assert run(sights, 2.8, [person(x, "robot_a")]) == []
    said = run(sights, 3.0, [person(x, "robot_a")], start=2.8)
    assert said == ["robot_b sees nothing: it has not seen anybody for 3 s who was in its view"]
    assert sights.seeing == {"robot_a"}
    assert run(sights, 1.0, [person(x, *BOTH)], start=5.8) == ["robot_b sees again"]


def test_robot_before_which_nobody_is_is_not_blind() -> None:
    sights = Sights()
    behind, far = person(-2.0, "robot_c"), person(9.0, "robot_c")
    assert run(sights, 10.0, [behind, far]) == []
    assert sights.seeing == set(BOTH)


def test_robot_that_takes_no_part_does_not_see() -> None:
    sights = Sights()
    sights.step(BOTH, [], {"robot_a": ROBOTS["robot_a"]}, CONFIG, FreeSpace.unbounded(), 0.0)
    assert sights.seeing == {"robot_a"}
