"""`mrs calibrate` on recorded and simulated heads whose mounting is known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_people_loc.config import Mounting, load_team
from mrs_people_loc.errors import BagError, FloorError
from mrs_people_loc.health.floor import Floor
from mrs_tools.calibration import Calibration, from_bag, how_sure, snippet
from mrs_tools.cli import app
from shared_data import shared_data

ROOT = Path(__file__).resolve().parents[2]
FORMATION = ROOT / "bags" / "paper_formation"

#: Nobody in a room with a carpet; the heads look at it from different heights.
SCENE = """
name: carpet
seed: 3
timing: {frames: 3, rate: 5.0}
room: {length: 8.0, width: 6.0, floor: carpet}
robots:
  robot_a: {x: 1.5, y: 3.0, head: {height: 1.35, pitch: 0.42, roll: 0.12, yaw: 0.1, forward: 0.2}}
  robot_b: {x: 6.5, y: 2.0, yaw: 3.0, head: {height: 0.8, pitch: 0.10, roll: -0.05}}
"""


def run(*args: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["calibrate", *map(str, args)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def carpet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated bag, and its team's file beside it."""
    pytest.importorskip("embreex", reason="drawing scenes needs embreex")
    from mrs_people_sim.render_scene import simulate
    from mrs_people_sim.scene import load_scene

    folder = tmp_path_factory.mktemp("carpet")
    folder.joinpath("scene.yaml").write_text(SCENE, "utf-8")
    simulate(load_scene(folder / "scene.yaml"), folder / "carpet.mcap")
    return folder / "carpet.mcap"


def test_formation_prints_a_team_file(tmp_path: Path) -> None:
    """Three heads, level and one metre high; the nodes can read the output."""
    code, out, err = run(FORMATION)
    assert code == 0
    tmp_path.joinpath("team.yaml").write_text(out, "utf-8")
    team = load_team(tmp_path / "team.yaml", robots=("robot_a", "robot_b", "robot_c"))
    for name, config in team.robots.items():
        assert config.mounting.height == pytest.approx(1.0, abs=0.03)
        assert math.degrees(config.mounting.pitch) == pytest.approx(0.0, abs=0.6)
        assert math.degrees(config.mounting.roll) == pytest.approx(0.0, abs=0.6)
        assert f"{name}: height 1.0" in err
    assert out.count("# +- 0.01") == 3
    assert "15 views" in err


def test_only_the_requested_robot_is_calibrated() -> None:
    code, out, _ = run(FORMATION, "--robot", "robot_b")
    assert code == 0
    assert list(yaml.safe_load(out)) == ["/robot_b/robot_node"]


def test_unconfigured_tilted_heads_are_calibrated(carpet: Path, tmp_path: Path) -> None:
    """The mounting is in the file beside the bag; without that file only the floor is used."""
    bag = tmp_path / "alone.mcap"
    bag.write_bytes(carpet.read_bytes())
    for name, mounting in (
        ("robot_a", Mounting(height=1.35, pitch=0.42, roll=0.12)),
        ("robot_b", Mounting(height=0.8, pitch=0.10, roll=-0.05)),
    ):
        found = from_bag(bag, [], [name])[name].floor()
        want = (mounting.height, mounting.pitch, mounting.roll)
        got = (found.height, found.pitch, found.roll)
        assert (np.abs(np.subtract(got, want)) < 3.0 * np.array(found.sigma)).all()
        assert found.height == pytest.approx(mounting.height, rel=0.03)
        assert math.degrees(found.pitch - mounting.pitch) == pytest.approx(0.0, abs=1.0)
        assert math.degrees(found.roll - mounting.roll) == pytest.approx(0.0, abs=1.0)


def test_unobservable_values_are_kept(carpet: Path) -> None:
    _, out, _ = run(carpet, "-r", "robot_a")
    mounting = yaml.safe_load(out)["/robot_a/robot_node"]["ros__parameters"]["mounting"]
    assert (mounting["forward"], mounting["yaw"]) == (0.2, 0.1)
    assert set(mounting) == {"height", "pitch", "roll", "forward", "yaw"}


