"""`mrs bench`: its reference is the same as the core, it notices what differs, and it reports.

Nothing here asserts a time: how fast the method is, the bench says, not a test.
"""

import dataclasses
import json
import math
import mmap
import os
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="reading bags needs rosbags")
pytest.importorskip("typer", reason="mrs is a typer command")

import typer
from typer.testing import CliRunner

from mrs_people_loc.bodies import finder as bodies
from mrs_people_loc.bodies import scanner, search
from mrs_people_loc.cells import filters
from mrs_people_loc.config import Mounting, PlannerConfig, RobotConfig, load_team
from mrs_people_loc.errors import BagError
from mrs_people_loc.planner import Planner
from mrs_people_loc.robot import RobotPipeline
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.timing import StageTimes
from mrs_tools.bags.offline import BagRun
from mrs_tools.bench import bodies as bench_bodies
from mrs_tools.bench import growth as bench_growth
from mrs_tools.bench import live as bench_live
from mrs_tools.bench import scenes as bench_scenes
from mrs_tools.bench.differs import DiffersError
from mrs_tools.bench.reference import (
    cells_of,
    check_cells,
    check_people,
    check_view,
    clusters_of,
    is_repeatable,
)
from mrs_tools.commands import bench

ROOT = Path(__file__).resolve().parents[3]
PAPER = ROOT / "config" / "paper.yaml"
DEFAULT = ROOT / "config" / "default.yaml"
TEAM = ROOT / "config" / "team.yaml"
#: The paper's method, and the default one; this with a cap that StereoBM repeats itself with.
CELLS = load_team(PAPER, robots=("robot_a",)).robots["robot_a"]
BODIES = RobotConfig.from_mapping({"disparity.pre_filter_cap": 31})


@pytest.fixture(scope="session")
def bag():
    path = ROOT / "bags" / "paper_formation"
    if not path.exists():
        pytest.skip("bags/paper_formation is not here")
    return path


# -------------------------------------------------------------------- the reference and the core


@pytest.mark.parametrize("files", [[PAPER], [DEFAULT], [PAPER, TEAM]], ids=lambda f: f[-1].stem)
def test_reference_equals_the_core_on_the_papers_formation(bag, files):
    run = BagRun(bag, files, planner=lambda c: Planner(c.memoryless()))
    intervals = list(run.intervals())[::7]
    assert len(intervals) == 3
    kinds = set()
    for interval in intervals:
        for robot, view in interval.views.items():
            kinds.add(bool(view.camera.vertical_baseline))
            check_view(view.images, view.stages, view.camera, run.team.robots[robot])
        check_people(interval.scans, interval.people, run.team.planner)
        assert len(interval.people.persons) >= 5
    assert kinds == ({False} if files == [DEFAULT] else {False, True})


def random_cloud(seed: int, count: int = 3000) -> np.ndarray:
    """Pillars of points, gaps in them, noise around, and heights on the borders of the zone."""
    rng = np.random.default_rng(seed)
    place = rng.uniform((0.5, -2.0), (5.0, 2.0), (12, 2))[rng.integers(0, 12, count)]
    xy = place + rng.normal(0.0, 0.06, (count, 2))
    z = rng.choice([0.05, 0.1]) * rng.integers(-4, 50, count) + rng.normal(0.0, 0.02, count)
    z[:40] = rng.choice([0.2, 1.4, 1.45, 4.4], 40)
    cloud = np.column_stack([xy, z]).astype(np.float32)
    return np.asfortranarray(cloud)


def core_cells(cloud: np.ndarray, config: RobotConfig) -> Cells:
    zones = filters.discriminate_zones(cloud, low=config.zones.low, high=config.zones.high)
    noise = filters.reduce_noise(
        zones, window=config.noise.window, min_points=config.noise.min_points
    )
    cells = filters.quantize(noise, cell=config.quantization.cell)
    top = filters.measure_tops(
        cells,
        noise,
        cloud,
        zone_high=config.zones.high,
        window=config.noise.window,
        support=config.quantization.top_support,
        gap=config.quantization.top_gap,
    )
    return dataclasses.replace(cells, top=top)


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
def test_cells_of_random_clouds_equal_the_reference(seed, changes):
    config = RobotConfig.from_mapping(changes)
    cloud = random_cloud(seed)
    check_cells("random", core_cells(cloud, config), cells_of(cloud, config))


