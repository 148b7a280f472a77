"""What `mrs tour --simulate` runs."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import embreex  # noqa: F401  # where it is missing, this says so, and how to get it
import typer

from mrs_people_sim.domain import private_domain
from mrs_people_sim.evaluation.results import evaluate_bag
from mrs_people_sim.evaluation.tables import robots_of_tours_table, tours_table
from mrs_people_sim.guided import guided_scene
from mrs_people_sim.light.guided_tour import POSES
from mrs_people_sim.options import scene_file
from mrs_people_sim.page import open_page
from mrs_people_sim.tour.simulated_tour import Plan, run_tour
from mrs_people_sim.tour.trouble import read_kill
from mrs_tools.signals import Stop, stop_on_signals

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def simulate(
    scene: str,
    seed: int,
    poses: str,
    kills: list[str],
    record: Path | None,
    images: bool,
    duration: float,
    open_: bool | None,
    console: Console,
) -> Iterator[tuple[Stop, Any]]:
    """Simulates a tour, on a page for the browser, too, and prints its scores.

    Yields:
        The event that stopped it, and its GuideTour_Result, if any. The page stays after that.
    """
    if poses not in POSES:
        raise typer.BadParameter(f"--poses is {poses!r}; allowed: {', '.join(POSES)}")
    if record is not None and record.exists():
        raise typer.BadParameter(f"--record: {record} exists already; wanted: a new bag")
    what = guided_scene(scene_file(scene, "guided_*.yaml"), seed)
    names = [*what.robots, "planner", "guide"]
    plan = Plan(what, poses, [read_kill(text, names) for text in kills], duration, images)
    with ExitStack() as stack:
        # Before the page, which plays the bag in it to the last.
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        page = open_page(what.name, console, open_, stack)
        watching: AbstractContextManager[object] = nullcontext()
        if page is not None:
            console.print(f"page: {page.url}")
            watching = page.source.team()
        bag = record or Path(folder, "tour.mcap")
        with private_domain() as where, stop_on_signals() as stop:
            console.print(where)
            result = run_tour(plan, bag, stop, console, watching)
        if bag.exists():
            if page is not None:
                page.source.show_bag(bag)
            report = evaluate_bag(bag, recorded=True).report().get("tour")
            if report is not None:
                console.print(tours_table({what.name: report}))
                console.print(robots_of_tours_table({what.name: report}))
        yield stop, result
        if page is not None:
            page.stay(console)
