"""The published suite: its scenes, variants of them, and `mrs render-suite`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mrs_people_loc.errors import ConfigError

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")
pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")

from typer.testing import CliRunner

from mrs_people_sim.layouts import expand
from mrs_people_sim.render_scene import team_file
from mrs_people_sim.scene import read_scene
from mrs_studies import suite_scenes as suite_scenes_module
from mrs_studies.suite_scenes import simulate_suite, suite_scenes, variants
from mrs_tools.cli import app

SUITE = Path(__file__).resolve().parents[2] / "config" / "scenes" / "suite.yaml"
HEAD = {"width": 80, "height_px": 60, "focal": 52.7}


def test_suite_is_as_documented() -> None:
    halves = {half: suite_scenes(SUITE, half) for half in ("train", "test")}
    assert len(halves["train"]) == len(halves["test"])
    scenes = suite_scenes(SUITE, "all")
    assert len(scenes) >= 40
    assert len({s.name for s in scenes}) == len({s.seed for s in scenes}) == len(scenes)
    for half in halves.values():
        plans = [s.layout for s in half]
        assert {p.activity for p in plans} == {"stand", "talk", "close", "walk", "mixed", "tour"}
        assert {p.heads for p in plans} == {"level", "tilted", "mixed", "trinocular"}
        assert {p.people for p in plans} >= {1, 2, 3, 4, 5, 6, 7, 8, 10}
        assert {p.robots for p in plans} == {2, 3, 4}
        assert any(s.room.contrast < 0.4 for s in half)
        assert any(p.cloth == "dark" for p in plans)


def test_random_scenes_respect_their_limits() -> None:
    for scene in suite_scenes(SUITE, "all"):
        full = expand(scene)
        assert full == expand(scene)
        plan = scene.layout
        assert (len(full.people), len(full.robots)) == (plan.people, plan.robots)
        for head in full.heads.values():
            assert head.height <= 2.4
            assert head.pitch <= math.radians(30.01)
            assert abs(head.roll) <= math.radians(10.01)
        if plan.heads == "trinocular":
            assert [bool(h.top) for h in full.heads.values()] == [True] + [False] * (
                plan.robots - 1
            )
        spots = np.array([[p.x, p.y] for p in full.people])
        gaps = np.linalg.norm(spots[:, None] - spots[None], axis=2) + 9 * np.eye(len(spots))
        assert gaps.min() > 0.45, scene.name
        assert (spots > 0.3).all()
        assert (spots < [scene.room.length - 0.3, scene.room.width - 0.3]).all()


@pytest.mark.parametrize(
    ("text", "part"),
    [("{}", "is not a suite"), ("[{name: a}]", "has no `half"), ("[]", "no scene of the half")],
)
def test_a_bad_suite_is_refused(tmp_path: Path, text: str, part: str) -> None:
    (tmp_path / "suite.yaml").write_text(text)
    with pytest.raises(ConfigError, match=part):
        suite_scenes(tmp_path / "suite.yaml", "train")


def test_suite_renders_missing_scenes(tmp_path: Path) -> None:
    small = {"robots": {"robot_a": {}}, "head": HEAD, "timing": {"frames": 1}}
    scenes = [read_scene({**small, "name": name}, "scene.yaml") for name in ("one", "two")]
    (tmp_path / "one").mkdir()
    done: list[str] = []
    assert simulate_suite(scenes, tmp_path, on_scene=done.append) == [
        tmp_path / "one",
        tmp_path / "two",
    ]
    assert done == ["two"]
    assert team_file(tmp_path / "two").is_file()


def test_variants_are_scenes_of_the_same_kinds() -> None:
    scenes = suite_scenes(SUITE, "train")
    more = variants(scenes, 3)
    assert len(more) == 3 * len(scenes)
    assert more == variants(scenes, 3)
    everything = [*scenes, *suite_scenes(SUITE, "test"), *more]
    assert len({s.name for s in everything}) == len({s.seed for s in everything}) == len(everything)
    for number, other in enumerate(more):
        scene = scenes[number % len(scenes)]
        assert other.name == f"{scene.name}_{number // len(scenes) + 1:02d}"
        assert (other.timing.frames, other.timing.rate) == (2, scene.timing.rate)
        for name in ("people", "robots", "activity", "cloth"):
            assert getattr(other.layout, name) == getattr(scene.layout, name)
        assert len(expand(other).people) == scene.layout.people
    # Looks, faults and heads of every third are those of the list, in another order.
    part = more[2 * len(scenes) :]
    assert not any(s.layout.variety for s in part)
    for value in (
        lambda s: s.room.ambient,
        lambda s: s.imaging.noise,
        lambda s: s.odometry.sigma,
        lambda s: s.layout.heads,
    ):
        before, after = [value(s) for s in scenes], [value(s) for s in part]
        assert sorted(before) == sorted(after)
        assert before != after
    # The others have all that there is.
    rest = more[: 2 * len(scenes)]
    assert all(s.layout.variety and s.layout.heads == "varied" for s in rest)
    assert len({s.imaging.noise for s in rest}) > 20
    assert len({s.layout.furniture for s in rest}) > 5
    assert variants(scenes, 0) == variants([], 3) == []


def test_every_second_variant_is_in_a_narrower_room() -> None:
    scenes = suite_scenes(SUITE, "train")
    more = variants(scenes, 2)
    for scene, other in zip(scenes, more[: len(scenes)], strict=True):
        assert (other.room.length, other.room.width) == (scene.room.length, scene.room.width)
    narrow = 0
    for scene, other in zip(scenes, more[len(scenes) :], strict=True):
        if other.room.width == scene.room.width:
            continue  # somebody would have stuck out
        narrow += 1
        assert other.room.width <= 0.8 * scene.room.width
        expanded = expand(other)
        places = [(person.x, person.y) for person in expanded.people]
        places += [(robot.x, robot.y) for robot in expanded.robots.values()]
        for x, y in places:
            assert 0.3 < x < other.room.length - 0.3
            assert 0.3 < y < other.room.width - 0.3
    assert narrow > 10


def test_one_half_of_the_walks_is_rendered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    monkeypatch.setattr(suite_scenes_module, "default_file", lambda *_: scenes / "walks.yaml")
    (scenes / "walks.yaml").write_text(
        "- {name: one, half: train, layout: {people: 3, robots: 1, activity: group}}\n"
        "- {name: two, half: test, layout: {people: 2, robots: 1, activity: group},\n"
        "   room: {length: 12.0}, head: {width: 80, height_px: 60, focal: 52.7},\n"
        "   timing: {frames: 1}}\n"
        "- {name: three, half: test, tracks: zara01/obsmat.txt, robots: {robot_a: {}}}\n"
    )
    reported = CliRunner().invoke(app, ["render-suite", "test", "bags", "--walks", "-j", "1"])
    assert reported.exit_code == 0, reported.output
    assert "bags: 1 bags" in reported.output
    assert "three is left out: no recording" in " ".join(reported.output.split())
    assert sorted(p.name for p in (tmp_path / "bags").iterdir()) == ["two", "two.yaml"]


@pytest.mark.parametrize(
    ("arguments", "code", "part"),
    [
        (["half", "bags"], 1, "allowed: train, test, all"),
        (["test", "bags", "--walks", "--variants", "2"], 2, "variants of the scenes only"),
    ],
)
def test_wrong_usage_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], code: int, part: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["render-suite", *arguments])
    assert result.exit_code == code
    assert part in result.output + result.stderr
    assert not Path("bags").exists()