def test_cells_with_a_far_outlier_equal_the_reference():
    # Too far for a table of all tiles: the numbers of tiles come from sorting.
    cloud = random_cloud(1)
    cloud[0] = (9_000.0, -9_000.0, 1.0)
    config = RobotConfig.from_mapping({"noise.min_points": 1})
    got = core_cells(cloud, config)
    assert got.x.max() > 8_999
    check_cells("outlier", got, cells_of(cloud, config))


@pytest.mark.parametrize("cloud", [np.empty((0, 3)), [[2.0, 0.0, 1.0]], [[2.0, 0.0, 1.5]]], ids=len)
def test_cells_of_few_points_equal_the_reference(cloud):
    config = RobotConfig.from_mapping({"noise.min_points": 1})
    points = np.array(cloud, dtype=np.float32).reshape(-1, 3)
    check_cells("few", core_cells(points, config), cells_of(points, config))


@pytest.mark.parametrize("vertical", [0.0, 0.1, -0.08])
@pytest.mark.parametrize("offset", [0.0, 3.25])
@pytest.mark.parametrize("base", [CELLS, BODIES], ids=["cells", "bodies"])
def test_view_of_random_images_equals_the_reference(vertical, offset, base):
    rng = np.random.default_rng(7)
    scene = rng.integers(0, 256, (100, 140), dtype=np.uint8)
    camera = StereoCamera(
        width=100, height=70, fx=90.0, fy=95.0, cx=50.3, cy=33.1, baseline=0.1,
        disparity_offset_px=offset, vertical_baseline=vertical, vertical_offset_px=-0.6 * offset,
        mounting=Mounting(height=1.2, forward=0.1, left=-0.2, pitch=0.2, roll=-0.1, yaw=0.4),
    )  # fmt: skip
    images = StereoImages(
        5, *(np.ascontiguousarray(scene[v : v + 70, u : u + 100])
             for u, v in ((10, 10), (16, 10), (10, 4 if vertical > 0 else 16))),
    )  # fmt: skip
    changes = {"noise.min_points": 2, "zones.low": 0.0}
    changes |= {"bodies.min_score": -20.0, "bodies.min_extent": 0.05}
    config = RobotConfig.from_mapping(changes | {"disparity.min_range": 0.7}, base=base)
    stages = RobotPipeline("r", camera, config).stages(images)
    assert len(stages.cloud) > 1000
    assert len(stages.scan.cells) > 0
    check_view(images, stages, camera, config)


def random_scans(seed: int) -> tuple[list[Scan], dict[str, Pose]]:
    rng = np.random.default_rng(seed)
    scans, poses = [], {}
    for robot in ("b", "a", "c")[: 1 + seed % 3]:
        n = int(rng.integers(0, 120))
        xy = (rng.integers(0, 60, (n, 2)) + 0.5) * 0.05
        z, z_min, top = rng.uniform(0.2, 1.4, n), np.full(n, 0.2), rng.uniform(1.0, 1.9, n)
        x, y, z, z_min, top = (v.astype(np.float32) for v in (*xy.T, z, z_min, top))
        count = rng.integers(1, 99, n, dtype=np.uint32)
        scans.append(Scan(robot, 0, Cells(x, y, z, z_min, top, count)))
        root, place = rng.normal(0.0, 0.05, (3, 3)), rng.uniform(-3, 3, 3)
        poses[robot] = Pose(0, place[0], place[1], place[2], root @ root.T)
    return scans, poses


