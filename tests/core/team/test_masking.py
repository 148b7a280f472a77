import dataclasses
import math
import tracemalloc

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.errors import GridError
from mrs_people_loc.planner import Planner
from mrs_people_loc.scan import Scan
from mrs_people_loc.team import masking as module
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.masking import (
    MaskingTuning,
    OccupancyGrid,
    Walls,
    are_masked,
    are_robots,
)
from mrs_people_loc.team.poses import Pose
from oracle.masking import is_robot

#: A patch of cells as a person's body leaves them, 0.3 x 0.3 m.
BODY = [(0.05 * i, 0.05 * j) for i in range(-3, 4) for j in range(-3, 4)]


def grid_of(rows, resolution=0.1, x=0.0, y=0.0, yaw=0.0) -> OccupancyGrid:
    return OccupancyGrid(resolution, x, y, yaw, np.array(rows, dtype=np.int8))


def room(length=6.0, width=4.0, wall=100) -> OccupancyGrid:
    """A room with its corner at the origin, walls 0.1 m thick around it."""
    data = np.zeros((round(width * 10) + 2, round(length * 10) + 2))
    data[[0, -1]] = wall
    data[:, [0, -1]] = wall
    return grid_of(data, x=-0.1, y=-0.1)


def masking(**changes) -> cfg.PlannerConfig:
    """Each interval stands for itself."""
    return cfg.PlannerConfig.from_mapping({"masking": changes, "tracking.enabled": False})


def people(scans, poses, grid=None, **changes) -> list[tuple[float, float]]:
    """Where the people are, to the centimetre, sorted."""
    planner = Planner(masking(**changes))
    planner.take_grid(grid)
    result = planner.step(scans, poses, 0)
    return sorted(
        (round(float(x), 2), round(float(y), 2)) for x, y in (p.position for p in result.persons)
    )


def body_scan(make_cells, robot, *bodies, sigma_range=0.1) -> Scan:
    """A scan of bodies as (x, y, score) in base_link."""
    x, y, score = np.array(bodies, dtype=np.float32).reshape(-1, 3).T.copy()
    one = np.ones(len(x), dtype=np.float32)
    cells = dataclasses.replace(
        make_cells(np.stack([x, y], axis=1)),
        body=np.arange(1, len(x) + 1, dtype=np.uint32), score=score,
        sigma_range=sigma_range * one, sigma_across=0.04 * one,
    )  # fmt: skip
    return Scan(robot, 0, cells)


def plain_scan(make_cells, robot, *places) -> Scan:
    """A scan of person-sized patches of plain cells around places in base_link."""
    return Scan(robot, 0, make_cells([(x + dx, y + dy) for x, y in places for dx, dy in BODY]))


# ---------------------------------------------------------------------------------- robots ----


def robots_among(places, poses, *, covariance, radius=0.25, score=0.0, seen_by="a"):
    """Which of some places are robots, all seen by one robot."""
    n = len(places)
    return are_robots(
        np.array(places, dtype=float).reshape(-1, 2), np.array([covariance] * n).reshape(-1, 2, 2),
        np.zeros(n, dtype=np.intp), (seen_by,), poses, radius=radius,
        score=np.full(n, score),
    ).tolist()  # fmt: skip


@pytest.mark.parametrize(
    ("xy", "is_robot"),
    [
        ((4.0, 0.0), True),
        ((4.0, 0.24), True),
        ((4.0, 0.26), False),  # beside it
        ((4.45, 0.0), True),  # within 2.5 sigma of 0.2 m along the line of sight
        ((3.51, 0.0), True),
        ((3.45, 0.0), False),
        ((0.1, 0.0), False),  # on the robot that sees it
    ],
)
def test_body_at_a_robots_position_is_that_robot(xy, is_robot):
    # b, 4 m ahead of a, sees nothing itself; c is far away.
    poses = {"a": Pose(0, 0, 0, 1.0), "b": Pose(0, 4, 0, 0.0), "c": Pose(0, -50, 0, 0.0)}
    covariance = np.diag([0.04, 0.0025])
    assert robots_among([xy], poses, covariance=covariance) == [is_robot]
    assert robots_among([xy], poses, covariance=covariance, radius=0.0) == [False]


