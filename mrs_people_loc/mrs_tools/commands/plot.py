"""`mrs plot`: the figures of the paper's section 6, from a bag.

One interval is shown in every picture: `fig03` the images and their disparity, `fig04` what a
robot ranges, from above and from the side, `fig07`, `fig13`, `fig14` and `fig15` what the stages
leave of it on the common map, `fig16` the fused map, `fig17` its clusters and `fig18` the people.
`stages` and `errors` are about the whole bag. Or an animation of it, see `animation`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mrs_people_loc.bodies import search
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.geometry import Float
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_tools.bags.offline import BagRun, Interval, read_grid
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.commands.evaluate import OwnConfig, Result, evaluate_bag, progress_bar
from mrs_tools.figures import plots
from mrs_tools.figures.animation import animate, check_is_gif
from mrs_tools.figures.plots import TopView
from mrs_tools.plain import plain
from mrs_tools.scoring.positions import MATCH_DISTANCE, Truth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: What the paper keeps of each stage (section 6).
PAPER_KEPT = {"zones": 0.15, "noise": 0.73, "cells": 0.07}
#: Heights of side views, at least, and of the colours of points [m].
_SIDE_M, _COLOR_M = (-0.5, 2.8), (0.0, 2.0)
_HEIGHT = "height over the floor [m]"
#: Width of one panel [inch], and resolution.
_PANEL, _DPI = 4.4, 110


@dataclass(frozen=True)
class Stage:
    """Points of one stage of one robot.

    Attributes:
        points: x, y, z in base_link [m], shape (n, 3); of cells the highest point.
        low: Of cells, their lowest point [m], shape (n,); None for points.
    """

    points: Float
    low: Float | None = None


@dataclass(frozen=True)
class Shown:
    """The interval that is shown.

    Attributes:
        interval: The interval.
        view: The map of it.
        zones: Lower and upper end of the zones [m], by robot.
        reach: How far to the back and to the front side views go [m].
        top: How far up they go [m].
    """

    interval: Interval
    view: TopView
    zones: Mapping[str, tuple[float, float]]
    reach: tuple[float, float]
    top: float

    def stages(self, which: str) -> dict[str, Stage]:
        """Points of a stage by robot: raw, zones, noise or cells."""
        result = {}
        for scan in self.interval.scans:
            if which == "cells":
                c = scan.cells
                points = np.stack([c.x, c.y, c.z], axis=1).astype(np.float64)
                result[scan.robot] = Stage(points, c.z_min.astype(np.float64))
            elif scan.robot in self.interval.views:
                stages = self.interval.views[scan.robot].stages
                cloud = {"raw": stages.cloud, "zones": stages.zones, "noise": stages.noise}[which]
                result[scan.robot] = Stage(np.asarray(cloud, dtype=np.float64))
        return result


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
        people=people.persons,
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


def show(interval: Interval, run: BagRun, view: TopView) -> Shown:
    """What the pictures of an interval need, besides its map."""
    ahead = [border[:, 0] for border in view.views.values() if len(border)]
    ahead += [scan.cells.x.astype(np.float64) for scan in interval.scans]
    reach = np.concatenate([[0.0], *ahead])
    zones = {
        name: (search.LOWEST, search.HIGHEST)
        if config.bodies.search
        else (config.zones.low, config.zones.high)
        for name, config in run.team.robots.items()
    }
    heads = [seen.camera.mounting.height + 0.3 for seen in interval.views.values()]
    return Shown(
        interval=interval,
        view=view,
        zones=zones,
        reach=(float(reach.min()) - 0.3, float(reach.max()) + 0.3),
        top=max([_SIDE_M[1], *heads]),
    )


# ------------------------------------------------------------------------------------- figures


def draw_images(shown: Shown) -> Figure:
    """Fig. 3: each robot's image and its disparity."""
    views = shown.interval.views
    figure = _figure(2, len(views), 0.78)
    grid = figure.subplots(2, len(views), squeeze=False)
    every = np.concatenate([v.stages.disparity.reshape(-1) for v in views.values()])
    every = every[np.isfinite(every)]
    highest = float(np.percentile(every, 99.8)) if len(every) else 1.0  # not a few mismatches
    colored = None
    for (name, view), (above, below) in zip(views.items(), grid.T, strict=True):
        above.imshow(view.images.left, cmap="gray", vmin=0, vmax=255)
        above.set_title(name)
        below.set_facecolor("black")  # where there is no disparity
        colored = below.imshow(view.stages.disparity, cmap="turbo", vmin=0, vmax=highest)
        valid = float(np.isfinite(view.stages.disparity).mean())
        below.set_title(f"{100 * valid:.0f} % of the pixels", fontsize=10)
        for axes in (above, below):
            axes.set_xlabel("column [px]")
            axes.set_ylabel("row [px]")
    if colored is not None:
        figure.colorbar(colored, ax=grid, label="disparity [px]", extend="max", aspect=40)
    return figure


