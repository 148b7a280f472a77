"""What `mrs view` says of options that do not apply."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("aiohttp", reason="the server needs aiohttp")
pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")

from typer.testing import CliRunner

from mrs_people_loc.config import has_parameters
from mrs_tools.cli import app

TEAM_TAKES = "--namespace, --control, --tour"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("walk.mcap --control", "--control is for a running team, .* takes --config, --host"),
        ("walk.mcap --namespace a", "--namespace is for a running team, .* takes --config, --host"),
        ("walk.mcap --tour t.yaml", "--tour is for a running team, .* takes --config, --host"),
        ("-c nope.yaml", f"--config is for a bag.* a running team takes {TEAM_TAKES}, --host"),
        ("walk.mcap -c nope.yaml", "nope.yaml: there is no such file"),
        ("walk.mcap -c scene.yaml", "--config scene.yaml: has no parameters of planner_node"),
    ],
)
def test_option_that_does_not_apply_is_named_with_what_does(
    arguments: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scene.yaml").write_text("frames: 20\npeople: {count: 3}\n")
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["view", *arguments.split()], env={"COLUMNS": "400"})
    assert done.exit_code in (1, 2)
    assert re.search(message, done.stderr), done.stderr


@pytest.mark.parametrize("key", ["/**", "planner_node", "/robot_a/robot_node"])
def test_file_with_a_section_of_our_nodes_has_parameters(key: str, tmp_path: Path) -> None:
    file = tmp_path / "team.yaml"
    file.write_text(f"{key}: {{ros__parameters: {{}}}}\n")
    assert has_parameters(file)
