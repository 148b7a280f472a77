"""Drawings of results on axes of matplotlib (the extra `plots`), shared by the commands.

All maps are drawn alike: x and y of the common frame in metres at one scale, a colour per robot,
gold stars where people truly are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mrs_people_loc.arrays import Float
from mrs_people_loc.people import Group, Person
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.scoring.positions import CHI2_95

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours that differ for people who see few colours, too (Okabe & Ito); one per robot.
ROBOT_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
#: Those of clusters, in turn; grey is for clusters that are no person.
CLUSTER_COLORS = (*ROBOT_COLORS[:5], "#8C564B", "#17BECF", "#7F3C8D", "#A5AA00", "#E73F74")
_NOBODY = "0.6"
#: Colours of people and of stragglers; opacity of people that are predicted, not seen.
_PERSON, AWAY, _PALE = "#111111", "#C1121F", 0.4
#: From this value on a cell of a grid is drawn as occupied.
_OCCUPIED = 65
#: Centres of groups, and how sure positions are.
_CENTRE, _SURE = "0.3", "#D55E00"
#: Who is slower stands, and has no arrow [m/s].
STANDING = 0.1
#: From a person's circle to their id [pt].
_LABEL_AWAY = 8.0
#: What a robot sees of a body is between the floor and this height [m].
_BODY_HEIGHT = 2.0


@dataclass(frozen=True)
class TopView:
    """Everything in the picture of one interval, in the common frame.

    Attributes:
        title: Title.
        stamp_ns: Time of the interval [ns].
        xy: Cells [m], shape (n, 2).
        robot: Which of `robots` each cell comes from, shape (n,).
        cluster: Label of each cell, shape (n,).
        person: Index in `people` of each cell, -1 for none, shape (n,).
        robots: Pose of each robot, by name.
        views: By robot, where it is known, the border of what it sees (see `seen_floor`).
        people: The people.
        groups: The groups, with their stragglers.
        truth: True positions [m], shape (k, 2); NaN for somebody who is not there.
        circle_sigmas: How many sigmas the circles are.
        visible: Whether a robot sees each of the true people, shape (k,); None: not known.
        trails: By id, where people were of late [m], shape (j, 2), the oldest place first.
        events: What has just happened to the groups, in sentences.
        grid: What is known of walls and furniture; None: nothing.
        notes: By label, what to write beside the number of a cluster.
    """

    title: str
    stamp_ns: int
    xy: Float
    robot: np.ndarray
    cluster: np.ndarray
    person: np.ndarray
    robots: Mapping[str, Pose]
    views: Mapping[str, Float]
    people: Sequence[Person]
    groups: Sequence[Group]
    truth: Float
    circle_sigmas: float = 3.0
    visible: np.ndarray | None = None
    trails: Mapping[int, Float] = field(default_factory=dict)
    events: Sequence[str] = ()
    grid: OccupancyGrid | None = None
    notes: Mapping[int, str] | None = None

    @property
    def positions(self) -> Float:
        """Positions of the people [m], shape (m, 2)."""
        return np.array([person.position for person in self.people]).reshape(-1, 2)

    @property
    def away_s(self) -> dict[int, float]:
        """By id, for how long stragglers have been behind their group or away from it [s]."""
        return {one: s for group in self.groups for one, s in group.stragglers.items()}

    def bounds(self) -> tuple[float, float, float, float]:
        """The least rectangle around everything: x from, to, y from, to [m]."""
        borders = [
            map_from_robot(border, self.robots[name])
            for name, border in self.views.items()
            if name in self.robots
        ]
        places = [(pose.x, pose.y) for pose in self.robots.values()]
        parts = (self.xy, self.truth, self.positions, places, *borders, *self.trails.values())
        every = np.concatenate([np.array(part).reshape(-1, 2) for part in parts])
        low, high = np.nanmin(every, axis=0) - 0.5, np.nanmax(every, axis=0) + 0.5
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def seen_floor(camera: StereoCamera, min_range: float, max_range: float) -> Float:
    """Border of the floor above which a head sees a body, whatever its mounting.

    Args:
        camera: The head.
        min_range: Nearest depth along the optical axis [m].
        max_range: Farthest depth [m].

    Returns:
        Corners of a convex polygon in the robot's base_link [m], shape (k, 2); none if the head
        sees nothing between the floor and the height of a body.
    """
    rotation, origin = camera.robot_from_optical
    u, v, depth = np.meshgrid(
        np.linspace(0, camera.width - 1, 9),
        np.linspace(0, camera.height - 1, 49),
        np.linspace(min_range, max_range, 49),
    )
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)])
    x, y, z = rotation @ (rays * depth).reshape(3, -1) + origin[:, np.newaxis]
    inside = (z >= 0.0) & (z <= _BODY_HEIGHT)
    xy = np.stack([x[inside], y[inside]], axis=1)
    try:
        return np.asarray(xy[ConvexHull(xy).vertices])
    except (QhullError, ValueError):  # fewer than three places
        return np.empty((0, 2))


def draw_top_view(view: TopView, path: str | Path) -> None:
    """Draws cells by robot, people, groups, truth, and robots with what they see.

    Args:
        view: What to draw.
        path: PNG file to write.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 8), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    draw_walls(axes, view)
    draw_robots(axes, view)
    draw_cells(axes, view)
    frame_nobody(axes, view)
    draw_people(axes, view)
    legend_of_people(axes, [view])
    draw_truth(axes, view)
    finish_map(axes, view)
    axes.set_title(view.title)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(path)


