"""The state for the page, from messages: values worked out by hand."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mrs_people_loc.clusters import measure
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.guidance import Guidance, Post, Role
from mrs_people_loc.guiding.guidance import State as TourState
from mrs_people_loc.people import Group, Person
from mrs_people_loc.planner import People
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_tools.view.protocol import encode
from mrs_tools.view.state import HeadView, TeamState

SECOND = 1_000_000_000
WALKS = Person(
    position=np.array([1.25, -2.5]),
    covariance=np.array([[0.04, 0.01], [0.01, 0.09]]),
    height=1.75,
    sigma=0.125,
    robots=("robot_a",),
    label=-1,
    id=3,
    velocity=np.array([0.6, 0.8]),
    velocity_covariance=np.eye(2),
    age_s=12.5,
)
NEW = dataclasses.replace(
    WALKS, id=8, velocity=None, velocity_covariance=None, height=math.nan, age_s=0.0
)
GROUP = Group(
    centre=np.array([2.0, 1.0]),
    covariance=np.eye(2),
    radius=1.5,
    rms_spread=1.0,
    size=1,
    members=(8,),
    id=2,
    stragglers={3: 4.25},
)
POSE = Pose(5 * SECOND, 1.0, 2.0, math.pi / 2, np.diag([0.01, 0.02, 0.04]))


def message_of(
    stamp_ns: int, *persons: Person, groups: tuple[Group, ...] = (), pose: Pose = POSE
) -> Any:
    nothing = fuse([], {})
    clusters = measure(nothing, np.empty(0, dtype=np.intp))
    shown = tuple(person for person in persons if person.seen_at is None)
    hidden = tuple(person for person in persons if person.seen_at is not None)
    people = People(stamp_ns, {"robot_a": pose}, shown, groups, nothing, clusters, hidden=hidden)
    return convert.people(people, "map")


def test_people_groups_and_robots() -> None:
    team = TeamState()
    team.take_people(message_of(5 * SECOND, WALKS, NEW, groups=(GROUP,)), 1000.0)
    state = team.state(1000.25)  # of another clock than the stamps
    assert (state["t"], state["age"]) == (5.0, 0.25)
    walks, new = state["people"]
    assert walks == {
        "id": 3, "x": 1.25, "y": -2.5, "vx": 0.6, "vy": 0.8, "cov": [0.04, 0.01, 0.09],
        "height": 1.75, "age": 12.5, "seen_s": 0.0, "predicted": False,
        "seen_at": None, "group": 2, "straggler": True, "straggling_s": 4.2,
    }  # fmt: skip
    assert (new["vx"], new["height"], new["group"], new["straggler"]) == (None, None, 2, False)
    assert state["groups"] == [{"id": 2, "x": 2.0, "y": 1.0, "members": [8], "stragglers": [3]}]
    assert state["robots"] == [
        {
            "name": "robot_a", "x": 1.0, "y": 2.0, "yaw": 1.571, "cov": [0.01, 0.0, 0.02],
            "yaw_sigma": 0.2, "reach": None, "view": None, "view_yaw": None,
            "age": 0.25, "ok": True, "note": "",
        }
    ]  # fmt: skip
    assert json.loads(encode(state)) == state


def test_who_is_predicted_was_last_seen_some_time_ago() -> None:
    team = TeamState()
    hidden = dataclasses.replace(WALKS, coasting=True, robots=())
    team.take_people(message_of(5 * SECOND, hidden), 5.0)
    assert team.state(5.0)["people"][0]["seen_s"] is None  # nobody here has seen them
    team.take_people(message_of(6 * SECOND, WALKS), 6.0)
    team.take_people(message_of(8 * SECOND, hidden), 8.0)
    (person,) = team.state(8.0)["people"]
    assert (person["seen_s"], person["predicted"]) == (2.0, True)


def test_who_is_hidden_brings_along_when_and_where_they_were_seen() -> None:
    team = TeamState()
    seen_at = np.array([1.0, 2.0])
    hidden = dataclasses.replace(WALKS, coasting=True, stamp_ns=2 * SECOND, seen_at=seen_at)
    team.take_people(message_of(5 * SECOND, hidden), 5.0)
    (person,) = team.state(5.0)["people"]
    assert (person["seen_s"], person["seen_at"], person["predicted"]) == (3.0, [1.0, 2.0], True)


def test_robot_that_says_nothing_is_silent_and_one_with_an_error_is_not_well() -> None:
    team = TeamState()
    team.take_people(message_of(5 * SECOND, WALKS), 5.0)
    (robot,) = team.state(8.0)["robots"]
    assert (robot["age"], robot["ok"], robot["note"]) == (3.0, False, "sends no pose")
    team.notes = {"robot_a": "no images"}
    (robot,) = team.state(5.5)["robots"]
    assert (robot["ok"], robot["note"]) == (False, "no images")


def test_newest_pose_counts_whichever_topic_it_comes_by() -> None:
    team = TeamState()
    later = dataclasses.replace(POSE, stamp_ns=5_500_000_000, x=3.0)
    team.take_pose("robot_a", convert.pose_stamped(later, "map"), 5.0)
    team.take_people(message_of(5 * SECOND, WALKS), 5.0)
    assert team.state(6.0)["robots"][0]["x"] == 3.0
    # After a jump back of the time, what is older is newer.
    earlier = dataclasses.replace(POSE, stamp_ns=SECOND)
    team.take_people(message_of(1 * SECOND, WALKS, pose=earlier), 6.0)
    assert team.state(6.0)["robots"][0]["x"] == 1.0
    with pytest.raises(PeopleLocError, match="frame_id is 'odom'; wanted: 'map'"):
        team.take_pose("robot_a", convert.pose_stamped(later, "odom"), 6.0)


def test_message_that_cannot_be_used_changes_nothing() -> None:
    team = TeamState()
    team.take_people(message_of(5 * SECOND, WALKS), 5.0)
    twice = message_of(6 * SECOND, WALKS, WALKS)
    with pytest.raises(PeopleLocError, match="the id 3"):
        team.take_people(twice, 6.0)
    assert team.state(6.0)["t"] == 5.0


def test_tour_is_shown_until_a_while_after_its_end() -> None:
    team = TeamState()
    guidance = Guidance(
        stamp_ns=5 * SECOND,
        state=TourState.AT_STOP,
        reason="waits",
        stop="hall",
        way_m=3.0,
        length_m=12.0,
        lost=(4,),
        posts={"robot_a": Post(Role.LEADER, np.array([1.0, 2.0]), 0.5, 0.6)},
        faults={"robot_b": "its pose is outdated"},
    )
    team.take_status(convert.guide_status("museum", guidance, {"robot_a": POSE}, "map"), 5.0)
    tour = team.state(7.0)["tour"]
    assert tour == {
        "name": "museum", "state": "at_stop", "leader": "robot_a", "progress": 0.25,
        "way": 3.0, "length": 12.0, "stop": "hall", "message": "waits", "lost": [4], "age": 2.0,
        "posts": [{"robot": "robot_a", "x": 1.0, "y": 2.0, "yaw": 0.5, "role": "leader"}],
    }  # fmt: skip
    assert team.state(500.0)["tour"] is not None  # the guide may have died
    ended = dataclasses.replace(guidance, state=TourState.FINISHED)
    team.take_status(convert.guide_status("museum", ended, {}, "map"), 10.0)
    assert team.state(60.0)["tour"] is not None
    assert team.state(80.0)["tour"] is None


def test_view_of_a_head_whose_axis_is_not_in_the_middle() -> None:
    # 100 px to the left of the axis and 300 px to the right, at a focal length of 100 px.
    p = np.array([[100.0, 0, 100.0, 0], [0, 100.0, 50.0, 0], [0, 0, 1.0, 0]])
    camera = CameraModel(400, 100, np.eye(3), (), np.eye(3), p)
    view = HeadView.of(camera, 5.0, math.pi)
    left, right = math.pi / 4, math.atan(3.0)
    assert view.view == pytest.approx(left + right)
    assert view.yaw == pytest.approx(math.pi + (left - right) / 2)