def with_bodies(scan: Scan, rng: np.random.Generator) -> Scan:
    """The scan with some of its cells being those of bodies."""
    n = len(scan.cells)
    of_body = rng.uniform((-4.0, 0.01, 0.01), (6.0, 0.4, 0.2), (9, 3)).astype(np.float32)
    body = rng.integers(0, 9, n, dtype=np.uint32)
    score, sigma_range, sigma_across = of_body[body].T.copy()
    return dataclasses.replace(
        scan,
        cells=dataclasses.replace(
            scan.cells, body=body, score=score, sigma_range=sigma_range, sigma_across=sigma_across
        ),
    )


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
    ],
    ids=str,
)
def test_people_of_random_scans_equal_the_reference(seed, planner):
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


def test_reference_clusters_match_hand_computed_values():
    places = [(1.0, 0.0), (0.0, 0.0), (0.15, 0.0), (0.30, 0.0), (1.0, 0.16)]
    assert clusters_of(places, 0.15) == [1, 0, 0, 0, 2]


def test_reference_joining_matches_hand_computed_values():
    # Seen by a from the left and by b from below, each sure across its line of sight (1 cm) and
    # not along it (10 cm): the place is where their lines cross. Seen by a alone: another one.
    def scan(robot, cells):
        x, y, body, score = np.array(cells, dtype=np.float32).T.copy()
        one = np.ones(len(cells), dtype=np.float32)
        made = Cells(
            x=x, y=y, z=one, z_min=one, top=one, count=one.astype(np.uint32),
            body=body.astype(np.uint32), score=score,
            sigma_range=0.1 * one, sigma_across=0.01 * one,
        )  # fmt: skip
        return Scan(robot, 0, made)

    poses = {"a": Pose(0, 0.0, 2.0, 0.0), "b": Pose(0, 2.0, 0.0, math.pi / 2)}
    scans = [
        scan("a", [(2.05, 0.0, 1, 1.0), (2.15, 0.0, 1, 1.0), (4.0, 1.0, 2, -1.0)]),
        scan("b", [(1.9, 0.0, 5, 2.0)]),
    ]
    config = PlannerConfig()
    people = Planner(config.memoryless()).step(scans, poses, 0)
    joined, robots = bench_bodies.joined_of(people.fused, poses, poses, config.joining, 0.25)
    assert robots == []
    assert [body.cells for body in joined] == [(0, 1, 3), (2,)]
    assert [body.is_person for body in joined] == [True, False]
    # The first is 10 cm off along x for a and 10 cm along y for b.
    np.testing.assert_allclose(joined[0].xy, (2.0 + 0.1 / 101, 2.0 - 0.1 / 101), atol=1e-6)
    (person,) = people.persons
    np.testing.assert_allclose(person.position, joined[0].xy, atol=1e-9)
    assert person.robots == ("a", "b")
    # Where one robot stands, another sees that robot.
    poses["b"] = Pose(0, 4.0, 3.1, 0.0)
    people = Planner(config.memoryless()).step(scans[:1], poses, 0)
    _, robots = bench_bodies.joined_of(people.fused, poses, poses, config.joining, 0.25)
    assert robots == [(2,)]


def test_reference_extents_match_hand_computed_values():
    # 10 px of focal length and 0.1 m: 1 px of disparity is 1 m. Level, 1 m up.
    camera = StereoCamera(width=21, height=21, fx=10, fy=10, cx=10, cy=10, baseline=0.1)
    disparity = np.full((21, 21), np.nan, dtype=np.float32)
    disparity[8:13, 10] = 0.5  # 2 m ahead: each pixel is 0.2 m high
    disparity[0, 10] = 0.5  # 3 m up: too high
    histogram = bench_bodies.histogram_of(disparity, camera, min_range=0.5, max_range=4.0)
    assert histogram.sum() == pytest.approx(5 * 0.2, rel=0.02)
    (row,), (column,) = (np.unique(index) for index in np.nonzero(histogram))
    assert row == 1  # from 0.25 px in steps of 0.25
    assert column == int(math.atan(1.0) / 0.1)  # 45 degrees from the left border


