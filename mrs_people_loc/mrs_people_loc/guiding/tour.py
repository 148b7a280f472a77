"""Tours: a way with stops, and its YAML file.

For example::

    name: hall
    points: [[0.0, 0.0], [12.0, 0.0], [12.0, 8.0]]   # the way, in the frame `map` [m]
    stops:                                           # in the order of the way
      - {name: Foyer, at: [12.0, 0.5], wait: 10.0}   # [m], [s]
    speed: 0.5                                       # highest speed of the leader [m/s]

`name`, `stops` and `speed` may be left out, as may be a stop's `wait`.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import ConfigError, TourError
from mrs_people_loc.guiding.way import Way

if TYPE_CHECKING:  # a planner, which reads no tours, is there sooner without its libraries
    from mrs_people_loc.guiding.free_space import FreeSpace


@dataclass(frozen=True)
class TourLimits:
    """What a tour may be; chosen far beyond those that people walk.

    Attributes:
        shortest: Shortest way [m].
        longest: Longest way [m].
        points: Most points of a way.
        stops: Most stops.
        farthest: Greatest coordinate [m].
        beside: A stop is no farther from the way than this [m].
        wait_s: Longest waiting time [s].
        step: A way is checked every so often [m].
    """

    shortest: float = 1.0
    longest: float = 5_000.0
    points: int = 1_000
    stops: int = 200
    farthest: float = 1e6
    beside: float = 2.0
    wait_s: float = 3600.0
    step: float = 0.05


LIMITS = TourLimits()
_KEYS = ("name", "frame", "points", "stops", "speed")
_STOP_KEYS = ("name", "at", "wait")


@dataclass(frozen=True)
class Stop:
    """A place on the way where the group stays for a while.

    Attributes:
        name: Its name.
        xy: Where it is, on the way or beside it [m], shape (2,).
        way_m: How far along the way it is [m].
        wait_s: How long the group stays once everybody is there [s].
    """

    name: str
    xy: Float
    way_m: float
    wait_s: float


@dataclass(frozen=True)
class Tour:
    """A way with stops.

    Attributes:
        name: Its name.
        points: Of the way, as they were given [m], shape (n, 2).
        way: The way through these points.
        stops: In the order of the way.
        speed: Highest speed of the leader [m/s]; None: as in the parameters.
        frame: The frame of `points` and `stops`.
    """

    name: str
    points: Float
    way: Way
    stops: tuple[Stop, ...] = ()
    speed: float | None = None
    frame: str = "map"


def read_tour(path: str | Path) -> Tour:
    """Reads the file of a tour, see the module's docstring.

    Raises:
        TourError: It cannot be read, or holds something else; names the file and what is wrong.
    """
    path = Path(path).expanduser()
    try:
        return tour_of(cfg.load_yaml(path), path.stem)
    except ConfigError as err:
        raise TourError(str(err)) from err
    except TourError as err:
        raise TourError(f"{path}: {err}") from err


def tour_from(
    points: ArrayLike,
    stops: Iterable[tuple[str, ArrayLike, float]] = (),
    *,
    name: str = "",
    speed: float | None = None,
    frame: str = "map",
) -> Tour:
    """A tour along a polyline.

    Args:
        points: Of the way [m], shape (n, 2).
        stops: Name, place [m] and waiting time [s] of each, in the order of the way.
        name: Of the tour.
        speed: Highest speed of the leader [m/s]; None: as in the parameters.
        frame: The frame of the points and places.

    Raises:
        TourError: Naming what cannot be used, what it is and what is allowed.
    """
    given = np.asarray(points, dtype=np.float64)
    if given.shape == (1, 2):
        raise TourError("a tour needs at least two points; this one has one")
    if given.ndim != 2 or given.shape[1:] != (2,) or not 2 <= len(given) <= LIMITS.points:
        raise TourError(
            f"points have the shape {given.shape}; wanted: (n, 2), n from 2 to {LIMITS.points}"
        )
    if not (np.abs(given) <= LIMITS.farthest).all():  # NaN compares false
        raise TourError(f"points hold NaN or too large values; wanted: up to {LIMITS.farthest:g} m")
    length_m = float(np.linalg.norm(np.diff(given, axis=0), axis=1).sum())
    if not LIMITS.shortest <= length_m <= LIMITS.longest:
        raise TourError(
            f"the way is {length_m:.2f} m long; "
            f"allowed: {LIMITS.shortest:g} to {LIMITS.longest:g} m"
        )
    try:
        speed = None if speed is None else cfg.Pace(speed=speed).speed
    except ConfigError as err:
        raise TourError(str(err).removeprefix("Pace: ")) from err
    way = Way(given)
    return Tour(name, given, way, _stops(way, stops), speed, frame)


def check_tour(tour: Tour, space: FreeSpace, radius: float) -> None:
    """Checks that robots may drive along a tour.

    Args:
        tour: The tour.
        space: Where robots may drive.
        radius: Smallest distance of a robot's centre from walls and furniture [m].

    Raises:
        TourError: The way passes nearer to a wall; names the place.
    """
    along = np.arange(0.0, tour.way.length, LIMITS.step)
    places = tour.way.at(along)
    clearance = space.clearance(places)
    near = np.flatnonzero(clearance < radius)
    if not len(near):
        return
    worst = near[np.argmin(clearance[near])]
    at = f"at {_place(places[worst])}, {along[worst]:.1f} m along it"
    if clearance[worst] <= 0.0:
        raise TourError(f"the way passes through a wall {at}, or leaves the map")
    raise TourError(
        f"the way passes a wall at a distance of {clearance[worst]:.2f} m {at}; "
        f"allowed: at least {radius:g} m"
    )


def narrowest(tour: Tour, space: FreeSpace) -> float:
    """The least distance of a tour's way from walls and furniture [m]."""
    along = np.arange(0.0, tour.way.length, LIMITS.step)
    return float(space.clearance(tour.way.at(along)).min())


