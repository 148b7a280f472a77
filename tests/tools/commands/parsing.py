"""Command lines of `mrs`, parsed without running them."""

import shlex
import typing

import typer

from mrs_tools import cli


def parsed(line: str) -> str:
    """Parses what stands behind `mrs` without running it: the command's name; raises if wrong."""
    group: typing.Any = typer.main.get_command(cli.app)
    rest, names = shlex.split(line), []
    context = group.make_context("mrs", [*rest])
    while hasattr(context.command, "commands"):
        name, command, rest = context.command.resolve_command(context, rest)
        names.append(name)
        context = command.make_context(name, [*rest], parent=context)
    return " ".join(names)


def exists(name: str) -> bool:
    """Whether `mrs` has a command of that name."""
    group: typing.Any = typer.main.get_command(cli.app)
    return group.get_command(group.make_context("mrs", [name]), name) is not None
