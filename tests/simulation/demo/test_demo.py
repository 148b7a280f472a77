"""`mrs demo`: what it prints and which interval it draws; the processes are in test_team."""

from __future__ import annotations

import dataclasses
import io
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")
pytest.importorskip("matplotlib", reason="pictures need matplotlib")

from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

from mrs_people_loc.clusters import measure
from mrs_people_loc.config import PlannerConfig, Team
from mrs_people_loc.errors import ConfigError, PeopleLocError
from mrs_people_loc.planner import People
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.demo import pictures
from mrs_people_sim.demo.pictures import RecordedTeam, draw_demo, views_of
from mrs_people_sim.demo.scores import print_events, print_scores
from mrs_people_sim.figures.files import check_pictures
from mrs_ros import convert, shipped
from mrs_tools import installing
from mrs_tools.bags.records import Truth
from mrs_tools.cli import app
from simulation.made_views import group_of, person, walk

MS = 1_000_000
ROOT = Path(__file__).parents[3]


def message(ms: int, *people: Any) -> Any:
    nothing = fuse([], {})
    clusters = measure(nothing, np.empty(0, dtype=np.intp))
    poses = {f"robot_{k}": Pose(ms * MS, k, 0.0, 0.0) for k in range(2)}
    groups = (group_of(*people, velocity_covariance=np.eye(2)),)
    return convert.people(People(ms * MS, poses, people, groups, nothing, clusters), "map")


def printed(function: Any, *arguments: Any, **options: Any) -> str:
    console = Console(file=io.StringIO(), width=120, highlight=False, soft_wrap=True)
    function(*arguments, console, **options)
    file: Any = console.file
    return str(file.getvalue())


def test_score_matches_hand_computed_values():
    """Person 2 is missed in one frame, and has another id after that."""
    stamps = [0, 200 * MS, 400 * MS]
    truth = Truth.build(stamps, [np.array([[0.0, 0.0], [3.0, 0.0]])] * 3)
    people = [
        message(0, person(1, 0.1, 0.0), person(2, 3.0, 0.1)),
        message(200, person(1, 0.1, 0.0)),
        message(400, person(1, 0.1, 0.0), person(5, 3.0, 0.3), person(6, 6.0, 6.0)),
    ]
    text = printed(print_scores, people, truth)
    rows = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]
    assert ["1", "1", "3 / 3", "10.0 cm", "10.0 cm"] in rows
    assert ["2", "2, 5", "2 / 3", "20.0 cm", "30.0 cm"] in rows
    assert "found 5 of 6 people in 3 frames of the ground truth, 1 false;\nmean error 14.0" in text
    # 1 - (1 missed + 1 false + 1 switch) / 6
    assert "followed: 1 id switches, MOTA 0.500" in text


def test_frames_without_an_estimate_are_attributed_to_the_machine():
    stamps = [ms * MS for ms in range(0, 2000, 200)]
    truth = Truth.build(stamps, [np.array([[0.0, 0.0]])] * 10)
    people = [message(ms, person(1, 0.1, 0.0)) for ms in range(0, 2000, 200)]
    assert "too busy" not in printed(print_scores, people, truth)
    del people[4:6]
    assert "the machine was too busy for 2 frames" in printed(print_scores, people, truth)


def test_events_belong_to_the_interval_before_them():
    listener: Any = SimpleNamespace(
        maps={},
        events=[(-1, "too early"), (1250 * MS, "one"), (1260 * MS, "two"), (1900 * MS, "end")],
    )
    recorded = RecordedTeam(Truth.build([], []), None, {})
    people = [message(ms, person(1, 0, 0)) for ms in (1000, 1200, 1400)]
    views = views_of(people, listener, recorded, Team(PlannerConfig(), {}))
    assert [list(view.events) for view in views] == [["too early"], ["one", "two"], ["end"]]
    assert [view.stamp_ns for view in views] == [1000 * MS, 1200 * MS, 1400 * MS]
    text = printed(print_events, views)
    assert text.splitlines()[1:] == ["after  0.2 s: one", "after  0.2 s: two", "after  0.4 s: end"]


def test_picture_shows_the_moment_of_the_farthest_straggler(tmp_path, monkeypatch):
    drawn: list[Any] = []
    monkeypatch.setattr(pictures, "draw_top_view", lambda view, path: drawn.append(view))
    monkeypatch.setattr(pictures, "animate", lambda views, path, **_: drawn.append(path))
    views = walk()
    printed(draw_demo, views, 2, tmp_path / "demo.png", gif=True)
    # They fall behind from 2 s on, and the others get away from them until the end, 4 s.
    assert drawn[0].stamp_ns == views[-1].stamp_ns
    assert drawn[0].title == "after 4.0 s: 2 people, 1 in group 1, walking at 1.0 m/s"
    assert drawn[0].trails
    assert drawn[1] == tmp_path / "demo.gif"
    printed(draw_demo, views[:8], 2, tmp_path / "demo.png", gif=True)
    assert drawn[2].stamp_ns == views[7].stamp_ns  # nobody: the last one
    printed(draw_demo, [*views[:12], *walk()[:3]], 2, tmp_path / "demo.png", gif=True)
    assert drawn[4].stamp_ns == views[11].stamp_ns


