"""`mrs demo`: a recorded team, replayed through its real processes, and scored."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mrs_people_loc.errors import PeopleLocError

if TYPE_CHECKING:
    from rich.console import Console

    from mrs_tools.demo.page import DemoPage


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
    and followed, how far off, and what happened to the group. Draws one interval as a PNG and all
    of them as a GIF. In a terminal the page stays until Ctrl-C, with the recording and its people.
    """
    from rich.console import Console

    from mrs_tools.bags.rosbag import BagReader
    from mrs_tools.figures.files import check_pictures
    from mrs_tools.installing import default_file

    began_s = time.monotonic()
    console = Console(highlight=False, soft_wrap=True)
    check_pictures(out)
    bag = bag or default_file("bags", "walking_group")
    BagReader(bag).close()  # whether it is one
    with ExitStack() as stack:
        page = _open_page(bag, console, open_, stack, began_s)  # before anything that takes long
        _replay(bag, team, rate, out, page, console)
        if page is not None:
            _stay(page, console)


def _open_page(
    bag: Path, console: Console, open_: bool | None, stack: ExitStack, began_s: float
) -> DemoPage | None:
    """Serves the page while the stack lasts; None: what that needs is not installed."""
    from mrs_tools.common import print_note
    from mrs_tools.demo.steps import tell
    from mrs_tools.installing import how_to_install

    try:
        from mrs_tools.demo.page import DemoPage, has_display, is_watched
    except ModuleNotFoundError as err:
        print_note(console, f"no page: it needs {err.name}: {how_to_install(str(err.name))}")
        return None
    page = stack.enter_context(DemoPage(bag.name))
    if not page.url:
        print_note(console, "no page: no port of this machine can be used")
        return None
    tell(console, f"page: {page.url}", time.monotonic() - began_s)
    if open_ or (open_ is None and is_watched() and has_display()):
        import webbrowser

        webbrowser.open(page.url)
    return page


def _replay(
    bag: Path,
    team: list[Path] | None,
    rate: float,
    out: Path,
    page: DemoPage | None,
    console: Console,
) -> None:
    """Runs the team on the bag, compares, draws, and lets the page show what came out."""
    from mrs_people_loc.config import load_team
    from mrs_tools.bags.sources import file_beside
    from mrs_tools.demo.pictures import draw_demo, read_team_bag, results_of, stamp_of, views_of
    from mrs_tools.demo.replayed_team import run_team
    from mrs_tools.demo.scores import print_events, print_scores
    from mrs_tools.demo.steps import step
    from mrs_tools.domain import private_domain
    from mrs_tools.installing import default_file

    with step(console, f"reading {bag.name}"):
        beside = file_beside(bag)
        files = team or [beside or default_file("config", "team.yaml")]
        config = load_team(*files)
        recorded = read_team_bag(bag, config)
    with private_domain() as where:
        console.print(where)
        watching: AbstractContextManager[object] = nullcontext()
        if page is not None:
            page.source.tell(f"starting {', '.join(config.robots)} and the planner")
            watching = page.source.team()
        listener = run_team(bag, files, rate, console, watching)
    people = sorted(listener.people, key=stamp_of)
    if not any(len(message.scans) == len(config.robots) for message in people):
        raise PeopleLocError(
            f"{len(people)} intervals, none of them with scans of all robots: "
            "is the machine too slow? Try --rate 0.5"
        )
    if page is not None:
        page.source.show_bag(bag, files, results_of(people, listener, recorded))
    views = views_of(people, listener, recorded, config)
    print_scores(people, recorded.truth, console)
    print_events(views, console)
    draw_demo(views, len(config.robots), out, console)


def _stay(page: DemoPage, console: Console) -> None:
    """Lets the page stay until Ctrl-C, if somebody watches."""
    from mrs_tools.demo.page import is_watched
    from mrs_tools.signals import stop_on_signals

    if not is_watched():
        return
    with stop_on_signals() as stop:
        console.print(f"the page stays, with the recording: {page.url} (Ctrl-C ends it)")
        stop.wait()
