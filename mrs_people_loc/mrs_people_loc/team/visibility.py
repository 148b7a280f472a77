"""Where robots see people: within the ranges at which they have detected some, and unhidden."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.team.masking import Walls
from mrs_people_loc.team.occlusion import (
    PERSON_RADIUS,
    ROBOT_RADIUS,
    hidden_by_people,
    hidden_by_robots,
)
from mrs_people_loc.team.poses import Pose, places_of

#: Bearings around a robot are told apart by this [rad].
_STEP = np.radians(5.0)
_BEARINGS = round(2.0 * np.pi / _STEP)
#: People of whom more than this share is hidden may be missed.
_HIDDEN = 0.25
#: Lines of sight are looked at for walls at so many places [m].
_RAY_STEP = 0.08


class FieldsOfView:
    """What each robot has in view, learned from where it has detected people.

    The planner does not know the heads, and what a head should see is not what the whole chain
    detects.
    """

    def __init__(self) -> None:
        #: Which row each robot has below; by row and bearing, the least and the greatest distance
        #: of a detection [m].
        self._row: dict[str, int] = {}
        self._least = np.empty((0, _BEARINGS))
        self._greatest = np.empty((0, _BEARINGS))

    def learn(self, robots: Sequence[str], xy: Float, poses: Mapping[str, Pose]) -> None:
        """Takes detections of people.

        Args:
            robots: Which robot has made each.
            xy: Where, on the map [m], shape (n, 2).
            poses: By robot, its pose.
        """
        row = np.array([self._row.setdefault(name, len(self._row)) for name in robots], np.intp)
        if more := len(self._row) - len(self._least):
            self._least = np.concatenate([self._least, np.full((more, _BEARINGS), np.inf)])
            self._greatest = np.concatenate([self._greatest, np.zeros((more, _BEARINGS))])
        bearing, away = _seen_from(xy, _numbers(poses[name] for name in robots))
        np.minimum.at(self._least, (row, bearing), away)
        np.maximum.at(self._greatest, (row, bearing), away)

    def farthest(self, robot: str) -> float:
        """The distance of a robot's farthest detection [m]; 0 before the first."""
        return float(self._greatest[self._row[robot]].max()) if robot in self._row else 0.0

    def are_seen(
        self,
        xy: Float,
        people: Float,
        own: Int,
        *,
        looking: Mapping[str, Pose],
        robots: Mapping[str, Pose],
        walls: Walls | None = None,
    ) -> Bool:
        """Whether a robot would have a person in plain view, if they were at a place.

        Args:
            xy: The places, on the map [m], shape (k, 2).
            people: Where everybody is, who hide each other, shape (n, 2) [m].
            own: Who of these people would be there, shape (k,).
            looking: By robot whose scan there is, its pose.
            robots: Likewise of all robots, who hide people, too.
            walls: What else hides people, where it is known. Low furniture counts, too: a map does
                not tell how high it is.

        Returns:
            Shape (k,).
        """
        seen = np.zeros(len(xy), dtype=bool)
        mates = places_of(robots.values())
        known = [name for name in looking if name in self._row]
        row = np.array([self._row[name] for name in known], dtype=np.intp)[:, np.newaxis]
        at = _numbers(looking[name] for name in known)
        bearing, away = _seen_from(xy, at[:, np.newaxis])
        in_range = (away >= self._least[row, bearing]) & (away <= self._greatest[row, bearing])
        # Bodies at the edge of what a head sees are cut, and often missed: there have to be
        # detections on both sides, too.
        for aside in (bearing - 1, (bearing + 1) % _BEARINGS):
            in_range &= np.isfinite(self._least[row, aside])
        for k in np.flatnonzero(in_range.any(axis=1)).tolist():
            rows = np.flatnonzero(in_range[k] & ~seen)
            if not len(rows):
                continue
            place = at[k : k + 1, :2]
            by_people = hidden_by_people(place, xy[rows], people, own[rows])[0]
            by_robots = hidden_by_robots(place, xy[rows], mates)[0].max(axis=0, initial=0.0)
            rows = rows[np.maximum(by_people, by_robots) <= _HIDDEN]
            if walls is not None:
                rows = rows[~_behind_walls(place, xy[rows], walls)]
            seen[rows] = True
        return seen


def _behind_walls(place: Float, xy: Float, walls: Walls) -> Bool:
    """Whether walls or furniture are on the line from a place, shape (1, 2), to others.

    Args:
        place: Where a robot looks from [m], shape (1, 2).
        xy: Where people would be [m], shape (k, 2).
        walls: Walls and furniture.

    Returns:
        Shape (k,).
    """
    off = xy - place
    away = np.hypot(off[:, 0], off[:, 1])
    # Whoever stands at a wall is not behind it.
    last = away - PERSON_RADIUS
    steps = np.arange(ROBOT_RADIUS, last.max(initial=0.0), _RAY_STEP)[:, np.newaxis]
    line = place + steps[..., np.newaxis] * (off / np.maximum(away, 1e-9)[:, np.newaxis])
    return np.asarray(((walls.distance(line) <= 0.5 * _RAY_STEP) & (steps < last)).any(axis=0))


def _numbers(poses: Iterable[Pose]) -> Float:
    """The numbers x, y [m] and yaw [rad] of poses, shape (n, 3)."""
    return np.array([(pose.x, pose.y, pose.yaw) for pose in poses]).reshape(-1, 3)


def _seen_from(xy: Float, poses: Float) -> tuple[Int, Float]:
    """Bearings, as indices, and distances [m] of places from poses, shapes (..., 2), (..., 3)."""
    dx, dy = xy[..., 0] - poses[..., 0], xy[..., 1] - poses[..., 1]
    bearing = (np.arctan2(dy, dx) - poses[..., 2]) % (2.0 * np.pi)
    return (bearing / _STEP).astype(np.intp) % _BEARINGS, np.asarray(np.hypot(dx, dy))
