"""All figures of a bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_sim.evaluation.results import Result, evaluate_bag
from mrs_people_sim.figures import plots
from mrs_people_sim.figures.paper_figures import (
    Shown,
    draw_images,
    draw_map,
    draw_ranging,
    draw_stage,
)
from mrs_people_sim.figures.plots import TopView
from mrs_people_sim.figures.result_figures import draw_errors, draw_stages
from mrs_tools.bags.offline import BagRun, Interval
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.records import Truth
from mrs_tools.bags.sources import read_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class _Chooser:
    """Keeps the interval with the most robots; of several, the nearest to a time."""

    def __init__(self, wanted_ns: int) -> None:
        self._wanted_ns = wanted_ns
        self.best: Interval | None = None
        self._rank = (0, 0)

    def __call__(self, interval: Interval) -> None:
        people = interval.people
        rank = (len(people.poses), -abs(people.stamp_ns - self._wanted_ns))
        if self.best is None or rank > self._rank:
            self.best, self._rank = interval, rank


def top_view(
    interval: Interval,
    run: BagRun,
    truth: Truth,
    grid: OccupancyGrid | None,
    borders: dict[str, Float],
) -> TopView:
    """The map of an interval.

    Args:
        interval: The interval.
        run: What it comes from.
        truth: What is true.
        grid: What is known of walls and furniture.
        borders: By robot, what it sees of the floor, as far as that is known already; what is
            not is added.
    """
    people = interval.people
    label = people.clusters.label
    person_of = np.full(len(people.clusters), -1)
    for index, person in enumerate(people.persons):
        if person.label >= 0:
            person_of[person.label] = index
    true, visible = truth.at(people.stamp_ns)
    for name, view in interval.views.items():
        if name not in borders:
            reach = run.team.robots[name].disparity
            borders[name] = plots.seen_floor(view.camera, reach.min_range, reach.max_range)
    return TopView(
        title="",
        stamp_ns=people.stamp_ns,
        xy=people.fused.xy,
        robot=people.fused.robot,
        cluster=label,
        person=person_of[label],
        robots=people.poses,
        views={name: borders[name] for name in interval.views},
        people=people.everybody,
        groups=people.groups,
        truth=true,
        circle_sigmas=run.team.planner.human.circle_sigmas,
        visible=visible,
        events=people.events,
        grid=grid,
        notes={
            number: f"{height:.1f} m, {points} points"
            for number, (height, points) in enumerate(
                zip(people.clusters.height, people.clusters.points, strict=True)
            )
            if person_of[number] < 0
        },
    )


@dataclass(frozen=True)
class Ran:
    """A bag that was run, for its pictures.

    Attributes:
        run: How.
        result: What it gave.
        best: The interval that is shown.
        view: Its map.
        views: Maps of all intervals, if they were asked for.
    """

    run: BagRun
    result: Result
    best: Interval
    view: TopView
    views: Sequence[TopView]


def run_bag(
    path: Path,
    configs: Sequence[Path] = (),
    *,
    beside: bool = True,
    at_s: float | None = None,
    all_views: bool = False,
    on_progress: Callable[[float], None] | None = None,
) -> Ran:
    """Runs a bag, for its pictures.

    Args:
        path: The bag.
        configs: Parameter files of the team.
        beside: Whether the bag's own parameter file is read, see `BagRun`.
        at_s: Which interval is shown: that nearest to so long after the bag's beginning, among
            those with the most robots; None: the middle.
        all_views: Whether the maps of all intervals are kept, for `animation.animate`.
        on_progress: Called with how much of the bag is done, 0 to 1.

    Raises:
        PeopleLocError: The bag or a file cannot be used, or there is no interval.
    """
    run = BagRun(path, configs, beside=beside)
    offset_ns = (run.end_ns - run.start_ns) // 2 if at_s is None else round(at_s * 1e9)
    chooser = _Chooser(run.start_ns + offset_ns)
    truth = run.truth()
    with BagReader(path) as bag:
        grid = read_grid(bag, run.team.planner.map_frame)
    views: list[TopView] = []
    borders: dict[str, Float] = {}

    def on_interval(interval: Interval) -> None:
        chooser(interval)
        if all_views:
            views.append(top_view(interval, run, truth, grid, borders))

    result = evaluate_bag(run, on_interval=on_interval, on_progress=on_progress)
    if chooser.best is None:
        raise BagError(f"{path}: not one interval closed, there is nothing to draw")
    view = top_view(chooser.best, run, truth, grid, borders)
    return Ran(run, result, chooser.best, view, views)


def figures_of(ran: Ran) -> dict[str, Figure]:
    """All figures of a bag, by name."""
    result = ran.result
    shown = Shown.of(ran.best, ran.run, ran.view)
    figures: dict[str, Figure] = {}
    if ran.best.views:
        figures["fig03_images"] = draw_images(shown)
        figures["fig04_ranging"] = draw_ranging(shown)
        for number, stage in ((7, "raw"), (13, "zones"), (14, "noise")):
            figures[f"fig{number:02d}_{stage}"] = draw_stage(shown, stage)
    figures["fig15_cells"] = draw_stage(shown, "cells")
    for number, which in ((16, "map"), (17, "clusters"), (18, "people")):
        figures[f"fig{number}_{which}"] = draw_map(shown, which)
    if result.counts:
        figures["stages"] = draw_stages(result)
    if result.truth is not None and len(result.truth):
        figures["errors"] = draw_errors(result)
    return figures
