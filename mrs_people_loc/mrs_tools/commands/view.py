"""`mrs view`: a running team, or a bag, in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.view.protocol import PORT
from mrs_tools.view.source import Source

if TYPE_CHECKING:
    from rich.console import Console


def command(
    bag: Annotated[
        Path | None, typer.Argument(help="A bag to play, in place of a running team.")
    ] = None,
    config: Annotated[
        list[Path] | None,
        typer.Option(
            "--config",
            "-c",
            help="Of a bag: parameter file of its team; later ones win. BAG.yaml beside it "
            "overrides them.",
        ),
    ] = None,
    namespace: Annotated[
        str, typer.Option("--namespace", "-n", help="Namespace of the planner.")
    ] = "",
    host: Annotated[
        str,
        typer.Option(
            help="Address to serve on: 127.0.0.1 is for this machine only, 0.0.0.0 for all; except "
            "for this machine, the page's address contains a token."
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(help="TCP port; 0: any that is free.", min=0, max=65535)
    ] = PORT,
    token: Annotated[
        str, typer.Option(help="Token to ask for; empty: one is made where it is needed.")
    ] = "",
    control: Annotated[
        bool, typer.Option("--control", help="Viewers may start and cancel tours.")
    ] = False,
    tour: Annotated[
        list[Path] | None,
        typer.Option(metavar="TOUR.yaml", help="With --control: a tour to choose; repeat it."),
    ] = None,
    rate: Annotated[
        float, typer.Option(help="Highest rate of updates of the page [Hz].", min=0.5, max=60.0)
    ] = 30.0,
    open_: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = False,
) -> None:
    """Show a running team, or a bag, in the browser; Ctrl-C ends it.

    The page has the map with people, groups and robots, and on demand the robots' images. Nothing
    is loaded from the internet. A bag has play, pause, speed and a time line, the same for all
    viewers; it needs no ROS. If it has images or scans but no people, they are found meanwhile.
    """
    import asyncio

    from rich.console import Console

    from mrs_tools.signals import stop_on_signals
    from mrs_tools.view.server import Address, serve

    _check_options(bag, config=config, namespace=namespace, control=control, tour=tour)
    console = Console(soft_wrap=True, highlight=False)
    source = _played(bag, config or []) if bag else _live(namespace, control, tour or [])
    with stop_on_signals() as stop:
        asyncio.run(
            serve(
                source,
                Address.of(host, port, token),
                rate=rate,
                stop=stop,
                ready=lambda url: _say(url, console, open_),
            )
        )


def _check_options(bag: Path | None, **given: object) -> None:
    """Checks that each option given is one for a bag, or for a running team.

    Raises:
        typer.BadParameter: One is not.
    """
    others = "--host, --port, --token, --rate, --open"
    if bag is None:
        if given["config"]:
            raise typer.BadParameter(
                f"--config is for a bag: mrs view BAG --config TEAM.yaml; a running team takes "
                f"--namespace, --control, --tour, {others}"
            )
        return
    for name in ("namespace", "control", "tour"):
        if given[name]:
            raise typer.BadParameter(
                f"--{name} is for a running team, not for a bag; a bag takes --config, {others}"
            )


def _live(namespace: str, control: bool, files: list[Path]) -> Source:
    """A running team.

    Raises:
        PeopleLocError: A tour cannot be read, or two have one name.
    """
    from mrs_people_loc.guiding.tour import read_tour
    from mrs_tools.view.live import LiveSource

    if files and not control:
        raise typer.BadParameter("--tour needs --control")
    tours = {}
    for file in files:
        tour = read_tour(file)
        name = tour.name or file.stem
        if name in tours:
            raise PeopleLocError(f"{file}: another tour is called {name!r}, too; rename one")
        tours[name] = tour
    return LiveSource(namespace, control=control, tours=tours)


def _played(bag: Path, files: list[Path]) -> Source:
    """A bag.

    Raises:
        PeopleLocError: It is none, has nothing to show, or a file is wrong.
    """
    from mrs_people_loc.config import has_parameters
    from mrs_tools.view.playback import Playback

    for file in files:
        if not has_parameters(file):
            raise PeopleLocError(
                f"--config {file}: has no parameters of planner_node or robot_node; wanted: a "
                "parameter file of the team"
            )
    return Playback(bag, files)


def _say(url: str, console: Console, open_page: bool) -> None:
    from rich.text import Text

    console.print(Text.assemble("The page: ", (url, "bold"), " (Ctrl-C ends it)"))
    if open_page:
        import webbrowser

        webbrowser.open(url)
