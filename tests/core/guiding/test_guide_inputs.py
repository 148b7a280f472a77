"""A tour under way: outdated people, other maps, and the goals of its robots."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import numpy as np
import pytest

from core.guiding.test_free_space import grid_of
from machine import nine_of_ten
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
    made.take_people(PEOPLE, [GROUP], now, now, robots)


def test_outdated_people_halt_a_tour_once_until_they_come_again() -> None:
    made, last = running(), T0 + 3000 * MS
    assert set(made.guidance.posts) == set(CONFIG.robots)
    assert set(made.velocities(last + 500 * MS).values()) == {(0.0, 0.0)}  # ... already stand
    assert made.check_age(last + 1499 * MS) is None
    halted = made.check_age(last + 1500 * MS)
    assert halted is not None
    assert halted.state == State.HALTED
    assert halted.events == ("halts: no people have come for 1.50 s; allowed: 0.5 s",)
    assert made.guidance.events == ()
    assert made.goals(last + 1500 * MS) == {}
    assert made.check_age(last + 1600 * MS) is None
    hear(made, last + 1700 * MS)
    assert made.guidance.state == State.LEADING
    assert set(made.goals(last + 1700 * MS)) == set(CONFIG.robots)


def test_people_who_are_late_for_a_moment_halt_no_tour_and_are_no_event() -> None:
    made, last = running(), T0 + 3000 * MS
    for now in range(last + 800 * MS, last + 4800 * MS, 800 * MS):
        assert set(made.velocities(now - 50 * MS).values()) == {(0.0, 0.0)}
        assert made.check_age(now - 50 * MS) is None
        hear(made, now)
        assert made.guidance.state != State.HALTED
        assert made.velocities(now + 50 * MS)["robot_a"] != (0.0, 0.0)


def test_tour_without_any_people_halts() -> None:
    made = Guide(TOUR, CONFIG, ROOM, T0)
    assert made.check_age(T0 + 1400 * MS) is None
    assert made.check_age(T0 + 1500 * MS) is not None


def test_tour_of_nav2_halts_at_once_for_its_goals_have_to_be_moved() -> None:
    made = Guide(TOUR, dataclasses.replace(CONFIG, drive="nav2"), ROOM, T0)
    assert made.check_age(T0 + 400 * MS) is None
    assert made.check_age(T0 + 500 * MS) is not None


def test_robot_in_quarantine_leaves_the_tour_until_it_is_placed_again() -> None:
    made, now = running(), T0 + 3000 * MS
    said = []
    for k, apart in enumerate([("robot_b",)] * 3 + [()] * 2):
        now = T0 + (3200 + 200 * k) * MS
        for robot, x in (("robot_a", 4.0), ("robot_b", 0.6)):
            made.take_pose(robot, Pose(now, x, 3.0, 0.0), now)
        guidance = made.take_people(PEOPLE, [GROUP], now, now, CONFIG.robots, apart)
        assert guidance is not None
        said += guidance.events
        assert ("robot_b" in guidance.posts) == (not apart)
        if apart:
            assert "quarantine" in guidance.faults["robot_b"]
            assert made.velocities(now)["robot_b"] == (0.0, 0.0)
            assert made._steering.blind == {"robot_b"}  # it clears no place
    assert [event for event in said if "robot_b" in event] == [
        "robot_b takes no part: it is in quarantine: it is lost, or its team doubts its pose",
        "robot_b takes part again",
    ]


def test_map_with_a_wall_on_the_way_halts_a_tour_until_another_comes() -> None:
    made, now = running(), T0 + 3000 * MS
    halted = made.take_space(WALLED)
    assert halted is not None
    assert "by the new map" in halted.reason
    assert made.take_people(PEOPLE, [GROUP], now + 200 * MS, now + 200 * MS, ()) is None
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


def crowd(count: int, seed: int) -> tuple[list[Person], Group]:
    """People round the start, in one group; with other ids each time."""
    rng = np.random.default_rng(seed)
    people = [
        Person(xy, 0.01 * np.eye(2), 1.7, 0.1, (), 1, id=count * seed + k + 1)
        for k, xy in enumerate(rng.uniform((0.0, 0.5), (5.0, 5.5), (count, 2)))
    ]
    ids = tuple(one.id for one in people)
    return people, Group(np.array([2.5, 3.0]), 0.01 * np.eye(2), 3.0, 3.0, count, members=ids)


@pytest.mark.alone
@pytest.mark.parametrize("same", [True, False])
def test_no_crowd_delays_a_step(show: Callable[[str], None], same: bool) -> None:
    made = running()
    times = iter(range(T0 + 3200 * MS, T0 + 10**12, 200 * MS))

    def took_s() -> float:
        now = next(times)
        people, group = crowd(1000, 1 if same else now // MS % 1000)
        for robot, x in (("robot_a", 4.0), ("robot_b", 0.6)):
            made.take_pose(robot, Pose(now, x, 3.0, 0.0), now)
        began_s = time.perf_counter()
        made.take_people(people, [group], now, now, CONFIG.robots)
        made.velocities(now)
        return time.perf_counter() - began_s

    took_s()
    nine_of_ten(took_s, 0.05, "a step with 1000 people", show=show)


def test_limits_are_in_words() -> None:
    made = Guide(TOUR, CONFIG, ROOM, T0)
    assert not made.limits(24)
    for now in range(T0, T0 + 1000 * MS, 200 * MS):
        people, group = crowd(100, 1)
        for robot, x in (("robot_a", 6.0), ("robot_b", 7.0)):
            made.take_pose(robot, Pose(now, x, 3.0, 0.0), now)
        guidance = made.take_people(people, [group], now, now, CONFIG.robots)
        assert guidance is not None
        assert len(guidance.people) in (0, 30)
        events = made.limits(len(people))
    assert events == [
        "more than 24 people: each robot keeps clear of the nearest 24",
        "the group has more than 30 people; guides the nearest 30",
    ]


@pytest.mark.parametrize("space", [ROOM, FreeSpace.unbounded()])
def test_people_in_another_country_cost_nothing(space: FreeSpace) -> None:
    made = Guide(TOUR, CONFIG, space, T0)
    far = [dataclasses.replace(one, position=np.array([2e7, -2e7])) for one in PEOPLE]
    for now in range(T0, T0 + 4000 * MS, 200 * MS):
        for robot, x in (("robot_a", 4.0), ("robot_b", 0.6)):
            made.take_pose(robot, Pose(now, x, 3.0, 0.0), now)
        made.take_people(far, [GROUP], now, now, CONFIG.robots)
        made.velocities(now)
    assert made.guidance.reason.startswith("waits for the group: it is 2")