# ----------------------------------------------------------------------------- it notices mistakes


@pytest.mark.parametrize("field", ["x", "y", "z", "z_min", "top", "count"])
def test_wrong_field_of_a_cell_is_detected(field):
    config = RobotConfig.from_mapping({"noise.min_points": 3})
    cloud = random_cloud(2)
    cells = core_cells(cloud, config)
    values = getattr(cells, field).copy()
    values[3] = values[3] + 1 if field == "count" else np.nextafter(values[3], np.float32(9))
    with pytest.raises(DiffersError, match=rf"cells\.{field} .* 1 of \d+ values.*\(3,\)"):
        check_cells("v", dataclasses.replace(cells, **{field: values}), cells_of(cloud, config))


@pytest.mark.parametrize("stage", ["disparity", "cloud", "zones", "noise"])
def test_wrong_stage_is_detected(bag, stage):
    run = BagRun(bag, [PAPER])
    view = next(iter(next(run.intervals()).views.values()))
    values = getattr(view.stages, stage).copy()
    values.flat[-1] += 0.001
    if stage == "disparity":
        values[60, 80] += 1 / 16
    wrong = dataclasses.replace(view.stages, **{stage: values})
    with pytest.raises(DiffersError, match=stage):
        check_view(view.images, wrong, view.camera, run.team.robots[view.robot])


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda p: _with_clusters(p, label=np.roll(p.clusters.label, 1)), "clusters differs"),
        (lambda p: _with_clusters(p, width=p.clusters.width + 0.01), "width"),
        (lambda p: _with_clusters(p, sigma=p.clusters.sigma * 1.001), "sigma"),
        (lambda p: _with_clusters(p, seen_by=~p.clusters.seen_by), "seen_by"),
        (lambda p: dataclasses.replace(p, persons=p.persons[1:]), "number of people"),
        (lambda p: _with_person(p, position=p.persons[0].position + 1e-6), "position"),
        (lambda p: _with_person(p, covariance=p.persons[0].covariance * 1.1), "covariance"),
        (lambda p: _with_person(p, robots=("robot_z",)), "robots"),
        (lambda p: dataclasses.replace(p, groups=()), "group"),
        (lambda p: dataclasses.replace(
            p, groups=(dataclasses.replace(p.group, radius=p.group.radius + 0.1),)), "radius"),
        (lambda p: dataclasses.replace(
            p, fused=dataclasses.replace(p.fused, xy=p.fused.xy + 1e-3)), "map"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)  # fmt: skip
@pytest.mark.parametrize("base", [CELLS, BODIES], ids=["cells", "bodies"])
def test_wrong_person_is_detected(change, what, base):
    config = PlannerConfig()
    scans, poses = bench_scenes.drawn_scans(base, 0)
    people = Planner(config.memoryless()).step(scans, poses, 0)
    check_people(scans, people, config)
    with pytest.raises(DiffersError, match=what):
        check_people(scans, change(people), config)


@pytest.mark.parametrize(
    ("module", "name", "wrong", "what"),
    [
        (search, "LOWEST", lambda right: right + 0.3, "zones|histogram"),
        (search.BodySearch, "histogram", lambda right: lambda *a: right(*a) * 1.01, "histogram"),
        (
            scanner, "cells_of",
            lambda right: lambda found: dataclasses.replace(
                right(found), score=right(found).score + np.float32(0.01)
            ),
            r"cells\.score",
        ),
        (
            scanner, "cells_of",
            lambda right: lambda found: dataclasses.replace(
                right(found), x=right(found).x + np.float32(0.001)
            ),
            "cells of bodies, x",
        ),
    ],
    ids=["heights", "histogram", "score", "place"],
)  # fmt: skip
def test_wrong_search_is_detected(bag, monkeypatch, module, name, wrong, what):
    run = BagRun(bag, [DEFAULT])
    view = next(iter(next(run.intervals()).views.values()))
    right = getattr(module, name)
    config = run.team.robots[view.robot]
    if name == "LOWEST":  # which both take from one place
        cloud = view.stages.zones[view.stages.zones[:, 2] > 0.5]
        stages = dataclasses.replace(view.stages)
        vars(stages)["zones"] = cloud  # in place of what would be made of the cloud
    else:
        monkeypatch.setattr(module, name, wrong(right))
        pipeline = RobotPipeline(view.robot, view.camera, config)
        pipeline.matcher = lambda _: view.stages.disparity  # type: ignore[assignment]
        stages = pipeline.stages(view.images)
    with pytest.raises(DiffersError, match=what):
        check_view(view.images, stages, view.camera, config)


