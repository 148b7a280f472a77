"""`mrs bench`: what it runs on, what it reports, and that nothing is timed that differs.

Nothing here asserts a time: how fast the method is, the bench says, not a test.
"""

import dataclasses
import json
import math
import mmap
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="reading bags needs rosbags")
pytest.importorskip("typer", reason="mrs is a typer command")

import typer
from typer.testing import CliRunner

from mrs_people_loc.cells import filters
from mrs_people_loc.config import PlannerConfig, RobotConfig, load_team
from mrs_people_loc.errors import BagError
from mrs_people_loc.planner import Planner
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.common import write_json
from mrs_studies.bench import growth as bench_growth
from mrs_studies.bench import live as bench_live
from mrs_studies.bench import run as bench_run
from mrs_studies.bench import scenes as bench_scenes
from mrs_studies.bench import targets as bench_targets
from mrs_studies.bench.differs import DiffersError
from mrs_studies.commands import bench
from mrs_tools.bags.offline import BagRun
from oracle import comparison

ROOT = Path(__file__).resolve().parents[3]
PAPER = ROOT / "config" / "paper.yaml"
DEFAULT = ROOT / "config" / "default.yaml"
TEAM = ROOT / "config" / "team.yaml"
#: The paper's method, and the default one.
CELLS = load_team(PAPER, robots=("robot_a",)).robots["robot_a"]
BODIES = RobotConfig()


@pytest.fixture(scope="session")
def bag():
    path = ROOT / "bags" / "paper_formation"
    if not path.exists():
        pytest.skip("bags/paper_formation is not here")
    return path


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
    growth = bench_growth.time_growth({"c": file}, 11, comparison, rounds=1)
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
        bench_growth.time_growth({"c": DEFAULT}, 16, comparison)


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
        "search", "patches", "vote", "evidence", "judge", "appearance", "select", "cells",
    },
}  # fmt: skip


@pytest.mark.slow
def test_report_has_all_documented_figures(bag, tmp_path, monkeypatch):
    # The other intervals are compared in tests/oracle.
    monkeypatch.setattr(bench_run, "_CHECKED", 1000)
    documented = bench_run.targets
    missed = bench_targets.Target("planner", "paper.yaml", 99.0, 2.0, "ms")
    monkeypatch.setattr(bench_run, "targets", lambda *of: [*documented(*of), missed])
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
        "1",
        "--robots",
        "8",
        "--no-live",
    ]
    result = CliRunner().invoke(app, [*args, "--json", str(file)], env={"COLUMNS": "120"})
    assert result.exit_code == 0, result.output  # though a target is missed
    assert "missed" in result.output
    report = json.loads(file.read_text())
    assert report.keys() == {
        "machine", "bag", "equal_to_reference", "robot", "planner", "growth", "tracking", "walls",
        "localization", "guiding", "live", "viewers", "targets",
    }  # fmt: skip
    assert report["live"] is None
    assert report["equal_to_reference"]["views"] == 2 * 3
    for name in ("paper.yaml", "default.yaml"):
        assert report["robot"][name].keys() == {"binocular", "trinocular", "pair of three"}
        for kind, figures in report["robot"][name].items():
            assert figures["frames"] == 1
            assert figures["image"] == "160x120"
            pairs = 2 if kind == "trinocular" else 1
            assert figures["searched_px"] == [16 if name == "paper.yaml" else 32] * pairs
            assert figures["rest_to_stereo_bm"] > 0
            assert figures["frames_per_s"] > 0
            stages = figures["stages_ms"]
            around = {"StereoBM", "disparity around it", "all but StereoBM", "whole"}
            around |= {"StereoBM on the bare pair", "collision monitor, beside it"}
            assert set(stages) == STAGES[name] | around
            assert (figures["bodies"] > 0) == (name == "default.yaml")
            assert all(0 <= s["median"] <= s["p99"] for s in stages.values())
        planner = report["planner"][name]
        assert (planner["robots"], planner["people"], planner["people_found"]) == (4, 10, 10)
        stages = {"fusion", "masking", "joining", "clustering", "whole"}
        stages |= {"tracking", "groups"} if name == "default.yaml" else set()
        assert set(planner["stages_ms"]) == stages
    assert [row["people"] for row in report["tracking"]] == [10, 50, 200]
    assert all(row["tracker_ms"] > 0 and row["groups_ms"] > 0 for row in report["tracking"])
    assert [row["sensor"] for row in report["walls"]] == ["stereo head, 160x120", "laser, 720 rays"]
    assert all(0 < row["median"] <= row["p99"] and row["found"] > 0 for row in report["walls"])
    assert [row["robots"] for row in report["localization"]] == [3, 8]
    assert all(row["shared_ms"] > 0 and row["walls_ms"] > 0 for row in report["localization"])
    for row in report["localization"]:
        assert row["walls_ms"] < row["frame_ms"] <= row["frame_p99_ms"]
    guiding = report["guiding"]
    assert (guiding["robots"], guiding["people"]) == (3, 10)
    assert all(guiding[f"{what}_ms"] > 0.05 for what in ("guide", "paths", "drive"))
    *targets, last = report["targets"]
    assert not last["reached"]
    limits = [1.0, 500.0, 2.0, 1.0, 1.0, 8.0, 3.0, 1.0, 1.0, 0.5, 10.0, 1.0, 1.0]
    limits += [*[0.2, 1.0, 1.0] * 2, 10.0, 2.0]
    assert [t["limit"] for t in targets] == limits
    files = [t["configuration"].partition(",")[0] for t in targets]
    walls = ["stereo head", "laser"]
    sizes = [
        "10 people",
        "200 people",
        *walls,
        *["3 robots"] * 3,
        *["8 robots"] * 3,
        *["3 robots"] * 2,
    ]
    assert files == ["paper.yaml"] * 5 + ["default.yaml"] * 4 + sizes
    assert "pair of three" in targets[5]["configuration"]
    rows = [line.split() for line in result.output.splitlines()]
    assert [row[-1] for row in rows if row[:1] == ["tops"]] == ["-"] * 3
    assert [row[1] for row in rows if row[:1] == ["search"]] == ["-"] * 3
    assert [row[-1] for row in rows if row[:1] == ["cloud"]] == ["-"] * 3
    assert not any("-" in row for row in rows if row[:1] == ["cells"])
    for target in targets:
        assert f"{target['value']:.4g}" in result.output
    for text in ("paper.yaml", "default.yaml", "trinocular", "equal to the oracle"):
        assert text in result.output


