"""The figures of the paper's section 6, for one interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.bodies import search
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_sim.figures import plots
from mrs_people_sim.figures.layout import legend_below, new_figure
from mrs_people_sim.figures.plots import TopView
from mrs_tools.bags.offline import BagRun, Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Heights of side views, at least, and of the colours of points [m].
_SIDE_M, _COLOR_M = (-0.5, 2.8), (0.0, 2.0)
_HEIGHT = "height over the floor [m]"


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

    @classmethod
    def of(cls, interval: Interval, run: BagRun, view: TopView) -> Shown:
        """Takes an interval, the run that it comes from, and its map."""
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
        return cls(
            interval=interval,
            view=view,
            zones=zones,
            reach=(float(reach.min()) - 0.3, float(reach.max()) + 0.3),
            top=max([_SIDE_M[1], *heads]),
        )

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
                cloud = {"raw": stages.cloud, "zones": stages.cropped, "noise": stages.foreground}[
                    which
                ]
                result[scan.robot] = Stage(np.asarray(cloud, dtype=np.float64))
        return result


def draw_images(shown: Shown) -> Figure:
    """Fig. 3: each robot's image and its disparity."""
    views = shown.interval.views
    figure = new_figure(2, len(views), 0.78)
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
    figure = new_figure(2, len(stages), 0.85)
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
    figure = new_figure(2, len(stages), 0.95)
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
    legend_below(figure, grid[0, 0])
    return figure


def draw_map(shown: Shown, which: str) -> Figure:
    """Figs. 16, 17 and 18: the fused map, its clusters, the people."""
    view = shown.view
    figure = new_figure(1, 1, 1.1, panel=7.5)
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
    legend_below(figure, axes)
    return figure


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
