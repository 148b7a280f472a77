"""Robots that see people where others see nobody."""

import dataclasses
import math

import numpy as np
import pytest

from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.people.contradictions import (
    CONTRADICTIONS_TUNING,
    Contradictions,
    ContradictionsTuning,
)
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.team.masking import OccupancyGrid, Walls
from mrs_people_loc.team.poses import Pose

#: Five people, and three robots around them that look at them.
GROUP = 1.3 * np.array([[0.0, 0.0], [0.9, 0.4], [-0.7, 0.8], [0.2, -0.9], [1.1, -0.6]])
ROBOTS = {
    "robot_a": Pose(0, 3.0, 0.0, math.pi),
    "robot_b": Pose(0, -3.0, 0.6, -0.2),
    "robot_c": Pose(0, -3.0, -0.6, 0.2),
}


class Team:
    """Robots that see all people in front of them, ten times a second; these walk in circles."""

    def __init__(self, *robots: str, tuning: ContradictionsTuning = CONTRADICTIONS_TUNING) -> None:
        self.true = {name: ROBOTS[name] for name in robots}
        self.people = dict.fromkeys(robots, GROUP)
        self.told = dict(self.true)
        self.walls: Walls | None = None
        #: How fast people go round [rad/s].
        self.turns = 0.5
        #: By robot: from where on it sees nobody, by how much people are too far [m], and the
        #: standard deviation that it states along its line of sight [m].
        self.reach = dict.fromkeys(robots, 10.0)
        self.off = dict.fromkeys(robots, (0.0, 0.1))
        self.now_s = 0.0
        self._contradictions = Contradictions(tuning)
        self._rng = np.random.default_rng(1)

    def runs(self, seconds: float) -> set[str]:
        """Those who are contradicted at the end."""
        fits: dict[str, bool] = {}
        for _ in range(round(10 * seconds)):
            self.now_s += 0.1
            stamp_ns = round(1e9 * self.now_s)
            seen = {name: self._seen(name, stamp_ns) for name in self.true}
            poses = {
                name: dataclasses.replace(pose, stamp_ns=stamp_ns)
                for name, pose in self.told.items()
            }
            fits = self._contradictions.step(seen, poses, self.walls)
        assert set(fits) <= set(self.true)
        return {name for name, fit in fits.items() if not fit}

    def _seen(self, name: str, stamp_ns: int) -> SeenPeople:
        pose = self.true[name]
        people = self.people[name] @ rotation_2d(self.turns * self.now_s)
        xy = (people - (pose.x, pose.y)) @ rotation_2d(pose.yaw)
        away, bearing = np.hypot(*xy.T), np.arctan2(xy[:, 1], xy[:, 0])
        seen = (np.abs(bearing) < 0.65) & (away < self.reach[name])
        along = xy[seen] / away[seen, np.newaxis]
        off, sigma = self.off[name]
        xy = xy[seen] + off * along + 0.05 * self._rng.normal(size=(seen.sum(), 2))
        outer = along[:, :, np.newaxis] * along[:, np.newaxis]
        return SeenPeople(stamp_ns, xy, 0.01 * np.eye(2) + (sigma**2 - 0.01) * outer)

    def turn(self, name: str, by: float) -> None:
        """A robot is turned, and does not know."""
        pose = self.true[name]
        self.true[name] = dataclasses.replace(pose, yaw=pose.yaw + by)


def test_robots_at_their_places_do_not_contradict_each_other():
    team = Team(*ROBOTS)
    assert not any(team.runs(1.0) for _ in range(10))


@pytest.mark.parametrize("name", sorted(ROBOTS))
@pytest.mark.parametrize("degrees", [25, -25, 40])
def test_robot_that_was_turned_is_named_in_3_s_and_until_it_agrees_again(name, degrees):
    team = Team(*ROBOTS)
    team.runs(40.0)
    team.turn(name, math.radians(degrees))
    assert team.runs(3.0) == {name}
    assert team.runs(1.0) == {name}
    team.told[name] = team.true[name]
    assert team.runs(1.5) == set()


@pytest.mark.parametrize(("sigma", "named"), [(0.3, set()), (0.1, {"robot_a"})])
def test_people_may_be_elsewhere_by_as_much_as_their_covariances_say(sigma, named):
    team = Team(*ROBOTS)
    team.runs(15.0)
    team.off["robot_a"] = 0.55, sigma
    assert team.runs(3.0) == named


@pytest.mark.parametrize(("reach", "named"), [(0.8, set()), (1.0, {"robot_a"})])
def test_people_near_the_end_of_what_a_robot_sees_may_be_missed(reach, named):
    team = Team(*ROBOTS, tuning=ContradictionsTuning(reach=reach))
    assert team.runs(15.0) == set()
    team.turns = 0.0
    team.people = dict.fromkeys(ROBOTS, np.array([[-2.0, 0.0], [2.0, 0.5], [2.0, -0.5]]))
    assert team.runs(5.0) == set()
    team.reach = dict.fromkeys(ROBOTS, 4.2)
    assert team.runs(3.0) == named


@pytest.mark.parametrize(("known", "named"), [(True, set()), (False, {"robot_a"})])
def test_nobody_is_seen_through_walls_that_are_known(known, named):
    team = Team(*ROBOTS)
    team.turns = 0.0
    everybody = np.array([[-1.5, 1.0], [-1.5, -1.0], [0.4, 0.5], [0.4, -0.5], [2.0, 0.0]])
    team.people = {"robot_a": everybody, "robot_b": everybody, "robot_c": everybody}
    assert team.runs(5.0) == set()
    team.people = {"robot_a": everybody[2:4], "robot_b": everybody[:2], "robot_c": everybody[:2]}
    occupied = np.zeros((100, 100), np.int8)
    occupied[:, 50] = 100  # across, through the origin
    if known:
        team.walls = Walls(OccupancyGrid(0.1, -5.05, -5.0, 0.0, occupied), occupied_from=65)
    assert team.runs(3.0) == named


def test_two_robots_cannot_tell_which_one_is_wrong():
    team = Team("robot_a", "robot_b")
    team.runs(15.0)
    team.turn("robot_b", math.radians(40.0))
    assert team.runs(3.0) == set()


def test_robot_that_nobody_can_contradict_stays():
    """It looks where no other one has ever seen anybody."""
    team = Team(*ROBOTS)
    team.runs(15.0)
    team.true["robot_b"] = team.told["robot_b"] = Pose(0, -3.0, 0.6, math.pi)
    team.people["robot_b"] = GROUP[:2] - [6.0, 0.0]
    assert team.runs(3.0) == set()


def test_what_looks_like_a_person_from_one_side_parts_nobody_for_long():
    team = Team(*ROBOTS)
    team.runs(15.0)
    for name in ROBOTS:
        team.people[name] = GROUP[[2, 3]]
    team.people["robot_b"] = GROUP[:1]
    assert team.runs(1.5) == {"robot_b"}
    assert team.runs(20.0) == set()
    team.people["robot_b"] = GROUP
    assert team.runs(5.0) == set()
    team.people["robot_b"] = GROUP[:1]
    assert team.runs(1.5) == {"robot_b"}
