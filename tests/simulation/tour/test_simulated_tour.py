"""`mrs tour --simulate`: its options and the team's parameters."""

from __future__ import annotations

import dataclasses
import re
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")
pytest.importorskip("embreex", reason="the simulator needs embreex")

from typer.testing import CliRunner

from mrs_people_loc.config import load_team
from mrs_people_loc.errors import ConfigError
from mrs_people_sim.guided import guided_scene
from mrs_people_sim.scoring.tours import TourScores
from mrs_people_sim.tour.simulated_tour import Plan, team_of
from mrs_people_sim.tour.trouble import Kill, read_kill
from mrs_tools.cli import app
from mrs_tools.installing import default_file

NAMES = ["robot_a", "planner"]


@pytest.mark.parametrize(
    ("text", "kill"),
    [
        ("planner@15-25", Kill("planner", 15.0, 25.0)),
        ("robot_a@2.5", Kill("robot_a", 2.5)),
    ],
)
def test_kills_are_read(text: str, kill: Kill) -> None:
    assert read_kill(text, NAMES) == kill


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("planner", "wanted NAME@T"),
        ("planner@-3", "wanted NAME@T"),
        ("planner@1-", "wanted NAME@T"),
        ("robot_x@3", "there is no robot_x; allowed: robot_a, planner"),
        ("planner@5-5", "it is back at 5 s; allowed: after 5 s"),
    ],
)
def test_a_wrong_kill_is_refused(text: str, part: str) -> None:
    with pytest.raises(ConfigError, match=part):
        read_kill(text, NAMES)


@pytest.mark.parametrize("poses", ["exact", "odometry", "localized"])
def test_the_team_has_the_poses_that_were_asked_for(tmp_path: Path, poses: str) -> None:
    scene = guided_scene(default_file("config", "scenes", "guided_corridor.yaml"), 2)
    mode = "exact" if poses == "exact" else "drift"
    scene = dataclasses.replace(scene, odometry=dataclasses.replace(scene.odometry, mode=mode))
    file = tmp_path / "team.yaml"
    file.write_text(yaml.safe_dump(team_of(Plan(scene, poses))), "utf-8")
    team = load_team(file)
    assert list(team.robots) == list(scene.robots)
    for name, settings in team.robots.items():
        robot, start = scene.robots[name], settings.pose.map_from_odom
        assert bool(start) == (poses != "exact")
        if start:
            assert start[:2] == pytest.approx((robot.x, robot.y), abs=0.06)
        assert (settings.localization.run == "never") == (poses == "odometry")
        assert settings.walls.occupancy_grid == (poses == "localized")
        assert settings.walls.laser, "for the collision monitor"


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ([], "give either TOUR.yaml or --simulate"),
        (["--simulate", "--poses", "guessed"], "allowed: exact, localized, odometry"),
        (
            ["--simulate", "--scene", "nowhere"],
            "'nowhere'; allowed: a file NAME.yaml, or guided_bystanders, guided_corridor, "
            "guided_doors, guided_hall, guided_loop, guided_narrow, guided_narrow_against",
        ),
        (["t.yaml", "--seed", "1", "--images"], "--seed, --images: applies only with --simulate"),
        (["t.yaml", "--no-open"], "--open: applies only with --simulate"),
        (["--simulate", "-n", "team"], "--namespace: does not apply with --simulate"),
        (["--simulate", "--scene", "office"], "has no tour"),
        (["--simulate", "--kill", "robot_z@1"], "there is no robot_z"),
        (["--simulate", "--record", str(Path(__file__).parent)], "exists already"),
        (["--simulate", "--record", "new", "--seeds", "2"], "keeps one tour, not 2"),
        (["t.yaml", "--seeds", "2"], "--seeds: applies only with --simulate"),
    ],
)
def test_wrong_options_are_reported_before_anything_starts(arguments: list[str], part: str) -> None:
    result = CliRunner().invoke(app, ["tour", *arguments])
    assert result.exit_code
    assert part in " ".join(f"{result.output} {result.exception}".replace("│", " ").split())


def test_tour_whose_time_is_over_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(_plan: Any, _bag: Any, stop: threading.Event, *_: Any) -> Any:
        stop.set()
        return SimpleNamespace(finished=False, message="cancelled", lost=[])

    monkeypatch.setattr("mrs_people_sim.tour.command.run_tour", run)
    result = CliRunner().invoke(app, ["tour", "--simulate", "--duration", "40"])
    assert result.exit_code == 1
    assert "cancelled: the 40 s asked for (--duration) are over" in result.output
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/$", result.output, re.MULTILINE)


def test_tours_of_several_seeds_are_scored_one_by_one_and_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seeds = []

    def run(plan: Plan, bag: Path, *_: Any) -> Any:
        seeds.append(plan.scene.seed)
        bag.touch()
        return SimpleNamespace(finished=plan.scene.seed != 4, message=str(bag), lost=[])

    def score(bag: Path, **_: Any) -> Any:
        number = int(bag.stem[-1])
        tour = TourScores(
            tours=1, finished=int(number != 1), people=5, times_s=np.array([60.0 + number])
        )
        return SimpleNamespace(tour=tour)

    monkeypatch.setattr("mrs_people_sim.tour.command.run_tour", run)
    monkeypatch.setattr("mrs_people_sim.tour.command.evaluate_bag", score)
    monkeypatch.setattr("mrs_people_sim.page.TeamSource.show_bag", lambda *_: None)
    result = CliRunner().invoke(app, ["tour", "--simulate", "--seed", "3", "--seeds", "3"])
    assert seeds == [3, 4, 5]
    for row in (
        r"seed 3 +1 of 1 +60\.0",
        r"seed 4 +0 of 1",
        r"seed 5 +1 of 1 +62\.0",
        r"guided_corridor +2 of 3 +61\.0 .* 15 ",
    ):
        assert re.search(row, result.output), result.output
    assert result.exit_code == 1
    assert "tour_1" in result.output  # what the guide said of the one that failed
