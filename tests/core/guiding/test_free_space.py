import math

import numpy as np
import pytest

from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.team.masking import OccupancyGrid


def grid_of(
    size: tuple[float, float], boxes: list, resolution: float = 0.05, yaw: float = 0.0
) -> OccupancyGrid:
    """A room of `size` with walls along its edges and boxes (x0, y0, x1, y1, value)."""
    data = np.zeros((round(size[1] / resolution), round(size[0] / resolution)), dtype=np.int8)
    data[[0, -1]] = data[:, [0, -1]] = 100
    for x0, y0, x1, y1, value in boxes:
        rows, columns = (
            slice(round(a / resolution), round(b / resolution)) for a, b in ((y0, y1), (x0, x1))
        )
        data[rows, columns] = value
    return OccupancyGrid(resolution, 0.0, 0.0, yaw, data)


def length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def dense(path: np.ndarray) -> np.ndarray:
    at = np.linspace(0, len(path) - 1, 400)
    return np.stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in (0, 1)], axis=1)


#: Two rooms with a door of 1 m, from y = 2.5 to 3.5.
ROOMS = FreeSpace(
    grid_of((10.0, 6.0), [(5.0, 0.0, 5.2, 2.5, 100), (5.0, 3.5, 5.2, 6.0, 100)]), occupied_from=65
)


def test_clearance_matches_hand_computed_values() -> None:
    places = np.array([[2.0, 1.0], [5.1, 3.0], [5.1, 1.0], [-1.0, 3.0]])
    assert ROOMS.clearance(places) == pytest.approx([0.95, 0.5, -0.1, -1.05], abs=0.03)
    assert ROOMS.clearance(places[0]).shape == ()
    assert FreeSpace.unbounded().clearance(places).min() == math.inf


def test_walls_hide_what_is_behind_them() -> None:
    here = np.array([1.0, 1.0])
    there = np.array([[9.0, 1.0], [9.0, 5.0], [4.0, 1.0], [5.1, 1.0]])
    assert ROOMS.is_visible(here, there).tolist() == [False, True, True, True]


def test_path_leads_through_the_door_where_the_robot_fits() -> None:
    start, goal = np.array([1.0, 1.0]), np.array([9.0, 1.0])
    path = ROOMS.path(start, goal, 0.35)
    assert path is not None
    assert path[[0, -1]] == pytest.approx(np.stack([start, goal]))
    assert ROOMS.clearance(dense(path)).min() > 0.42
    assert length(path) < 9.6  # 8.9 m touch both corners of the door
    assert ROOMS.path(start, goal, 0.55) is None
