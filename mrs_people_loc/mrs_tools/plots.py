"""Figures of results; needs the extra `plots` (matplotlib)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc.geometry import Float
from mrs_people_loc.poses import Pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours that differ for people who see few colours, too (Okabe & Ito); one per robot.
ROBOT_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


@dataclass(frozen=True)
class FieldOfView:
    """What a robot can see of the floor.

    Attributes:
        left: Angle of the left border, from the robot's x axis [rad].
        right: Angle of the right border [rad].
        min_range: Nearest depth [m].
        max_range: Farthest depth [m].
    """

    left: float
    right: float
    min_range: float
    max_range: float


@dataclass(frozen=True)
class TopView:
    """Everything in the picture of one interval, in the common frame.

    Attributes:
        title: Title.
        xy: Cells [m], shape (n, 2).
        robot: Which of `robots` each cell comes from, shape (n,).
        cluster: Label of each cell, shape (n,).
        person: Index in `people` of each cell, -1 for none, shape (n,).
        robots: Pose of each robot, by name.
        views: Field of view of each robot, where it is known.
        people: Positions [m], shape (m, 2).
        radii: Radius of each person's circle [m], shape (m,).
        truth: True positions [m], shape (k, 2); NaN for somebody who is not there.
        circle_sigmas: How many sigmas the circles are.
    """

    title: str
    xy: Float
    robot: np.ndarray
    cluster: np.ndarray
    person: np.ndarray
    robots: Mapping[str, Pose]
    views: Mapping[str, FieldOfView]
    people: Float
    radii: Sequence[float]
    truth: Float
    circle_sigmas: float = 3.0


def draw_top_view(view: TopView, path: str | Path) -> None:
    """Draws cells by robot, clusters, people, truth, and robots with what they see.

    Args:
        view: What to draw.
        path: PNG file to write.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    figure = Figure(figsize=(9, 8), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    for index, (name, pose) in enumerate(view.robots.items()):
        color = ROBOT_COLORS[index % len(ROBOT_COLORS)]
        if name in view.views:
            _draw_field_of_view(axes, pose, view.views[name], color)
        _draw_robot(axes, name, pose, color)
        mine = view.robot == index
        axes.plot(*view.xy[mine].T, "s", ms=3.2, color=color, label=f"cells of {name}")
    _draw_clusters(axes, view)
    for (x, y), radius in zip(view.people, view.radii, strict=True):
        axes.add_patch(Circle((x, y), radius, fill=False, ec="black", lw=1.8))
    axes.plot(
        [], [], "o", ms=12, mfc="none", mec="black", label=f"people ({view.circle_sigmas:g} sigma)"
    )
    axes.plot(*view.people.T, "+", ms=9, mew=1.8, color="black", label="their positions")
    if len(view.truth):
        axes.plot(
            *view.truth.T, "*", ms=11, mfc="gold", mec="black", mew=0.7, label="true positions"
        )
    axes.set_aspect("equal")
    axes.set_xlabel("x in map [m]")
    axes.set_ylabel("y in map [m]")
    axes.set_title(view.title)
    axes.grid(alpha=0.25)
    axes.margins(0.05)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(path)


def _draw_field_of_view(axes: Axes, pose: Pose, view: FieldOfView, color: str) -> None:
    # Depth is along the optical axis, so the borders of the range are straight lines.
    middle = 0.5 * (view.left + view.right)
    corners = []
    for angle, depth in (
        (view.left, view.min_range),
        (view.left, view.max_range),
        (view.right, view.max_range),
        (view.right, view.min_range),
    ):
        distance = depth / math.cos(angle - middle)
        heading = pose.yaw + angle
        corners.append(
            (pose.x + distance * math.cos(heading), pose.y + distance * math.sin(heading))
        )
    axes.fill(*np.array(corners).T, fc=color, ec=color, alpha=0.08, lw=1)


def _draw_robot(axes: Axes, name: str, pose: Pose, color: str) -> None:
    shape = np.array([[0.28, 0.0], [-0.18, 0.17], [-0.18, -0.17]])
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    turned = shape @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
    axes.fill(*turned.T, fc=color, ec="black", lw=0.8, zorder=5)
    axes.annotate(name, (pose.x, pose.y), xytext=(0, -18), textcoords="offset points", ha="center")


def _draw_clusters(axes: Axes, view: TopView) -> None:
    """Numbers every cluster; those that are no person are drawn grey."""
    for label in np.unique(view.cluster):
        cells = view.cluster == label
        centre = view.xy[cells].mean(axis=0)
        nobody = view.person[cells][0] < 0
        if nobody:
            axes.plot(*view.xy[cells].T, "s", ms=7, mfc="none", mec="0.6", mew=0.8, zorder=1)
        text = f"{label + 1}" + (" no person" if nobody else "")
        axes.annotate(
            text,
            tuple(centre),
            xytext=(14, 14),
            textcoords="offset points",
            color="0.45" if nobody else "black",
            fontsize=9,
        )
