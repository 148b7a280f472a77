"""The `mrs` command as a whole."""

import importlib
import types
import typing

import pytest
import typer
from typer.testing import CliRunner

from mrs_tools import cli


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_each_command_has_help(name: str) -> None:
    result = CliRunner().invoke(cli.app, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert "Usage" in result.output


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
