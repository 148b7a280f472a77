"""Where people and robots are at a time: standing, turning, paths, walkers, recorded tracks."""

from __future__ import annotations

import copy
import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import ConfigError

#: Tracks are kept at this interval [s].
STEP_S = 0.02
#: Tracks begin this long before the first frame, so that odometry can start earlier [s].
LEAD_S = 0.5


@dataclass(frozen=True)
class Place:
    """Where somebody is at one instant.

    Attributes:
        x: Position in the map [m]; NaN: not there.
        y: Position in the map [m].
        yaw: Where the body faces [rad].
        speed: Along its way [m/s].
        way: Length of the way so far [m].
    """

    x: float
    y: float
    yaw: float
    speed: float
    way: float


class Track:
    """Positions and headings over time, linear between samples.

    Args:
        start: Time of the first sample [s].
        xy: Positions [m], shape (n, 2), one every `STEP_S`; NaN where somebody is not there.
        yaw: Headings [rad], shape (n,); None: along the way.
        sign: -1 for one who goes backwards.
        free: Whether it may go in any direction, whichever way it looks.
    """

    def __init__(
        self,
        start: float,
        xy: NDArray,
        yaw: NDArray | None = None,
        sign: float = 1.0,
        *,
        free: bool = False,
    ) -> None:
        self.free = free
        self._start = start
        self._xy = np.asarray(xy, dtype=np.float64)
        step = np.linalg.norm(np.diff(self._xy, axis=0), axis=1)
        step = np.concatenate([[0.0], np.nan_to_num(step)])
        self._way = np.cumsum(step) * sign
        speed = np.gradient(self._way, STEP_S) if len(step) > 1 else np.zeros(1)
        self._speed = _smooth(speed, 9)
        if yaw is None:
            yaw = _headings(self._xy)
        self._yaw = np.unwrap(np.asarray(yaw, dtype=np.float64))

    def carried(self, time: float, ahead: float, left: float, turn: float) -> Track:
        """The track of one who is moved at a time [s], and goes on from there in the same way.

        Args:
            time: When [s].
            ahead: How far in the direction that they then look, and from then on [m].
            left: How far to the left of it [m].
            turn: How far turned to the left [rad].
        """
        moved, xy = copy.copy(self), self._xy.copy()
        later = self._start + STEP_S * np.arange(len(xy)) > time
        cos, sin = np.cos(self._yaw[later]), np.sin(self._yaw[later])
        xy[later] += np.stack([cos * ahead - sin * left, sin * ahead + cos * left], axis=1)
        moved._xy, moved._yaw = xy, self._yaw + turn * later
        return moved

    def at(self, time: float) -> Place:
        """Where one is at a time [s]; before the first and after the last sample as there."""
        t = min(max((time - self._start) / STEP_S, 0.0), len(self._xy) - 1.0)
        i = min(int(t), max(len(self._xy) - 2, 0))
        j, f = min(i + 1, len(self._xy) - 1), t - i
        (x, y) = self._xy[i] * (1 - f) + self._xy[j] * f if f > 0 else self._xy[i]
        return Place(
            float(x),
            float(y),
            float(self._yaw[i] * (1 - f) + self._yaw[j] * f),
            float(self._speed[i] * (1 - f) + self._speed[j] * f),
            float(self._way[i] * (1 - f) + self._way[j] * f),
        )


