"""The tables of `mrs guiding`."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_people_sim.light.guided_tour import TourRun, Trouble
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_people_sim.scoring.tours import TourRecord, TourScores
from mrs_studies.experiment import tours
from mrs_studies.experiment.tours import Case, CaseScores, run_cases
from mrs_studies.experiment.tours_report import markdown
from mrs_tools.bags.records import Truth
from mrs_tools.cli import app

START_NS = 1_000_000_000_000


def stamp(seconds: float) -> int:
    return START_NS + round(seconds * 1e9)


def track(x) -> PoseTrack:
    """A robot at x(t), ten times a second."""
    stamps = np.array([stamp(0.1 * k) for k in range(len(x))])
    return PoseTrack(stamps, np.column_stack([x, np.zeros((len(x), 2))]), np.zeros((len(x), 3, 3)))


def run_of(statuses=(), truth=None, robots=None, speeds=None) -> TourRun:
    truth = truth or Truth.build([], [])
    record = TourRecord(statuses, truth, robots or {}, ())
    return TourRun(record, {}, None, speeds, START_NS)


def status(seconds, leader="", **posts) -> Guidance:
    roles = {name: Role.LEADER if name == leader else Role.REAR for name in posts}
    return Guidance(
        stamp(seconds),
        State.LEADING,
        posts={name: Post(roles[name], np.array([x, 0.0]), 0.0, 0.5) for name, x in posts.items()},
    )


def test_times_after_a_robot_was_killed():
    # b drives at 1 m/s from 5 s on; its new post, 4 m ahead, is there from 7 s on.
    x = np.clip(np.arange(200) * 0.1 - 5.0, 0.0, None)
    robots = {"a": track(np.zeros(200)), "b": track(x)}
    statuses = [status(4.8, a=0.0, b=0.0), status(5.2, a=0.0, b=0.0)]
    statuses += [status(t, b=4.0) for t in np.arange(7.0, 12.0, 0.5)]
    run = run_of(statuses, robots=robots)
    reposted, others, formed = tours._after_killed(run, Trouble(killed=("a", 5.0)))
    assert reposted == pytest.approx((2.0,))
    assert others == formed == pytest.approx((3.0,))
    assert tours._after_killed(run, Trouble()) == ((), (), ())
    assert np.isnan(tours._after_killed(run, Trouble(killed=("b", 5.0)))).all()


def test_successor_of_a_killed_leader_is_told_from_the_others():
    # b drives at 1 m/s from 5 s on, 8 m to the leader's post; c is on its own post at once.
    x = np.clip(np.arange(200) * 0.1 - 5.0, 0.0, None)
    robots = {"a": track(np.zeros(200)), "b": track(x), "c": track(np.zeros(200))}
    statuses = [status(4.8, leader="a", a=8.0, b=0.0, c=0.0)]
    statuses += [status(t, leader="b", b=8.0, c=0.0) for t in np.arange(6.0, 16.0, 0.5)]
    run = run_of(statuses, robots=robots)
    times = tours._after_killed(run, Trouble(killed=("a", 5.0)))
    np.testing.assert_allclose(times, [[1.0], [1.0], [7.0]])


@pytest.mark.parametrize(("stop_s", "expected"), [(10.4, 0.4), (13.0, np.nan)])
def test_times_until_all_stand_without_a_planner(stop_s, expected):
    times = np.arange(0.0, 20.0, 0.1)
    speeds = np.column_stack([times, np.where(times < stop_s + 0.05, 0.3, 0.0), 0.0 * times])
    run = run_of(speeds=speeds)
    stood = tours._stood(run, Trouble(planner_gone=(10.0, 12.0)))
    assert stood == pytest.approx((expected,), nan_ok=True)


def test_a_group_that_stays_near_waits():
    xy = np.zeros((100, 4, 2))
    xy[:, 1:, 0] = np.linspace(0.0, 9.9, 100)[:, None]  # the others go on at 1 m/s
    run = run_of(truth=Truth.build([stamp(0.1 * k) for k in range(100)], [*xy]))
    assert tours._is_near(run, 0, 2.0, 7.9)
    assert not tours._is_near(run, 0, 2.0, 8.5)


def test_scores_are_added_and_reported():
    one = CaseScores(TourScores(tours=1, finished=1), 1, 1, 0, 2, (2.0,), (4.0,), (), (0.44,))
    two = CaseScores(TourScores(tours=1), 2, 0, 1, 0, (np.nan,), (np.nan,), ())
    total = (one + two).report()
    assert total["tour"]["tours"] == 2
    assert total["stragglers"] == {"stopped": 3, "fetched": 1, "waited_for": 1}
    assert (total["bumps"], total["reposted_s"]) == (2, [2.0, None])
    text = markdown([Case("hall", "")], [total])
    assert "| hall | 1 of 2 | - | 0 of 0 | - | - | - | 3 | 1 | 1 | 0 |" in text
    assert "| hall | 2 | 2.0 / never | 4.0 / never | - | 0.44 / 0.44 |" in text


def test_events_are_counted_by_their_words():
    said = ("robot_a leads", "person 12 is back", "robot_b leads", "sets off with people 1, 22, 3")
    run = run_of([dataclasses.replace(status(1.0, a=0.0), events=said)])
    assert tours._events(run) == {"_ leads": 2, "person _ is back": 1, "sets off with people _": 1}
    scores = CaseScores(TourScores(tours=1), events=tours._events(run))
    text = markdown([Case("hall", "")], [(scores + scores).report()])
    assert "| hall | _ leads: 4; person _ is back: 2 |" in text


def test_cases_are_run_with_their_seeds(monkeypatch):
    ran = []

    def run_case(case: Case, seed: int) -> CaseScores:
        ran.append((case.name, seed))
        return CaseScores(TourScores(tours=1))

    monkeypatch.setattr(tours, "run_case", run_case)
    counts = [s.tour.tours for s in run_cases([Case("main", "", main=True), Case("few", "")], 4)]
    assert counts == [4, tours.FEW]
    assert ran == [*(("main", k) for k in (1, 2, 3, 4)), *(("few", k) for k in (1, 2, 3))]


def test_command_prints_and_writes(tmp_path, monkeypatch):
    monkeypatch.setattr(tours, "run_case", lambda case, seed: CaseScores(TourScores(tours=1)))
    page, figures = tmp_path / "page.md", tmp_path / "figures.json"
    page.write_text("# Title\n\n## Results\n\nold\n")
    arguments = ["guiding", "--only", "planner", "-j", "1", "--out", page, "--json", figures]
    result = CliRunner().invoke(app, [*map(str, arguments)])
    assert result.exit_code == 0, result.output
    assert page.read_text() == f"# Title\n\n{result.output}"
    (name,) = json.loads(figures.read_text())
    assert name == "corridor, no planner from 60 to 65 s"


def test_own_scene_has_a_case_for_each_kind_of_poses(tmp_path):
    cases = tours.cases_in(tmp_path / "mine.yaml")
    assert [case.name for case in cases] == [
        f"mine, {poses} poses" for poses in ("exact", "localized", "odometry")
    ]
    assert {(case.scene, case.robots, case.main) for case in cases} == {
        (str(tmp_path / "mine.yaml"), None, True)
    }


def test_every_scene_of_the_cases_is_there():
    assert all(
        (tours.default_file("config", "scenes", case.scene)).is_file() for case in tours.CASES
    )
