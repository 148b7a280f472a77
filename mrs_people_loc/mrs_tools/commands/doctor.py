"""`mrs doctor`: what is wrong with a running team, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from mrs_tools.common import make_table
from mrs_tools.diagnosis.diagnose import Check, diagnose
from mrs_tools.diagnosis.facts import ERROR, OK, STALE, WARN, figures
from mrs_tools.diagnosis.look import look

if TYPE_CHECKING:
    from rich.console import Console

_COLOURS = {OK: "green", WARN: "yellow", ERROR: "red", STALE: "yellow"}
#: What decides which nodes find each other.
_SETTINGS = (
    "RMW_IMPLEMENTATION",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "ROS_SUPER_CLIENT",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "ROS_SECURITY_ENABLE",
)


def command(
    duration: Annotated[
        float, typer.Option("--duration", min=2.0, help="Listen for this long [s].")
    ] = 4.0,
) -> None:
    """Look at a running team for a few seconds; say what is wrong, and what to do.

    Looks at every node of ours in this ROS domain. Exit code 1 if there is an error.
    """
    from rich.console import Console

    from mrs_ros.network import environment
    from mrs_tools.tool_node import node, spinning

    environ = environment()  # as the user made it
    settings = [f"{name}={environ[name]}" for name in _SETTINGS if environ.get(name)]
    with node("mrs_doctor") as made, spinning(made) as executor:
        facts = look(made, duration, lambda: executor.spin_once(timeout_sec=0.1))
    checks = diagnose(facts)
    console = Console(soft_wrap=True, highlight=False)
    named = ", ".join(settings) or "no ROS network variables are set"
    console.print(f"ROS domain {facts.domain}; {named}")
    _print(console, checks, figures(facts))
    if any(check.level == ERROR for check in checks):
        raise typer.Exit(1)


def _print(console: Console, checks: Iterable[Check], rows: Sequence[Sequence[str]]) -> None:
    from rich.text import Text

    for check in checks:
        line = Text.assemble((f"{check.level:>8}  ", _COLOURS[check.level]), check.subject)
        console.print(line.append(f": {check.text}"))
        if check.advice:
            console.print(Text(f"          -> {check.advice}"))
        for one in check.follows:
            console.print(Text(f"          so: {one.subject}: {one.text}", style="dim"))
    if rows:
        columns = ("robot", "scans/s", "age [s]", "clock [s]", "CPU [%]", "frame [ms]")
        table = make_table("", *columns)
        for row in rows:
            table.add_row(*map(Text, row))
        console.print(table)
