"""The `mrs` command as a whole."""

import importlib
import sys
import types
import typing
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from mrs_tools import cli, installing
from mrs_tools.examples import EXAMPLES
from tools.commands.parsing import parsed


def names_of_commands() -> list[str]:
    """Those of groups, too, such as `keys init`."""
    names = []
    for name in cli.COMMANDS:
        names += [f"{name} {sub}" for sub in getattr(cli._load(name), "commands", ())] or [name]
    return names


@pytest.mark.parametrize("name", ["", *cli.COMMANDS, *(n for n in EXAMPLES if " " in n)])
def test_help_has_examples_and_fits_80_columns(name: str) -> None:
    arguments = [*name.split(), "--help"]
    result = CliRunner().invoke(cli.app, arguments, prog_name="mrs", env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    assert f"Usage: mrs {name}".rstrip() in result.output
    assert max(map(len, result.output.splitlines())) <= 80
    if name:
        shown = " ".join(result.output.replace("`", "").split("Examples:")[1].split())
        for command, examples in EXAMPLES.items():
            for arguments_of in examples if f"{command} ".startswith(f"{name} ") else ():
                assert f"mrs {command} {arguments_of}".rstrip() + ":" in shown


@pytest.mark.parametrize("name", ["", "keys", "convert"])
def test_group_without_arguments_prints_its_help(name: str) -> None:
    result = CliRunner().invoke(cli.app, name.split(), prog_name="mrs")
    assert f"Usage: mrs {name}".rstrip() in result.output
    assert ("Commands" if name else "A team") in result.output


def test_flags_show_no_type() -> None:
    """`--loop <bool>` would invite `--loop true`; `--rate` does take a value."""
    help_ = CliRunner().invoke(cli.app, ["replay", "--help"], env={"COLUMNS": "80"}).output
    lines = {line.split()[1]: line for line in help_.splitlines() if "--" in line and "│" in line}
    assert "bool" not in lines["--loop"].lower()
    assert "float" in lines["--rate"].lower()


def test_each_command_has_examples() -> None:
    assert set(names_of_commands()) == EXAMPLES.keys()
    assert all(EXAMPLES.values())


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_valid(name: str) -> None:
    for arguments in EXAMPLES[name]:
        assert parsed(f"{name} {arguments}") == name


@pytest.mark.parametrize("line", ["doctor --durations 10", "keys make", "up --guide"])
def test_invalid_example_would_be_noticed(line: str) -> None:
    with pytest.raises(Exception, match=r"No such option|Missing"):
        parsed(line)


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_typer_0_9_understands_each_command(name: str) -> None:
    """Ubuntu 24.04's Typer does not evaluate annotations, nor know X | None."""
    cli._load(name)
    path, _ = cli.COMMANDS[name]
    module, _, attribute = path.partition(":")
    target = getattr(importlib.import_module(module), attribute)
    commands = (
        [info.callback for info in target.registered_commands]
        if isinstance(target, typer.Typer)
        else [target]
    )
    commands = [cli._options, *commands]
    hints = [hint for command in commands for hint in command.__annotations__.values()]
    annotated = [h for h in hints if typing.get_origin(h) is typing.Annotated]
    assert len(annotated) > 1
    for hint in annotated:
        assert not isinstance(typing.get_args(hint)[0], types.UnionType), hint


@pytest.mark.parametrize("package", cli.FURTHER)
def test_commands_of_other_packages_are_known_where_these_are_not(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    headings = importlib.import_module(f"{package}.commands").HEADINGS
    names = sorted(name for commands in headings.values() for name in commands)
    assert names == cli.FURTHER[package].split()
    for name in names:
        monkeypatch.delitem(cli.COMMANDS, name)
    result = CliRunner().invoke(cli.app, [names[0]], prog_name="mrs")
    assert result.exit_code == 1
    how = installing.how_to_install(package)
    assert f"mrs {names[0]} needs {package}, which is not installed: {how}" in result.stderr
    assert "No such command" in CliRunner().invoke(cli.app, ["nothing"]).stderr


@pytest.mark.parametrize(
    ("module", "in_a_venv", "in_the_system"),
    [
        ("rich", "pip install 'mrs-people-loc[tools]'", "sudo apt install python3-rich"),
        ("PIL", "pip install 'mrs-people-loc[plots]'", "sudo apt install python3-pil"),
        (
            "rosbags",
            "pip install 'mrs-people-loc[tools]'",
            "python3 -m venv --system-site-packages ~/mrs && ~/mrs/bin/pip install rosbags, then "
            "`~/mrs/bin/python -m mrs_tools` in place of `mrs`",
        ),
        (
            "embreex",
            "pip install 'mrs-people-loc[sim]'",
            "python3 -m venv --system-site-packages ~/mrs && ~/mrs/bin/pip install embreex, then "
            "`~/mrs/bin/python -m mrs_tools` in place of `mrs`",
        ),
        (
            "rclpy",
            "source your ROS 2 installation, or pip install 'mrs-people-loc[ros]'",
            "source your ROS 2 installation, or run `make setup`",
        ),
        ("mrs_people_msgs", *["run `make setup`, or source the workspace that has it"] * 2),
        ("a_bug", None, None),
    ],
)
def test_pip_is_not_suggested_where_the_system_forbids_it(
    module: str, in_a_venv: str, in_the_system: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installing, "_pip_is_refused", lambda: False)
    assert installing.how_to_install(module) == in_a_venv
    monkeypatch.setattr(installing, "_pip_is_refused", lambda: True)
    assert installing.how_to_install(module) == in_the_system


def test_pip_is_forbidden_by_the_markers_of_pep_668(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PEP 668: a marker beside the standard library, and no virtual environment."""
    monkeypatch.setattr(installing.sysconfig, "get_path", lambda _: str(tmp_path))
    monkeypatch.setattr(sys, "base_prefix", sys.prefix)
    assert not installing._pip_is_refused()
    (tmp_path / "EXTERNALLY-MANAGED").touch()
    assert installing._pip_is_refused()
    monkeypatch.setattr(sys, "base_prefix", "/usr-of-another")
    assert not installing._pip_is_refused()