# ----------------------------------------------------------------------------- parts of a map


def finish_map(
    axes: Axes, view: TopView, bounds: tuple[float, float, float, float] | None = None
) -> None:
    """Scale, limits (if not given, around everything), units and grid."""
    from matplotlib.ticker import MultipleLocator

    left, right, low, high = bounds or view.bounds()
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_aspect("equal")
    step = next((m for m in (1, 2, 5, 10) if max(right - left, high - low) <= 12 * m), 20)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(step))
    axes.set_xlabel("x in map [m]")
    axes.set_ylabel("y in map [m]")
    axes.grid(alpha=0.25)


def draw_walls(axes: Axes, view: TopView) -> None:
    """Walls and furniture, as far as they are known."""
    if view.grid is not None:
        draw_grid(axes, view.grid)


def draw_grid(axes: Axes, grid: OccupancyGrid) -> None:
    """Occupied cells of a grid."""
    from matplotlib.colors import ListedColormap
    from matplotlib.transforms import Affine2D

    occupied = np.ma.masked_less(grid.data, _OCCUPIED)
    height, width = grid.resolution * np.array(grid.data.shape)
    place = Affine2D().rotate(grid.yaw).translate(grid.x, grid.y) + axes.transData
    axes.imshow(
        occupied,
        extent=(0.0, width, 0.0, height),
        origin="lower",
        cmap=ListedColormap(["0.82"]),
        interpolation="nearest",
        transform=place,
        zorder=0.5,
    )


def draw_robots(axes: Axes, view: TopView, *, only: str | None = None) -> None:
    """The robots with their names and what they see; or without, and what `only` one sees."""
    for index, (name, pose) in enumerate(view.robots.items()):
        color = robot_color(index)
        border = view.views.get(name)
        if border is not None and len(border) and only in (None, name):
            axes.fill(*map_from_robot(border, pose).T, fc=color, ec=color, alpha=0.08, lw=1)
        shape = np.array([[0.28, 0.0], [-0.18, 0.17], [-0.18, -0.17]])
        axes.fill(*map_from_robot(shape, pose).T, fc=color, ec="black", lw=0.8, zorder=5)
        if only is None:
            axes.annotate(
                name,
                (pose.x, pose.y - 0.28),  # below, however it is turned
                xytext=(0, -2),
                textcoords="offset points",
                ha="center",
                va="top",
                annotation_clip=True,
            )


def robot_color(index: int) -> str:
    """Colour of a robot, by its place in the team."""
    return ROBOT_COLORS[index % len(ROBOT_COLORS)]


def draw_cells(axes: Axes, view: TopView) -> None:
    """The cells, in the colours of the robots that sent them."""
    for index, name in enumerate(view.robots):
        mine = view.robot == index
        axes.plot(*view.xy[mine].T, "s", ms=3.2, color=robot_color(index), label=f"cells of {name}")


def draw_clusters(axes: Axes, view: TopView) -> None:
    """The cells, in a colour of each cluster; those that are no person are grey."""
    people = 0
    for label in np.unique(view.cluster):
        cells = view.cluster == label
        somebody = bool(view.person[cells][0] >= 0)
        color = CLUSTER_COLORS[people % len(CLUSTER_COLORS)] if somebody else _NOBODY
        people += somebody
        axes.plot(*view.xy[cells].T, "s", ms=3.2, color=color)


def frame_nobody(axes: Axes, view: TopView) -> None:
    """Grey frames around the cells of clusters that are no person."""
    nobody = view.person < 0
    if nobody.any():
        style: dict[str, Any] = {"marker": "s", "ls": "none", "ms": 7, "mfc": "none", "zorder": 1}
        axes.plot(*view.xy[nobody].T, **style, mec=_NOBODY, mew=0.8, label="no person")


