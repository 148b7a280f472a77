"""Figures of scores: stages, errors, bags side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mrs_people_sim.evaluation.results import Result
from mrs_people_sim.figures import plots
from mrs_people_sim.figures.layout import DPI, new_figure
from mrs_people_sim.figures.tour_figures import draw_tour
from mrs_people_sim.paper import PAPER_KEPT, PAPER_STAGES
from mrs_people_sim.scoring.positions import MATCH_DISTANCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_stages(result: Result) -> Figure:
    """Bars of what each stage keeps, with the paper's figures."""
    figure = new_figure(1, 1, 0.62, panel=7.5)
    axes = figure.subplots()
    kept = {
        robot: {left: means[f"{left}_kept"] for left in PAPER_STAGES.values()}
        for robot, means in result.report()["stages"].items()
    }
    paper = {PAPER_STAGES[stage]: share for stage, share in PAPER_KEPT.items()}
    plots.draw_kept(axes, kept, paper)
    axes.set_title("points that each stage keeps (means of all views)")
    return figure


def draw_errors(result: Result) -> Figure:
    """Histogram of the errors of all matched people."""
    figure = new_figure(1, 1, 0.62, panel=7.5)
    axes = figure.subplots()
    errors = np.concatenate([np.empty(0), *(frame.errors for frame in result.frames)])
    plots.draw_errors(axes, errors, limit_m=MATCH_DISTANCE)
    people = result.report()["people"]
    axes.set_title(
        f"{people['matched']} of {people['true']} people found, {len(result.frames)} frames"
    )
    return figure


def figures_of_results(results: Mapping[str, Result]) -> dict[str, Figure]:
    """Figures of the evaluation of some bags.

    `errors`, `stages`, of several bags `bags`, and a `tour` of each bag in which a team guided.
    """
    total = Result.pooled(list(results.values()))
    figures = {"errors": draw_errors(total)}
    if total.counts:
        figures["stages"] = draw_stages(total)
    if len(results) > 1:
        figures["bags"] = draw_bags(results)
    for name, result in results.items():
        if result.tour_record is not None:
            which = f"tour_{name.replace('/', '_')}" if len(results) > 1 else "tour"
            figures[which] = draw_tour(result.tour_record, result.grid)
    return figures


def draw_bags(results: Mapping[str, Result]) -> Figure:
    """Bars of recall, precision and mean error of each bag."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 1.6 + 0.26 * len(results)), dpi=DPI, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[1.4, 1.0])
    people = [result.report()["people"] for result in results.values()]
    rows = np.arange(len(people))
    for key, shift, color in (("recall", -0.2, 0), ("precision", 0.2, 1)):
        values = [100 * (p[key] or 0.0) for p in people]
        left.barh(rows + shift, values, 0.38, color=plots.robot_color(color), label=key)
    left.set_xlabel("recall, precision [%]")
    left.set_xlim(0.0, 100.0)
    for key, height, shade in (("p95", 0.76, "0.85"), ("mean", 0.5, plots.robot_color(2))):
        values = [100 * (p["error_m"][key] or 0.0) for p in people]
        right.barh(rows, values, height, color=shade, label=key)
    right.set_xlabel("error [cm]")
    right.set_xlim(0.0, 100 * MATCH_DISTANCE)
    left.set_yticks(rows, list(results))
    left.invert_yaxis()
    figure.legend(loc="outside upper right", ncols=4, frameon=False)
    for axes in (left, right):
        axes.grid(alpha=0.25, axis="x")
    return figure
