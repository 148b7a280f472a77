"""A tour under way: outdated people, other maps, and the goals of its robots."""

from __future__ import annotations

import numpy as np
import pytest

from core.guiding.test_free_space import grid_of
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.errors import TourError
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import State
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.tour import tour_from
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.poses import Pose

MS = 1_000_000
T0 = 1_700_000_000_000 * MS
TOUR = tour_from([[2.0, 3.0], [14.0, 3.0]], name="hall")
CONFIG = GuideConfig(robots=("robot_a", "robot_b"), leader="robot_a")
ROOM = FreeSpace(grid_of((16.0, 6.0), []), around=TOUR.points)
WALLED = FreeSpace(grid_of((16.0, 6.0), [(9.0, 0.0, 9.2, 6.0, 100)]), around=TOUR.points)
PEOPLE = [
    Person(np.array([x, 3.0]), 0.01 * np.eye(2), 1.7, 0.1, (), 1, id=k)
    for k, x in ((1, 2.0), (2, 1.2))
]
GROUP = Group(np.array([1.6, 3.0]), 0.01 * np.eye(2), 0.4, 0.4, 2, id=1, members=(1, 2))


def running(until_ms: int = 3000) -> Guide:
    """A tour whose two people stand; everything is fresh until then."""
    made = Guide(TOUR, CONFIG, ROOM, T0)
    for now in range(T0, T0 + until_ms * MS + 1, 200 * MS):
        hear(made, now)
    return made


def hear(made: Guide, now: int, robots: tuple[str, ...] = CONFIG.robots) -> None:
    for robot in robots:
        x = 4.0 if robot == "robot_a" else 0.6
        made.take_pose(robot, Pose(now, x, 3.0, 0.0), now)
    made.take_people(PEOPLE, [GROUP], now, now)


def test_outdated_people_halt_a_tour_once_until_they_come_again() -> None:
    made, last = running(), T0 + 3000 * MS
    assert set(made.guidance.posts) == set(CONFIG.robots)
    assert made.check_age(last + 499 * MS) is None
    halted = made.check_age(last + 500 * MS)
    assert halted is not None
    assert halted.state == State.HALTED
    assert halted.events == ("halts: no people have come for 0.50 s; allowed: 0.5 s",)
    assert made.guidance.events == ()
    assert made.goals(last + 500 * MS) == {}
    assert made.check_age(last + 600 * MS) is None
    hear(made, last + 700 * MS)
    assert made.guidance.state == State.LEADING
    assert set(made.goals(last + 700 * MS)) == set(CONFIG.robots)


def test_tour_without_any_people_halts() -> None:
    made = Guide(TOUR, CONFIG, ROOM, T0)
    assert made.check_age(T0 + 400 * MS) is None
    assert made.check_age(T0 + 500 * MS) is not None


def test_map_with_a_wall_on_the_way_halts_a_tour_until_another_comes() -> None:
    made, now = running(), T0 + 3000 * MS
    halted = made.take_space(WALLED)
    assert halted is not None
    assert "by the new map" in halted.reason
    assert made.take_people(PEOPLE, [GROUP], now + 200 * MS, now + 200 * MS) is None
    assert made.take_space(WALLED) is None
    assert made.take_space(ROOM) is None
    hear(made, now + 400 * MS)
    assert made.guidance.state == State.LEADING
    with pytest.raises(TourError, match="wall"):
        Guide(TOUR, CONFIG, WALLED, now)


def test_robot_with_an_outdated_pose_has_a_post_but_no_goal() -> None:
    made, now = running(), T0 + 3600 * MS
    hear(made, now, robots=("robot_a",))
    assert set(made.guidance.posts) == set(CONFIG.robots)
    assert set(made.goals(now)) == {"robot_a"}
    assert made.off_posts()["robot_b"] == pytest.approx(
        np.hypot(*(made.guidance.posts["robot_b"].xy - [0.6, 3.0]))
    )
