"""`mrs view`: a running team, or a bag, in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mrs_people_loc.errors import PeopleLocError
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
    ] = 8765,
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
    from mrs_tools.view.playback import Playback

    return Playback(bag, files)


def _say(url: str, console: Console, open_page: bool) -> None:
    from rich.text import Text

    console.print(Text.assemble("The page: ", (url, "bold"), " (Ctrl-C ends it)"))
    if open_page:
        import webbrowser

        webbrowser.open(url)