def test_near_robots_have_their_radius_along_the_line_of_sight():
    poses = {"a": Pose(0, 0, 0, 0.0), "b": Pose(0, 0, 2, 0.0)}
    places = [(0, y) for y in (1.7, 1.8, 2.2, 2.3)]
    got = robots_among(places, poses, covariance=0.01**2 * np.eye(2))
    assert got == [False, True, True, False]


def test_robots_do_not_mask_in_their_own_view():
    poses = {"a": Pose(0, 0, 0, 0.0), "b": Pose(0, 3, 0, 0.0)}
    places = np.array([(x, 0.0) for _ in (0, 1) for x in (0.1, 3.1)])
    seen_by = np.array([0, 0, 1, 1], dtype=np.intp)
    covariance = np.array([0.05**2 * np.eye(2)] * 4)
    got = are_robots(places, covariance, seen_by, ("b", "a"), poses, radius=0.25)
    assert got.tolist() == [True, False, False, True]  # the order of the names counts


@pytest.mark.parametrize(("sigma", "is_robot"), [(0.0, False), (0.1, False), (0.2, True)])
def test_uncertain_robot_masks_a_larger_area(sigma, is_robot):
    # 0.35 m across the line of sight and beyond the radius: 2.5 sigma of 0.2 m reach it.
    poses = {
        "a": Pose(0, 0, 0, 0.0),
        "b": Pose(0, 3, 0, 0.0, np.diag([sigma**2, sigma**2, 0.0])),
    }
    exact = 0.01**2 * np.eye(2)
    assert robots_among([(3.0, 0.35)], poses, covariance=exact) == [is_robot]


@pytest.mark.parametrize("variance", [100.0, 1e308, 1.7e308])
def test_masked_area_of_an_uncertain_robot_is_bounded(variance):
    poses = {
        "a": Pose(0, 0, 0, 0.0),
        "b": Pose(0, 3, 0, 0.0, np.diag([variance, variance, 0.0])),
    }
    places = [(3.79, 0.0), (3.81, 0.0), (3.0, 0.39), (3.0, 0.41)]
    got = robots_among(places, poses, covariance=np.diag([4.0, 0.01]))
    assert got == [True, False, True, False]


def test_clear_person_beside_a_robot_is_kept():
    poses = {"a": Pose(0, 0, 0, 0.0), "b": Pose(0, 3, 0, 0.0)}
    wide = np.diag([0.2**2, 0.05**2])  # 2.5 sigma: 0.5 m
    places = [(3.2, 0.0), (3.4, 0.0)]
    assert robots_among(places, poses, covariance=wide, score=4.9) == [True, True]
    assert robots_among(places, poses, covariance=wide, score=5.1) == [True, False]


def test_many_robots_are_masked_as_one_by_one():
    rng = np.random.default_rng(5)
    names = [f"r{k}" for k in range(30)]
    poses = {
        name: Pose(0, x, y, 0.0, np.diag([*rng.uniform(0, 0.04, 2), 0.0]))
        for name, (x, y) in zip(names, rng.uniform(0, 6, (30, 2)), strict=True)
    }
    xy, seen_by = rng.uniform(0, 6, (200, 2)), rng.integers(0, 30, 200)
    root = rng.normal(0, 0.1, (200, 2, 2))
    covariance = root @ root.transpose(0, 2, 1) + 1e-4 * np.eye(2)
    score = rng.uniform(0, 8, 200)
    got = are_robots(xy, covariance, seen_by, names, poses, radius=0.25, score=score)
    for k in range(200):
        robot = names[seen_by[k]]
        wanted = is_robot(robot, xy[k], covariance[k], poses, 0.25, float(score[k]))
        assert got[k] == wanted
    assert 20 < got.sum() < 180


# ----------------------------------------------------------------------------------- cells ----


