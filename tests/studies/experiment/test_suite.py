"""`mrs suite`: the steps, the rows and tables, and a suite of one scene from end to end."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.config import PlannerConfig, RobotConfig, load_team
from mrs_people_sim.scoring.positions import score
from mrs_people_sim.scoring.stragglers import StragglerScores
from mrs_people_sim.scoring.tracks import score_tracks
from mrs_tools.bags.records import Estimate, Truth

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_people_sim.evaluation.results import Result
from mrs_people_sim.scene import read_scene
from mrs_studies.commands import suite as suite_command
from mrs_studies.experiment import suite_steps as suite
from mrs_studies.experiment.suite_report import markdown
from mrs_studies.experiment.suite_steps import Row, steps
from mrs_tools.cli import app

ROOT = Path(__file__).resolve().parents[3]
PAPER = ROOT / "config" / "paper.yaml"


def result_of(*errors: float, missed: int = 0, false: int = 0) -> Result:
    """One frame: somebody found this far off for each error [m], others missed or made up."""
    count = len(errors) + missed
    true = np.stack([3.0 * np.arange(count), np.zeros(count)], axis=1)
    found = [(3.0 * k, error) for k, error in enumerate(errors)]
    found += [(3.0 * k, 50.0) for k in range(false)]
    covariances = np.tile(0.02**2 * np.eye(2), (len(found), 1, 1))
    estimate = Estimate(0, np.array(found).reshape(-1, 2), covariances)
    return Result(frames=score(Truth.build([0], [true]), [estimate]))


def cells_of(text: str, first: str) -> list[str]:
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {first} |")]
    return [cell.strip() for cell in line.strip("|").split("|")]


# -------------------------------------------------------------------------------- steps ----


def test_steps_lead_from_the_paper_to_the_default() -> None:
    ladder = steps()
    assert (dict(ladder[0].robot), dict(ladder[0].planner)) == ({}, {})
    names = [step.name for step in ladder]
    assert len(set(names)) == len(names) > 3
    robot: dict = {}
    planner: dict = {}
    seen = []
    for step in ladder:
        robot, planner = {**robot, **step.robot}, {**planner, **step.planner}
        with suite._config_file(robot, planner) as file:
            team = load_team(PAPER, file, robots=("robot_a",))
        seen.append((team.robots["robot_a"], team.planner))
    paper = load_team(PAPER, robots=("robot_a",))
    assert seen[0] == (paper.robots["robot_a"], paper.planner)
    for before, after in pairwise(seen):
        assert before != after  # each step is one
    last, planner_config = seen[-1]
    assert last.disparity == RobotConfig().disparity
    assert last.bodies == RobotConfig().bodies
    assert planner_config.joining == PlannerConfig().joining
    assert planner_config.masking == PlannerConfig().masking
    assert planner_config.splitting == PlannerConfig().splitting
    assert planner_config.tracking == PlannerConfig().tracking


# --------------------------------------------------------------------------------- rows ----


def row(name: str = "ours") -> Row:
    results = {"test_a": result_of(0.03, 0.05), "test_b": result_of(0.10, missed=1, false=2)}
    return Row(name, results, {"test_a": suite.STANDING, "test_b": suite.WALKING})


def test_pooled_rows_match_hand_computed_values() -> None:
    kinds = ((suite.STANDING,), (suite.WALKING,), ())
    standing, walking, both = (row().report(*kind) for kind in kinds)
    assert (standing["true"], walking["true"], both["true"]) == (2, 2, 4)
    assert (standing["recall"], walking["recall"], both["recall"]) == (1.0, 0.5, 0.75)
    assert walking["precision"] == pytest.approx(1 / 3)
    assert both["precision"] == pytest.approx(3 / 5)
    assert standing["error_m"]["mean"] == pytest.approx(0.04)
    assert both["error_m"]["mean"] == pytest.approx(0.06)
    # 2.45 sigma of 2 cm are 4.9 cm.
    assert (standing["coverage_95"], walking["coverage_95"]) == (0.5, 0.0)


def test_tables_match_hand_computed_values() -> None:
    first = Row("printed", {"test_a": result_of(missed=2), "test_b": result_of(0.2, missed=1)},
                row().kinds)  # fmt: skip
    text = markdown([first, row()], "test")
    assert text.startswith("## Results on the test half\n")
    assert "What each step gives" not in text
    assert cells_of(text, "default.yaml") == [
        "default.yaml",
        "4",
        "0.750",
        "0.600",
        "6.0",
        "9.5",
        "0.333",
    ]
    assert cells_of(text, "default.yaml, standing")[2:5] == ["1.000", "1.000", "4.0"]
    assert cells_of(text, "default.yaml, walking")[2:5] == ["0.500", "0.333", "10.0"]
    assert cells_of(text, "paper.yaml, standing")[1:] == ["2", "0.000", "-", "-", "-", "-"]
    assert cells_of(text, "test_a")[1:5] == ["2", "1.000 (0.000)", "1.000 (-)", "4.0 (-)"]
    widths = {line.count("|") for line in text.splitlines() if line.startswith("| test")}
    assert widths == {12}
    assert cells_of(text, "test_a")[7:] == ["-"] * 4  # nobody is followed


def followed(*ids: int) -> Result:
    """Somebody who stands is followed by these, at 10 Hz; whose velocity is 0.3 m/s."""
    place = np.zeros((1, 2))
    stamps = [100_000_000 * k for k in range(len(ids))]
    truth = Truth.build(stamps, [place] * len(ids))
    estimates = [
        Estimate(stamp, place, np.zeros((1, 2, 2)), ids=np.array([k]), velocities=place + (0.3, 0))
        for stamp, k in zip(stamps, ids, strict=True)
    ]
    frames = score(truth, estimates)
    return Result(frames=frames, tracks=score_tracks(truth, frames, estimates))


def test_table_of_tracks_matches_hand_computed_values() -> None:
    found = {"test_a": followed(1, 1, 1, 1), "test_b": followed(1, 2, 2, 2),
             "test_c": followed(1, 1, 2, 2)}  # fmt: skip
    kinds = {"test_a": suite.STANDING, "test_b": suite.WALKING, "test_c": suite.GROUP}
    text = markdown([Row("printed", found, kinds), Row("ours", found, kinds)], "test")
    (_, _, after) = text.partition("## Tracks")
    rows = {label: cells_of(after, label)[1:-1] for label in
            ("standing and walking", "standing", "walking", "walking group")}  # fmt: skip
    assert rows == {
        "standing and walking": ["0.875", "0.875", "0.30", "1", "75.00"],  # one in 0.8 s
        "standing": ["1.000", "1.000", "0.30", "0", "0.00"],
        "walking": ["0.750", "0.750", "0.30", "1", "150.00"],
        "walking group": ["0.750", "0.500", "0.30", "1", "150.00"],
    }
    assert cells_of(text, "test_c")[7:] == rows["walking group"][:-1]


def test_people_have_rows_by_how_much_of_them_is_visible() -> None:
    place = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]])
    truth = Truth.build([0], [place], shares=[np.array([0.3, 0.6, 0.9])])
    near = Estimate(0, place[:2], np.zeros((2, 2, 2)))
    result = Result(frames=score(truth, [near]))
    row = Row("ours", {"test_a": result}, {"test_a": suite.STANDING})
    text = markdown([row, row], "test")
    half_hidden = text[text.index("## Half-hidden people") : text.index("## Tracks")]
    assert cells_of(half_hidden, "standing")[1:] == ["1", "1.000", "1", "1.000", "1", "0.000"]


def test_stragglers_have_a_line() -> None:
    def of(kind: str, **scores: Any) -> str:
        found = {"test_a": dataclasses.replace(followed(1), stragglers=StragglerScores(**scores))}
        row = Row("ours", found, {"test_a": kind})
        return markdown([row, row], "test")

    walked = {"true": 4, "false": 3, "observed_s": 90.0, "delays_s": np.array([0.5, 0.9, 1.9])}
    assert (
        "\nStragglers of the walking groups: 3 of 4 flagged, 2 of them within 1 s of crossing the "
        "limit, after 1.10 s on average and 1.90 s at most; 3 false flags in 1.5 minutes.\n"
    ) in of(suite.GROUP, **walked)
    assert "0 of 0 flagged, 0 of them within 1 s of crossing the limit; 0 false flags" in of(
        suite.GROUP, observed_s=60.0
    )
    assert "Stragglers" not in of(suite.GROUP)
    assert "Stragglers" not in of(suite.WALKING, **walked)


def test_walks_have_separate_rows() -> None:
    kinds = {"test_a": suite.STANDING, "test_b": suite.GROUP, "test_c": suite.RECORDED}
    found = {"test_a": result_of(0.05), "test_b": result_of(0.1, 0.1, missed=2),
             "test_c": result_of(missed=3)}  # fmt: skip
    text = markdown([Row("printed", found, kinds), Row("ours", found, kinds)], "test")
    rows = {label: cells_of(text, f"default.yaml{label}")[1:3] for label in
            ("", ", standing", ", walking", ", walking group", ", recorded walks")}  # fmt: skip
    assert rows == {
        "": ["1", "1.000"],  # as it was before there were walks
        ", standing": ["1", "1.000"],
        ", walking": ["0", "-"],
        ", walking group": ["4", "0.500"],
        ", recorded walks": ["3", "0.000"],
    }
    assert "recorded" not in markdown([row(), row()], "test")


@pytest.mark.parametrize(
    ("section", "kind"),
    [
        ({}, suite.STANDING),
        ({"layout": {"activity": "talk"}}, suite.STANDING),
        ({"layout": {"activity": "tour"}}, suite.WALKING),
        ({"layout": {"activity": "group"}}, suite.GROUP),
        ({"tracks": "obsmat.txt"}, suite.RECORDED),
    ],
)
def test_scenes_have_the_expected_kinds(section: dict, kind: str) -> None:
    assert suite.kind_of(read_scene(section, "scene.yaml")) == kind


def test_all_steps_have_a_row_in_the_table_of_steps() -> None:
    text = markdown([row("one"), row("two"), row("three")], "train")
    (_, _, after) = text.partition("## What each step gives")
    table, _, _ = after.partition("## Scene by scene")
    lines = [line.split("|")[1].strip() for line in table.splitlines() if line.startswith("| ")]
    assert lines == ["step", "one", "two", "three"]
    assert "With default.yaml; in brackets with paper.yaml." in text


# ------------------------------------------------------------------------------ command ----

SUITE = """
- name: train_01_none
  half: train
  layout: {people: 1, robots: 2}
