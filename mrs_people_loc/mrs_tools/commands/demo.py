"""`mrs demo`: a recorded team, replayed through its real processes, and scored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_people_loc.config import load_team
from mrs_people_loc.errors import PeopleLocError
from mrs_tools.bags.sources import file_beside
from mrs_tools.demo.pictures import draw_demo, read_team_bag, stamp_of, views_of
from mrs_tools.demo.replayed_team import run_team
from mrs_tools.demo.scores import print_events, print_scores
from mrs_tools.domain import private_domain
from mrs_tools.figures.files import check_pictures
from mrs_tools.installing import default_file


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
        Path, typer.Option("--out", "-o", help="The picture; the animation goes beside it.")
    ] = Path("demo.png"),
) -> None:
    """Replay a recorded team through its real processes and compare with the truth.

    Starts one robot_node per robot and the planner, replays the bag to them over DDS, shows the
    people live, then prints which people were found and followed, how far off, and what happened
    to the group. Draws one interval as a PNG and all of them as a GIF.
    """
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    check_pictures(out)
    bag = bag or default_file("bags", "walking_group")
    beside = file_beside(bag)
    files = team or [beside or default_file("config", "team.yaml")]
    config = load_team(*files)
    recorded = read_team_bag(bag, config)
    with private_domain() as where:
        console.print(where)
        listener = run_team(bag, files, rate, console)
    people = sorted(listener.people, key=stamp_of)
    if not any(len(message.scans) == len(config.robots) for message in people):
        raise PeopleLocError(
            f"{len(people)} intervals, none of them with scans of all robots: "
            "is the machine too slow? Try --rate 0.5"
        )
    views = views_of(people, listener, recorded, config)
    print_scores(people, recorded.truth, console)
    print_events(views, console)
    draw_demo(views, len(config.robots), out, console)