def number_clusters(axes: Axes, view: TopView) -> None:
    """Numbers every cluster, from 1."""
    for label in np.unique(view.cluster):
        cells = view.cluster == label
        nobody = view.person[cells][0] < 0
        text = f"{label + 1}"
        if view.notes and label in view.notes:
            text += f": {view.notes[label]}"
        elif nobody:
            text += " no person"
        axes.annotate(
            text,
            tuple(view.xy[cells].mean(axis=0)),
            xytext=(14, 14 if not nobody else -4),
            textcoords="offset points",
            color="0.35" if nobody else "black",
            fontsize=8 if nobody else 10,
            path_effects=_outline(),
            zorder=7,
        )


def draw_people(axes: Axes, view: TopView, *, ellipses: bool = False) -> None:
    """People with ids, trails and velocities as circles of some sigmas, and their groups.

    Args:
        axes: Where to.
        view: What is drawn.
        ellipses: Whether 95 % ellipses of the positions are drawn, too.
    """
    away_s = view.away_s
    _draw_groups(axes, view)
    for index, person in enumerate(view.people):
        color = AWAY if person.id in away_s else _PERSON
        alpha = _PALE if person.coasting else 1.0
        radius = view.circle_sigmas * person.sigma
        _draw_trail(axes, view.trails.get(person.id), color, alpha)
        _draw_person(axes, person, radius, color, alpha)
        text = str(person.id or index + 1)
        if person.id in away_s:
            text += f" ({away_s[person.id]:.0f} s)"
        _label_person(axes, person, radius, text, color, alpha)
        if ellipses:
            _draw_ellipse(axes, person)


def _draw_person(axes: Axes, person: Person, radius: float, color: str, alpha: float) -> None:
    """A circle, a cross in its centre, and an arrow to where the person is in a second."""
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Circle

    place = person.position
    axes.add_patch(
        Circle(
            tuple(place),
            radius,
            fc=to_rgba(color, 0.1 * alpha),
            ec=to_rgba(color, alpha),
            lw=1.8,
            zorder=3,
        )
    )
    axes.plot(*place, "+", ms=8, mew=1.6, color=color, alpha=alpha, zorder=4)
    if person.velocity is not None and np.hypot(*person.velocity) >= STANDING:
        style = {"arrowstyle": "-|>", "lw": 1.6, "color": color, "alpha": alpha}
        style |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
        axes.annotate("", tuple(place + person.velocity), tuple(place), arrowprops=style, zorder=4)


def _label_person(
    axes: Axes, person: Person, radius: float, text: str, color: str, alpha: float
) -> None:
    beside = _beside(person)
    axes.annotate(
        text,
        tuple(person.position + radius * beside),
        xytext=tuple(_LABEL_AWAY * beside),
        textcoords="offset points",
        ha="center" if abs(beside[0]) < 0.5 else "left" if beside[0] > 0 else "right",
        va="center",
        color=color,
        alpha=max(alpha, 0.7),
        fontweight="bold",
        path_effects=_outline(),
        annotation_clip=True,
        zorder=8,
    )


def _draw_ellipse(axes: Axes, person: Person) -> None:
    """The 95 % ellipse of a position."""
    from matplotlib.patches import Ellipse

    values, vectors = np.linalg.eigh(person.covariance)
    width, height = 2.0 * np.sqrt(CHI2_95 * np.maximum(values[::-1], 0.0))
    angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    axes.add_patch(
        Ellipse(tuple(person.position), width, height, angle=angle, fill=False, ec=_SURE, lw=1.2)
    )


def _beside(person: Person) -> Float:
    """Direction in which there is room for text: across the way, where nobody else is ahead."""
    if person.velocity is None or np.hypot(*person.velocity) < STANDING:
        return np.full(2, math.sqrt(0.5))
    x, y = person.velocity / np.hypot(*person.velocity)
    return np.array([-y, x]) if x >= 0 else np.array([y, -x])


def legend_of_people(axes: Axes, views: Sequence[TopView], *, ellipses: bool = False) -> None:
    """Puts what `draw_people` draws in some views into the legend."""
    from matplotlib.colors import to_rgba

    def add(label: str, color: str, alpha: float = 1.0, width: float = 1.8) -> None:
        fill = "none" if color == _SURE else to_rgba(color, 0.1 * alpha)
        edge = to_rgba(color, alpha)
        axes.plot([], [], "o", ms=11, mfc=fill, mec=edge, mew=width, label=label)

    people = [person for view in views for person in view.people]
    add(f"people ({views[0].circle_sigmas:g} sigma)", _PERSON)
    if any(person.coasting for person in people):
        add("predicted, not seen", _PERSON, _PALE)
    if any(view.away_s for view in views):
        add("fallen behind or left", AWAY)
    if ellipses:
        add("95 % ellipse", _SURE, width=1.2)
    if any(view.groups for view in views):
        axes.plot([], [], "X", ms=10, mfc=_CENTRE, mec="white", label="centre of the group")


