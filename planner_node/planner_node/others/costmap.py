"""Costs around people, now and where they walk, as Nav2's costmaps take them."""

from __future__ import annotations

import array
from collections.abc import Iterable

import numpy as np
from nav_msgs.msg import MapMetaData, OccupancyGrid
from numpy.typing import NDArray
from std_msgs.msg import Header

from mrs_people_loc.anthropometry import SHOULDER_BREADTH
from mrs_people_loc.arrays import Float
from mrs_people_loc.people import Person
from mrs_people_loc.team.masking import OccupancyGrid as Grid

#: Cells where nothing is known of people: Nav2 leaves what other layers say of them.
UNKNOWN = -1
#: Of cells that a body covers now; beside it, at most. Nav2 takes 99 for an inflated obstacle.
LETHAL, _HIGHEST = 100, 98
#: Radius of a body [m].
RADIUS_M = SHOULDER_BREADTH / 2.0
#: People are avoided by so much, even where their place is exact: standard deviation [m].
_APART_M = 0.3
#: Costs reach so many sigmas, and never farther than this from a body [m].
_SIGMAS, _REACH_M = 3.0, 3.0
#: So far ahead along the velocity [s]; a person is half as costly there as now.
AHEAD_S = 1.0
_AHEAD_COST = 0.5


def costs(persons: Iterable[Person], grid: Grid) -> NDArray[np.int8]:
    """Costs of a floor with people.

    100 within the radius of a body. Around it, and around where it walks within `AHEAD_S`, up to
    98, falling as a Gaussian with the distance from the body's edge, by the covariance of the
    position at that time and an additional 0.3 m. -1 elsewhere.

    Args:
        persons: The people, in the frame that the grid lies in.
        grid: Its geometry.

    Returns:
        int8, shape (height, width), as `grid.data`.
    """
    made = np.full(grid.data.shape, UNKNOWN, dtype=np.int8)
    c, s = np.cos(grid.yaw), np.sin(grid.yaw)
    grid_from_map = np.array([[c, s], [-s, c]])
    for person in persons:
        _add(made, person, grid_from_map, np.array([grid.x, grid.y]), grid.resolution)
    return made


def _add(
    made: NDArray[np.int8], person: Person, turn: Float, corner: Float, resolution: float
) -> None:
    """Raises the cells around a person.

    Args:
        made: The costs so far.
        person: The person.
        turn: From the map's axes to the grid's, shape (2, 2).
        corner: Of cell (0, 0) on the map [m], shape (2,).
        resolution: Side of a cell [m].
    """
    way, spread = np.zeros(2), np.zeros((2, 2))
    if person.velocity is not None and person.velocity_covariance is not None:
        way = AHEAD_S * turn @ person.velocity
        spread = AHEAD_S**2 * turn @ person.velocity_covariance @ turn.T
    place = turn @ (person.position - corner)
    known = turn @ person.covariance @ turn.T + _APART_M**2 * np.eye(2)
    widest = _SIGMAS * np.sqrt(np.linalg.eigvalsh(known + spread)[-1])
    reach = RADIUS_M + min(widest, _REACH_M)
    ends = np.array([place, place + way])
    size = np.array(made.shape[::-1])
    low = np.clip((ends.min(axis=0) - reach) / resolution, 0, size).astype(int)
    high = np.clip((ends.max(axis=0) + reach) / resolution + 1, 0, size).astype(int)
    if (low >= high).any():
        return
    x = (np.arange(low[0], high[0]) + 0.5) * resolution - place[0]
    y = (np.arange(low[1], high[1]) + 0.5) * resolution - place[1]
    box = made[low[1] : high[1], low[0] : high[0]]
    np.maximum(box, _costs_around(x, y[:, None], way, known, spread, reach), out=box)


def _costs_around(
    x: Float, y: Float, way: Float, known: Float, spread: Float, reach: float
) -> NDArray[np.int8]:
    """Costs of cells by their place relative to a person.

    Args:
        x: [m], shape (n,).
        y: [m], shape (m, 1).
        way: How far the person walks within `AHEAD_S` [m], shape (2,).
        known: Covariance at once [m^2], shape (2, 2).
        spread: What is added to it at the end of the way [m^2], shape (2, 2).
        reach: No cost is farther from the way [m].

    Returns:
        int8, shape (m, n).
    """
    length = float(way @ way)
    share = np.clip((x * way[0] + y * way[1]) / length, 0.0, 1.0) if length else 0.0 * (x + y)
    dx, dy = x - share * way[0], y - share * way[1]
    distance = np.hypot(dx, dy)
    beyond = np.maximum(distance - RADIUS_M, 0.0) / np.maximum(distance, 1e-9)
    a, b, d = (known[i] + share**2 * spread[i] for i in ((0, 0), (0, 1), (1, 1)))
    squared = beyond**2 * (d * dx**2 - 2.0 * b * dx * dy + a * dy**2) / (a * d - b * b)
    cost = _HIGHEST * (1.0 - (1.0 - _AHEAD_COST) * share) * np.exp(-0.5 * squared)
    cost[distance > reach] = 0.0
    cost[np.hypot(x, y) <= RADIUS_M] = LETHAL
    cost[cost < 1.0] = UNKNOWN
    return np.rint(cost).astype(np.int8)


def occupancy_grid(
    header: Header, info: MapMetaData, grid: Grid, persons: Iterable[Person]
) -> OccupancyGrid:
    """Costs of a floor with people as a message.

    Args:
        header: Stamp and frame.
        info: Geometry of the map, as it was received.
        grid: The map.
        persons: The people.
    """
    made = OccupancyGrid(header=header, info=info)
    made.data = array.array("b", costs(persons, grid).tobytes())
    return made