def test_robot_seen_as_cells_is_not_a_person(make_cells):
    """The paper's method: b stands 2 m ahead of a, a person 1 m beside b."""
    poses = {"a": Pose(0, 0.0, 0.0, 0.0), "b": Pose(0, 2.0, 0.0, 0.0)}
    scan = plain_scan(make_cells, "a", (2.0, 0.0), (2.0, 1.0))
    assert people([scan], poses) == [(2.0, 1.0)]
    assert people([scan], poses, robot_radius=0.0) == [(2.0, 0.0), (2.0, 1.0)]
    # Its cells stay on the map, in a cluster of their own.
    result = Planner(masking()).step([scan], poses, 0)
    assert len(result.fused) == 2 * len(BODY)
    assert len(result.clusters) == 2


def test_cells_of_a_robot_are_masked_within_the_range_error(make_cells):
    """A cell 0.5 m behind a robot, 4.5 m away: a sigma of 0.48 m, or of 0.08 m."""
    poses = {"a": Pose(0, 0.0, 0.0, 0.0), "b": Pose(0, 4.0, 0.0, 0.0)}
    fused = fuse([Scan("a", 0, make_cells([(4.5, 0.0)]))], poses)
    for sigma, masked in ((0.25 / 10.5, True), (0.004, False)):
        config = cfg.Masking(cell_range_sigma=sigma)
        assert are_masked(fused, np.arange(1), poses, None, config).tolist() == [masked]
    tuning = MaskingTuning(reach_along=0.4)
    assert not are_masked(fused, np.arange(1), poses, None, cfg.Masking(), tuning=tuning).any()


def test_masking_cells_in_blocks_equals_masking_at_once(make_cells, monkeypatch):
    """Fifty robots in one place, each with cells there: all pairs take hundreds of megabytes."""
    rng = np.random.default_rng(1)
    stand = rng.uniform(0, 1, (50, 2)).tolist()
    poses = {f"robot_{k:02}": Pose(0, x, y, 0.0) for k, (x, y) in enumerate(stand)}
    scans = [Scan(name, 0, make_cells(rng.uniform(-1, 2, (600, 2)))) for name in poses]
    fused, config = fuse(scans, poses), cfg.Masking(robot_radius=0.1)
    cells = np.arange(len(fused))
    tracemalloc.start()
    try:
        made = are_masked(fused, cells, poses, None, config)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    monkeypatch.setattr(module, "_PAIRS_AT_ONCE", 10**9)
    np.testing.assert_array_equal(made, are_masked(fused, cells, poses, None, config))
    assert 0.0 < made.mean() < 1.0
    assert most < 200e6


def test_person_at_arms_length_of_a_robot_is_found_as_cells(make_cells):
    # Patches of 0.3 m, 0.5 m apart, and an arm on the robot: one cluster of 1 m with it.
    poses = {"a": Pose(0, 0.0, 0.0, 0.0), "b": Pose(0, 2.0, 0.0, 0.0)}
    arm = [(2.0, 0.05 * k) for k in range(3, 8)]
    patches = plain_scan(make_cells, "a", (2.0, 0.0), (2.0, 0.5)).cells
    places = [*zip(patches.x, patches.y, strict=True), *arm]
    scan = Scan("a", 0, make_cells(places))
    ((x, y),) = people([scan], poses)
    assert math.dist((x, y), (2.0, 0.5)) < 0.06
    assert len(people([scan], poses, robot_radius=0.0)) == 2  # the robot, too


def test_masks_of_nothing_are_empty(make_cells):
    poses = {"a": Pose(0, 0.0, 0.0, 0.0)}
    walls = Walls(room(), occupied_from=65)
    fused = fuse([Scan("a", 0, make_cells([]))], poses)
    none = np.empty(0, dtype=np.intp)
    for known in (None, walls):
        assert are_masked(fused, none, poses, known, cfg.Masking()).shape == (0,)
    assert fuse([], {}).robots == ()
    assert are_masked(fuse([], {}), none, {}, walls, cfg.Masking()).shape == (0,)
    assert walls.log_odds(np.empty((0, 2)), np.empty((0, 2, 2)), cfg.Masking()).shape == (0,)


