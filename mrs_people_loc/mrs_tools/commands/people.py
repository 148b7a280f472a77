"""`mrs people`: people, groups, events, robots of a running team, live in the terminal."""

from __future__ import annotations

import math
import time
from contextlib import nullcontext
from typing import Annotated

import typer

from mrs_tools.live.people_table import LivePeople, follow_clock


def command(
    namespace: Annotated[
        str, typer.Option("--namespace", "-n", help="Namespace of the planner.")
    ] = "",
    duration: Annotated[
        float, typer.Option("--duration", min=0.0, help="End after this time [s]; 0: at Ctrl-C.")
    ] = 0.0,
) -> None:
    """Show people, groups, events, robots and rates of a running team, live in the terminal.

    Ages are by /clock while somebody publishes it, as a simulation or `mrs replay --clock` does.
    Where the output is no terminal, the table is printed once at the end.
    """
    from rich.console import Console
    from rich.live import Live

    from mrs_tools.signals import stop_on_signals
    from mrs_tools.tool_node import node, spinning

    console = Console()
    with node("mrs_people", namespace=namespace) as made, spinning(made) as executor:
        live = LivePeople(made)
        follow_clock(made)
        end = time.monotonic() + duration if duration else math.inf
        screen = (
            Live(live, console=console, refresh_per_second=5)
            if console.is_terminal
            else nullcontext()
        )
        with stop_on_signals() as stop, screen:
            while not stop.is_set() and time.monotonic() < end:
                executor.spin_once(timeout_sec=0.1)
        if not console.is_terminal:
            console.print(live)
