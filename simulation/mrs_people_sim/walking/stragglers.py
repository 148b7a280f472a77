"""People who stop on the way to look at something and stay behind, or who leave."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_sim.walking.crowd_ground import Clearance

#: A straggler goes on when a robot has been so near [m] for so long [s]; not while they still walk
#: to what they look at, for so long [s].
_NEAR, _NEAR_S, _SETTLES_S = 1.5, 2.0, 2.0
#: They look at something from so far [m], which is no farther off their way than this [m].
_LOOKS_FROM, _ASIDE = 0.45, 0.6


@dataclass(frozen=True)
class Straggling:
    """Somebody stops to look at something, and stays behind; or leaves.

    Attributes:
        person: Who.
        after: Once they have walked so far [m].
        stays: For so long [s], or until they are fetched.
        leaves: They walk back instead to where the tour began, whatever robots do, and stay there.
    """

    person: int
    after: float
    stays: float = 40.0
    leaves: bool = False


@dataclass(frozen=True)
class Stay:
    """A straggler's stay.

    Attributes:
        person: Who.
        begin_s: When they stopped [s].
        end_s: When they went on [s]; inf: not yet.
        fetched: Whether a robot made them go on.
    """

    person: int
    begin_s: float
    end_s: float
    fetched: bool


class Stragglers:
    """Who of a crowd stays behind, and until when.

    Args:
        given: Who stops where.
        clearance: Walls and furniture: what people look at.
    """

    def __init__(self, given: Sequence[Straggling], clearance: Clearance) -> None:
        self._given, self._clearance = given, clearance
        self._people = np.array([one.person for one in given], dtype=np.intp)
        self._leaves = np.array([one.leaves for one in given], dtype=bool)
        self._begin = np.full(len(given), math.inf)
        self._end = np.full(len(given), math.inf)
        self._near_s = np.zeros(len(given))
        self._spots = np.zeros((len(given), 2))
        self._fetched = np.zeros(len(given), dtype=bool)

    @property
    def who(self) -> Int:
        """Who stands and looks at something now, shape (k,)."""
        return self._people[self._now & ~self._leaves]

    @property
    def leaving(self) -> Int:
        """Who has left, shape (k,)."""
        return self._people[self._now & self._leaves]

    @property
    def spots(self) -> Float:
        """Where those stand who look at something [m], shape (k, 2)."""
        return self._spots[self._now & ~self._leaves]

    @property
    def _now(self) -> Bool:
        return np.isfinite(self._begin) & np.isinf(self._end)

    @property
    def stays(self) -> list[Stay]:
        """The stays that have begun; of nobody who leaves."""
        columns = zip(self._given, self._begin, self._end, self._fetched, strict=True)
        return [
            Stay(one.person, float(begin), float(end), bool(fetched))
            for one, begin, end, fetched in columns
            if math.isfinite(begin) and not one.leaves
        ]

    def step(self, time: float, dt: float, xy: Float, walked: Float, robots: Float) -> Int:
        """Who stops, and who goes on.

        Args:
            time: Now [s].
            dt: Since the last step [s].
            xy: Where people are [m], shape (n, 2).
            walked: How far they have walked [m], shape (n,).
            robots: Where they are [m], shape (m, 2).

        Returns:
            Who goes on now, shape (k,).
        """
        go_on = []
        for k, one in enumerate(self._given):
            place = xy[one.person]
            if math.isinf(self._begin[k]) and walked[one.person] >= one.after:
                self._begin[k], self._spots[k] = time, self._exhibit(place)
            if one.leaves or math.isinf(self._begin[k]) or math.isfinite(self._end[k]):
                continue
            stays_s = time - self._begin[k]
            near = len(robots) > 0 and np.hypot(*(robots - place).T).min() < _NEAR
            self._near_s[k] = self._near_s[k] + dt if near and stays_s > _SETTLES_S else 0.0
            self._fetched[k] = self._near_s[k] >= _NEAR_S
            if self._fetched[k] or stays_s >= one.stays:
                self._end[k] = time
                go_on.append(one.person)
        return np.array(go_on, dtype=np.intp)

    def _exhibit(self, place: Float) -> Float:
        """Where somebody stands to look at something beside their way [m], shape (2,)."""
        distance, out = self._clearance.at(place[None])
        return np.asarray(place - out[0] * np.clip(distance[0] - _LOOKS_FROM, 0.0, _ASIDE))
