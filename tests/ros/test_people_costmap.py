"""Costs around people, cell by cell."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from nav_msgs.msg import MapMetaData
from std_msgs.msg import Header

from mrs_people_loc.people import Person
from mrs_people_loc.team.masking import OccupancyGrid as Grid
from planner_node.others.costmap import AHEAD_S, LETHAL, RADIUS_M, UNKNOWN, costs, occupancy_grid

EXACT = np.zeros((2, 2))
#: 4 x 3 m in cells of 5 cm from (-1, -1) on.
GRID = Grid(0.05, -1.0, -1.0, 0.0, np.zeros((60, 80), np.int8))


def person(
    x: float = 0.025,
    y: float = 0.025,
    velocity: tuple[float, float] | None = None,
    covariance: np.ndarray = EXACT,
    spread: float = 0.0,
) -> Person:
    """Somebody, by default in the middle of a cell, with an exact velocity or none."""
    made = Person(np.array([x, y]), covariance, 1.7, 0.1, (), -1, id=1)
    if velocity is None:
        return made
    uncertain = spread**2 * np.eye(2)
    return dataclasses.replace(made, velocity=np.array(velocity), velocity_covariance=uncertain)


def cost(made: np.ndarray, x: float, y: float) -> int:
    """Of the cell at a place of `GRID`'s frame."""
    return int(made[math.floor((y + 1.0) / 0.05), math.floor((x + 1.0) / 0.05)])


def test_cost_is_lethal_on_the_body_and_falls_as_a_gaussian_from_its_edge() -> None:
    made = costs([person()], GRID)
    assert made.dtype == np.int8
    assert made.shape == (60, 80)
    assert cost(made, 0.025, 0.025) == cost(made, 0.275, 0.025) == LETHAL
    # 0.525 - 0.255 = 0.27 m from the edge: 0.9 sigma of 0.3 m.
    assert cost(made, 0.525, 0.025) == round(98 * math.exp(-0.5 * ((0.5 - RADIUS_M) / 0.3) ** 2))
    assert cost(made, 1.225, 0.025) == UNKNOWN  # beyond 3 sigma
    np.testing.assert_array_equal(made[:41, :41], made[:41, :41].T)  # it is round


def test_covariance_widens_costs_along_its_long_axis() -> None:
    made = costs([person(covariance=np.diag([0.16, 0.0]))], GRID)
    beside = 0.5 - RADIUS_M
    assert cost(made, 0.525, 0.025) == round(98 * math.exp(-0.5 * (beside / 0.5) ** 2))
    assert cost(made, 0.025, 0.525) == round(98 * math.exp(-0.5 * (beside / 0.3) ** 2))


def test_person_who_walks_costs_half_where_they_are_a_second_later() -> None:
    made = costs([person(velocity=(1.0, 0.0))], GRID)
    assert AHEAD_S == 1.0
    assert cost(made, 0.025, 0.025) == LETHAL
    assert cost(made, 0.425, 0.025) == round(98 * 0.8)
    assert cost(made, 1.025, 0.025) == cost(made, 1.225, 0.025) == 49
    assert cost(made, -0.475, 0.025) == cost(costs([person()], GRID), -0.475, 0.025)
    # Where they walk to is as uncertain as the velocity: 0.4 m in a second, and 0.3 m.
    wide = costs([person(velocity=(1.0, 0.0), spread=0.4)], GRID)
    beside = 0.5 - RADIUS_M
    assert cost(wide, 1.025, 0.525) == round(49 * math.exp(-0.5 * (beside / 0.5) ** 2))


def test_costs_of_several_people_are_the_highest_and_nobody_costs_nothing() -> None:
    assert (costs([], GRID) == UNKNOWN).all()
    one, other = person(), person(0.625, 0.025)
    both = np.maximum(costs([one], GRID), costs([other], GRID))
    np.testing.assert_array_equal(costs([one, other], GRID), both)


def test_costs_of_a_turned_grid_are_those_of_the_same_places() -> None:
    """A quarter turn about the corner of both."""
    turned = Grid(0.05, -1.0, -1.0, math.pi / 2.0, np.zeros((60, 80), np.int8))
    walker = person(0.325, -0.225, velocity=(0.8, 0.2), covariance=np.diag([0.04, 0.01]))
    # What is (1 + a, 1 + b) from the corner for one grid is (-1 - b, 1 + a) for the other.
    same = person(-1.775, 0.325, velocity=(-0.2, 0.8), covariance=np.diag([0.01, 0.04]))
    np.testing.assert_array_equal(costs([same], turned), costs([walker], GRID))


def test_people_off_the_map_are_left_out() -> None:
    np.testing.assert_array_equal(
        costs([person(50.0, 0.0), person(), person(0.0, -50.0)], GRID), costs([person()], GRID)
    )


def test_costs_stay_near_a_person_whose_place_is_unknown() -> None:
    wide = Grid(0.5, -20.0, -20.0, 0.0, np.zeros((80, 80), np.int8))
    made = costs([person(0.25, 0.25, covariance=1e6 * np.eye(2))], wide)
    rows, columns = np.nonzero(made > UNKNOWN)
    assert np.hypot(rows - 40, columns - 40).max() * 0.5 <= 3.0 + RADIUS_M


def test_message_has_the_geometry_of_the_map() -> None:
    info = MapMetaData(resolution=0.05, width=80, height=60)
    info.origin.position.x = info.origin.position.y = -1.0
    made = occupancy_grid(Header(frame_id="map"), info, GRID, [person()])
    assert (made.info, made.header.frame_id) == (info, "map")
    np.testing.assert_array_equal(np.reshape(made.data, (60, 80)), costs([person()], GRID))