def test_picture_shows_as_many_people_as_most_intervals(tmp_path, monkeypatch):
    drawn: list[Any] = []
    monkeypatch.setattr(pictures, "draw_top_view", lambda view, path: drawn.append(view))
    monkeypatch.setattr(pictures, "animate", lambda views, path, **_: None)
    views = walk()
    false = dataclasses.replace(views[-1], people=[*views[-1].people, person(3, 0.0, 0.0)])
    lost = dataclasses.replace(views[-2], people=views[-2].people[:1])
    printed(draw_demo, [*views[:-2], lost, false], 2, tmp_path / "demo.png", gif=True)
    assert drawn[-1].stamp_ns == views[-3].stamp_ns
    # As often two as one: the more.
    printed(draw_demo, [lost, views[3]], 2, tmp_path / "demo.png", gif=True)
    assert drawn[-1].stamp_ns == views[3].stamp_ns


def test_animation_is_drawn_only_where_it_is_asked_for(tmp_path):
    printed(draw_demo, walk(), 2, tmp_path / "demo.png", gif=False)
    assert [path.name for path in tmp_path.iterdir()] == ["demo.png"]


@pytest.mark.slow
def test_pictures_are_written(tmp_path):
    text = printed(draw_demo, walk(), 2, tmp_path / "demo.png", gif=True)
    with Image.open(tmp_path / "demo.png") as picture, Image.open(tmp_path / "demo.gif") as film:
        assert picture.size == (990, 880)
        assert getattr(film, "n_frames", 1) == 21
    drawn = [line.partition(" s  ")[2] for line in text.splitlines()]
    assert drawn == [f"drawing {tmp_path / 'demo.png'}", f"drawing {tmp_path / 'demo.gif'}"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("picture.gif", r"wanted: a name that ends in .*\.png"),
        ("picture", r"wanted: a name that ends in .*\.png"),
        ("none/picture.png", "none/picture.png: there is no folder .*none$"),
        ("file/picture.png", "file/picture.png: there is no folder .*file$"),
        ("/proc/picture.png", r"/proc/picture\.png: cannot be written \("),
        ("folder.png", "folder.png is a folder; wanted: a file"),
        ("other.png", "other.gif is a folder; wanted: a file"),
    ],
)
def test_unwritable_target_is_reported_before_anything_runs(tmp_path, name, message):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "other.gif").mkdir()
    (tmp_path / "file").touch()
    arguments = ["demo", str(tmp_path / "no_bag"), "--gif", "--out", str(tmp_path / name)]
    done = CliRunner().invoke(app, arguments, env={"COLUMNS": "400"})
    assert done.exit_code == 1
    assert re.search(message, done.stderr.strip()), done.stderr


def test_bag_that_is_none_is_reported_before_the_page_is_served(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["demo", "nope"])
    assert (done.exit_code, done.stdout) == (1, "")
    assert "nope: there is no such bag" in done.stderr


def test_team_file_that_is_none_is_reported_before_the_page_is_served(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["demo", "--team", "nope.yaml"])
    assert (done.exit_code, done.stdout) == (1, "")
    assert "nope.yaml" in done.stderr


def test_plain_demo_needs_no_plots():
    """Up to its start: matplotlib and Pillow are not installed on every machine."""
    program = (
        "import sys; sys.modules['matplotlib'] = sys.modules['PIL'] = None; "
        "from mrs_people_sim import page; from mrs_people_sim.commands import demo; "
        "from mrs_people_sim.demo import pictures, replayed_team, scores; "
        "from mrs_tools.view import live, playback, server"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_forbidden_target_is_reported(tmp_path, monkeypatch):
    check_pictures(tmp_path / "picture.png", gif=True)
    assert not list(tmp_path.iterdir())

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(PeopleLocError, match=r"picture\.png: cannot be written"):
        check_pictures(tmp_path / "picture.png", gif=True)


def test_shipped_files_are_found_or_reported_in_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert installing.default_file("bags", "walking_group").samefile(
        ROOT / "bags" / "walking_group"
    )
    (tmp_path / "bags" / "none").mkdir(parents=True)  # the current directory does not matter
    with pytest.raises(ConfigError, match=r"^bags/none is not installed: it belongs to mrs_peop"):
        installing.default_file("bags", "none")
    monkeypatch.setattr(shipped, "__file__", str(tmp_path / "a" / "b" / "shipped.py"))
    installed = installing.default_file("bags", "walking_group")
    assert installed.parts[-3:] == ("share", "mrs_people_bags", "walking_group")


def test_shipped_files_are_found_without_rosbags():
    program = (
        "import sys; sys.modules['rosbags'] = None; "
        "from mrs_studies.suite_scenes import suite_file; print(suite_file())"
    )
    run = [sys.executable, "-c", program]
    assert "suite.yaml" in subprocess.run(run, capture_output=True, text=True, check=True).stdout
