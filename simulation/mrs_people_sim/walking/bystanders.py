"""People on a guided tour who are not of the group: where they want to go."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mrs_people_loc.arrays import Bool, Float
from mrs_people_sim.scene import Bystander
from mrs_people_sim.walking.walks import shortened

#: A point of a path is reached within this distance [m]; who comes to the last one slows down
#: within this time [s].
_REACHED, _SLOWS_S = 0.5, 0.8


class Bystanders:
    """Where bystanders want to go.

    Args:
        given: Who is there.

    Attributes:
        start: Where they are at first [m], shape (n, 2).
        ignores: Who walks as if there were no robots, shape (n,).
        speed: [m/s], shape (n,).
    """

    def __init__(self, given: Sequence[Bystander] = ()) -> None:
        self._paths = [np.array(one.path, dtype=np.float64).reshape(-1, 2) for one in given]
        self._near = np.array([one.near or math.inf for one in given])
        self._waits = np.array([one.waits for one in given])
        self._out_s = np.full(len(given), math.inf)
        self._next = np.ones(len(given), dtype=np.intp)
        self.start: Float = np.array([path[0] for path in self._paths]).reshape(-1, 2)
        self.ignores: Bool = np.array([one.ignores for one in given], dtype=bool)
        self.speed: Float = np.array([one.speed for one in given])

    def step(self, time: float, xy: Float, leader: Float | None) -> Float:
        """Velocities that they would like to have [m/s], shape (n, 2).

        Args:
            time: Now [s].
            xy: Where they are [m], shape (n, 2).
            leader: Where the leading robot is [m], shape (2,); None: none leads.
        """
        away = math.inf if leader is None else np.linalg.norm(xy - leader, axis=1)
        due = (away <= self._near) & np.isinf(self._out_s)
        self._out_s[due] = time + self._waits[due]
        targets = np.array(xy)
        for one in np.flatnonzero(time >= self._out_s):
            path = self._paths[one]
            last = len(path) - 1
            if self._next[one] < last and math.dist(path[self._next[one]], xy[one]) < _REACHED:
                self._next[one] += 1
            targets[one] = path[min(self._next[one], last)]
        to_go = (targets - xy) / _SLOWS_S
        return np.asarray(shortened(to_go, self.speed[:, np.newaxis]))