@pytest.mark.parametrize("field", ["u", "v", "expected", "difference", "inside"])
def test_wrong_patch_is_detected(bag, field):
    run = BagRun(bag, [DEFAULT])
    view = next(iter(next(run.intervals()).views.values()))
    find = bodies.BodyFinder(view.camera, BODIES.bodies, min_range=0.7)
    disparity = view.stages.disparity
    patches = find.look(disparity, view.images, StageTimes()).patches
    bench_bodies.check_patches("p", patches, disparity, view.camera)
    values = getattr(patches, field)
    wrong = ~values if field == "inside" else values + np.float32(0.01)
    with pytest.raises(DiffersError, match=rf"patches\.{field}"):
        bench_bodies.check_patches(
            "p", dataclasses.replace(patches, **{field: wrong}), disparity, view.camera
        )


def test_only_the_known_share_of_nondeterministic_pixels_is_allowed(bag):
    run = BagRun(bag, [DEFAULT])
    view = next(iter(next(run.intervals()).views.values()))
    for cap, part in ((63, 0.004), (31, 0.0)):
        config = RobotConfig.from_mapping({"disparity.pre_filter_cap": cap})
        pipeline = RobotPipeline(view.robot, view.camera, config)
        assert is_repeatable(config.disparity) == (cap == 31)
        matched = pipeline.matcher(view.images)

        def check(moved: int, matched=matched, pipeline=pipeline, config=config) -> None:
            disparity = matched.copy()
            disparity.reshape(-1)[:moved] = 9.0
            pipeline.matcher = lambda _: disparity
            check_view(view.images, pipeline.stages(view.images), view.camera, config)

        check(int(part * matched.size))
        with pytest.raises(DiffersError, match="disparity"):
            check(int((part + 0.002) * matched.size))


def _with_clusters(people, **changes):
    return dataclasses.replace(people, clusters=dataclasses.replace(people.clusters, **changes))


def _with_person(people, **changes):
    first = dataclasses.replace(people.persons[0], **changes)
    return dataclasses.replace(people, persons=(first, *people.persons[1:]))


# ---------------------------------------------------------------------------------------- the bench


@pytest.mark.parametrize("base", [CELLS, BODIES], ids=["cells", "bodies"])
def test_simulated_scene_has_four_robots_and_ten_people(base):
    scans, poses = bench_scenes.drawn_scans(base, 0)
    people = Planner(PlannerConfig().memoryless()).step(scans, poses, 0)
    assert len(poses) == 4
    found = np.array([person.position for person in people.persons])
    assert len(found) == len(bench_scenes.PEOPLE) == 10
    away = np.linalg.norm(found[:, None] - np.array(bench_scenes.PEOPLE), axis=2)
    assert (away.min(axis=0) < 0.25).all()


@pytest.mark.parametrize("file", [PAPER, DEFAULT], ids=lambda f: f.stem)
def test_growth_has_a_row_for_each_size(file):
    growth = bench_growth.time_growth({"c": file}, 11, rounds=1)
    assert growth["c"].keys() == {"rooms apart", "one floor"}
    for rows in growth["c"].values():
        assert [row["robots"] for row in rows] == [1, 2, 4, 8]
        assert [row["people"] for row in rows] == [10, 10, 10, 20]
        assert all(row["ms_per_robot"] == row["ms"] / row["robots"] > 0 for row in rows)
        assert bench_growth.growth_of(rows) == rows[3]["ms_per_robot"] / rows[2]["ms_per_robot"]
        assert bench_growth.growth_of(rows[:3]) is None
    assert [row["people_found"] for row in growth["c"]["rooms apart"][2:]] == [10, 20]


