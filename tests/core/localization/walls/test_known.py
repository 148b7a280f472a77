from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_loc.errors import ConfigError, GridError
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.localization.walls.known import read_walls, walls_of_grid
from mrs_people_loc.team.masking import OccupancyGrid

CELL = 0.05


# ---------------------------------------------------------------------------------------- files


def from_file(tmp_path: Path, text: str) -> Walls:
    path = tmp_path / "walls.yaml"
    path.write_text(text)
    return read_walls(path)


def ends(walls: Walls) -> np.ndarray:
    """Both ends of each wall in the map [m], shape (n, 2, 2)."""
    normal = np.stack([np.cos(walls.bearing), np.sin(walls.bearing)], axis=1)
    along = np.stack([-np.sin(walls.bearing), np.cos(walls.bearing)], axis=1)
    foot = walls.distance[:, np.newaxis] * normal
    return foot[:, np.newaxis] + walls.extent[:, :, np.newaxis] * along[:, np.newaxis]


def test_walls_of_a_file_match_hand_computed_values(tmp_path: Path) -> None:
    walls = from_file(
        tmp_path, "walls: [[2.0, -1.0, 2.0, 3.0], [2.0, 3.0, -4.0, 3.0], [0, -2, 5, -2]]"
    )
    np.testing.assert_allclose(walls.distance, [2.0, 3.0, 2.0])
    np.testing.assert_allclose(walls.bearing, [0.0, math.pi / 2, -math.pi / 2])
    # Along bearing + pi/2, which is y, -x and x.
    np.testing.assert_allclose(walls.extent, [[-1.0, 3.0], [-2.0, 4.0], [0.0, 5.0]])
    np.testing.assert_array_equal(walls.is_end, [[False, True], [True, False], [False, False]])


def test_covariance_is_that_of_both_ends(tmp_path: Path) -> None:
    """Drawn: lines through ends that are off by sigma."""
    walls = from_file(tmp_path, "{walls: [[10.0, 3.0, 14.0, 6.0]], sigma: 0.02}")
    drawn = np.array([[10.0, 3.0], [14.0, 6.0]]) + np.random.default_rng(1).normal(
        0.0, 0.02, (20_000, 2, 2)
    )
    way = drawn[:, 1] - drawn[:, 0]
    # The foot is right of the way from the begin to the end, or left of it.
    normal = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.hypot(*way.T)[:, np.newaxis]
    distance = (normal * drawn[:, 0]).sum(axis=1)
    sign = np.sign(distance.mean())
    bearing = np.arctan2(sign * normal[:, 1], sign * normal[:, 0])
    assert walls.distance[0] == pytest.approx((sign * distance).mean(), abs=1e-3)
    assert walls.bearing[0] == pytest.approx(bearing.mean(), abs=1e-3)
    np.testing.assert_allclose(
        walls.covariance[0], np.cov(np.stack([sign * distance, bearing])), rtol=0.05
    )


def test_wall_that_goes_on_in_line_has_no_end(tmp_path: Path) -> None:
    walls = from_file(tmp_path, "walls: [[0, 1, 4, 1], [4, 1, 9, 1]]")
    assert not walls.is_end.any()


def test_wall_that_runs_into_another_ends_there_and_the_other_does_not(tmp_path: Path) -> None:
    walls = from_file(tmp_path, "walls: [[0, 1, 8, 1], [4, 5, 4, 1]]")
    np.testing.assert_array_equal(walls.is_end[0], [False, False])
    assert walls.is_end[1].sum() == 1
    np.testing.assert_allclose(ends(walls)[1][walls.is_end[1]], [[4.0, 1.0]], atol=1e-9)


coordinate = st.floats(-50, 50)


