"""What the packages compute equals the oracle: on recordings, drawn rooms and random input."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="reading bags needs rosbags")

from mrs_people_loc.cells.scanner import filter_cloud
from mrs_people_loc.config import PlannerConfig, RobotConfig
from mrs_people_loc.planner import Planner
from mrs_people_loc.timing import StageTimes
from mrs_studies.bench.differs import DiffersError
from mrs_tools.bags.offline import BagRun
from oracle.cells import cells_of
from oracle.comparison import check_cells, check_people, check_places, check_view
from oracle.scenes import (
    BAG,
    BODIES,
    CELLS,
    DEFAULT,
    PAPER,
    TEAM,
    furnished_room,
    mixed_team,
    random_cloud,
    random_scans,
    random_view,
    with_bodies,
)


@pytest.mark.slow
@pytest.mark.parametrize("files", [[PAPER], [DEFAULT], [PAPER, TEAM]], ids=lambda f: f[-1].stem)
def test_papers_formation_equals_the_oracle(files):
    run = BagRun(BAG, files, planner=lambda c: Planner(c.memoryless()))
    intervals = list(run.intervals())[::7]
    assert len(intervals) == 3
    kinds = set()
    for interval in intervals:
        for robot, view in interval.views.items():
            kinds.add(bool(view.camera.vertical_baseline))
            check_view(view.images, view.stages, view.camera, run.team.robots[robot])
        check_people(interval.scans, interval.people, run.team.planner)
        # By their appearance, not all of the bag's cylinders are people.
        assert len(interval.people.persons) >= (3 if files == [DEFAULT] else 5)
    assert kinds == ({False} if files == [DEFAULT] else {False, True})


def cells_by_the_core(cloud, config):
    return filter_cloud(cloud, config, StageTimes())[2]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    "changes",
    [
        {"noise.min_points": 3},
        {"noise.min_points": 1, "quantization.top_support": 1, "quantization.top_gap": 0.05},
        {"noise.min_points": 5, "noise.window": 0.17, "quantization.cell": 0.07},
        {"zones.low": -0.3, "zones.high": -0.1, "noise.min_points": 1},
        {"zones.low": 0.5, "zones.high": 0.9, "quantization.top_gap": 2.0},
        {"quantization.cell": 1.0, "noise.window": 2.0},
        {"noise.min_points": 100_000},
    ],
    ids=str,
)
def test_cells_of_random_clouds_equal_the_oracle(seed, changes):
    config = RobotConfig.from_mapping(changes)
    cloud = random_cloud(seed)
    check_cells("random", cells_by_the_core(cloud, config), cells_of(cloud, config))


def test_cells_with_a_far_outlier_equal_the_oracle():
    # Too far for a table of all tiles: the numbers of tiles come from sorting.
    cloud = random_cloud(1)
    cloud[0] = (9_000.0, -9_000.0, 1.0)
    config = RobotConfig.from_mapping({"noise.min_points": 1})
    got = cells_by_the_core(cloud, config)
    assert got.x.max() > 8_999
    check_cells("outlier", got, cells_of(cloud, config))


@pytest.mark.parametrize("cloud", [np.empty((0, 3)), [[2.0, 0.0, 1.0]], [[2.0, 0.0, 1.5]]], ids=len)
def test_cells_of_few_points_equal_the_oracle(cloud):
    config = RobotConfig.from_mapping({"noise.min_points": 1})
    points = np.array(cloud, dtype=np.float32).reshape(-1, 3)
    check_cells("few", cells_by_the_core(points, config), cells_of(points, config))


@pytest.mark.parametrize("vertical", [0.0, 0.1, -0.08])
@pytest.mark.parametrize("offset", [0.0, 3.25])
@pytest.mark.parametrize("base", [CELLS, BODIES], ids=["cells", "bodies"])
def test_view_of_random_images_equals_the_oracle(vertical, offset, base):
    images, stages, camera, config = random_view(base, vertical=vertical, offset=offset)
    assert len(stages.cloud) > 1000
    assert len(stages.scan.cells) > 0
    check_view(images, stages, camera, config)


@pytest.mark.parametrize(
    "changes",
    [
        {"bodies.vote": False, "bodies.axis": False},
        {"bodies.axis": False},
        {"bodies.human_test": False},
        {"bodies.appearance": False},
        {"bodies.max_count": 2},
        {"bodies.max_range": 2.0},
    ],
    ids=str,
)
def test_steps_that_are_off_equal_the_oracle(changes):
    images, stages, camera, config = random_view(BODIES, **changes)
    assert len(stages.scan.cells) > 0
    check_view(images, stages, camera, config)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(
    "planner",
    [
        None,
        {},
        {"joining.line_of_sight": False},
        {"joining.gate": 10.0, "joining.max_distance": 1.5},
        {"masking.robot_radius": 0},
        {"masking.robot_radius": 1.0},
        {"joining.fragment_gate": 0.0, "joining.apart": 0.0},
        {"splitting.max_width": 0.3, "human.min_points": 10},
    ],
    ids=str,
)
def test_people_of_random_scans_equal_the_oracle(seed, planner):
    config = PlannerConfig.from_mapping(
        {
            "human.min_points": 100, "human.max_width": 3.0, "human.max_depth": 3.0,
            **(planner or {}),
        }
    )  # fmt: skip
    scans, poses = random_scans(seed)
    if planner is not None:
        rng = np.random.default_rng(seed)
        scans = [with_bodies(scan, rng) for scan in scans]
    check_people(scans, Planner(config.memoryless()).step(scans, poses, 0), config)


@pytest.mark.parametrize("max_width", [0.2, 0.4, 0.75])
@pytest.mark.parametrize("seed", range(8))
def test_splitting_of_wide_clusters_equals_the_oracle(seed, max_width):
    config = PlannerConfig.from_mapping(
        {"splitting.max_width": max_width, "clustering.distance": 0.3, "human.min_points": 10}
    )
    scans, poses = random_scans(seed)
    people = Planner(config.memoryless()).step(scans, poses, 0)
    whole = PlannerConfig.from_mapping({"splitting.max_width": 0.0}, base=config)
    before = Planner(whole.memoryless()).step(scans, poses, 0)
    check_people(scans, people, config)
    check_people(scans, before, whole)


@pytest.mark.parametrize("with_walls", [False, True])
def test_mixed_team_equals_the_oracle(with_walls):
    (scans, poses), grid = mixed_team()
    planner, time_ns = Planner(PlannerConfig().memoryless()), 10_000_000
    planner.take_grid(grid if with_walls else None)
    people = planner.step(scans, poses, time_ns)
    check_people(scans, people, planner.config, grid if with_walls else None)
    # Shoulder to shoulder, the one of both kinds of robots, those of c and d, and not the robots.
    assert len(people.persons) >= 5
    if with_walls:
        with pytest.raises(DiffersError):
            check_people(scans, people, planner.config)


@pytest.mark.parametrize("seed", range(6))
def test_places_of_a_furnished_room_equal_the_oracle(seed):
    lost = check_places(*furnished_room(seed), PlannerConfig())
    assert max(of.max() for of in lost) > 2.0