# ----------------------------------------------------------------------------------- walls ----


def test_distances_match_hand_computed_values():
    # One occupied cell, 1.4 to 1.5 m along x and 1.2 to 1.3 m along y.
    data = np.zeros((25, 30))
    data[12, 14] = 100
    walls = Walls(grid_of(data), occupied_from=65)
    inside = [(1.45, 1.25), (1.41, 1.29)]
    np.testing.assert_array_equal(walls.distance(np.array(inside)), 0.0)
    # To its border, from centres of cells: 0.1 * (n - 0.5) for n cells.
    beside = [(1.55, 1.25), (1.85, 1.25), (1.45, 1.55)]
    np.testing.assert_allclose(walls.distance(np.array(beside)), [0.05, 0.35, 0.25], atol=1e-6)
    assert walls.distance(np.array((9.0, 9.0))) == np.inf
    assert walls.distance(np.array([[(1.45, 1.25)] * 3] * 2)).shape == (2, 3)


@pytest.mark.parametrize("value", [100, 65, 64, 0, -1])
def test_cells_from_occupied_from_on_are_occupied(value):
    walls = Walls(grid_of([[0, 0, value]]), occupied_from=65)
    occupied = walls.distance(np.array((0.25, 0.05))) == 0.0
    assert occupied == (value >= 65)


def test_translated_and_rotated_grid_is_used():
    """A wall along the grid's x, 1 to 3 m from its corner; the grid is turned to the left."""
    data = np.zeros((30, 40))
    data[8, 10:30] = 100
    straight = Walls(grid_of(data), occupied_from=65)
    turned = Walls(grid_of(data, x=2.0, y=-1.0, yaw=math.pi / 2), occupied_from=65)
    rng = np.random.default_rng(1)
    own = (rng.integers((-10, -10), (50, 40), (200, 2)) + 0.5) * 0.1  # no cell's border
    on_map = np.stack([2.0 - own[:, 1], -1.0 + own[:, 0]], axis=1)
    # OpenCV's distance transform is not repeatable in its last bit.
    np.testing.assert_allclose(turned.distance(on_map), straight.distance(own), rtol=1e-6)
    assert turned.distance(np.array((2.0 - 0.85, -1.0 + 2.0))) == 0.0


def test_unknown_cells_behind_a_wall_are_its_interior():
    walls = Walls(room(), occupied_from=65)
    # Off the grid, to 0.5 m behind the wall's face; far off nothing is known.
    assert walls.distance(np.array((3.0, -0.5))) == 0.0
    assert walls.distance(np.array((3.0, -1.5))) == np.inf
    # Unknown with no wall near it is nothing.
    unknown = np.full((20, 20), -1)
    assert Walls(grid_of(unknown), occupied_from=65).distance(np.array((1.0, 1.0))) == np.inf


def test_places_are_moved_straight_off_walls():
    """To 0.45 m, from cells whose centres are 0.05 m from a wall of the room of 6 m x 4 m."""
    walls = Walls(room(), occupied_from=65)
    diagonal = 0.05 + 0.4 / math.sqrt(2.0)
    moved = {
        (3.05, 0.05): (3.05, 0.45),
        (3.05, 3.95): (3.05, 3.55),
        (0.05, 2.05): (0.45, 2.05),
        (0.05, 0.05): (diagonal, diagonal),
        (3.05, -0.05): (3.05, 0.4),  # in the wall, at 0 m from it
        (3.05, 0.55): (3.05, 0.55),  # far enough
        (3.05, -0.5): (3.05, -0.5),  # deep behind it, beside what is off the grid
        (3.05, -9.0): (3.05, -9.0),  # off the grid
    }
    np.testing.assert_allclose(walls.off(np.array([*moved]), 0.45), [*moved.values()], atol=1e-6)
    deep = np.ones((20, 20)) * 100  # all directions are alike
    inside = np.array([(1.05, 1.05)])
    np.testing.assert_array_equal(Walls(grid_of(deep), occupied_from=65).off(inside, 0.45), inside)