def _smooth(values: NDArray, width: int) -> NDArray:
    if len(values) < width:
        return values
    padded = np.pad(values, width // 2, mode="edge")
    return np.convolve(padded, np.ones(width) / width, mode="valid")


def _headings(xy: NDArray) -> NDArray:
    """Directions of travel, smoothed over half a second; kept while nobody moves."""
    n = len(xy)
    reach = min(12, max(1, (n - 1) // 2))
    later, sooner = np.minimum(np.arange(n) + reach, n - 1), np.maximum(np.arange(n) - reach, 0)
    way = np.nan_to_num(xy[later] - xy[sooner])
    moving = np.linalg.norm(way, axis=1) > 0.01
    yaw = np.unwrap(np.arctan2(way[:, 1], way[:, 0])[moving]) if moving.any() else np.zeros(1)
    return np.interp(np.arange(n), np.flatnonzero(moving), yaw) if moving.any() else np.zeros(n)


def times(duration: float) -> NDArray:
    """Times of a track's samples for a scene of that length [s]."""
    return np.arange(-LEAD_S, duration + LEAD_S + STEP_S, STEP_S)


def standing(
    x: float,
    y: float,
    yaw: float,
    duration: float,
    *,
    turn_rate: float = 0.0,
    sway: float = 0.0,
    phase: float = 0.0,
) -> Track:
    """One who stands, swaying a little, or turns on the spot."""
    t = times(duration)
    swing = sway * np.stack(
        [np.sin(2 * np.pi * 0.23 * t + phase), np.sin(2 * np.pi * 0.31 * t + 2.1 * phase)], axis=1
    )
    heading = yaw + turn_rate * t + 2.0 * sway * np.sin(2 * np.pi * 0.17 * t + phase)
    return Track(-LEAD_S, np.array([x, y]) + swing, heading)


def along(
    path: tuple[float, ...], speed: float, duration: float, *, backwards: bool = False
) -> Track:
    """One who follows a path at constant speed, cutting its corners, and stops at its end."""
    points = np.array(path, dtype=np.float64).reshape(-1, 2)
    dense = rounded(points)
    ways = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    t = times(duration)
    # Comes to a stop within the last half second of way.
    way = np.clip(speed * (t + LEAD_S), 0.0, ways[-1])
    xy = np.stack([np.interp(way, ways, dense[:, k]) for k in (0, 1)], axis=1)
    yaw = None
    if backwards:
        yaw = _headings(xy) + math.pi
    elif speed == 0.0 or ways[-1] == 0.0:
        ahead = dense[-1] - dense[0]
        yaw = np.full(len(t), math.atan2(ahead[1], ahead[0]))
    return Track(-LEAD_S, xy, yaw, -1.0 if backwards else 1.0)


def rounded(points: NDArray, width: int = 41) -> NDArray:
    """The path every 2 cm, its corners rounded over so many samples (odd)."""
    dense = [points[:1]]
    for a, b in itertools.pairwise(points):
        count = max(1, math.ceil(float(np.linalg.norm(b - a)) / 0.02))
        dense.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    path = np.concatenate(dense)
    if len(points) > 2 and len(path) > 60:
        path = np.stack([_smooth(path[:, k], width) for k in (0, 1)], axis=1)
    return path


@dataclass(frozen=True)
class Walker:
    """One who walks on their own.

    Attributes:
        x: Where from [m].
        y: Where from [m].
        speed: Preferred speed [m/s].
        goal: Where to; None: from place to place.
        area: Centre and radius of the circle in which they choose places [m]; None: anywhere.
    """

    x: float
    y: float
    speed: float
    goal: tuple[float, float] | None = None
    area: tuple[float, float, float] | None = None


def walk_about(
    walkers: list[Walker],
    *,
    duration: float,
    bounds: tuple[float, float, float, float],
    obstacles: NDArray,
    others: list[Track],
    rng: np.random.Generator,
) -> list[Track]:
    """Walkers who keep clear of each other, of walls, furniture, people and robots.

    A social force model (Helbing & Molnar 1995): everybody is drawn to their goal and pushed away
    by what is near.

    Args:
        walkers: Who walks.
        duration: Length of the scene [s].
        bounds: Walls: least and greatest x, least and greatest y [m].
        obstacles: Furniture: centre and radius [m], shape (k, 3).
        others: Those whose way is given.
        rng: Source of randomness.
    """
    t = times(duration)
    n = len(walkers)
    low, high = np.array([bounds[0], bounds[2]]), np.array([bounds[1], bounds[3]])
    position = np.array([[w.x, w.y] for w in walkers], dtype=np.float64).reshape(n, 2)
    wish = np.array([w.speed for w in walkers])
    goals = np.array(
        [w.goal if w.goal is not None else _goal(w, low, high, obstacles, rng) for w in walkers]
    ).reshape(n, 2)
    ahead = goals - position
    velocity = (
        ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-6) * wish[:, None]
    )
    ways = np.empty((len(t), n, 2))
    for k, now in enumerate(t):
        ways[k] = position
        ahead = goals - position
        left = np.linalg.norm(ahead, axis=1, keepdims=True)
        desired = ahead / np.maximum(left, 1e-6) * wish[:, None] * np.minimum(1.0, left / 0.5)
        force = (desired - velocity) / 0.5
        force += push(position, position, 0.5, skip_self=True)
        if others:
            there = np.array([[p.x, p.y] for p in (o.at(float(now)) for o in others)])
            there = there[np.isfinite(there).all(axis=1)]
            force += push(position, there, 0.55)
        if len(obstacles):
            force += push(position, obstacles[:, :2], 0.3, radius=obstacles[:, 2])
        for axis in (0, 1):
            force[:, axis] += 6.0 * np.exp(-(position[:, axis] - low[axis] - 0.25) / 0.12)
            force[:, axis] -= 6.0 * np.exp(-(high[axis] - 0.25 - position[:, axis]) / 0.12)
        velocity = velocity + np.clip(force, -6.0, 6.0) * STEP_S
        pace = np.linalg.norm(velocity, axis=1, keepdims=True)
        velocity *= np.minimum(1.0, 1.3 * wish[:, None] / np.maximum(pace, 1e-6))
        position = np.clip(position + velocity * STEP_S, low + 0.25, high - 0.25)
        for i, walker in enumerate(walkers):
            if walker.goal is None and left[i, 0] < 0.6:
                goals[i] = _goal(walker, low, high, obstacles, rng)
    return [Track(-LEAD_S, ways[:, i]) for i in range(n)]


def _goal(
    walker: Walker, low: NDArray, high: NDArray, obstacles: NDArray, rng: np.random.Generator
) -> NDArray:
    """A random place in the room, in the walker's area and away from obstacles, if there is one."""
    for _ in range(100):
        place = rng.uniform(low + 0.7, np.maximum(high - 0.7, low + 0.71))
        if walker.area and math.dist(place, walker.area[:2]) > walker.area[2]:
            continue
        if not len(obstacles):
            return place
        away = np.linalg.norm(obstacles[:, :2] - place, axis=1) - obstacles[:, 2]
        if (away > 0.6).all():
            return place
    return place


def push(
    places: NDArray,
    others: NDArray,
    distance: float,
    *,
    radius: NDArray | float = 0.0,
    skip_self: bool = False,
) -> NDArray:
    """Accelerations away from what is near, shape (n, 2) [m/s^2].

    Args:
        places: Of those that are pushed [m], shape (n, 2).
        others: Of those that push [m], shape (k, 2).
        distance: Where it is 5 m/s^2 [m].
        radius: Of what pushes [m], shape (k,).
        skip_self: `others` is `places`, and nobody pushes themselves.
    """
    if not len(others):
        return np.zeros_like(places)
    away = places[:, None] - others[None]
    gap = np.linalg.norm(away, axis=2)
    strength = 5.0 * np.exp(-(gap - distance - radius) / 0.15)
    if skip_self:
        np.fill_diagonal(strength, 0.0)
    return (strength[..., None] * away / np.maximum(gap, 1e-3)[..., None]).sum(axis=1)


def read_tracks(
    path: str | Path,
    window: tuple[float, ...],
    duration: float,
    size: tuple[float, float] = (math.inf, math.inf),
) -> dict[int, Track]:
    """Recorded pedestrians, by id: `obsmat.txt` of the UCY and ETH sets, positions in metres.

    Columns 0, 1, 2 and 4 are used: frame, id, x and y; 0.4 s between rows of one pedestrian.

    Args:
        path: The file.
        window: First and last time [s] of the recording, and the x, y that become the map's
            origin [m]; empty: from its beginning, as it is.
        duration: Length of the scene [s].
        size: Length and width of the room [m]; who is out of it is not there.

    Raises:
        ConfigError: The file cannot be read, or nobody is there in that time.
    """
    try:
        rows = np.loadtxt(path, ndmin=2)
        if not np.isfinite(rows[:, (0, 1, 2, 4)]).all():
            raise ValueError("it holds NaN or infinite values")
        frames, ids, xy = rows[:, 0], rows[:, 1].astype(int), rows[:, (2, 4)]
    except (OSError, ValueError, IndexError) as err:
        raise ConfigError(f"{path}: no obsmat.txt of a pedestrian data set: {err}") from err
    # Some recordings are sorted by pedestrian, some by frame.
    order = np.lexsort((frames, ids))
    frames, ids, xy = frames[order], ids[order], xy[order]
    same = np.diff(ids) == 0
    if not same.any():
        raise ConfigError(f"{path}: no obsmat.txt of a pedestrian data set: each id has one row")
    step = float(np.median(np.diff(frames)[same]))
    if step <= 0:
        raise ConfigError(f"{path}: no obsmat.txt of a pedestrian data set: frames repeat")
    at = (frames - frames.min()) / step * 0.4
    first, last, x0, y0 = window or (0.0, math.inf, 0.0, 0.0)
    t = times(duration)
    tracks = {}
    for one in np.unique(ids):
        mine = ids == one
        when, where = at[mine] - first, xy[mine] - (x0, y0)
        if len(when) < 3 or when[0] > min(duration, last - first) or when[-1] < 0:
            continue
        way = np.stack([np.interp(t, when, where[:, k]) for k in (0, 1)], axis=1)
        way = np.stack([_smooth(way[:, k], 21) for k in (0, 1)], axis=1)
        inside = (way > 0.25).all(axis=1) & (way < np.array(size) - 0.25).all(axis=1)
        way[(t < when[0]) | (t > when[-1]) | ~(inside | np.isinf(size[0]))] = np.nan
        if np.isfinite(way).any():
            tracks[int(one)] = Track(-LEAD_S, way)
    if not tracks:
        raise ConfigError(f"{path}: nobody is there from {first:g} s on for {duration:g} s")
    return tracks


def read_groups(path: str | Path) -> dict[int, int]:
    """Groups of people: `groups.txt` beside a recording of `read_tracks`.

    Each line holds the ids of one group; who is in no line, or alone in one, is in no group.

    Args:
        path: The recording; without a `groups.txt` beside it nobody is in a group.

    Returns:
        Numbers of groups from 1 on, by id of the pedestrian.

    Raises:
        ConfigError: The file cannot be read.
    """
    file = Path(path).with_name("groups.txt")
    if not file.is_file():
        return {}
    try:
        lines = [[int(word) for word in line.split()] for line in file.read_text().splitlines()]
    except (OSError, ValueError) as err:
        raise ConfigError(f"{file}: no groups.txt of a pedestrian data set: {err}") from err
    groups = [ids for ids in lines if len(ids) > 1]
    return {one: number for number, ids in enumerate(groups, 1) for one in ids}


def positions(places: list[Place]) -> Float:
    """Positions as an array, shape (n, 2)."""
    return np.array([[p.x, p.y] for p in places]).reshape(-1, 2)