def draw_ranging(shown: Shown) -> Figure:
    """Fig. 4: what each robot ranges, from above and from the side, in its own frame."""
    stages = shown.stages("raw")
    figure = _figure(2, len(stages), 0.85)
    grid = figure.subplots(2, len(stages), squeeze=False, sharex=True)
    borders = [border[:, 1] for border in shown.view.views.values() if len(border)]
    aside = max([float(np.abs(border).max()) for border in borders], default=3.0)
    colored = None
    for (name, stage), (above, side) in zip(stages.items(), grid.T, strict=True):
        colored = _points(above, stage.points[:, :2], stage.points[:, 2])
        above.set_title(name)
        above.set_ylim(-aside, aside)
        above.set_ylabel("y, to the left [m]")
        above.set_aspect("equal")
        above.grid(alpha=0.25)
        _head(above, shown, name, "xy")
        _side(side, stage, shown, name)
    if colored is not None:
        figure.colorbar(colored, ax=grid, label=_HEIGHT, extend="both", aspect=40)
    return figure


def draw_stage(shown: Shown, which: str) -> Figure:
    """Figs. 7, 13, 14 and 15: what a stage left, from above on the map and from the side."""
    stages = shown.stages(which)
    figure = _figure(2, len(stages), 0.95)
    grid = figure.subplots(2, len(stages), squeeze=False, height_ratios=[1.9, 1.0])
    colored = None
    for (name, stage), (above, side) in zip(stages.items(), grid.T, strict=True):
        plots.draw_walls(above, shown.view)
        plots.draw_robots(above, shown.view, only=name)
        pose = shown.interval.people.poses[name]
        colored = _points(
            above, map_from_robot(stage.points[:, :2], pose), stage.points[:, 2], stage.low
        )
        plots.draw_truth(above, shown.view)
        plots.finish_map(above, shown.view)
        what = "cells" if which == "cells" else "points"
        above.set_title(f"{name}: {len(stage.points)} {what}")
        _side(side, stage, shown, name)
    if colored is not None:
        figure.colorbar(colored, ax=grid, label=_HEIGHT, extend="both", aspect=40)
    _legend(figure, grid[0, 0])
    return figure


def draw_map(shown: Shown, which: str) -> Figure:
    """Figs. 16, 17 and 18: the fused map, its clusters, the people."""
    view = shown.view
    figure = _figure(1, 1, 1.1, panel=7.5)
    axes = figure.subplots()
    plots.draw_walls(axes, view)
    plots.draw_robots(axes, view)
    people = f"{len(view.people)} " + ("person" if len(view.people) == 1 else "people")
    if which == "map":
        plots.draw_cells(axes, view)
        title = f"{len(view.xy)} cells of {len(view.robots)} robots"
    elif which == "clusters":
        plots.draw_clusters(axes, view)
        plots.number_clusters(axes, view)
        title = f"{len(set(view.cluster.tolist()))} clusters, {people}; grey: no person"
    else:
        axes.plot(*view.xy.T, "s", ms=2.4, color="0.78", zorder=1)
        plots.draw_people(axes, view, ellipses=True)
        plots.legend_of_people(axes, [view], ellipses=True)
        there = int(np.isfinite(view.truth).all(axis=1).sum())
        title = people + (f" found, {there} there" if len(view.truth) else " found")
    plots.draw_truth(axes, view)
    plots.finish_map(axes, view)
    axes.set_title(title)
    _legend(figure, axes)
    return figure


def draw_stages(result: Result) -> Figure:
    """Bars of what each stage keeps, with the paper's figures."""
    figure = _figure(1, 1, 0.62, panel=7.5)
    axes = figure.subplots()
    kept = {
        robot: {stage: means[f"{stage}_kept"] for stage in PAPER_KEPT}
        for robot, means in result.report()["stages"].items()
    }
    plots.draw_kept(axes, kept, PAPER_KEPT)
    axes.set_title("points that each stage keeps (means of all views)")
    return figure


def draw_errors(result: Result) -> Figure:
    """Histogram of the errors of all matched people."""
    figure = _figure(1, 1, 0.62, panel=7.5)
    axes = figure.subplots()
    errors = np.concatenate([np.empty(0), *(frame.errors for frame in result.frames)])
    plots.draw_errors(axes, errors, limit_m=MATCH_DISTANCE)
    people = result.report()["people"]
    axes.set_title(
        f"{people['matched']} of {people['true']} people found, {len(result.frames)} frames"
    )
    return figure


def _figure(rows: int, columns: int, aspect: float, panel: float = _PANEL) -> Figure:
    from matplotlib.figure import Figure

    size = (panel * columns + 1.0, panel * aspect * rows + 0.4)
    return Figure(figsize=size, dpi=_DPI, layout="constrained")


def _points(axes: Axes, xy: Float, height: Float, low: Float | None = None) -> Any:
    """Points from above; cells are larger than points."""
    order = np.argsort(height, kind="stable")  # the highest on top
    return axes.scatter(
        xy[order, 0],
        xy[order, 1],
        c=height[order],
        s=4.0 if low is None else 8.0,
        marker="." if low is None else "s",
        linewidths=0,
        cmap="viridis",
        vmin=_COLOR_M[0],
        vmax=_COLOR_M[1],
    )