def large_floor(seed: int) -> np.ndarray:
    """Of several tiles, with things in it, unknown parts and a free floor."""
    rng = np.random.default_rng(seed)
    data = np.where(rng.random((70, 61)) < 0.3, -1, 0).repeat(10, axis=0).repeat(10, axis=1)
    data[rng.integers(0, 700, 150), rng.integers(0, 610, 150)] = 100
    return data[: 700 - seed, : 610 - 2 * seed]


@pytest.mark.parametrize("resolution", [0.03, 0.05, 0.1])
def test_distances_by_tiles_equal_those_of_the_whole_grid(resolution, monkeypatch):
    for seed in range(3):
        grid = dataclasses.replace(grid_of(large_floor(seed)), resolution=resolution)
        rng = np.random.default_rng(seed)
        size = np.array(grid.data.shape[::-1]) * resolution
        places = rng.uniform(-0.6, size + 0.6, (20_000, 2))
        in_tiles = Walls(grid, occupied_from=65).distance(places)
        with monkeypatch.context() as patch:
            patch.setattr(module, "_TILE", 1000)
            whole = Walls(grid, occupied_from=65).distance(places)
        near = (whole <= 1.0) | (in_tiles <= 1.0)
        assert near.sum() > 1000
        np.testing.assert_allclose(in_tiles[near], whole[near], rtol=1e-6)


def test_evicted_tiles_are_computed_again(monkeypatch):
    monkeypatch.setattr(module, "_CELLS_KEPT", 2 * 256**2)
    grid = grid_of(large_floor(0))
    walls, places = (
        Walls(grid, occupied_from=65),
        np.argwhere(grid.data == 100)[:, ::-1] * 0.1 + 0.05,
    )
    for place in np.concatenate([places, places]):
        assert walls.distance(place) == 0.0


def test_only_requested_tiles_of_a_large_grid_are_computed():
    """600 x 600 m: as a whole it takes seconds and gigabytes."""
    data = np.zeros((12_000, 12_000), dtype=np.int8)
    data[::100, ::100] = 100
    tracemalloc.start()
    try:
        walls = Walls(OccupancyGrid(0.05, 0.0, 0.0, 0.0, data), occupied_from=65)
        assert walls.distance(np.array((10.01, 20.01))) == 0.0
        # A robot that claims to see everything everywhere gets it bit by bit.
        everywhere = np.random.default_rng(1).uniform(0, 600, (10_000, 2))
        answered = np.isfinite(walls.distance(everywhere)).mean()
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert 0.0 < answered < 0.02
    assert most < 150e6


@pytest.mark.parametrize("far", [1e12, 1e300, 1.7e308])
def test_positions_far_outside_the_grid_are_infinitely_far_from_walls(far):
    walls = Walls(room(), occupied_from=65)
    places = np.array([(far, 0.0), (-far, far)])
    np.testing.assert_array_equal(walls.distance(places), np.inf)


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({"resolution": 0.0}, "resolution is 0.0 m; allowed: 0.005 to 1 m"),
        ({"resolution": math.nan}, "resolution is nan"),
        ({"resolution": 1e-9}, "resolution is 1e-09"),
        ({"x": math.inf}, "origin is"),
        ({"yaw": math.nan}, "origin is"),
        ({"data": np.zeros((0, 3), np.int8)}, "data is int8 of shape"),
        ({"data": np.zeros(3, np.int8)}, "data is int8 of shape"),
        ({"data": np.zeros((2, 2))}, "data is float64"),
        ({"data": np.array([[0, 101]], np.int8)}, "data goes from 0 to 101"),
        ({"data": np.array([[-2, 0]], np.int8)}, "data goes from -2 to 0"),
    ],
)
def test_invalid_grids_are_refused(changes, reported):
    good = {"resolution": 0.1, "x": 0.0, "y": 0.0, "yaw": 0.0, "data": np.zeros((2, 2), np.int8)}
    with pytest.raises(GridError) as err:
        OccupancyGrid(**good | changes)
    assert reported in str(err.value)