def test_overridden_mounting_is_named(carpet: Path, tmp_path: Path) -> None:
    """The bag's own file has 1.35 m and 0.42 rad for robot_a, and no roll but its own."""
    heads = tmp_path / "heads.yaml"
    heads.write_text(
        "/robot_a/robot_node: {ros__parameters: {mounting: {height: 1.35, pitch: 0.3}}}", "utf-8"
    )
    line = "carpet.yaml beside the bag goes before heads.yaml for mounting.pitch; --no-own-config"
    _, _, err = run(carpet, "-r", "robot_a", "-c", heads)
    assert err.startswith(line)
    assert f"pitch {math.degrees(0.42):.1f} deg" in err.split("was configured")[1]
    _, _, err = run(carpet, "-r", "robot_a", "-c", heads, "--no-own-config")
    assert "carpet.yaml" not in err
    assert f"pitch {math.degrees(0.3):.1f} deg" in err.split("was configured")[1]


def test_without_floor_advice_is_printed(tmp_path: Path) -> None:
    """With a configuration of heads that look up, the floor is not found."""
    file = tmp_path / "up.yaml"
    file.write_text(
        "/**/robot_node: {ros__parameters: {mounting: {height: 1.0, pitch: -1.5}}}", "utf-8"
    )
    code, out, err = run(FORMATION, "-r", "robot_a", "-c", file)
    assert (code, out) == (1, "")
    assert err.startswith("error: robot_a: ")
    assert "Point the head so that" in " ".join(err.split())


def test_robot_that_is_not_in_the_bag_is_an_error() -> None:
    with pytest.raises(BagError, match=r"no images of robot_x; it has those of: robot_a, robot_b"):
        from_bag(FORMATION, [], ["robot_x"])


def test_neither_bag_nor_robot_is_a_usage_error() -> None:
    assert run()[0] == 2
    assert run("-r", "robot_a", "-r", "robot_b")[0] == 2


def test_robot_without_views_reports_the_missing_inputs() -> None:
    config = load_team(robots=("robot_a",)).robots["robot_a"]
    with pytest.raises(FloorError, match=r"robot_a: no view.*/robot_a/left/image_rect"):
        Calibration("robot_a", config).floor()


def test_long_recordings_are_subsampled_evenly() -> None:
    one = Calibration("robot_a", load_team(robots=("robot_a",)).robots["robot_a"])
    for number in range(1000):
        one._keep(np.full((2, 2), number, dtype=np.float32))
    kept = [int(view[0, 0]) for view in one._kept]
    assert one.views == 1000
    assert 40 <= len(kept) < 80
    assert set(np.diff(kept)) == {16}
    assert kept[-1] > 980


def test_snippet_matches_hand_computed_values() -> None:
    floor = Floor(1.0034, 0.17249, -0.0001, np.diag([0.012, 0.004, 0.005]) ** 2, 0.18, 40)
    assert snippet("robot_a", Mounting(height=1.0, left=-0.05), floor) == (
        "/robot_a/robot_node:\n"
        "  ros__parameters:\n"
        "    # +- 0.012 m, 0.004 and 0.005 rad; floor in 40 views, 18% of their pixels\n"
        "    mounting: {height: 1.003, pitch: 0.172, roll: 0.000, left: -0.050}\n"
    )
    assert "rough" not in how_sure(floor)
    rough = Floor(1.0034, 0.17249, 0.0, np.diag([0.012, 0.03, 0.005]) ** 2, 0.18, 40)
    assert "rough" in how_sure(rough)


@pytest.mark.slow
def test_real_head_looking_down_is_calibrated(tmp_path: Path) -> None:
    """OAK-D over a patio: `config/oak_overhead.yaml` was fitted to its floor by other means."""
    oak = shared_data("oak-stereo-overhead-person")
    assert run_convert("oak", oak, tmp_path / "oak.mcap") == 0
    file = tmp_path / "down.yaml"
    file.write_text(
        "/**/robot_node: {ros__parameters: {mounting: {height: 2.0, pitch: 1.4}}}", "utf-8"
    )
    found = from_bag(tmp_path / "oak.mcap", [file], [])["robot_a"].floor()
    known = load_team(ROOT / "config" / "oak_overhead.yaml").robots["robot_a"].mounting
    assert found.height == pytest.approx(known.height, abs=0.06)
    assert math.degrees(_angle(found, known)) < 2.0


def run_convert(*args: object) -> int:
    return CliRunner().invoke(app, ["convert", *map(str, args)]).exit_code


def _angle(one: Floor | Mounting, other: Floor | Mounting) -> float:
    """Between the two directions of down."""

    def down(m: Floor | Mounting) -> np.ndarray:
        return np.array(
            [
                math.sin(m.pitch),
                -math.cos(m.pitch) * math.sin(m.roll),
                -math.cos(m.pitch) * math.cos(m.roll),
            ]
        )

    return math.acos(float(down(one) @ down(other)))
