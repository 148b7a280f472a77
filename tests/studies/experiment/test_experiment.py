"""`mrs experiment`: its measures by hand, and on simulated recordings of a few frames."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from mrs_people_loc.config import Human, RobotConfig, Team, load_team
from mrs_people_loc.errors import ConfigError, ScanError
from mrs_people_loc.messages import read_scan
from mrs_people_loc.planner import Planner
from mrs_people_loc.scan import CELL_DTYPE, Cells, Scan
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.scoring.positions import score
from mrs_tools.bags.records import Truth

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")
pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")

from typer.testing import CliRunner

from mrs_people_sim.estimates import estimate_of
from mrs_people_sim.evaluation.results import evaluate_bag
from mrs_people_sim.paper import PAPER_CLUSTERS, PAPER_ERROR_M, PAPER_REMOVED, PAPER_STAGES
from mrs_people_sim.scene import load_scene, read_scene
from mrs_studies.experiment.causes import along_sight, distances
from mrs_studies.experiment.cluster_kinds import kinds_of, places_of
from mrs_studies.experiment.comparisons import POSE_ERRORS, TRIALS, compare_architectures, misplaced
from mrs_studies.experiment.draws import Draw, draw, draws_of
from mrs_studies.experiment.paper_experiment import CELL_SIZES, SCENES, run_experiment
from mrs_studies.experiment.recording import Recording
from mrs_studies.experiment.report import reasons
from mrs_studies.experiment.tally import people_of, recall_of_subsets, remains_of, subsets
from mrs_studies.experiment.ways import (
    FilterThenShare,
    ShareThenFilter,
    cloud_message,
    join,
    one_config,
    read_cloud,
    size_on_wire,
)
from mrs_tools.cli import app

ROOT = Path(__file__).resolve().parents[3]
PAPER = ROOT / "config" / "paper.yaml"
DEFAULT = ROOT / "config" / "default.yaml"
FILES = {name: ROOT / "config" / "scenes" / file for name, file in SCENES.items()}
XYZ = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


def run(folder: Path, **options: Any) -> dict[str, Any]:
    return run_experiment(FILES, PAPER, DEFAULT, folder, **{"draws": 1, "frames": 2, **options})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def report(folder: Path) -> dict[str, Any]:
    return run(folder)


@pytest.fixture(scope="module")
def formation(report: dict[str, Any], folder: Path) -> Recording:
    """The recording of `report`, read again from the bag that it left."""
    (job,) = draws_of(FILES["formation"], folder, seed=None, draws=1, frames=2)
    scene, bag = job
    return Recording.of(Draw(bag, scene, pixels_of(a=range(5), b=range(5), c=range(5))), PAPER)


def pixels_of(**seen: Any) -> dict[str, np.ndarray]:
    """Pixels of the formation's people in two frames; seen: whom a robot has in view."""
    rows = {robot: np.full((2, 5), 149.0) for robot in ("robot_a", "robot_b", "robot_c")}
    for robot, people in seen.items():
        rows[f"robot_{robot}"][:, [*people]] = 150.0
    return rows


def with_pixels(recording: Recording, **seen: Any) -> Recording:
    one = dataclasses.replace(recording.draw, pixels=pixels_of(**seen))
    return dataclasses.replace(recording, draw=one)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    scene = load_scene(FILES["single_person"])
    scene = dataclasses.replace(scene, timing=dataclasses.replace(scene.timing, frames=1))
    return Recording.of(draw(scene, tmp_path_factory.mktemp("alone") / "bag"), PAPER)


def team(**robots: RobotConfig) -> Team:
    return Team(load_team(PAPER, robots=("robot_a",)).planner, robots)


