"""Who hides whom, by shares that are worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrs_people_loc.team.occlusion import hidden_by_people, hidden_by_robots

ORIGIN = np.zeros((1, 2))


def test_people_hide_people():
    # Of the same direction all; beside by 0.25 m at 2 m and seen from 4 m: half and little more.
    behind = hidden_by_people(ORIGIN, np.array([[2.0, 0.0], [4.0, 0.0]]))
    assert behind == pytest.approx(np.array([[0.0, 1.0]]))
    near, far = math.asin(0.25 / math.hypot(2.0, 0.25)), math.asin(0.25 / 4.0)
    turn = math.atan2(0.25, 2.0)
    half = hidden_by_people(ORIGIN, np.array([[2.0, 0.25], [4.0, 0.0]]))
    assert half[0, 1] == pytest.approx((near + far - turn) / (2.0 * far))
    # From both sides: what is hidden adds up, to all of it at most.
    both = hidden_by_people(ORIGIN, np.array([[2.0, 0.25], [2.0, -0.25], [4.0, 0.0]]))
    assert both[0, 2] == pytest.approx(1.0)
    assert hidden_by_people(ORIGIN, np.empty((0, 2))).shape == (1, 0)


def test_some_people_are_hidden_by_everybody():
    everybody = np.array([[2.0, 0.25], [2.0, -0.25], [4.0, 0.0], [3.0, 3.0]])
    all_of_them = hidden_by_people(ORIGIN, everybody)
    some = hidden_by_people(ORIGIN, everybody[2:], everybody)
    np.testing.assert_array_equal(some, all_of_them[:, 2:])
    assert hidden_by_people(ORIGIN, everybody[:1], np.empty((0, 2))) == [[0.0]]


def test_nobody_hides_themselves():
    people = np.array([[2.0, 0.0], [3.0, 3.0]])
    elsewhere = np.array([[4.0, 0.0], [4.0, 0.0]])
    hidden = hidden_by_people(ORIGIN, elsewhere, people, np.array([0, 1]))
    np.testing.assert_array_equal(hidden, [[0.0, 1.0]])


def test_a_robot_hides_the_middle_of_somebody_right_behind_it():
    places = np.array([[0.0, 0.0], [3.6, 0.0]])
    hidden = hidden_by_robots(places, np.array([[4.0, 0.0]]))
    assert hidden[0, 1, 0] == pytest.approx(math.asin(0.2 / 3.6) / math.asin(0.25 / 4.0))
    assert hidden[1, 0, 0] == hidden[0, 0, 0] == 0.0  # nobody hides somebody from behind, or itself


def test_robots_that_do_not_look_hide_people_too():
    looking, robots = np.array([[0.0, 0.0]]), np.array([[0.0, 0.0], [3.6, 0.0]])
    people = np.array([[4.0, 0.0]])
    hidden = hidden_by_robots(looking, people, robots)
    np.testing.assert_array_equal(hidden, hidden_by_robots(robots, people)[:1])