def test_log_odds_match_hand_computed_values():
    walls = Walls(room(), occupied_from=65)
    exact, unsure = 0.01**2 * np.eye(2), 0.3**2 * np.eye(2)

    def reported(xy, covariance, **changes) -> float:
        config = cfg.Masking(**changes)
        (value,) = walls.log_odds(np.array([xy]), covariance[np.newaxis], config)
        return float(value)

    assert reported((3.0, -0.1), exact) == -5.0  # in the wall
    assert reported((3.0, -0.1), exact, wall_score=2.0) == -2.0
    assert reported((3.0, 0.05), exact) == -5.0  # too near to it to be an axis
    assert reported((3.0, 0.05), exact, wall_margin=0.0) == 1.5
    assert reported((3.0, 0.4), exact) == 1.5  # within arm's length of it
    assert reported((3.0, 0.4), exact, beside_score=0.0) == 0.0
    assert reported((3.0, 2.0), exact) == 0.0  # in the open
    assert reported((30.0, 20.0), exact) == 0.0  # where nothing is known
    # As likely in it as not: half of the draws are nearer than the margin.
    assert abs(reported((3.0, 0.15), unsure)) < 0.5
    assert -5.0 < reported((3.0, 0.0), unsure) < -0.2


def test_walls_and_furniture_are_not_people(make_cells):
    """A coat stand 4 m away, as wide as a person; parts of the wall; a person in front of it."""
    grid = room()
    grid.data[20:24, 45:49] = 100
    poses = {"a": Pose(0, 0.5, 2.0, 0.0)}
    scan = body_scan(make_cells, "a", (4.0, 0.1, 1.5), (3.0, -1.95, 1.5), (3.0, -1.5, 1.5))
    assert people([scan], poses) == [(3.5, 0.05), (3.5, 0.5), (4.5, 2.1)]
    assert people([scan], poses, grid) == [(3.5, 0.5)]


def test_wall_cells_are_masked_and_a_person_in_front_is_found(make_cells):
    """The paper's method: a wall and a person at arm's length, connected by cells between them."""
    poses = {"a": Pose(0, 3.0, 2.5, -math.pi / 2)}
    wall = [(2.5 + noise, y) for noise in (0.0, 0.05) for y in np.arange(-1, 1, 0.05)]
    person = [(2.1 + dx, dy) for dx, dy in BODY]  # axis 0.4 m from the wall
    between = [(2.1 + 0.05 * k, 0.0) for k in range(4, 8)]
    scan = Scan("a", 0, make_cells([*wall, *person, *between]))
    assert len(people([scan], poses)) > 1
    ((x, y),) = people([scan], poses, room())
    assert math.dist((x, y), (3.0, 0.4)) < 0.05


@pytest.mark.parametrize(("value", "masked"), [(49, False), (50, True)])
def test_limit_of_what_is_occupied_is_a_parameter(make_cells, value, masked):
    poses = {"a": Pose(0, 0.5, 2.0, 0.0)}
    scan = body_scan(make_cells, "a", (3.0, 1.95, 1.5))  # at a wall, which is occupied at 50 %
    assert (people([scan], poses, room(wall=value), occupied_from=50) == []) == masked


def test_grid_can_be_removed_and_replaced(make_cells):
    poses = {"a": Pose(0, 0.5, 2.0, 0.0)}
    scan = body_scan(make_cells, "a", (3.0, 1.95, 1.5))
    planner = Planner(masking())
    planner.take_grid(room())
    assert planner.step([scan], poses, 0).persons == ()
    planner.take_grid(room(width=8.0))
    assert len(planner.step([scan], poses, 0).persons) == 1
    planner.take_grid(room())
    planner.take_grid(None)
    assert len(planner.step([scan], poses, 0).persons) == 1