def _stops(way: Way, stops: Iterable[tuple[str, ArrayLike, float]]) -> tuple[Stop, ...]:
    """Stops at the nearest place of the way that is not before the former stop."""
    along = np.append(np.arange(0.0, way.length, LIMITS.step), way.length)
    places = way.at(along)
    found: list[Stop] = []
    for name, at, wait_s in stops:
        what = f"stop {name!r}" if name else f"stop {len(found) + 1}"
        xy = np.asarray(at, dtype=np.float64)
        if xy.shape != (2,) or not np.isfinite(xy).all():
            raise TourError(f"{what} is at {np.asarray(at).tolist()}; wanted: x, y [m]")
        if not 0.0 <= wait_s <= LIMITS.wait_s:
            raise TourError(f"{what} waits for {wait_s:g} s; allowed: 0 to {LIMITS.wait_s:g} s")
        away = np.hypot(*(places - xy).T)
        nearest = float(away.min())
        if nearest > LIMITS.beside:
            raise TourError(f"{what} is {nearest:.1f} m from the way; allowed: {LIMITS.beside:g} m")
        away[along < (found[-1].way_m if found else 0.0)] = np.inf
        if away.min() > max(LIMITS.beside, nearest):
            raise TourError(
                f"{what} is before stop {found[-1].name!r} on the way; "
                "wanted: stops in the order of the way"
            )
        found.append(Stop(name, xy, float(along[away.argmin()]), float(wait_s)))
        if len(found) > LIMITS.stops:
            raise TourError(f"there are more stops than allowed: {LIMITS.stops}")
    return tuple(found)


def tour_of(document: Any, name: str) -> Tour:
    """A tour from what its file holds.

    Args:
        document: The file's content, see the module's docstring.
        name: Of the tour, where the file gives none.

    Raises:
        TourError: It holds something else; names what is wrong.
    """
    if document is None:
        raise TourError(f"the file is empty; wanted: a mapping with {', '.join(_KEYS)}")
    values = _mapping(document, "a tour", _KEYS, wanted=("points",))
    stops = values.get("stops") or ()
    if not isinstance(stops, Sequence) or isinstance(stops, str):
        raise TourError("stops: wanted: a list")
    made = []
    for number, one in enumerate(stops, start=1):
        stop = _mapping(one, f"stop {number}", _STOP_KEYS, wanted=("name", "at"))
        what = f"stop {stop['name']!r}"
        at = _numbers([stop["at"]], f"{what}: at")[0]
        made.append((str(stop["name"]), at, _number(stop.get("wait", 0.0), f"{what}: wait")))
    speed = values.get("speed")
    return tour_from(
        _numbers(values["points"], "points"),
        made,
        name=str(values.get("name", name)),
        speed=None if speed is None else _number(speed, "speed"),
        frame=str(values.get("frame", "map")),
    )


def _mapping(
    given: Any, what: str, known: Sequence[str], *, wanted: Sequence[str]
) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise TourError(f"{what} is {_shown(given)}; wanted: a mapping with {', '.join(known)}")
    unknown = [str(key) for key in given if key not in known]
    if unknown:
        raise TourError(f"{what} has the unknown key {unknown[0]!r}; known: {', '.join(known)}")
    for key in wanted:
        if key not in given:
            raise TourError(f"{what} has no {key!r}; wanted: {', '.join(wanted)}")
    return given


def _numbers(given: Any, what: str) -> Float:
    """Places from a list of lists of two numbers [m], shape (n, 2)."""
    pairs = given if isinstance(given, list) else []
    if not pairs or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        raise TourError(f"{what}: {_shown(given)}; wanted: x, y in brackets [m]")
    return np.array([[_number(value, what) for value in pair] for pair in pairs])


def _number(given: Any, what: str) -> float:
    number = math.nan
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        with contextlib.suppress(OverflowError):  # a whole number that no float holds
            number = float(given)
    if not math.isfinite(number):
        raise TourError(f"{what} is {_shown(given)}; wanted: a finite number")
    return number


def _shown(given: Any) -> str:
    try:
        return f"{given!r:.60}"
    except ValueError:  # a whole number of more digits than Python writes
        return f"a {type(given).__name__}"


def _place(xy: Float) -> str:
    return f"({xy[0]:.2f}, {xy[1]:.2f})"