- name: test_01_pair
  half: test
  seed: 5
  timing: {frames: 2}
  layout: {people: 2, robots: 2}
  room: {length: 6.0, width: 6.0}
  odometry: {mode: exact}
"""


WALKS = """
- name: train_02_group
  half: train
  layout: {people: 3, robots: 2, activity: group}
- name: test_02_walk
  half: test
  seed: 6
  timing: {frames: 2}
  layout: {people: 3, robots: 1, activity: group}
  room: {length: 14.0, width: 4.0}
- name: test_03_recorded
  half: test
  tracks: nowhere/zara01/obsmat.txt
  robots: {robot_a: {x: 1.0, y: 1.0}}
"""


@pytest.mark.slow
def test_suite_of_one_scene_is_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")
    bags, out = tmp_path / "bags", tmp_path / "suite.md"
    (tmp_path / "suite.yaml").write_text(SUITE)
    (tmp_path / "walks.yaml").write_text(WALKS)
    out.write_text("# The suite\n\nKept.\n\n## Results on the test half\n\nOld.\n")
    monkeypatch.setattr(suite_command, "suite_file", lambda name="suite.yaml": tmp_path / name)
    result = CliRunner().invoke(app, ["suite", str(bags), "--out", str(out), "-j", "1"])
    assert result.exit_code == 0, result.output
    there = ["test_01_pair", "test_01_pair.yaml", "test_02_walk", "test_02_walk.yaml"]
    assert sorted(p.name for p in bags.iterdir()) == there
    assert "test_03_recorded is left out: no recording" in " ".join(result.output.split())
    text = out.read_text()
    assert text.startswith("# The suite\n\nKept.\n\n## Results on the test half\n")
    assert "Old." not in text
    ours, printed = cells_of(text, "default.yaml"), cells_of(text, "paper.yaml")
    assert ours[1] == printed[1]
    assert 0 < int(ours[1]) <= 4  # two people, two frames; some may not be seen
    assert cells_of(text, "default.yaml, walking")[1] == "0"
    assert cells_of(text, "test_01_pair")[1] == ours[1]
    walk = cells_of(text, "default.yaml, walking group")
    assert 0 < int(walk[1]) <= 6
    assert cells_of(text, "test_02_walk")[1] == walk[1]