def test_differing_results_prevent_timing(bag, monkeypatch):
    right = filters.measure_tops
    monkeypatch.setattr(filters, "measure_tops", lambda *a, **k: right(*a, **k) + np.float32(0.001))
    monkeypatch.setattr(bench_run, "time_robot", lambda *_: pytest.fail("timed"))
    with pytest.raises(DiffersError, match=r"cells\.top"):
        bench.run_bench(bag, [PAPER], frames=1, robots=1)


def test_oracle_is_found_without_a_previous_import():
    code = "from mrs_studies.bench.oracle import find; print(find().__file__)"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd="/", capture_output=True, text=True, check=True
    )
    assert Path(result.stdout.strip()) == ROOT / "tests" / "oracle" / "comparison.py"


@pytest.mark.parametrize(
    ("value", "at_least", "reached"),
    [(1.9, False, True), (2.0, False, True), (2.1, False, False), (2.1, True, True),
     (1.9, True, False), (math.nan, True, False), (math.nan, False, False)],
)  # fmt: skip
def test_targets_are_compared_in_their_direction(value, at_least, reached):
    target = bench_targets.Target("t", "c", value, 2.0, "ms", at_least)
    assert target.report()["reached"] is reached


def test_two_configurations_of_one_name_are_refused(bag):
    with pytest.raises(bench_run.BenchError, match=r"paper\.yaml"):
        bench.run_bench(bag, [PAPER, PAPER])


def test_undefined_values_are_null_in_the_file(tmp_path):
    file = tmp_path / "out.json"
    write_json(file, bench.finite({"a": math.nan, "b": [math.inf, 1.5], "c": {"d": None}}))
    assert json.loads(file.read_text()) == {"a": None, "b": [None, 1.5], "c": {"d": None}}


# ------------------------------------------------------------------------------------ the live part


def test_message_gets_the_current_stamp(bag):
    from mrs_tools.bags.reader import BagReader

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


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")
def test_viewers_are_measured_beside_a_planner_without_any(monkeypatch):
    pytest.importorskip("aiohttp")
    pytest.importorskip("mrs_people_msgs")
    from mrs_studies.bench import viewers
    from ros.harness import own_domain

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setattr(viewers, "_SETTLE_S", 0.5)
    with own_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        report = viewers.measure_viewers(DEFAULT, 1.5, (0, 2))
    without, two = report["rows"]
    assert (without["viewers"], two["viewers"]) == (0, 2)
    assert without["intervals_per_s"] > 0
    assert without["view_cpu_percent"] is None
    assert two["view_cpu_percent"] > 0
    # Each gets a state of all ten people about as often as the planner sends them.
    assert 0.3 * two["intervals_per_s"] < two["states_per_s"] < 1.5 * viewers.RATE_HZ
    assert two["bytes_per_s"] > 1000.0 * two["states_per_s"]
    assert report["encode_ms"] > 0