def test_result_that_differs_between_rooms_apart_is_detected(monkeypatch):
    right = bench_growth.Planner.step

    def wrong(self, scans, *rest):
        people = right(self, scans, *rest)
        return (
            people if len(scans) < 16 else dataclasses.replace(people, persons=people.persons[1:])
        )

    monkeypatch.setattr(bench_growth.Planner, "step", wrong)
    monkeypatch.setattr(bench_growth, "_time", lambda *_: pytest.fail("timed"))
    with pytest.raises(DiffersError, match="16 robots in rooms apart: number of people"):
        bench_growth.time_growth({"c": DEFAULT}, 16)


def test_on_one_floor_robots_also_see_people_of_other_rooms():
    scans, poses = bench_scenes.on_one_floor(BODIES, 8, 0)
    people = Planner(PlannerConfig().memoryless()).step(scans, poses, 0).persons
    # robot_0004 to 0007 are of the second room, which begins at x = 8 m.
    across = [
        p for p in people if p.position[0] < 7.0 and {"robot_0004", "robot_0006"} & {*p.robots}
    ]
    assert across


def test_simulated_body_is_at_its_position():
    # robot_a looks to the middle; the nearest person in its line of sight hides the others.
    pose = Pose(0, 4.0, 1.0, math.pi / 2)
    disparity = bench_scenes.drawn_disparity(pose, 0, bench_scenes.PEOPLE, bench_scenes.ROOM)
    depth = 10.546 / np.nanmedian(disparity[55:65, 78:82])
    assert depth == pytest.approx(2.8 - 1.0 - 0.2, abs=0.05)


STAGES = {
    "paper.yaml": {"cloud", "zones", "noise", "cells", "tops"},
    "default.yaml": {
        "search", "patches", "vote", "evidence", "judge", "cells",
    },
}  # fmt: skip


def test_report_has_all_documented_figures(bag, tmp_path):
    app = typer.Typer()
    app.command()(bench.command)
    file = tmp_path / "bench.json"
    args = [
        str(bag),
        "-c",
        str(PAPER),
        "-c",
        str(DEFAULT),
        "--frames",
        "2",
        "--robots",
        "8",
        "--no-live",
    ]
    result = CliRunner().invoke(app, [*args, "--json", str(file)], env={"COLUMNS": "120"})
    assert result.exit_code == 0, result.output
    report = json.loads(file.read_text())
    assert report.keys() == {
        "machine", "bag", "equal_to_reference", "robot", "planner", "growth", "tracking", "live",
        "targets",
    }  # fmt: skip
    assert report["live"] is None
    assert report["equal_to_reference"]["views"] == 2 * 3 * 3
    for name in ("paper.yaml", "default.yaml"):
        assert report["robot"][name].keys() == {"binocular", "trinocular", "pair of three"}
        for kind, figures in report["robot"][name].items():
            assert figures["frames"] == 2
            assert figures["image"] == "160x120"
            pairs = 2 if kind == "trinocular" else 1
            assert figures["searched_px"] == [16 if name == "paper.yaml" else 32] * pairs
            assert figures["rest_to_stereo_bm"] > 0
            assert figures["frames_per_s"] > 0
            stages = figures["stages_ms"]
            around = {"StereoBM", "disparity around it", "all but StereoBM", "whole"}
            around.add("StereoBM on the bare pair")
            assert set(stages) - around == STAGES[name]
            assert (figures["bodies"] > 0) == (name == "default.yaml")
            assert all(0 <= s["median"] <= s["p99"] for s in stages.values())
        planner = report["planner"][name]
        assert (planner["robots"], planner["people"], planner["people_found"]) == (4, 10, 10)
        stages = {"fusion", "masking", "joining", "clustering", "whole"}
        stages |= {"tracking", "groups"} if name == "default.yaml" else set()
        assert set(planner["stages_ms"]) == stages
    assert [row["people"] for row in report["tracking"]] == [10, 50, 200]
    assert all(row["tracker_ms"] > 0 and row["groups_ms"] > 0 for row in report["tracking"])
    targets = report["targets"]
    limits = [1.0, 500.0, 2.0, 1.0, 1.0, 10.0, 3.0, 1.0, 1.0, 0.5, 10.0]
    assert [t["limit"] for t in targets] == limits
    files = [t["configuration"].partition(",")[0] for t in targets]
    assert files == ["paper.yaml"] * 5 + ["default.yaml"] * 4 + ["10 people", "200 people"]
    assert "pair of three" in targets[5]["configuration"]
    rows = [line.split() for line in result.output.splitlines()]
    assert [row[-1] for row in rows if row[:1] == ["tops"]] == ["-"] * 3
    assert [row[1] for row in rows if row[:1] == ["search"]] == ["-"] * 3
    assert [row[-1] for row in rows if row[:1] == ["cloud"]] == ["-"] * 3
    assert not any("-" in row for row in rows if row[:1] == ["cells"])
    for target in targets:
        assert f"{target['value']:.4g}" in result.output
    for text in ("paper.yaml", "default.yaml", "trinocular", "equal to the reference"):
        assert text in result.output


