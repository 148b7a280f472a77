import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.geometry import rotation_2d
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


def test_path_prefers_clearance_and_touches_no_corner() -> None:
    around = FreeSpace(grid_of((8.0, 8.0), [(3.0, 3.0, 5.0, 5.0, 100)]), occupied_from=65)
    path = around.path(np.array([1.0, 4.0]), np.array([7.0, 4.2]), 0.35)
    assert path is not None
    assert around.clearance(dense(path)).min() > 0.45
    assert dense(path)[:, 1].max() > 5.0  # the shorter side


def test_people_are_gone_round_where_there_is_room_and_else_walked_up_to() -> None:
    start, goal, disc = np.array([1.0, 1.0]), np.array([5.0, 1.0]), np.array([[3.0, 1.05, 0.8]])
    for space in (FreeSpace.unbounded(), FreeSpace(grid_of((6.0, 4.0), []), occupied_from=65)):
        path = space.path(start, goal, 0.35, disc)
        assert path is not None
        assert np.linalg.norm(dense(path) - disc[0, :2], axis=1).min() > 0.75
        assert length(path) < 4.8
    corridor = FreeSpace(grid_of((6.0, 2.0), []), occupied_from=65)
    path = corridor.path(start, goal, 0.35, disc)
    assert path is not None
    assert length(path) < 4.5


def test_path_stays_on_its_side_of_somebody_until_the_other_one_is_much_shorter() -> None:
    space, here, goal = FreeSpace.unbounded(), np.array([0.5, 0.0]), np.array([6.0, 0.0])

    def side(disc: list[float], before: np.ndarray | None = None) -> float:
        path = space.path(here, goal, 0.4, np.array([disc]), before)
        assert path is not None
        assert (path[0] == here).all()
        return float(path[np.abs(path[:, 1]).argmax(), 1])

    left = space.path(np.array([0.0, 0.0]), goal, 0.4, np.array([[3.0, -0.1, 0.8]]))
    assert side([3.0, 0.1, 0.6]) < 0.0
    assert side([3.0, 0.1, 0.6], left) > 0.0
    assert side([3.0, 1.5, 2.2], left) < 0.0


def test_start_too_near_to_a_wall_has_a_way_out() -> None:
    goal = np.array([9.0, 3.0])
    for start in ([0.1, 3.0], [4.95, 1.0], [0.02, 0.02]):
        path = ROOMS.path(np.array(start), goal, 0.35)
        assert path is not None
        clearance = ROOMS.clearance(dense(path))
        assert clearance.min() > -0.06
        far = np.linalg.norm(dense(path) - start, axis=1) > 1.0
        assert clearance[far].min() > 0.35
    # Not through a thin wall, however near.
    thin = FreeSpace(grid_of((6.0, 6.0), [(3.0, 0.0, 3.05, 5.0, 100)]), occupied_from=65)
    path = thin.path(np.array([2.9, 1.0]), np.array([3.8, 1.0]), 0.35)
    assert path is not None
    assert length(path) > 8.0
    # Out of a niche of 0.6 m by its open end.
    boxes = [(3.0, 0.0, 3.05, 5.0, 100), (2.0, 0.0, 2.4, 2.0, 100)]
    niche = FreeSpace(grid_of((6.0, 6.0), boxes), occupied_from=65)
    path = niche.path(np.array([2.7, 1.3]), np.array([1.0, 3.0]), 0.35)
    assert path is not None
    assert length(path) < 3.5


def test_goal_in_a_wall_or_another_room_has_no_path() -> None:
    closed = FreeSpace(grid_of((10.0, 6.0), [(5.0, 0.0, 5.2, 6.0, 100)]), occupied_from=65)
    start = np.array([1.0, 1.0])
    for goal in ([5.1, 1.0], [4.8, 1.0], [9.0, 1.0], [12.0, 1.0]):
        assert closed.path(start, np.array(goal), 0.35) is None


def test_unknown_floor_is_not_free_and_hides_nothing() -> None:
    space = FreeSpace(grid_of((6.0, 4.0), [(2.0, 0.0, 4.0, 4.0, -1)]), occupied_from=65)
    here, there = np.array([1.0, 2.0]), np.array([5.0, 2.0])
    assert space.clearance(np.array([3.0, 2.0])) < 0.0
    assert space.path(here, there, 0.35) is None
    assert space.is_visible(here, there)
    # Occupied only from the value on that counts as such.
    doubtful = grid_of((6.0, 4.0), [(2.0, 0.0, 4.0, 4.0, 60)])
    assert FreeSpace(doubtful, occupied_from=65).path(here, there, 0.35) is not None
    assert FreeSpace(doubtful, occupied_from=50).path(here, there, 0.35) is None


def test_turned_and_cropped_maps_say_the_same() -> None:
    grid = grid_of((10.0, 6.0), [(5.0, 0.0, 5.2, 2.5, 100)])
    yaw, rng = 0.7, np.random.default_rng(0)
    turn = rotation_2d(yaw)
    a, b = rng.uniform((0.0, 0.0), (10.0, 6.0), (2, 50, 2))
    plain = FreeSpace(grid, occupied_from=65)
    moved = FreeSpace(
        OccupancyGrid(grid.resolution, 3.0, -2.0, yaw, grid.data),
        occupied_from=65,
        around=a @ turn.T + (3.0, -2.0),
    )
    offset = np.array([3.0, -2.0])
    assert moved.clearance(a @ turn.T + offset) == pytest.approx(plain.clearance(a), abs=1e-6)
    same = moved.is_visible(a @ turn.T + offset, b @ turn.T + offset) == plain.is_visible(a, b)
    assert same.mean() > 0.95  # rays that touch a corner may differ
    wide = grid_of((60.0, 6.0), [(20.0, 0.0, 20.2, 6.0, 100)])
    near = FreeSpace(wide, occupied_from=65, around=np.array([[2.0, 3.0], [4.0, 3.0]]))
    assert near.clearance(a) == pytest.approx(FreeSpace(wide, occupied_from=65).clearance(a))
    assert near.clearance(np.array([18.0, 3.0])) < 0.0  # beyond what matters


@given(st.lists(st.tuples(st.floats(-3, 12), st.floats(-3, 9)), min_size=2, max_size=9))
def test_distances_change_no_faster_than_places(places: list[tuple[float, float]]) -> None:
    xy = np.array(places)
    apart = np.linalg.norm(xy[:, np.newaxis] - xy, axis=2)
    differs = np.abs(np.subtract.outer(ROOMS.clearance(xy), ROOMS.clearance(xy)))
    assert (differs <= 1.1 * apart + 0.08).all()
