"""The table of `mrs localization`."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_people_sim.light.team import TeamRun
from mrs_people_sim.scene import Robot
from mrs_people_sim.scoring.poses import PoseScores, PoseTrack
from mrs_studies.experiment import localization
from mrs_studies.experiment.localization import Case, CaseScores, run_cases
from mrs_studies.experiment.localization_report import markdown
from mrs_tools.bags.records import Truth
from mrs_tools.cli import app

START_NS = 1_000_000_000_000


def track(x: np.ndarray) -> PoseTrack:
    """A robot at x(t), ten times a second."""
    stamps = START_NS + np.arange(len(x), dtype=np.int64) * 100_000_000
    poses = np.column_stack([x, np.zeros((len(x), 2))])
    return PoseTrack(stamps, poses, np.zeros((len(x), 3, 3)))


def team(error: np.ndarray) -> TeamRun:
    """Two robots that stand; one is wrong by so much."""
    still = np.zeros(len(error))
    true = {"a": track(still), "b": track(still + 2.0)}
    wrong = {"a": track(still), "b": track(error + 2.0)}
    return TeamRun(true, wrong, wrong, Truth.build([], []), {}, {}, start_ns=START_NS)


def test_a_team_is_right_again_when_it_stays_so():
    error = np.zeros(200)
    # Wrong from 5 to 7 s, right for a second, and wrong again until 9 s.
    error[50:70] = error[80:90] = 0.5
    assert localization._right_after(team(error), 5.0) == pytest.approx(4.0)
    assert localization._right_after(team(error), 9.0) == pytest.approx(0.0)


def test_a_team_that_stays_wrong_is_never_right_again():
    assert math.isnan(localization._right_after(team(np.full(100, 0.3)), 2.0))


def test_scores_of_several_tours_are_added():
    one = CaseScores(PoseScores(runs=1), named={"x": (3.0,)}, right_s=(1.0,))
    two = CaseScores(PoseScores(runs=1), named={"x": (4.0,), "y": (5.0,)}, right_s=(math.nan,))
    total = (one + two).report()
    assert total["localized"]["runs"] == 2
    assert total["named_s"] == {"x": [3.0, 4.0], "y": [5.0]}
    assert total["right_again_s"] == [1.0, None]


def test_cases_are_run_with_their_seeds(monkeypatch):
    ran = []

    def run_case(case: Case, seed: int) -> CaseScores:
        ran.append((case.name, seed))
        return CaseScores(PoseScores(runs=1))

    monkeypatch.setattr(localization, "run_case", run_case)
    cases = [Case("one", ""), Case("other", "")]
    runs = [scores.localized.runs for scores in run_cases(cases, 4)]
    assert runs == [4, 4]
    assert ran == [(name, seed) for name in ("one", "other") for seed in (1, 2, 3, 4)]


def test_table_by_hand():
    poses = PoseScores(
        runs=1,
        along=np.array([0.01]), across=np.array([-0.02]), heading=np.array([0.1]),
        squares=np.array([3.0]), along_sigmas=np.array([4.0]),
        apart=np.array([0.03]), turned=np.array([-np.pi / 180]),
        in_team=np.array([0.015]), turned_in_team=np.array([0.0]),
    )  # fmt: skip
    people = dict.fromkeys(("exact", "localized", "odometry"), ())
    scores = CaseScores(poses, poses, people, {"robot_b doubted": (2.0,)}, (math.nan,), poses)
    text = markdown([Case("hall", "")], [scores.report()])
    row = "| hall | 1 | 3.0 / 3.0 | 1.00 / 1.00 | 3.0 / 3.0 | 1.5 / 1.5 | 0.00 / 0.00 |"
    assert f"{row} 1.0 / 1.0 | 2.0 / 2.0 | 0.000 | 3.00 (0.22 to " in text
    assert "| hall | robot_b doubted (1 of 1, after 2 s) | never |" in text


def test_command_prints_and_writes(tmp_path, monkeypatch):
    scores = CaseScores(
        PoseScores(runs=1),
        PoseScores(runs=1),
        dict.fromkeys(("exact", "localized", "odometry"), ()),
    )
    monkeypatch.setattr(localization, "run_case", lambda case, seed: scores)
    page, figures = tmp_path / "page.md", tmp_path / "figures.json"
    page.write_text("# Title\n\n## Results\n\nold\n")
    arguments = ["localization", "--only", "hall, no", "-j", "1", "--out", page, "--json", figures]
    result = CliRunner().invoke(app, [*map(str, arguments)])
    assert result.exit_code == 0, result.output
    assert page.read_text().startswith("# Title\n\n## Results\n\n### Poses\n")
    assert "old" not in page.read_text()
    assert page.read_text().endswith(result.output)
    (name,) = json.loads(figures.read_text())
    assert name == "hall, no wall in range"


def test_robots_of_a_case_have_wheels_and_faults():
    robots = {"robot_a": Robot(), "robot_b": Robot()}
    case = Case("one", "", robots={"robot_b": {"frozen": (1.0, 2.0)}}, wheels=True)
    changed = localization._changed(robots, case)
    assert [robot.wheels for robot in changed.values()] == [*localization.WHEELS[:2]]
    assert [robot.frozen for robot in changed.values()] == [(), (1.0, 2.0)]
    assert localization._changed(robots, Case("other", "")) == robots


def test_the_way_until_wheels_are_known_is_left_out():
    run = team(np.zeros(400))
    driven = {"a": track(np.arange(400) * 0.1), "b": run.true["b"]}  # 1 m/s
    settled = localization._settled(dataclasses.replace(run, true=driven))
    first_s = (settled["b"].stamps_ns[0] - START_NS) / 1e9
    assert first_s == pytest.approx(localization.SETTLED_M, abs=0.2)


def test_command_takes_a_scene_and_a_first_seed(tmp_path, monkeypatch):
    ran = []

    def run_case(case: Case, seed: int) -> CaseScores:
        ran.append((case.name, case.scene, case.wheels, case.trouble.known, seed))
        return CaseScores(people=dict.fromkeys(("exact", "localized", "odometry"), ()))

    monkeypatch.setattr(localization, "run_case", run_case)
    scene = tmp_path / "mine.yaml"
    scene.write_text("{}")
    arguments = ["--scene", scene, "--seed", 7, "--seeds", 2, "--only", "wheels", "-j", 1]
    result = CliRunner().invoke(app, ["localization", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    assert ran == [
        (f"mine, wheels{more}", str(scene), True, bool(more), seed)
        for more in ("", ", walls known")
        for seed in (7, 8)
    ]


@pytest.mark.parametrize("command", ["localization", "guiding"])
@pytest.mark.parametrize("scene", ["moon", "moon.yaml"])
def test_scenes_that_are_not_there_are_named(command, scene):
    result = CliRunner().invoke(app, [command, "--scene", scene])
    assert result.exit_code == 2
    assert "moon" in result.output
    assert {"localization": "tour_hall", "guiding": "guided_hall"}[command] in result.output


def test_unknown_tours_are_named():
    result = CliRunner().invoke(app, ["localization", "--only", "moon"])
    assert result.exit_code == 2
    assert "moon" in result.output


@pytest.mark.slow
def test_a_tour_is_run():
    scores = localization.run_case(Case("hall", "tour_hall.yaml"), 1)
    report = scores.report()
    relative, alone = (
        report[way]["relative"]["position_m"]["median"] for way in ("localized", "odometry")
    )
    assert relative < 0.25 * alone
    assert report["people"]["exact"]["recall"] > 0.9