def test_differing_results_prevent_timing(bag, monkeypatch):
    right = filters.measure_tops
    monkeypatch.setattr(filters, "measure_tops", lambda *a, **k: right(*a, **k) + np.float32(0.001))
    monkeypatch.setattr(bench, "time_robot", lambda *_: pytest.fail("timed"))
    with pytest.raises(DiffersError, match=r"cells\.top"):
        bench.run_bench(bag, [PAPER], frames=1, robots=1)


def test_missed_target_is_not_an_error(bag, monkeypatch, tmp_path):
    slow = bench.Target("planner", "paper.yaml", 99.0, 2.0, "ms")
    monkeypatch.setattr(bench, "targets", lambda *_: [slow])
    app = typer.Typer()
    app.command()(bench.command)
    args = [str(bag), "-c", str(PAPER), "--frames", "1", "--robots", "1", "--no-live"]
    result = CliRunner().invoke(app, args)
    assert result.exit_code == 0
    assert "missed" in result.output


@pytest.mark.parametrize(
    ("value", "at_least", "reached"),
    [(1.9, False, True), (2.0, False, True), (2.1, False, False), (2.1, True, True),
     (1.9, True, False), (math.nan, True, False), (math.nan, False, False)],
)  # fmt: skip
def test_targets_are_compared_in_their_direction(value, at_least, reached):
    target = bench.Target("t", "c", value, 2.0, "ms", at_least)
    assert target.report()["reached"] is reached


def test_two_configurations_of_one_name_are_refused(bag):
    with pytest.raises(bench.BenchError, match=r"paper\.yaml"):
        bench.run_bench(bag, [PAPER, PAPER])


def test_undefined_values_are_null_in_the_file(tmp_path):
    file = tmp_path / "out.json"
    bench.write_json({"a": math.nan, "b": [math.inf, 1.5], "c": {"d": None}}, file)
    assert json.loads(file.read_text()) == {"a": None, "b": [None, 1.5], "c": {"d": None}}
    with pytest.raises(bench.BenchError, match="cannot be written"):
        bench.write_json({}, tmp_path / "no" / "out.json")


# ------------------------------------------------------------------------------------ the live part


