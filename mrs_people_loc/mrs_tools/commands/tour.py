"""`mrs tour`: a group is guided along a tour."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.console import Console


#: What may be asked for in place of a tour: services of guide_node.
_REQUESTS = ("stop", "release")
#: Options of each kind of tour that the other one does not have, by their parameters.
_LIVE = ("namespace", "attended")
_SIMULATED = ("scene", "seed", "seeds", "poses", "kill", "record", "images", "duration", "open_")


def command(
    context: typer.Context,
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[TOUR.yaml|stop|release]",
            help="The way and its stops; or stop the robots, or release them.",
        ),
    ] = None,
    namespace: Annotated[
        str, typer.Option("--namespace", "-n", help="Namespace of guide_node.")
    ] = "",
    attended: Annotated[
        bool,
        typer.Option("--attended", help="The tour ends within 2 s where this command does."),
    ] = False,
    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate",
            help="Simulate a scene with its own tour: people who follow, robots with wheels and "
            "rendered heads, and the team's real processes.",
        ),
    ] = False,
    scene: Annotated[
        str, typer.Option(help="With --simulate: a scene file, or the name of one of ours.")
    ] = "guided_corridor",
    seed: Annotated[
        int, typer.Option(help="With --simulate: seed of all random numbers.", min=0)
    ] = 1,
    seeds: Annotated[
        int,
        typer.Option(
            help="With --simulate: so many tours, each with the next seed; scores of each and of "
            "all.",
            min=1,
        ),
    ] = 1,
    poses: Annotated[
        str,
        typer.Option(
            help="With --simulate: robots' poses are exact, localized (odometry corrected by "
            "walls, people and the team) or odometry."
        ),
    ] = "exact",
    kill: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME@T[-T2]",
            help="With --simulate: kill a robot's node, planner or guide T seconds after the "
            "tour's beginning, and start it again at T2.",
        ),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="With --simulate: keep the recording, a new bag.")
    ] = None,
    images: Annotated[
        bool, typer.Option("--images", help="With --record: with the images, too.")
    ] = False,
    duration: Annotated[
        float, typer.Option(help="With --simulate: cancel the tour after this time [s].", min=1.0)
    ] = 600.0,
    open_: Annotated[
        bool | None,
        typer.Option(
            "--open/--no-open",
            help="With --simulate: open the page in the browser. Default: where there are a "
            "terminal and a display.",
        ),
    ] = None,
) -> None:
    """Guide a group along a tour, by a running guide_node; Ctrl-C cancels the tour.

    `mrs tour stop` lets the robots stand, whoever has started a tour, until `mrs tour release`.

    Shows how the tour goes on. Exit code 0 if the group has been guided to the end. With --simulate
    everything runs on this machine, in real time or as fast as it can, and is shown on a page for
    the browser; scores are printed at the end.
    """
    from rich.console import Console

    if simulate == (file is not None):
        raise typer.BadParameter("give either TOUR.yaml or --simulate")
    given = [name for name in (_LIVE if simulate else _SIMULATED) if _is_given(context, name)]
    if given:
        options = ", ".join(f"--{name.rstrip('_')}" for name in given)
        applies = "does not apply with" if simulate else "applies only with"
        raise typer.BadParameter(f"{options}: {applies} --simulate")
    if str(file) in _REQUESTS:
        _ask(str(file), namespace)
        return
    if file is not None:
        _guide(file, namespace, attended=attended)
        return
    # Simulated worlds are no part of what a robot installs.
    simulated = importlib.import_module("mrs_people_sim.tour.command")
    console = Console(soft_wrap=True, highlight=False)
    with simulated.simulate(
        scene, seed, seeds, poses, kill or [], record, images, duration, open_, console
    ) as (stop, result):
        if stop.is_set() and not stop.exit_code and not (result and result.finished):
            raise PeopleLocError(f"cancelled: the {duration:g} s asked for (--duration) are over")
        _report(result, stop.exit_code, console)


def _ask(request: str, namespace: str) -> None:
    """Stops the robots of a running guide_node, or releases them."""
    from mrs_tools.live.tour_client import ask_guide
    from mrs_tools.tool_node import node, spinning

    with node("mrs_tour", namespace=namespace) as made, spinning(made) as executor:
        print(plain(ask_guide(made, request, spin=lambda: executor.spin_once(timeout_sec=0.1))))


def _is_given(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _guide(file: Path, namespace: str, *, attended: bool) -> None:
    """Asks guide_node for a tour, and shows it."""
    from rich.console import Console

    from mrs_people_loc.guiding.tour import read_tour
    from mrs_tools.live.tour_client import guide
    from mrs_tools.live.tour_view import TourView
    from mrs_tools.signals import stop_on_signals
    from mrs_tools.tool_node import node, spinning

    tour, console = read_tour(file), Console(stderr=True, soft_wrap=True, highlight=False)
    with (
        node("mrs_tour", namespace=namespace) as made,
        spinning(made) as executor,
        stop_on_signals() as stop,
        TourView(console, tour) as view,
    ):
        result = guide(
            made,
            tour,
            spin=lambda: executor.spin_once(timeout_sec=0.1),
            stop=stop,
            show=view.show,
            attended=attended,
        )
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