def _side(axes: Axes, stage: Stage, shown: Shown, robot: str) -> None:
    """Points from the side, seen from the robot's right: ahead and up."""
    x, _, z = stage.points.T
    if stage.low is not None:
        axes.vlines(x, stage.low, z, color="0.6", lw=0.8, zorder=1)
    _points(axes, np.stack([x, z], axis=1), z, stage.low)
    for height in shown.zones.get(robot, ()):
        axes.axhline(height, color="#D55E00", lw=1.0, ls="--")
    _head(axes, shown, robot, "xz")
    axes.set_xlim(*shown.reach)
    axes.set_ylim(_SIDE_M[0], shown.top)
    axes.set_aspect("equal")
    axes.set_xlabel("x, ahead of the robot [m]")
    axes.set_ylabel("height [m]")
    axes.grid(alpha=0.25)


def _head(axes: Axes, shown: Shown, robot: str, plane: str) -> None:
    """The head and where it looks, in a plane of the robot's frame."""
    view = shown.interval.views.get(robot)
    if view is None:
        return
    rotation, place = view.camera.robot_from_optical
    one, other = ("xyz".index(axis) for axis in plane)
    axes.annotate(
        "",
        (place[one] + 0.4 * rotation[one, 2], place[other] + 0.4 * rotation[other, 2]),
        (place[one], place[other]),
        arrowprops={"arrowstyle": "-|>", "lw": 1.5, "color": "black", "shrinkA": 0, "shrinkB": 0},
    )
    axes.plot(place[one], place[other], "ks", ms=6, zorder=6)


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)


# ------------------------------------------------------------------------------------- command


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
    shown = show(ran.best, ran.run, ran.view)
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


def figures_of_results(results: Mapping[str, Result]) -> dict[str, Figure]:
    """Figures of the evaluation of some bags: `errors`, `stages` and, of several bags, `bags`."""
    total = Result.pooled(list(results.values()))
    figures = {"errors": draw_errors(total)}
    if total.counts:
        figures["stages"] = draw_stages(total)
    if len(results) > 1:
        figures["bags"] = draw_bags(results)
    return figures


def draw_bags(results: Mapping[str, Result]) -> Figure:
    """Bars of recall, precision and mean error of each bag."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 1.6 + 0.26 * len(results)), dpi=_DPI, layout="constrained")
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


def save(figures: Mapping[str, Figure], folder: Path) -> list[Path]:
    """Writes figures as PNG files.

    Raises:
        PeopleLocError: The folder cannot be written.
    """
    files = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            files.append(folder / f"{name}.png")
            figure.savefig(files[-1])
    except OSError as err:
        raise PeopleLocError(f"{folder}: cannot be written ({err.strerror or err})") from err
    return files


def command(
    bag: Annotated[Path, typer.Argument(help="A bag with our topics.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the pictures.")
    ] = None,
    animation: Annotated[
        Path | None, typer.Option("--animation", "-a", help="GIF file for an animation.")
    ] = None,
    config: Annotated[
        list[Path] | None,
        typer.Option("--config", "-c", help="Parameter file of the team; later ones win."),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option("--at", min=0.0, help="Which interval [s since the bag's start]: the middle."),
    ] = None,
    own_config: OwnConfig = True,
) -> None:
    """Draw the paper's figures from a bag, as PNG files, or an animation of all of it.

    Images with disparity, views of every stage from above and from the side, the fused map, its
    clusters, the people; then what each stage keeps and a histogram of the errors. The animation
    shows robots, people with their ids and ways, and groups, from above.
    """
    from rich.console import Console
    from rich.text import Text

    if out is None and animation is None:
        raise typer.BadParameter("what is to be drawn? --out FOLDER, --animation FILE, or both")
    if animation is not None:
        check_is_gif(animation)
    console = Console(highlight=False, soft_wrap=True)
    with progress_bar() as progress:
        task = progress.add_task(bag.name, total=1.0)
        ran = run_bag(
            bag,
            config or [],
            beside=own_config,
            at_s=at,
            all_views=animation is not None,
            on_progress=lambda p: progress.update(task, completed=p),
        )
        files = []
        if out is not None:
            figures = figures_of(ran)
            task = progress.add_task("drawing", total=len(figures))
            for name, figure in figures.items():
                files += save({name: figure}, out)
                progress.advance(task)
        if animation is not None:
            task = progress.add_task("animation", total=1.0)
            animate(ran.views, animation, on_progress=lambda p: progress.update(task, completed=p))
    for note in ran.result.notes:
        console.print(Text(plain(note)), style="yellow")
    if out is not None:
        console.print(f"{len(files)} pictures in {out}: {', '.join(f.name for f in files)}")
    if animation is not None:
        console.print(f"animation: {animation}")
