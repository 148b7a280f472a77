"""Messages about where robots are."""

from __future__ import annotations

import copy
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc import messages
from mrs_people_loc.errors import PeopleLocError, PoseError, StampError
from mrs_people_loc.localization.shared import RelativePose, StandingPeople

NAN, INF = math.nan, math.inf
STAMP_NS = 12_500_000_000


def stamp(stamp_ns: int = STAMP_NS) -> SimpleNamespace:
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return SimpleNamespace(sec=sec, nanosec=nanosec)


def header(frame_id: str = "map", stamp_ns: int = STAMP_NS) -> SimpleNamespace:
    return SimpleNamespace(stamp=stamp(stamp_ns), frame_id=frame_id)


def pose(
    x: float = 1.0, y: float = 2.0, yaw: float = 0.5, variances: Any = (0.04, 0.09, 0.01)
) -> SimpleNamespace:
    covariance = np.zeros((6, 6))
    covariance[np.ix_((0, 1, 5), (0, 1, 5))] = np.diag(variances)
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    place = SimpleNamespace(x=x, y=y, z=0.0)
    return SimpleNamespace(
        pose=SimpleNamespace(position=place, orientation=turn), covariance=covariance.reshape(-1)
    )


def wall(**changes: Any) -> SimpleNamespace:
    values: dict[str, Any] = {
        "stamp": stamp(), "distance": 2.0, "bearing": 1.0, "covariance": [0.01, 0.002, 0.001],
        "from_m": -1.0, "to_m": 3.0, "ends_at_from": False, "ends_at_to": True,
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def team_pose(**changes: Any) -> SimpleNamespace:
    values: dict[str, Any] = {
        "header": header(), "robot": "robot_b", "pose": pose(), "odometry_x": 3.0,
        "odometry_y": -1.0, "odometry_yaw": 0.25, "position_variance": 0.5,
        "heading_variance": 0.125, "walls": [], "absolute": [], "status": 0, "doubted": [],
        "covariance_in_team": [0.01, 0.0, 0.0, 0.0, 0.02, 0.001, 0.0, 0.001, 0.004],
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def absolute(**changes: Any) -> SimpleNamespace:
    return SimpleNamespace(**{"header": header(stamp_ns=STAMP_NS - 10), "pose": pose()} | changes)


# ------------------------------------------------------------------------------- team_poses ----


def test_team_pose_has_the_values_of_the_message():
    told = messages.read_team_pose(team_pose(absolute=[absolute()]), "map")
    assert told.robot == "robot_b"
    assert (told.pose.stamp_ns, told.pose.x, told.pose.y) == (STAMP_NS, 1.0, 2.0)
    assert told.pose.yaw == pytest.approx(0.5)
    np.testing.assert_allclose(told.pose.covariance, np.diag([0.04, 0.09, 0.01]))
    odometry = told.odometry
    assert (odometry.stamp_ns, odometry.x, odometry.y, odometry.yaw) == (STAMP_NS, 3.0, -1.0, 0.25)
    assert (odometry.position_variance, odometry.heading_variance) == (0.5, 0.125)
    assert told.walls == ()
    (one,) = told.absolute
    assert (one.stamp_ns, one.x) == (STAMP_NS - 10, 1.0)
    assert (told.lost, told.doubted) == (False, ())


@pytest.mark.parametrize("status", [1, 2, 255])
def test_robot_of_unknown_status_is_lost(status):
    told = messages.read_team_pose(team_pose(status=status, doubted=["robot_c", "robot_a"]), "map")
    assert (told.lost, told.doubted) == (True, ("robot_c", "robot_a"))


def test_walls_are_grouped_by_their_stamps_in_order():
    later, earlier = stamp(), stamp(STAMP_NS - 100_000_000)
    walls = [
        wall(stamp=later, distance=1.0),
        wall(stamp=earlier, distance=2.0, bearing=1.0 + 2 * math.pi),
        wall(stamp=later, distance=3.0, ends_at_from=True, ends_at_to=False),
    ]
    first, second = messages.read_team_pose(team_pose(walls=walls), "map").walls
    assert (first.stamp_ns, second.stamp_ns) == (STAMP_NS - 100_000_000, STAMP_NS)
    np.testing.assert_array_equal(first.walls.distance, [2.0])
    np.testing.assert_allclose(first.walls.bearing, [1.0])
    np.testing.assert_array_equal(first.walls.covariance, [[[0.01, 0.002], [0.002, 0.001]]])
    np.testing.assert_array_equal(first.walls.extent, [[-1.0, 3.0]])
    np.testing.assert_array_equal(second.walls.distance, [1.0, 3.0])
    np.testing.assert_array_equal(second.walls.is_end, [[False, True], [True, False]])


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"header": header("odom")}, "frame_id is 'odom'; wanted: 'map'"),
        ({"robot": ""}, "name has 0 characters; wanted: 1 to 255"),
        ({"robot": "a" * 256}, "name has 256 characters"),
        ({"pose": pose(x=NAN)}, "pose holds NaN"),
        ({"pose": pose(variances=(NAN, 1.0, 1.0))}, "covariance"),
        ({"odometry_x": INF}, "odometry is .*inf.*; wanted: finite"),
        ({"odometry_yaw": NAN}, "odometry is .*nan"),
        ({"odometry_y": 1e9}, "odometry is .*within 2.1e"),
        ({"position_variance": -1e-9}, "variances of odometry are .*; wanted: from 0"),
        ({"heading_variance": 1e300}, "variances of odometry are"),
        ({"walls": [wall()] * 201}, "message has 201 walls; allowed: up to 200"),
        ({"doubted": ["robot_a"] * 101}, "message doubts 101 robots; allowed: 100"),
        ({"doubted": ["robot_a", ""]}, "name has 0 characters; wanted: 1 to 255"),
        ({"doubted": ["a" * 256]}, "name has 256 characters"),
        ({"absolute": [absolute()] * 101}, "message has 101 absolute poses"),
        ({"absolute": [absolute(header=header("odom"))]}, "frame_id is 'odom'"),
        (
            {"absolute": [absolute(header=header(stamp_ns=STAMP_NS - 6 * 10**9))]},
            "stamp of an absolute pose is -6.000 s from that of the message; allowed: 5 s",
        ),
        ({"walls": [wall(stamp=stamp(STAMP_NS + 6 * 10**9))]}, "stamp of a wall is 6.000 s"),
        ({"walls": [wall(), wall(distance=-0.1)]}, "negative distance"),
        ({"walls": [wall(from_m=2.0, to_m=1.0)]}, "ends before it begins"),
        ({"walls": [wall(bearing=NAN)]}, "a wall holds NaN"),
        ({"walls": [wall(covariance=[0.01, 0.0, 0.0])]}, "covariance of a wall .*definite"),
        ({"walls": [wall(covariance=[1.0, 2.0, 1.0])]}, "covariance of a wall"),
    ],
)
def test_a_bad_team_pose_is_refused(changes, error):
    with pytest.raises(PoseError, match=error):
        messages.read_team_pose(team_pose(**changes), "map")


