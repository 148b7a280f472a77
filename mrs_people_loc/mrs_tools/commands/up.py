"""`mrs up`: every node of a team on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_ros.discovery import discovery_environment
from mrs_ros.network import given_domain
from mrs_ros.processes import NodeProcess, RunningTeam, team_processes


def command(
    files: Annotated[
        list[Path], typer.Argument(help="Parameter files of the team; later ones win.")
    ],
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Take the time from /clock (mrs replay --clock).")
    ] = False,
    guide: Annotated[
        bool, typer.Option("--guide", help="Start guide_node, too, which guides tours (mrs tour).")
    ] = False,
    discovery_server: Annotated[
        str,
        typer.Option(
            "--discovery-server",
            metavar="HOST[:PORT]",
            help="Find each other by the server there (mrs discovery-server), not by multicast.",
        ),
    ] = "",
    peers: Annotated[
        str,
        typer.Option(
            "--peers", metavar="HOST,...", help="Look for nodes on these hosts, too; by unicast."
        ),
    ] = "",
) -> None:
    """Start every robot_node of a team and the planner on this machine; Ctrl-C ends them all.

    On a real team, where each robot has its own computer, start `robot_node` there instead.
    """
    from rich.console import Console

    from mrs_tools.signals import stop_on_signals

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    given_domain()
    nodes = team_processes(files, sim_time=sim_time, guide=guide)
    env = discovery_environment(discovery_server, peers)
    with stop_on_signals() as stop, RunningTeam(nodes, env=env) as team:
        console.print(f"started {', '.join(node.label for node in nodes)}; Ctrl-C ends them")
        failed: dict[NodeProcess, int] = {}
        while not stop.wait(0.2):
            for node, code in team.ended().items():
                if node not in failed:
                    failed[node] = code
                    console.print(f"[red]{node.label} ended by itself, exit code {code}[/]")
            if len(failed) == len(nodes):
                break
    raise typer.Exit(1 if failed else 0)