def pose(x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> Pose:
    return Pose(0, x, y, yaw, np.zeros((3, 3)))


def sent_cloud(points: Any) -> Any:
    points = np.array(points, dtype=np.float32).reshape(-1, 3)
    return cloud_message(5, "robot_a/base_link", points.copy().view(XYZ).reshape(-1))


# ------------------------------------------------------------------------------------ the method


def test_papers_method_uses_no_defaults():
    """The experiment must not change with a default."""
    document = yaml.safe_load(PAPER.read_text())
    reported = {key.rpartition("/")[2]: body["ros__parameters"] for key, body in document.items()}
    sections = {
        "robot_node": ("disparity", "zones", "noise", "quantization"),
        "planner_node": ("clustering", "human"),
    }
    loaded = load_team(PAPER, robots=("robot_a",))
    configs = {"robot_node": loaded.robots["robot_a"], "planner_node": loaded.planner}
    for node, names in sections.items():
        for name in names:
            fields = {f.name for f in dataclasses.fields(getattr(configs[node], name))}
            assert fields == set(reported[node][name]), f"{node}: {name}"


# -------------------------------------------------------------------------------------- by hand


@pytest.mark.parametrize(
    ("height", "width", "points", "label", "kind"),
    [
        (1.7, 0.5, 900, "true", "person"),
        (1.7, 0.5, 900, "found", "false_person"),
        (1.0, 1.0, 900, None, "too_low"),
        (1.0, 1.0, 149, None, "too_small"),
        (1.7, 0.1, 900, None, "too_small"),
        (1.7, 1.5, 900, None, "too_large"),
        (2.5, 0.5, 900, None, "too_large"),
    ],
)
def test_kind_of_a_cluster_is_determined(height, width, points, label, kind):
    class Clusters(SimpleNamespace):
        def __len__(self) -> int:
            return 1

    clusters = Clusters(
        height=np.array([height]), width=np.array([width]), points=np.array([points])
    )
    people, true = [0] * (label is not None), [0] * (label == "true")
    human = Human(min_height=1.2, max_height=2.2, min_width=0.2, max_width=1.3, min_points=150)
    assert kinds_of(clusters, human, people, true) == [kind]


def test_positions_are_attributed_to_people_then_furniture_then_walls():
    scene = read_scene(
        {
            "room": {"length": 8.0, "width": 6.0},
            "furniture": [{"kind": "block", "x": 2.0, "y": 0.3, "size": [0.6, 0.8, 0.5]}],
            "robots": {"robot_a": {}},
        },
        "scene.yaml",
    )  # radius of the block: 0.425 m
    people = np.array([[4.0, 3.0], [2.3, 0.3]])
    xy = np.array(
        [[4.3, 3.2], [2.3, 0.6], [1.7, 0.3], [1.3, 0.3], [7.7, 3.0], [4.0, 6.2], [5.0, 3.0]]
    )
    places = ["person", "person", "furniture", "wall", "wall", "wall", "other"]
    assert places_of(xy, people, scene).tolist() == places


def test_all_subsets_are_listed():
    assert subsets(["a", "b", "c"]) == [
        ("a",), ("b",), ("c",), ("a", "b"), ("a", "c"), ("b", "c"), ("a", "b", "c"),
    ]  # fmt: skip


def test_draws_have_consecutive_seeds(tmp_path):
    jobs = draws_of(FILES["formation"], tmp_path, seed=7, draws=3, frames=4)
    assert [scene.seed for scene, _ in jobs] == [7, 8, 9]
    assert {scene.timing.frames for scene, _ in jobs} == {4}
    assert [bag.name for _, bag in jobs] == [f"paper_formation_{seed}" for seed in (7, 8, 9)]
    own = load_scene(FILES["formation"]).seed
    assert draws_of(FILES["formation"], tmp_path, seed=None, draws=1, frames=1)[0][0].seed == own


def test_offset_is_along_and_across_the_line_of_sight():
    assert along_sight(np.array([0.3, -0.1]), np.array([0.0, -5.0])) == pytest.approx((0.1, 0.3))
    assert along_sight(np.array([0.3, 0.4]), np.array([3.0, 4.0])) == pytest.approx((0.5, 0.0))


def test_causes_of_missed_people_are_determined():
    def block(x: float, top: float, count: int) -> list[tuple[float, ...]]:
        return [(x + 0.1 * i, 0.1 * j, top, 0.3, top, count) for i in range(4) for j in range(4)]

    # A table's height, a fragment, somebody's size but too far off; nothing at the last place.
    rows = [*block(1.0, 0.9, 50), (3.0, 0.0, 1.0, 0.5, 1.7, 21), *block(5.0, 1.7, 50)]
    cells = Cells.from_records(np.array(rows, CELL_DTYPE))
    planner = load_team(PAPER, robots=("robot_a",)).planner
    people = Planner(planner).step([Scan("robot_a", 7, cells)], {"robot_a": pose()}, 7)
    assert len(people.persons) == 1
    true = np.array([[1.1, 0.1], [3.1, 0.0], [5.1, -0.35], [8.0, 0.0]])
    (frame,) = score(Truth.build([7], [true]), [estimate_of(people)])
    assert len(frame.missed) == 4
    left = [*remains_of(people, frame, frame.missed, planner)]
    assert left == ["too_low", "too_small", "displaced", "nothing"]


# ----------------------------------------------------------------------------------------- ways


def test_cells_are_unchanged_by_transmission():
    records = np.array([(1, 2, 1.1, 0.3, 1.6, 21), (3, -4, 0.9, 0.4, 0.9, 2**31)], CELL_DTYPE)
    message = cloud_message(3_000_000_007, "robot_a/base_link", records)
    scan = read_scan(message, "robot_a")
    assert scan.stamp_ns == 3_000_000_007
    assert scan.cells.to_records().tolist() == records.tolist()


def test_bytes_include_the_message_and_its_points():
    empty, ten = (size_on_wire(sent_cloud(np.zeros((n, 3)))) for n in (0, 10))
    assert ten - empty == 10 * 12
    assert 100 < empty < 200
    cells = cloud_message(5, "robot_a/base_link", np.zeros(10, CELL_DTYPE))
    assert size_on_wire(cells) - ten > 10 * 12  # 24 bytes each, and names of more fields


def test_clouds_are_transformed_into_the_map():
    first, second = (
        read_cloud(sent_cloud(points)) for points in ([(1, 0, 0.5), (0, 2, 0.6)], [(1, 1, 0.7)])
    )
    joined = join([first, second], [pose(10, 20, math.pi / 2), pose(-1, 0)])
    assert joined.dtype == np.float32
    assert joined == pytest.approx(np.array([(10, 21, 0.5), (8, 20, 0.6), (0, 1, 0.7)]), abs=1e-5)


def test_cloud_with_nan_is_refused():
    with pytest.raises(ScanError, match="robot_a/base_link: a point is NaN"):
        read_cloud(sent_cloud([(1, 2, math.nan)]))


@pytest.mark.parametrize(("scaled", "kept"), [(False, 24), (True, 0)])
def test_points_of_several_robots_add_up_in_a_window(scaled, kept):
    config = load_team(PAPER, robots=("robot_a",)).robots["robot_a"]
    way = ShareThenFilter(team(robot_a=config, robot_b=config), scaled=scaled)
    # Twelve points each in one window of the map, 3 m before the one and 1 m before the other.
    heights = np.linspace(0.3, 1.3, 12)
    near, far = ([(x, 0.05, z) for z in heights] for x in (1.05, 3.05))
    sent = {"robot_a": sent_cloud(far), "robot_b": sent_cloud(near)}
    people = way.plan(sent, {"robot_a": pose(), "robot_b": pose(2.0)}, 9)
    assert (way.zones, way.noise) == (24, kept)
    assert people.fused.cells.count.sum() == kept
    if kept:
        assert people.fused.xy == pytest.approx(np.array([[3.075, 0.075]]), abs=1e-5)
        # The fifth highest of them all: each height is there twice.
        assert people.clusters.height == pytest.approx([heights[-3]], abs=0.002)


def test_stages_must_be_the_same_for_all_robots():
    config = load_team(PAPER, robots=("robot_a",)).robots["robot_a"]
    other = dataclasses.replace(config, noise=dataclasses.replace(config.noise, min_points=15))
    assert one_config(team(robot_a=config, robot_b=config)) == config
    with pytest.raises(ConfigError, match="noise differs between robots"):
        one_config(team(robot_a=config, robot_b=other))


def test_with_one_robot_at_the_origin_both_ways_agree(alone):
    """Joining has no effect then, so this compares the stages with those of the pipeline."""
    (interval,) = alone.intervals
    found = []
    for make in (FilterThenShare, ShareThenFilter):
        way = make(alone.team)
        sent = {robot: way.send(view) for robot, view in interval.views.items()}
        found.append(way.plan(sent, {"robot_a": pose()}, interval.people.stamp_ns))
        assert 0 < way.noise < way.zones
    ours, theirs = found
    assert len(ours.persons) > 0
    assert len(ours.fused) == len(theirs.fused)
    for name in Cells.__dataclass_fields__:
        one, other = (getattr(people.fused.cells, name) for people in found)
        assert one.tolist() == other.tolist(), name
    assert [p.position.tolist() for p in ours.persons] == [
        p.position.tolist() for p in theirs.persons
    ]


@pytest.mark.slow
def test_filtering_first_equals_the_pipeline(formation):
    for interval in formation.intervals:
        way = FilterThenShare(formation.team)
        sent = {robot: way.send(view) for robot, view in interval.views.items()}
        people = way.plan(sent, interval.people.poses, interval.people.stamp_ns)
        assert people.fused.xy.tolist() == interval.people.fused.xy.tolist()
        assert len(people.persons) == len(interval.people.persons) > 0


def test_wrong_pose_has_the_covariance_of_its_error():
    true = Pose(7, 1.0, 2.0, 3.1, np.diag([0.01, 0.02, 0.03]))
    wrong = misplaced(true, np.array([0.1, -0.2, 0.2]), np.array([0.3, 0.3, 0.1]))
    assert wrong.stamp_ns == 7
    assert [wrong.x, wrong.y] == pytest.approx([1.1, 1.8])
    assert wrong.yaw == pytest.approx(3.3 - 2 * math.pi)
    assert wrong.covariance == pytest.approx(np.diag([0.1, 0.11, 0.04]))


@pytest.mark.parametrize("trial", TRIALS)
def test_trial_changes_only_its_stated_parameters(trial, folder, report):
    file = folder / f"{trial.replace(' ', '_')}.yaml"
    printed, tried = (load_team(*files, robots=("robot_a",)) for files in ([PAPER], [PAPER, file]))
    wanted = printed.robots["robot_a"]
    for section, values in TRIALS[trial].items():
        changed = dataclasses.replace(getattr(wanted, section), **values)
        wanted = dataclasses.replace(wanted, **{section: changed})
    assert tried == Team(printed.planner, {"robot_a": wanted})
    assert (tried == printed) == (trial == "as printed")


# ------------------------------------------------------------------------- a simulated recording


def test_retention_equals_that_of_the_evaluation(report, folder):
    (bag,) = [path for path in folder.iterdir() if path.name == "paper_formation_2004"]
    stages = evaluate_bag(bag, [PAPER]).report()["stages"]
    kept = report["retention"]["formation"]
    for robot, means in stages.items():
        for stage, left in PAPER_STAGES.items():
            assert kept[robot][stage] == pytest.approx(means[f"{left}_kept"])
    noise, zones = (sum(means[s] for means in stages.values()) for s in ("foreground", "cropped"))
    assert kept["all"]["noise"] == pytest.approx(noise / zones)


def test_larger_cells_keep_fewer_points(report):
    for scene in SCENES:
        kept = report["cells"][scene]
        assert np.all(np.diff(kept) < 0)
        at = CELL_SIZES.index(0.05)
        assert kept[at] == pytest.approx(report["retention"][scene]["all"]["cells"])


def test_formation_has_clusters_of_people_table_and_fragments(report):
    clusters = report["clusters"]
    assert (clusters["person"]["mean"], clusters["too_low"]["mean"]) == (5.0, 1.0)
    assert clusters["person"]["where"] == {"person": 10}
    assert clusters["too_low"]["where"] == {"furniture": 2}
    assert clusters["too_small"]["median_points"] < 150 < clusters["person"]["median_points"]
    assert sum(clusters[kind]["mean"] for kind in PAPER_CLUSTERS) == clusters["all"]["mean"]
    assert clusters["all"]["min"] <= clusters["all"]["mean"] <= clusters["all"]["max"]


def test_every_subset_of_the_robots_is_scored(report):
    rows = {tuple(row["robots"]): row for row in report["robots"]}
    assert len(rows) == 7
    assert [rows[(f"robot_{r}",)]["in_view"] for r in "abc"] == [5.0, 4.0, 4.0]
    team = rows["robot_a", "robot_b", "robot_c"]
    assert team == {"robots": team["robots"], **report["people"]["formation"]}
    assert team["recall"] == 1.0
    assert team["error_per_axis_m"] < team["error_m"]["mean"] < 0.12
    for row in rows.values():
        assert row["recall"] == pytest.approx(row["found"] / 5)
        missed = 2 * row["in_view"] * (1.0 - row["recall_in_view"])
        assert sum(row["missed_as"].values()) == pytest.approx(missed)
        assert sum(row["false_at"].values()) == pytest.approx(2 * row["false"])
        assert row["found"] <= team["found"]
    assert rows[("robot_b",)]["found"] < 4.0  # if not, the reason given in the report is idle


def test_subset_uses_only_its_own_scans(formation):
    (row,) = [r for r in recall_of_subsets([formation]) if r["robots"] == ["robot_b"]]
    found = people_of(formation, ["robot_b"])
    assert {p.fused.robots for p in found} == {("robot_b",)}
    stamps = [
        next(s.stamp_ns for s in i.scans if s.robot == "robot_b") for i in formation.intervals
    ]
    assert [p.stamp_ns for p in found] == stamps
    assert row["in_view"] == 5.0  # by the pixels that this recording was given


def test_in_view_counts_people_seen_by_any_robot(formation):
    recording = with_pixels(formation, a=[0], b=[1, 2])
    assert recording.in_view(["robot_a", "robot_b"], 1).tolist() == [True, True, True, False, False]
    assert not recording.in_view(["robot_c"], 0).any()
    team = recall_of_subsets([with_pixels(formation, a=[0])])[-1]
    assert (team["in_view"], team["found"], team["recall_in_view"]) == (1.0, 5.0, 1.0)


def test_distance_is_that_of_people_in_view(formation):
    recording = with_pixels(formation, b=[3], c=[4])
    away = distances([recording], ["robot_b", "robot_c"])
    assert away["from_m"] == pytest.approx(math.hypot(2.8, 1.05), abs=0.01)
    assert away["to_m"] == pytest.approx(math.hypot(2.9, 0.95), abs=0.01)


def test_ways_are_compared_on_the_same_images(report):
    ways = report["architecture"]
    ours, theirs = ways["filter_then_share"], ways["share_then_filter"]
    for key in ("recall", "false", "error_m"):
        assert ours[key] == report["people"]["formation"][key]
    assert ours["noise_kept"] == pytest.approx(report["retention"]["formation"]["all"]["noise"])
    assert theirs["noise_kept"] > ours["noise_kept"]
    assert ways["share_then_filter_scaled"]["noise_kept"] < ours["noise_kept"]
    assert theirs["bytes_per_s"] > 20 * ours["bytes_per_s"]
    assert ours["bytes_per_s"] == pytest.approx(5.0 * ours["bytes_per_frame"])
    assert all(way["planner_ms"]["median"] > 0 for way in ways.values())


def test_points_equal_those_of_the_evaluation(report, folder):
    (bag,) = [path for path in folder.iterdir() if path.name == "paper_formation_2004"]
    stages = evaluate_bag(bag, [PAPER]).report()["stages"]
    for robot, points in report["points"]["formation"].items():
        means = stages[robot]
        assert points["ranged"] == pytest.approx(means["valid_pixels"] * 160 * 120)
        assert points["removed"] == pytest.approx(means["raw"] - means["cells"])
        assert points["ranged"] > points["raw"] > points["zones"] > points["noise"]
    assert report["points"]["formation"]["robot_a"]["raw"] > 12000


def test_trials_use_the_same_images(report):
    printed, lower, edges = report["trials"]
    assert [row["trial"] for row in report["trials"]] == [*TRIALS]
    for key in ("recall", "false", "error_m"):
        assert printed[key] == report["people"]["formation"][key]
    assert printed["noise"] == report["retention"]["formation"]["all"]["noise"]
    assert (lower["ranged"], lower["zones"]) == (printed["ranged"], printed["zones"])
    assert lower["noise"] > printed["noise"] + 0.03
    assert lower["clusters"] > printed["clusters"]
    assert edges["ranged"] != printed["ranged"]


def test_wrong_poses_displace_people(report):
    rows = report["poses"]
    assert [(row["position_m"], row["heading_deg"]) for row in rows] == [*POSE_ERRORS]
    exact, *_, worst = rows
    printed = exact["methods"]["paper.yaml"]
    people = report["people"]["formation"]
    assert printed["error_m"] == pytest.approx(people["error_m"]["mean"])
    assert (printed["recall"], printed["precision"]) == (people["recall"], people["precision"])
    for method in ("paper.yaml", "default.yaml"):
        errors = [row["methods"][method]["error_m"] for row in rows[:4]]
        assert errors == sorted(errors)
        assert errors[3] > errors[0] + 0.05
        assert worst["methods"][method]["precision"] < exact["methods"][method]["precision"]
    assert exact["methods"]["default.yaml"]["error_m"] < printed["error_m"]


def test_bytes_per_frame_include_all_robots(formation):
    ours, theirs, _ = compare_architectures([formation]).values()
    views = [view for interval in formation.intervals for view in interval.views.values()]
    points = np.mean([len(view.stages.cloud) for view in views])
    cells = np.mean([len(view.stages.scan.cells) for view in views])
    assert theirs["bytes_per_frame"] == pytest.approx(3 * (12 * points + 150), abs=3 * 50)
    assert ours["bytes_per_frame"] == pytest.approx(3 * (24 * cells + 220), abs=3 * 70)


def test_shares_add_up_to_one(report):
    for zones in report["causes"]["zones"].values():
        assert sum(zones["where"].values()) == pytest.approx(1.0)
        assert 0.0 < zones["low"] + zones["high"] < 1.0
    kept = report["retention"]["formation"]["all"]["zones"]
    formation = report["causes"]["zones"]["formation"]
    assert formation["low"] + formation["high"] + kept == pytest.approx(1.0)
    assert formation["of_all_pixels"] < kept
    assert formation["where"]["person"] > 0.5
    where = report["causes"]["zones"]["single_person"]["where"]
    assert where["person"] > where["wall"] > 0.15
    near, *_, far = report["causes"]["noise"]
    assert near["kept"] > far["kept"]


@pytest.mark.slow
def test_figures_are_determined_by_the_seed(report, tmp_path):
    def repeatable(what: dict[str, Any]) -> dict[str, Any]:
        what = copy.deepcopy(what)
        for way in what["architecture"].values():
            del way["planner_ms"]
        for row in what["poses"]:
            del row["methods"]["default.yaml"]  # StereoBM with its pre-filter cap: see below
        return what

    again, other = run(tmp_path / "again"), run(tmp_path / "other", seed=99)
    assert repeatable(again) == repeatable(report)
    for one, two in zip(again["poses"], report["poses"], strict=True):
        for key, figure in one["methods"]["default.yaml"].items():
            assert figure == pytest.approx(two["methods"]["default.yaml"][key], abs=0.02), key
    assert other["seeds"] == {"formation": [99], "single_person": [99]}
    assert other["retention"] != report["retention"]


# -------------------------------------------------------------------------------------- reasons


def test_figures_that_agree_with_the_paper_have_no_reason(report):
    same = copy.deepcopy(report)
    for scene in same["retention"].values():
        scene["all"] = {"zones": 0.16, "noise": 0.72, "cells": 0.066}
    same["clusters"]["too_small"]["mean"] = 1.0
    same["clusters"]["false_person"]["mean"] = 0.0
    same["people"]["formation"]["error_m"]["mean"] = PAPER_ERROR_M
    for robot, least in PAPER_REMOVED.items():
        same["points"]["formation"][robot]["removed"] = least
    for row in same["robots"]:
        row["missed_as"] = {}
    ours, theirs, _ = same["architecture"].values()
    theirs.update(false=ours["false"] + 0.5, recall=ours["recall"])
    assert reasons(same) == []


@pytest.mark.parametrize(
    ("figure", "part"),
    [
        ("zones", "% of the raw ones"),
        ("points removed of robot_a", "(paper: over 15000)"),
        ("zones, one person", "at walls"),
        ("noise", "1-2 m 9"),
        ("cells", "cells of 4."),
        ("fragments", "single windows"),
        ("mean error", "per axis"),
        ("rear robots", "in view (paper: 4)"),
        ("claim", "in 2 frames"),
    ],
)
def test_figures_that_differ_have_a_reason(report, figure, part):
    (why,) = [reason["why"] for reason in report["reasons"] if reason["figure"] == figure]
    assert part in why
    assert any(letter.isdigit() for letter in why)


# -------------------------------------------------------------------------------------- command


@pytest.mark.slow
def test_command(tmp_path: Path) -> None:
    file, out = tmp_path / "figures.json", tmp_path / "bags"
    arguments = ["experiment", "--draws", "1", "--frames", "1", "-j", "1"]
    arguments += ["--json", str(file), "--out", str(out)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert max(map(len, lines)) <= 100
    assert "…" not in result.output
    for part in ("zones      15", "share, then filter, th_n x robots", "robot_a robot_b robot_c"):
        assert part in result.output
    figures = json.loads(file.read_text())
    assert (figures["draws"], figures["frames"], figures["config"]) == (1, 1, "paper.yaml")
    names = {"paper_formation_2004", "single_person_4"}
    assert {path.name for path in out.iterdir() if path.is_dir()} == names

    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 1
    assert "exists" in again.stderr


def test_unwritable_file_is_reported(tmp_path: Path) -> None:
    arguments = ["experiment", "--draws", "1", "--frames", "1", "-j", "1"]
    result = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "no" / "file")])
    assert result.exit_code == 1
    assert "cannot be written" in result.stderr