def _draw_trail(axes: Axes, trail: Float | None, color: str, alpha: float) -> None:
    """Where somebody was, the paler the longer ago."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgba

    if trail is None or len(trail) < 2:
        return
    opaque = alpha * np.linspace(0.05, 0.7, len(trail) - 1)
    pieces = np.stack([trail[:-1], trail[1:]], axis=1)
    colors = [to_rgba(color, float(a)) for a in opaque]
    axes.add_collection(
        LineCollection(list(pieces), colors=colors, lw=2.2, zorder=2), autolim=False
    )


def _draw_groups(axes: Axes, view: TopView) -> None:
    """Centres of groups, and a thin line from each to its members."""
    places = {person.id: person.position for person in view.people if person.id}
    for group in view.groups:
        if group.size < 2 and len(view.groups) > 1:
            continue  # somebody alone, beside a group
        for place in (places[one] for one in group.members if one in places):
            axes.plot(*np.stack([group.centre, place]).T, color="0.55", lw=0.9, zorder=1.5)
        axes.plot(*group.centre, "X", ms=10, mfc=_CENTRE, mec="white", zorder=5)


def _outline() -> list[Any]:
    """Lets text be read on anything."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.5, foreground="white")]


def draw_truth(axes: Axes, view: TopView, *, size: float = 11.0) -> None:
    """Gold stars [pt] where people are; hollow ones where no robot sees them."""
    if not len(view.truth):
        return
    seen = np.ones(len(view.truth), bool) if view.visible is None else view.visible
    style: dict[str, Any] = {"mec": "black", "mew": 0.7, "ls": "none", "marker": "*", "ms": size}
    axes.plot(*view.truth[seen].T, **style, mfc="gold", label="true positions", zorder=6)
    if not seen.all():
        axes.plot(*view.truth[~seen].T, **style, mfc="white", label="seen by no robot", zorder=6)


# ----------------------------------------------------------------------------------- statistics


def draw_errors(axes: Axes, errors_m: Float, *, limit_m: float) -> None:
    """Histogram of the distances of matched people, with mean, median and 95th percentile.

    Args:
        axes: Where to.
        errors_m: Distances [m].
        limit_m: Greatest possible distance [m]: the end of the axis.
    """
    bins = np.linspace(0.0, 100 * limit_m, 41)
    errors_cm = 100 * errors_m
    axes.hist(errors_cm, bins=bins.tolist(), color=ROBOT_COLORS[0], alpha=0.75)
    if len(errors_cm):
        for name, value, color in (
            ("median", np.median(errors_cm), ROBOT_COLORS[2]),
            ("mean", errors_cm.mean(), "black"),
            ("95 % are within", np.percentile(errors_cm, 95), ROBOT_COLORS[1]),
        ):
            axes.axvline(float(value), color=color, lw=1.8, label=f"{name} {value:.1f} cm")
        axes.legend(frameon=False)
    axes.set_xlim(0.0, 100 * limit_m)
    axes.set_xlabel("distance of found from true position [cm]")
    axes.set_ylabel("matched people (all frames)")
    axes.grid(alpha=0.25, axis="y")


def draw_kept(
    axes: Axes,
    kept: Mapping[str, Mapping[str, float | None]],
    reference: Mapping[str, float] | None = None,
) -> None:
    """Bars: the share of points that each stage keeps of the one before.

    Args:
        axes: Where to.
        kept: By robot, by stage.
        reference: By stage, the share that somebody else had (the paper): a line.
    """
    from matplotlib.patheffects import withStroke

    stages = list(next(iter(kept.values()), {}))
    width = 0.8 / max(1, len(kept))
    for index, (robot, shares) in enumerate(kept.items()):
        values = [100 * (shares[stage] or 0.0) for stage in stages]
        places = np.arange(len(stages)) + (index - (len(kept) - 1) / 2) * width
        bars = axes.bar(places, values, width * 0.92, color=robot_color(index), label=robot)
        outline = [withStroke(linewidth=3, foreground="white")]
        axes.bar_label(bars, fmt="%.0f", padding=2, path_effects=outline, zorder=4)
    for index, stage in enumerate(stages):
        if reference and stage in reference:
            axes.hlines(
                100 * reference[stage],
                index - 0.45,
                index + 0.45,
                color="black",
                ls="--",
                lw=1.8,
                label="the paper" if index == 0 else "_",  # one line of the legend for all
            )
    axes.set_xticks(range(len(stages)), stages)
    axes.set_ylim(0.0, 108.0)
    axes.set_ylabel("kept of the stage before [%]")
    axes.legend(frameon=False)
    axes.grid(alpha=0.25, axis="y")
