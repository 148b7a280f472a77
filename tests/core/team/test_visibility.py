"""Whom robots have in view, after detections at known places."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrs_people_loc.team.masking import OccupancyGrid, Walls
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.team.visibility import FieldsOfView

AHEAD = {"a": Pose(0, 0.0, 0.0, 0.0)}


#: Bearings of detections: straight ahead, and on both sides [rad].
BEARINGS = np.radians([-4.0, 1.0, 6.0])


def learn(views, robot, poses, away):
    """People have been detected at some distances and bearings."""
    at = poses[robot]
    away, bearings = np.repeat(away, len(BEARINGS)), np.tile(BEARINGS + at.yaw, len(away))
    xy = np.column_stack([at.x + away * np.cos(bearings), at.y + away * np.sin(bearings)])
    views.learn([robot] * len(xy), xy, poses)


@pytest.fixture
def views():
    """People have been detected ahead of the robot, at 1 to 4 m."""
    made = FieldsOfView()
    learn(made, "a", AHEAD, [1.0, 4.0])
    return made


def are_seen(views, places, *, people=(), looking=AHEAD, robots=None, walls=None):
    xy = np.array(places, dtype=float)
    everybody = np.concatenate([xy, np.array(people, dtype=float).reshape(-1, 2)])
    own = np.arange(len(xy))
    robots = robots or looking
    return views.are_seen(xy, everybody, own, looking=looking, robots=robots, walls=walls).tolist()


@pytest.mark.parametrize(
    ("place", "seen"),
    [
        ((2.0, 0.05), True),
        ((0.9, 0.02), False),  # nearer than anybody so far
        ((4.2, 0.1), False),
        ((2.0, 1.0), False),  # nobody was ever detected at this bearing
        ((-2.0, 0.0), False),
    ],
)
def test_people_are_seen_where_some_were_detected_before(views, place, seen):
    assert are_seen(views, [place]) == [seen]


def test_nobody_is_seen_for_sure_at_the_edge_of_the_view(views):
    inside, outside = [(2 * math.cos(a), 2 * math.sin(a)) for a in BEARINGS[1:]]
    assert are_seen(views, [inside, outside]) == [True, False]


def test_fields_of_view_turn_with_the_robot(views):
    turned = {"a": Pose(0, 5.0, 5.0, math.pi / 2)}
    assert are_seen(views, [(4.95, 7.0), (7.0, 5.05)], looking=turned) == [True, False]


def test_people_and_robots_hide_people(views):
    assert are_seen(views, [(3.0, 0.05)], people=[(1.5, 0.02)]) == [False]
    assert are_seen(views, [(3.0, 0.05)], people=[(3.5, 0.0)]) == [True]
    mate = {**AHEAD, "b": Pose(0, 1.5, 0.02, 0.0)}
    assert are_seen(views, [(3.0, 0.05)], robots=mate) == [False]


def test_another_robot_sees_who_is_hidden_from_the_first(views):
    both = {**AHEAD, "b": Pose(0, 5.0, 0.0, math.pi)}
    assert are_seen(views, [(3.0, 0.05)], people=[(1.5, 0.02)], looking=both) == [False]
    learn(views, "b", both, [1.0, 3.0])
    assert are_seen(views, [(3.0, -0.05)], people=[(1.5, -0.02)], looking=both) == [True]
    # It has sent no scan in this interval.
    assert are_seen(views, [(3.0, -0.05)], people=[(1.5, -0.02)], robots=both) == [False]


def test_people_do_not_hide_themselves_elsewhere(views):
    """Somebody is looked for behind the place where they are expected; another one is hidden."""
    where = np.array([[3.0, 0.05], [3.0, 0.05]])
    people = np.array([[1.5, 0.02], [3.5, 2.0]])
    seen = views.are_seen(where, people, np.array([0, 1]), looking=AHEAD, robots=AHEAD)
    assert seen.tolist() == [True, False]


def test_walls_hide_people(views):
    """A wall across the view 2.5 m ahead, with a door at its left end."""
    data = np.zeros((40, 60), dtype=np.int8)
    data[:21, 25] = 100
    walls = Walls(OccupancyGrid(0.1, 0.0, -2.0, 0.0, data), occupied_from=65)
    places = [(2.0, 0.05), (2.4, 0.05), (3.0, 0.05)]
    assert are_seen(views, places[:1], walls=walls) == [True]
    assert are_seen(views, places[1:2], walls=walls) == [True]  # beside the wall
    assert are_seen(views, places[2:], walls=walls) == [False]
    assert are_seen(views, [(3.0, 0.25)], walls=walls) == [True]  # through the door
    assert are_seen(views, places[2:]) == [True]


def test_nobody_and_no_robot():
    assert are_seen(FieldsOfView(), np.empty((0, 2))) == []
    assert are_seen(FieldsOfView(), [(1.0, 0.0)], looking={}) == [False]
