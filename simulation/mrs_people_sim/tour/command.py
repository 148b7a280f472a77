"""What `mrs tour --simulate` runs."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
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
from mrs_people_sim.scoring.tours import TourScores
from mrs_people_sim.tour.simulated_tour import Plan, run_tour
from mrs_people_sim.tour.trouble import read_kill
from mrs_tools.signals import Stop, stop_on_signals

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def simulate(
    scene: str,
    seed: int,
    seeds: int,
    poses: str,
    kills: list[str],
    record: Path | None,
    images: bool,
    duration: float,
    open_: bool | None,
    console: Console,
) -> Iterator[tuple[Stop, Any]]:
    """Simulates tours, on a page for the browser, too, and prints their scores.

    Args:
        scene: What is simulated: a file, or the name of one of ours.
        seed: Of the first tour.
        seeds: How many tours; each has the next seed.
        poses: One of `light.guided_tour.POSES`.
        kills: Which processes are killed, as `read_kill` takes them.
        record: Keeps the bag of the only tour; None: nothing is kept.
        images: Whether images are recorded, too.
        duration: Each tour is cancelled after this time [s].
        open_: Whether the page is opened; None: where there are a terminal and a display.
        console: Where everything is shown.

    Yields:
        The event that stopped it, and the GuideTour_Result of the first tour that did not finish,
        or of the last one; None: stopped before it began. The page stays after that.
    """
    if poses not in POSES:
        raise typer.BadParameter(f"--poses is {poses!r}; allowed: {', '.join(POSES)}")
    if record is not None and record.exists():
        raise typer.BadParameter(f"--record: {record} exists already; wanted: a new bag")
    if record is not None and seeds > 1:
        raise typer.BadParameter(f"--record keeps one tour, not {seeds}; wanted: --seeds 1")
    file = scene_file(scene, "guided_*.yaml")
    scenes = [guided_scene(file, seed + number) for number in range(seeds)]
    what = scenes[0]
    names = [*what.robots, "planner", "guide"]
    killed = [read_kill(text, names) for text in kills]
    with ExitStack() as stack:
        # Before the page, which plays the bag in it to the last.
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        page = open_page(what.name, console, open_, stack)
        if page is not None:
            console.print(f"page: {page.url}")
        bags, results = [], []
        with private_domain() as where, stop_on_signals() as stop:
            console.print(where)
            for number, one in enumerate(scenes):
                bags.append(record or Path(folder, f"tour_{number}.mcap"))
                plan = Plan(one, poses, killed, duration, images)
                watching = nullcontext() if page is None else page.source.team()
                results.append(run_tour(plan, bags[-1], stop, console, watching))
                if stop.is_set():
                    break
        bags = [bag for bag in bags if bag.exists()]
        if page is not None and bags:
            page.source.show_bag(bags[-1])
        _print_scores(what.name, seed, bags, console)
        yield stop, next((one for one in results if not (one and one.finished)), results[-1])
        if page is not None:
            page.stay(console)


def _print_scores(name: str, seed: int, bags: list[Path], console: Console) -> None:
    """Prints how each tour went, and all of them together."""
    scored = [evaluate_bag(bag, recorded=True).tour for bag in bags]
    total = sum(scored, TourScores())
    if not total.tours:
        return
    each = {f"seed {seed + number}": one for number, one in enumerate(scored)}
    rows = {**(each if len(scored) > 1 else {}), name: total}
    reports = {row: one.report() for row, one in rows.items()}
    console.print(tours_table(reports))
    console.print(robots_of_tours_table(reports))