def test_message_gets_the_current_stamp(bag):
    from mrs_tools.bags.rosbag import BagReader

    with BagReader(bag) as reader:
        for topic in ("/robot_a/left/image_rect", "/robot_a/left/camera_info", "/robot_a/odom"):
            raw = next(iter(reader.messages([topic])))
            before = reader.decode(raw)
            changed = raw._replace(data=bench_live.stamped(raw.data, 12_000_000_034))
            after = reader.decode(changed)
            assert (after.header.stamp.sec, after.header.stamp.nanosec) == (12, 34)
            assert after.header.frame_id == before.header.frame_id
            assert len(changed.data) == len(raw.data)
    with pytest.raises(BagError, match="little-endian"):
        bench_live.stamped(b"\x00\x00" + bytes(20), 1)


def test_sent_frames_come_from_the_bag(bag):
    team = BagRun(bag, [PAPER, TEAM]).team
    recorded = bench_live.read_recorded(bag, team)
    assert [round(one.offset_s, 6) for one in recorded.values()] == [0.0, 0.007, 0.013]
    assert [len(one.frames) for one in recorded.values()] == [15] * 3
    assert [len(one.frames[0]) for one in recorded.values()] == [6, 4, 4]
    assert all(19_200 < one.image_bytes / cameras < 19_400
               for one, cameras in zip(recorded.values(), (3, 2, 2), strict=True))  # fmt: skip
    odd = dataclasses.replace(team, robots={"robot_z": next(iter(team.robots.values()))})
    with pytest.raises(BagError, match="robot_z"):
        bench_live.read_recorded(bag, odd)


def test_usage_of_a_process_is_measured():
    before, began = bench_live.Usage.of(os.getpid()), time.process_time()
    while (took := bench_live.Usage.of(os.getpid()) - before).cpu_ms < 20:
        with mmap.mmap(-1, 1 << 22) as fresh:  # pages that nobody had
            for at in range(0, len(fresh), mmap.PAGESIZE):
                fresh[at] = 1
    assert took.cpu_ms < 1e3 * (time.process_time() - began) + 20  # two ticks
    assert took.page_faults > 100


def test_ages_and_stages_are_read_from_received_messages(monkeypatch):
    monkeypatch.setattr(bench_live.time, "time_ns", lambda: 5_040_000_000)
    heard = bench_live.Heard()

    def scan(robot, ms):
        return SimpleNamespace(robot=robot, stamp=SimpleNamespace(sec=5, nanosec=ms * 1_000_000))

    heard.on_people(SimpleNamespace(scans=[scan("a", 10), scan("b", 23)]))
    assert heard.ages_ms == {"newest": [17.0], "oldest": [30.0]}
    assert heard.scans == {"a": 1, "b": 1}
    values = [SimpleNamespace(key="tops_ms", value="0.25"), SimpleNamespace(key="cells", value="9")]
    status = SimpleNamespace(name="/a/robot_node: scan", values=values)
    heard.on_diagnostics(SimpleNamespace(status=[status]))
    assert heard.stages_ms["/a/robot_node"] == {"tops": [0.25]}


@pytest.mark.slow
@pytest.mark.timeout(180)
@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")
def test_live_run_has_all_documented_figures(bag, monkeypatch):
    pytest.importorskip("rclpy")
    pytest.importorskip("mrs_people_msgs")
    from ros.harness import own_domain

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        # Slowly: what else runs here must not make it fail.
        live = bench_live.measure_live(bag, [PAPER, TEAM], 5.0, frame_hz=3.0, pose_hz=15.0)
    assert live["intervals"] > 0
    assert set(live["latency_ms"]) == {"newest", "oldest"}
    assert live["latency_ms"]["oldest"]["median"] >= live["latency_ms"]["newest"]["median"] > 0
    assert set(live["robots"]) == {"robot_a", "robot_b", "robot_c"}
    for robot in live["robots"].values():
        assert robot["frames"] > 0
        assert robot["cpu_percent"] > 0
        assert robot["pipeline_ms"] > 0
        assert robot["images_bytes_per_s"] > robot["points_bytes_per_s"] > 0
    assert live["planner"]["step_ms"] > 0
