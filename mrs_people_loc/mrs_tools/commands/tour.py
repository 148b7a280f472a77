"""`mrs tour`: a group is guided along a tour."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.console import Console


def command(
    file: Annotated[Path, typer.Argument(metavar="TOUR.yaml", help="The way and its stops.")],
    namespace: Annotated[
        str, typer.Option("--namespace", "-n", help="Namespace of guide_node.")
    ] = "",
) -> None:
    """Guide a group along a tour, by a running guide_node; Ctrl-C cancels the tour.

    Shows how the tour goes on. Exit code 0 if the group has been guided to the end.
    """
    _guide(file, namespace)


def _guide(file: Path, namespace: str) -> None:
    """Asks guide_node for a tour, and shows it."""
    from rclpy.executors import SingleThreadedExecutor
    from rich.console import Console

    from mrs_people_loc.guiding.tour import read_tour
    from mrs_tools.live.tour_client import guide
    from mrs_tools.live.tour_view import TourView
    from mrs_tools.signals import stop_on_signals
    from mrs_tools.tool_node import node

    tour, console = read_tour(file), Console(stderr=True, soft_wrap=True, highlight=False)
    with node("mrs_tour", namespace=namespace) as made:
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        try:
            with stop_on_signals() as stop, TourView(console, tour) as view:
                result = guide(
                    made,
                    tour,
                    spin=lambda: executor.spin_once(timeout_sec=0.1),
                    stop=stop,
                    show=view.show,
                )
        finally:
            executor.shutdown()
    _report(result, stop.exit_code, console)


def _report(result: Any, exit_code: int, console: Console) -> None:
    """Prints how a tour has ended."""
    from rich.text import Text

    if result is None or (exit_code and not result.finished):
        console.print("cancelled")
        raise typer.Exit(exit_code)
    if not result.finished:
        raise PeopleLocError(plain(result.message))
    console.print(Text(f"finished: {plain(result.message)}", style="green"))
    if result.lost:
        console.print(f"without people {', '.join(map(str, result.lost))}")