@given(st.lists(st.tuples(coordinate, coordinate, coordinate, coordinate), min_size=1, max_size=5))
def test_normal_form_holds_the_ends(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]]
) -> None:
    rows = [row for row in rows if math.dist(row[:2], row[2:]) > 0.11] or [(0.0, 0.0, 1.0, 1.0)]
    text = f"walls: {[[float(f'{value:.4f}') for value in row] for row in rows]}"
    walls = from_file(tmp_path_factory.mktemp("walls"), text)
    assert (walls.distance >= 0).all()
    assert ((walls.bearing > -math.pi) & (walls.bearing <= math.pi)).all()
    assert (walls.extent[:, 0] < walls.extent[:, 1]).all()
    wanted = np.array(rows).reshape(-1, 2, 2)
    off = np.minimum(
        np.abs(ends(walls) - wanted).max(axis=(1, 2)),
        np.abs(ends(walls) - wanted[:, ::-1]).max(axis=(1, 2)),
    )
    assert off.max() < 1e-3


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("[1, 2]", "is no file of walls; wanted: `walls:` with"),
        ("lines: []", "is no file of walls"),
        ("walls: []", "walls is no list of 1 to 10000 lines"),
        ("walls: [[0, 0, 1]]", "walls[0] is [0, 0, 1]; wanted: [x0, y0, x1, y1]"),
        ("walls: [[0, 0, 1, 1], [0, 0, 1, .nan]]", "walls[1] is [0, 0, 1, nan]"),
        ("walls: [[0, 0, 1, true]]", "walls[0] is"),
        ("walls: [[0, 0, 1e9, 0]]", "numbers within 2.1e+07 m"),
        ("walls: [[0, 0, 3, 0], [1, 1, 1, 1.05]]", "walls[1] is 0.05 m long; wanted: at least 0.1"),
        ("{walls: [[0, 0, 3, 0]], sgma: 0.1}", "unknown key sgma; known: walls, sigma"),
        ("{walls: [[0, 0, 3, 0]], sigma: 0}", "sigma is 0 m; allowed: more than 0"),
        ("{walls: [[0, 0, 3, 0]], sigma: thin}", "sigma is 'thin'; wanted: a number"),
        ("walls: [", "cannot be read as a YAML file"),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, text: str, error: str) -> None:
    with pytest.raises(ConfigError) as err:
        from_file(tmp_path, text)
    assert str(err.value).startswith(str(tmp_path / "walls.yaml"))
    assert error in str(err.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere.yaml"):
        read_walls(tmp_path / "nowhere.yaml")


# ---------------------------------------------------------------------------------------- grids


def room(
    length: float, width: float, yaw: float, *, thickness: float = 0.1, flaws: float = 0.0
) -> OccupancyGrid:
    """A room about the origin, in walls; of a share of the cells of and at walls nothing is right.

    Its frame is turned, so that the grid's pose counts.
    """
    rng = np.random.default_rng(1)
    half = math.hypot(length, width) / 2 + 0.5
    at = (np.arange(int(2 * half / CELL)) + 0.5) * CELL - half
    x, y = np.meshgrid(at, at)
    u, v = (
        np.abs(math.cos(yaw) * x + math.sin(yaw) * y),
        np.abs(math.cos(yaw) * y - math.sin(yaw) * x),
    )
    inside = (u < length / 2) & (v < width / 2)
    wall = ~inside & (u < length / 2 + thickness) & (v < width / 2 + thickness)
    data = np.where(inside, 0, np.where(wall, 100, -1)).astype(np.int8)
    flawed = rng.random(data.shape) < flaws
    beside = inside & (np.roll(wall, 1, 0) | np.roll(wall, 1, 1) | np.roll(wall, -1, 0))
    data[flawed & wall], data[flawed & beside] = -1, 100
    turn = np.array([[math.cos(0.3), -math.sin(0.3)], [math.sin(0.3), math.cos(0.3)]])
    x0, y0 = turn @ (-half, -half)
    return OccupancyGrid(CELL, float(x0), float(y0), 0.3, data)


@settings(max_examples=30, deadline=None)
@given(st.floats(2.0, 8.0), st.floats(2.0, 8.0), st.floats(-3.0, 3.0), st.sampled_from([0.0, 0.1]))
def test_walls_of_a_room_are_found_to_within_a_cell(
    length: float, width: float, yaw: float, flaws: float
) -> None:
    walls = walls_of_grid(room(length, width, yaw, flaws=flaws), occupied_from=65)
    true = [
        (half / 2, yaw + 0.3 + turn)
        for half, turn in (
            (length, 0.0), (width, math.pi / 2), (length, math.pi), (width, -math.pi / 2)
        )
    ]  # fmt: skip
    hit = set()
    for k in range(len(walls)):
        off = np.array(
            [
                (walls.distance[k] - d, math.remainder(walls.bearing[k] - b, 2 * math.pi))
                for d, b in true
            ]
        )
        nees = np.einsum("ni,nij,nj->n", off, np.linalg.inv(walls.covariance[[k] * 4]), off)
        assert nees.min() < 14  # 0.999
        wall = int(nees.argmin())
        side = width if wall in (0, 2) else length
        assert walls.extent[k, 1] - walls.extent[k, 0] < side + 4 * CELL
        hit.add(wall)
    assert hit == {0, 1, 2, 3}


def test_walls_that_are_turned_a_little_from_the_grid_are_all_found() -> None:
    for yaw in np.radians(np.linspace(-2.0, 2.0, 81)):
        walls = walls_of_grid(room(7.58, 2.07, float(yaw)), occupied_from=65)
        sides = walls.extent[:, 1] - walls.extent[:, 0]
        np.testing.assert_allclose(np.sort(sides), [2.07, 2.07, 7.58, 7.58], atol=4 * CELL)


def test_both_faces_of_a_thin_wall_are_two_walls() -> None:
    data = np.zeros((60, 80), dtype=np.int8)
    data[30:32, 10:70] = 100
    walls = walls_of_grid(OccupancyGrid(CELL, 0.0, 0.0, 0.0, data), occupied_from=65)
    np.testing.assert_allclose(np.sort(walls.distance), [1.5, 1.6], atol=1e-9)
    np.testing.assert_allclose(np.sort(ends(walls)[..., 0], axis=1), [[0.5, 3.5]] * 2, atol=1e-9)


def test_wall_with_a_door_is_one_and_with_a_gate_two() -> None:
    data = np.zeros((40, 200), dtype=np.int8)
    data[30:, :] = 100
    data[30:, 60:80] = 0  # 1 m
    door = walls_of_grid(OccupancyGrid(CELL, 0.0, 0.0, 0.0, data), occupied_from=65)
    data[30:, 60:100] = 0  # 2 m
    gate = walls_of_grid(OccupancyGrid(CELL, 0.0, 0.0, 0.0, data), occupied_from=65)
    along = [np.abs(np.sin(walls.bearing)) > 0.99 for walls in (door, gate)]
    assert [int(k.sum()) for k in along] == [1, 2]
    np.testing.assert_allclose(door.distance[along[0]], 1.5, atol=1e-9)
    np.testing.assert_allclose(gate.distance[along[1]], 1.5, atol=1e-9)


def test_what_is_not_straight_or_too_short_is_no_wall() -> None:
    at = (np.arange(100) + 0.5) * CELL - 2.5
    x, y = np.meshgrid(at, at)
    round_hall = np.where(np.hypot(x, y) < 2.0, 0, 100).astype(np.int8)
    box = np.where((np.abs(x) < 0.3) & (np.abs(y) < 0.3), 100, 0).astype(np.int8)
    for data in (round_hall, box):
        assert not len(walls_of_grid(OccupancyGrid(CELL, 0, 0, 0, data), occupied_from=65))


@pytest.mark.parametrize("value", [-1, 0, 100])
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (30, 40)])
def test_grid_of_one_value_has_no_walls(value: int, shape: tuple[int, int]) -> None:
    grid = OccupancyGrid(CELL, 0.0, 0.0, 0.0, np.full(shape, value, dtype=np.int8))
    assert not len(walls_of_grid(grid, occupied_from=65))


def test_unknown_cells_are_no_walls() -> None:
    data = np.zeros((60, 80), dtype=np.int8)
    data[30:] = -1
    assert not len(walls_of_grid(OccupancyGrid(CELL, 0.0, 0.0, 0.0, data), occupied_from=65))


def test_grid_that_is_nowhere_on_earth_is_refused() -> None:
    grid = OccupancyGrid(CELL, 1e9, 0.0, 0.0, np.zeros((4, 4), dtype=np.int8))
    with pytest.raises(GridError, match=r"origin is \(1e\+09, 0\) m; wanted: within 2.1e\+07"):
        walls_of_grid(grid, occupied_from=65)
