"""`mrs demo`: a recorded team, replayed through its real processes, and scored."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.diagnosis.load import Load

if TYPE_CHECKING:
    from rich.console import Console

    from mrs_people_loc.config import Team
    from mrs_people_sim.figures.plots import TopView
    from mrs_people_sim.page import TeamPage


def command(
    bag: Annotated[
        Path | None, typer.Argument(help="A bag of a team. Default: bags/walking_group.")
    ] = None,
    team: Annotated[
        list[Path] | None,
        typer.Option(
            "--team",
            "-t",
            help="Parameter file of its team. Default: the one beside the bag; without one, "
            "config/team.yaml.",
        ),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.01, help="Times as fast as recorded.")] = 1.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Draw one interval into this picture.")
    ] = None,
    gif: Annotated[
        bool,
        typer.Option(
            "--gif", help="Draw all intervals, too: demo.gif, or beside the picture of --out."
        ),
    ] = False,
    open_: Annotated[
        bool | None,
        typer.Option(
            "--open/--no-open",
            help="Open the page in the browser. Default: where there are a terminal and a display.",
        ),
    ] = None,
) -> None:
    """Replay a recorded team through its real processes and compare with the truth.

    Starts one robot_node per robot and the planner, replays the bag to them over DDS, shows the
    people live, in the terminal and on a page for the browser, then prints which people were found
    and followed, how far off, and what happened to the group. In a terminal the page stays until
    Ctrl-C, and plays the recording with its people.
    """
    from rich.console import Console

    from mrs_people_loc.config import load_team
    from mrs_people_sim.demo.steps import tell
    from mrs_people_sim.page import open_page
    from mrs_tools.bags.reader import BagReader
    from mrs_tools.bags.sources import file_beside
    from mrs_tools.installing import default_file

    began_s = time.monotonic()
    console = Console(highlight=False, soft_wrap=True)
    drawn = out or (Path("demo.png") if gif else None)
    if drawn is not None:
        from mrs_people_sim.figures.files import check_pictures

        check_pictures(drawn, gif=gif)
    bag = bag or default_file("bags", "walking_group")
    BagReader(bag).close()  # whether it is one
    files = team or [file_beside(bag) or default_file("config", "team.yaml")]
    config = load_team(*files)
    with ExitStack() as stack:
        page = open_page(bag.name, console, open_, stack)  # before anything that takes long
        if page is not None:
            tell(console, f"page: {page.url}", time.monotonic() - began_s)
        views = _replay(bag, files, config, rate, page, console)
        if drawn is not None:
            from mrs_people_sim.demo.pictures import draw_demo

            draw_demo(views, len(config.robots), drawn, console, gif=gif)
        if page is not None:
            page.stay(console)


def _replay(
    bag: Path,
    files: list[Path],
    config: Team,
    rate: float,
    page: TeamPage | None,
    console: Console,
) -> Sequence[TopView]:
    """Runs the team on the bag, compares, and lets the page show what came out; returns that."""
    from mrs_people_sim.demo.pictures import read_team_bag, results_of, stamp_of, views_of
    from mrs_people_sim.demo.replayed_team import run_team
    from mrs_people_sim.demo.scores import print_events, print_scores
    from mrs_people_sim.demo.steps import step
    from mrs_people_sim.domain import private_domain

    with step(console, f"reading {bag.name}"):
        recorded = read_team_bag(bag, config)
    with private_domain() as where:
        console.print(where)
        watching: AbstractContextManager[object] = nullcontext()
        if page is not None:
            page.source.tell(f"Starting {', '.join(config.robots)} and the planner.")
            watching = page.source.team()
        listener = run_team(bag, files, rate, console, watching)
    people = sorted(listener.people, key=stamp_of)
    if not any(len(message.scans) == len(config.robots) for message in people):
        raise PeopleLocError(
            f"{len(people)} intervals, none of them with scans of all robots: "
            f"is the machine too slow ({Load.now()})? Try --rate 0.5"
        )
    if page is not None:
        page.source.show_bag(bag, files, results_of(people, listener, recorded))
    views = views_of(people, listener, recorded, config)
    print_scores(people, recorded.truth, console)
    print_events(views, console)
    return views