def test_pose_whose_correlation_exceeds_one_is_refused():
    message = team_pose()
    message.pose.covariance = message.pose.covariance.copy()
    message.pose.covariance[[1, 6]] = 0.1  # var x 0.04, var y 0.09: at most 0.06
    with pytest.raises(PoseError, match="covariance of pose is no covariance"):
        messages.read_team_pose(message, "map")


def test_team_pose_without_a_stamp_is_refused():
    with pytest.raises(StampError):
        messages.read_team_pose(team_pose(header=header(stamp_ns=0)), "map")


# --------------------------------------------------------------------------- relative_poses ----


def relative(**changes: Any) -> SimpleNamespace:
    values: dict[str, Any] = {
        "stamp": stamp(STAMP_NS - 5), "robot": "robot_a", "other_stamp": stamp(STAMP_NS - 7),
        "other": "robot_b", "x": 1.0, "y": -2.0, "yaw": 0.5,
        "covariance": np.diag([0.01, 0.02, 0.003]).reshape(-1), "inflated": 0.0,
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def standing(**changes: Any) -> SimpleNamespace:
    values: dict[str, Any] = {
        "stamp": stamp(STAMP_NS - 5), "robot": "robot_a", "x": 1.0, "y": -2.0,
        "covariance": [0.01, 0.002, 0.02], "inflated": 3.0,
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def relatives(*poses: Any, people: Any = (), stamp_ns: int = STAMP_NS) -> SimpleNamespace:
    return SimpleNamespace(
        header=header(stamp_ns=stamp_ns), poses=list(poses), standing=list(people)
    )


def test_relative_pose_has_the_values_of_the_message():
    (read,) = messages.read_relative_poses(relatives(relative(yaw=0.5 - 2 * math.pi)))
    assert isinstance(read, RelativePose)
    assert (read.robot, read.stamp_ns) == ("robot_a", STAMP_NS - 5)
    assert read.inflated == 1.0
    assert (read.other, read.other_stamp_ns) == ("robot_b", STAMP_NS - 7)
    np.testing.assert_allclose(read.pose, [1.0, -2.0, 0.5])
    np.testing.assert_array_equal(read.covariance, np.diag([0.01, 0.02, 0.003]))


def test_people_who_stand_come_by_robot_and_stamp():
    late = stamp(STAMP_NS - 9)
    people = standing(), standing(x=3.0), standing(stamp=late), standing(robot="robot_b")
    one, two, three = messages.read_relative_poses(relatives(people=people))
    assert isinstance(one, StandingPeople)
    assert (one.robot, one.stamp_ns, one.inflated) == ("robot_a", STAMP_NS - 5, 3.0)
    np.testing.assert_array_equal(one.xy, [(1.0, -2.0), (3.0, -2.0)])
    np.testing.assert_array_equal(one.covariance, [[[0.01, 0.002], [0.002, 0.02]]] * 2)
    assert (two.robot, two.stamp_ns) == ("robot_a", STAMP_NS - 9)
    assert three.robot == "robot_b"


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"robot": ""}, "name has 0 characters"),
        ({"x": NAN}, "people who stand are at .*nan"),
        ({"stamp": stamp(STAMP_NS - 12_500_000_000)}, "stamp of a person who stands is -12.500 s"),
        ({"covariance": [0.01, 0.02, 0.01]}, "covariance of a person who stands .*definite"),
        ({"inflated": 0.5}, "inflated is 0.5"),
        ({"inflated": NAN}, "inflated is nan"),
    ],
)
def test_a_person_who_cannot_stand_there_is_refused(changes, error):
    with pytest.raises(PoseError, match=error):
        messages.read_relative_poses(relatives(people=[standing(**changes)]))


