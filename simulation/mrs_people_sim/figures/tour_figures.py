"""Figures of guided tours, from above."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.guiding.guidance import State
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_sim.figures import plots
from mrs_people_sim.figures.layout import new_figure
from mrs_people_sim.scoring.tours import TourRecord, people_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A picture of the formation every so many seconds [s].
_EVERY_S = 20.0
_PERSON = "0.55"


def draw_tour(record: TourRecord, grid: OccupancyGrid | None = None) -> Figure:
    """The ways of people and robots, stops, and the formation every 20 s.

    Args:
        record: The tour.
        grid: Walls and furniture, if they are known.
    """
    span = record.span_ns() or (record.statuses[0].stamp_ns, record.statuses[-1].stamp_ns)
    figure = new_figure(1, 1, 0.62, panel=11.0)
    axes = figure.subplots()
    if grid is not None:
        plots.draw_grid(axes, grid)
    stamps = np.arange(*span, 200_000_000, dtype=np.int64)
    people = people_at(record.truth, stamps)
    for person in range(people.shape[1]):
        axes.plot(
            *people[:, person].T, color=_PERSON, lw=0.7, zorder=2,
            label="people" if person == 0 else None,
        )  # fmt: skip
    for index, (name, track) in enumerate(record.robots.items()):
        xy = track.at(stamps)[:, :2]
        axes.plot(*xy.T, color=plots.robot_color(index), lw=1.5, zorder=3, label=name)
    for at_ns in range(span[0], span[1] + 1, round(_EVERY_S * 1e9)):
        _draw_formation(axes, record, at_ns)
    _draw_stops(axes, record)
    axes.set_aspect("equal")
    axes.set_xlabel("x in map [m]")
    axes.set_ylabel("y in map [m]")
    axes.grid(alpha=0.25)
    figure.legend(loc="outside lower center", ncols=6, frameon=False)
    return figure


def _draw_formation(axes: Axes, record: TourRecord, stamp_ns: int) -> None:
    """Where people and robots are at a time, each robot with its heading."""
    at = np.array([stamp_ns], dtype=np.int64)
    axes.plot(*people_at(record.truth, at)[0].T, "o", color=_PERSON, ms=3, zorder=4)
    for index, track in enumerate(record.robots.values()):
        x, y, yaw = track.at(at)[0]
        shape = np.array([[0.28, 0.0], [-0.18, 0.17], [-0.18, -0.17]])
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        corners: Float = shape @ turn + (x, y)
        axes.fill(*corners.T, fc=plots.robot_color(index), ec="black", lw=0.5, zorder=5)


def _draw_stops(axes: Axes, record: TourRecord) -> None:
    """Where the group was while it was at a stop."""
    stops: dict[str, list[int]] = {}
    for status in record.statuses:
        if status.state == State.AT_STOP:
            stops.setdefault(status.stop, []).append(status.stamp_ns)
    for name, stamps_ns in stops.items():
        middle = np.array(stamps_ns[len(stamps_ns) // 2 :][:1], dtype=np.int64)
        places = people_at(record.truth, middle)[0]
        places = places[np.isfinite(places).all(axis=1)]
        if len(places):
            place = places.mean(axis=0)
            axes.plot(*place, "*", color="gold", mec="black", ms=14, zorder=6)
            axes.annotate(name or "end", place, (0, 12), textcoords="offset points", ha="center")
