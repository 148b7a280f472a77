"""Animations of a team and the people around it, seen from above (the extra `plots`)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.figures import plots
from mrs_people_sim.figures.plots import TopView

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Bytes = NDArray[np.uint8]

#: Pictures per second, at most.
FRAMES_PER_S = 5
#: It is of at most so many seconds of the recording.
_MAX_S = 3600
#: Trails are so long [s], and events are told for so long [s].
TRAIL_S, _EVENT_S = 4.0, 3.0
#: Around everybody there is so much room [m].
_ROOM = 1.0
#: The longer side of the map, and what is beside it [inch].
_LONG, _LEFT, _RIGHT, _ABOVE = 9.4, 0.6, 0.15, 0.78
#: Below it: the axis, and each row of the legend [inch]; width of its entries, how many there are.
_AXIS, _ROW, _ENTRY, _ENTRIES = 0.62, 0.22, 1.65, 6
#: The other side of the map is this share of the longer one at least.
_LEAST_SHARE = 0.35
#: Size of stars [pt], resolution.
_STAR, _DPI = 7.0, 90
#: So many events are told at a time.
_TOLD = 2
#: Colours of the animation, chosen from so many of its pictures.
_COLORS, _SAMPLES = 256, 8
#: So many of them are those that most pixels have.
_FREQUENT = 96


def check_is_gif(path: Path) -> None:
    """Checks the name of a file that is to be written.

    Raises:
        PeopleLocError: It is no GIF.
    """
    if path.suffix.lower() != ".gif":
        raise PeopleLocError(f"{path}: an animation is a .gif")


def with_trails(views: Sequence[TopView]) -> list[TopView]:
    """Adds where people were in the last seconds to the views of a recording, in their order."""
    ways: dict[int, list[tuple[int, Float]]] = {}
    result = []
    for view in views:
        since_ns = view.stamp_ns - round(TRAIL_S * 1e9)
        trails = {}
        for person in view.people:
            if person.id:
                way = [*ways.get(person.id, ()), (view.stamp_ns, person.position)]
                ways[person.id] = way = [(ns, xy) for ns, xy in way if ns >= since_ns]
                trails[person.id] = np.array([xy for _, xy in way])
        result.append(dataclasses.replace(view, trails=trails))
    return result


def animate(
    views: Sequence[TopView],
    path: Path,
    *,
    on_progress: Callable[[float], None] | None = None,
) -> None:
    """Writes an animation as fast as it was: people, groups, robots and what has happened.

    Args:
        views: The intervals of a recording, in their order.
        path: GIF file to write.
        on_progress: Called with how much is done, 0 to 1.

    Raises:
        PeopleLocError: There is nothing to draw, or the file cannot be written.
    """
    from PIL import Image

    if not views:
        raise PeopleLocError(f"{path}: there is no interval to draw")
    film = _Film(views)
    # One palette for all pictures: colours that changed from one to the next would flicker.
    every = np.linspace(0, len(film) - 1, _SAMPLES, dtype=int)
    palette = palette_of(np.concatenate([film.draw(number).reshape(-1, 3) for number in every]))

    def pictures() -> Iterator[Image.Image]:
        for number in range(len(film)):
            picture = Image.fromarray(nearest(palette, film.draw(number)))
            picture.putpalette(palette.tobytes())
            yield picture
            if on_progress is not None:
                on_progress((number + 1) / len(film))

    drawn = pictures()
    try:
        next(drawn).save(
            path,
            "GIF",
            save_all=True,
            append_images=drawn,
            duration=1000 // FRAMES_PER_S,
            loop=0,
        )
    except OSError as err:
        raise PeopleLocError(f"{path}: cannot be written ({err.strerror or err})") from err


def palette_of(colors: Bytes) -> Bytes:
    """Colours for a picture: those that most of it has, and others that are like none of these.

    Args:
        colors: Of its pixels, RGB, shape (n, 3).

    Returns:
        Up to 256 colours, shape (m, 3).
    """
    codes, count = np.unique(_codes(colors), return_counts=True)
    left = codes[np.argsort(-count, kind="stable")]
    rest = _rgb(left[_FREQUENT:]).astype(np.int64)
    chosen = list(_rgb(left[:_FREQUENT]))
    away = _distance(rest, np.array(chosen)).min(axis=1) if len(rest) else np.empty(0)
    while len(chosen) < _COLORS and away.any():
        chosen.append(rest[away.argmax()].astype(np.uint8))
        away = np.minimum(away, _distance(rest, chosen[-1][np.newaxis])[:, 0])
    return np.array(chosen, dtype=np.uint8)


def nearest(palette: Bytes, picture: Bytes) -> Bytes:
    """Which colour of a palette each pixel has.

    Args:
        palette: Colours, RGB, shape (m, 3).
        picture: RGB, shape (height, width, 3).

    Returns:
        Indices, shape (height, width).
    """
    codes, which = np.unique(_codes(picture), return_inverse=True)
    index = _distance(_rgb(codes), palette).argmin(axis=1).astype(np.uint8)
    return np.asarray(index[which].reshape(picture.shape[:2]))


def _codes(colors: Bytes) -> NDArray[np.uint32]:
    """RGB, shape (..., 3), as one number each."""
    return np.asarray(colors.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32))


def _rgb(codes: NDArray[np.uint32]) -> Bytes:
    return np.stack([codes >> 16, codes >> 8 & 255, codes & 255], axis=-1).astype(np.uint8)


def _distance(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.int64]:
    """Squared distances of colours, shape (n, m)."""
    difference = one[:, np.newaxis].astype(np.int64) - other[np.newaxis].astype(np.int64)
    return np.asarray((difference**2).sum(axis=2))


class _Film:
    """Pictures of a recording at equal steps of time; the map stays where it is.

    Args:
        views: Its intervals, in their order; one at least.
    """

    def __init__(self, views: Sequence[TopView]) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self._views = with_trails(_with_all_robots(views))
        self._bounds = _bounds(self._views)
        self._figure = _figure(self._bounds)
        self._canvas = FigureCanvasAgg(self._figure)
        self._axes = self._figure.axes[0]
        self._stamps_ns = np.array([view.stamp_ns for view in views])
        step_ns = round(1e9 / FRAMES_PER_S)
        spans_s = (int(self._stamps_ns[-1]) - int(self._stamps_ns[0])) / 1e9
        if not 0 <= spans_s <= _MAX_S:
            raise PeopleLocError(
                f"the first interval is of {self._stamps_ns[0] / 1e9:.3f} s, the last one of "
                f"{self._stamps_ns[-1] / 1e9:.3f} s: {spans_s:.0f} s in between; allowed for an "
                f"animation: 0 to {_MAX_S} (did two planners speak, or does a clock jump?)"
            )
        self._times_ns = np.arange(self._stamps_ns[0], self._stamps_ns[-1] + 1, step_ns)
        # What is drawn once: the legend; and text that only changes.
        plots.legend_of_people(self._axes, self._views)
        for view in (self._views[0], self._views[-1]):
            plots.draw_truth(self._axes, view, size=_STAR)
        handles, labels = self._axes.get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        self._figure.legend(
            unique.values(),
            unique,
            loc="lower center",
            ncols=_columns(self._figure.get_figwidth()),
            frameon=False,
            fontsize=9,
            borderaxespad=0.2,
            columnspacing=1.2,
            handletextpad=0.4,
        )
        width, height = self._figure.get_size_inches()
        self._head, self._news = (
            self._figure.text(_LEFT / width, 1.0 - down / height, "", va="top", size=size)
            for down, size in ((0.1, 12.0), (0.34, 10.0))
        )

    def __len__(self) -> int:
        """Number of pictures."""
        return len(self._times_ns)

    def draw(self, number: int) -> Bytes:
        """A picture, RGB, shape (height, width, 3)."""
        time_ns = int(self._times_ns[number])
        # What was known at that time.
        latest = int(np.searchsorted(self._stamps_ns, time_ns, side="right")) - 1
        view, axes = self._views[latest], self._axes
        axes.clear()
        plots.draw_walls(axes, view)
        plots.draw_robots(axes, view)
        plots.draw_truth(axes, view, size=_STAR)
        plots.draw_people(axes, view)
        plots.finish_map(axes, view, self._bounds)
        self._head.set_text(f"{(time_ns - self._stamps_ns[0]) / 1e9:.1f} s   {headline(view)}")
        recent = [
            view for view in self._views[: latest + 1] if time_ns - view.stamp_ns < _EVENT_S * 1e9
        ]
        told = [event for view in recent for event in view.events]
        self._news.set_text("\n".join(told[-_TOLD:]))
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3].copy()


def headline(view: TopView) -> str:
    """How many people there are, and what the largest group does, in a line."""
    count = len(view.people)
    line = f"{count} {'person' if count == 1 else 'people'}"
    if not view.groups:
        return line
    group = view.groups[0]
    if group.id:
        line += f", {'all' if group.size == count else group.size} in group {group.id}"
    if group.velocity is not None:
        speed = float(np.hypot(*group.velocity))
        line += ", standing" if speed < plots.STANDING else f", walking at {speed:.1f} m/s"
    return line


def _with_all_robots(views: Sequence[TopView]) -> list[TopView]:
    """A robot that an interval is without stays where it was, in its colour."""
    robots: dict[str, Pose] = {}
    borders: dict[str, Float] = {}
    for view in reversed(views):
        robots.update(view.robots)
        borders.update(view.views)
    names = sorted(robots)
    result = []
    for view in views:
        robots.update(view.robots)
        borders.update(view.views)
        poses = {name: robots[name] for name in names}
        result.append(dataclasses.replace(view, robots=poses, views=dict(borders)))
    return result


def _bounds(views: Sequence[TopView]) -> tuple[float, float, float, float]:
    """The rectangle in which people and robots are: x from, to, y from, to [m]."""
    poses = [(pose.x, pose.y) for view in views for pose in view.robots.values()]
    places = np.concatenate([np.reshape(poses, (-1, 2)), *(view.positions for view in views)])
    low, high = places.min(axis=0) - _ROOM, places.max(axis=0) + _ROOM
    middle, size = (low + high) / 2.0, high - low
    size = np.maximum(size, _LEAST_SHARE * size.max())
    (left, below), (right, above) = middle - size / 2.0, middle + size / 2.0
    return float(left), float(right), float(below), float(above)


def _figure(bounds: tuple[float, float, float, float]) -> Figure:
    """A figure whose map has the shape of what it shows, and stays where it is."""
    from matplotlib.figure import Figure

    left, right, low, high = bounds
    inch_per_m = _LONG / max(right - left, high - low)
    width, height = inch_per_m * (right - left), inch_per_m * (high - low)
    across = max(width, _LONG / 2.0) + _LEFT + _RIGHT
    below = _AXIS + _ROW * math.ceil(_ENTRIES / _columns(across))
    up = height + below + _ABOVE
    figure = Figure(figsize=(across, up), dpi=_DPI)
    figure.add_axes((_LEFT / across, below / up, 1.0 - (_LEFT + _RIGHT) / across, height / up))
    return figure


def _columns(width: float) -> int:
    """Columns of the legend of a figure that is so wide [inch]."""
    return min(_ENTRIES, int(width / _ENTRY))