def test_no_relative_poses_are_none():
    assert messages.read_relative_poses(relatives()) == ()


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"other": "robot_a"}, "robot_a has a pose relative to itself"),
        ({"other": ""}, "name has 0 characters"),
        ({"x": NAN}, "a relative pose is .*nan"),
        ({"y": 1e9}, "a relative pose is"),
        ({"stamp": stamp(0)}, "stamp of a relative pose is -12.500 s"),
        ({"covariance": [1.0] * 4}, "covariance of a relative pose has 4 values; wanted: 9"),
        ({"covariance": np.zeros(9)}, "covariance of a relative pose .*definite"),
        ({"covariance": np.arange(9.0)}, "covariance of a relative pose"),
        ({"covariance": np.full(9, NAN)}, "covariance of a relative pose"),
    ],
)
def test_a_bad_relative_pose_is_refused(changes, error):
    with pytest.raises(PoseError, match=error):
        messages.read_relative_poses(relatives(relative(), relative(**changes)))


# --------------------------------------------------------------------------- any values ----

numbers = st.floats() | st.sampled_from([0.0, 1.0, 1e308, -1e308])
names = st.sampled_from(
    ["odometry_x", "odometry_yaw", "position_variance", "heading_variance"]
)  # fmt: skip
of_walls = st.sampled_from(["distance", "bearing", "from_m", "to_m"])


@given(names, numbers, of_walls, numbers, st.lists(numbers, min_size=3, max_size=3))
def test_any_team_pose_is_read_or_refused(name, value, of_wall, length, covariance):
    message = team_pose(walls=[wall(), wall(**{of_wall: length, "covariance": covariance})])
    for made in (copy.copy(message), message):
        try:
            told = messages.read_team_pose(made, "map")
        except PeopleLocError:
            pass
        else:
            for seen in told.walls:
                assert (np.linalg.eigvalsh(seen.walls.covariance) > 0).all()
                assert (seen.walls.distance >= 0).all()
                assert (np.abs(seen.walls.bearing) <= math.pi).all()
        setattr(message, name, value)
