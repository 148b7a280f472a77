"""Observations in the order of their stamps, however late they come."""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field

from mrs_people_loc.localization.filter.observations import (
    Claimed,
    Joined,
    Left,
    Met,
    Observation,
    Placed,
    Reached,
    WallsSeen,
)
from mrs_people_loc.localization.filter.team_filter import TeamFilter
from mrs_people_loc.localization.filter.team_state import TeamState

#: At one stamp, in this order.
_ORDER = (Joined, Reached, Placed, WallsSeen, Met, Claimed, Left)
_Key = tuple[int, int, str, str, int]


def _key(observation: Observation) -> _Key:
    other, other_ns = "", 0
    if isinstance(observation, Met):
        other, other_ns = observation.other, observation.other_odometry.stamp_ns
    rank = _ORDER.index(type(observation))
    return observation.odometry.stamp_ns, rank, observation.robot, other, other_ns


@dataclass
class History:
    """The last observations with the state after each.

    A late observation is put in its place and those after it are applied again, so that the state
    is that of observations in order.

    Attributes:
        filter: Applies them.
        span_ns: Observations older than the newest by more are not taken [ns].
    """

    filter: TeamFilter
    span_ns: int = 3_000_000_000
    _first: TeamState = field(default_factory=TeamState)
    _keys: list[_Key] = field(default_factory=list)
    _observations: list[Observation] = field(default_factory=list)
    _states: list[TeamState] = field(default_factory=list)  # after each; some may be missing
    _begin_ns: int = 0

    @property
    def newest(self) -> TeamState:
        """The state after all observations."""
        self._settle()
        return self._states[-1] if self._states else self._first

    def until(self, stamp_ns: int) -> TeamState:
        """The state after the observations up to a time, or the oldest that is there."""
        self._settle()
        index = bisect.bisect_right(self._keys, (stamp_ns, len(_ORDER), "", "", 0))
        return self._states[index - 1] if index else self._first

    def add(self, observation: Observation) -> bool:
        """Takes an observation; False: it is too old, or it is there already."""
        key = _key(observation)
        if key[0] < self._begin_ns:
            return False
        index = bisect.bisect_left(self._keys, key)
        if index < len(self._keys) and self._keys[index] == key:
            return False
        self._keys.insert(index, key)
        self._observations.insert(index, observation)
        del self._states[index:]
        # Rarely, and many at once: removing the first of a list moves all others.
        if self._keys[-1][0] - self._begin_ns > 1.5 * self.span_ns:
            self._forget(self._keys[-1][0] - self.span_ns)
        return True

    def _settle(self) -> None:
        """Applies what was not yet applied."""
        states = self._states
        state = states[-1] if states else self._first
        for observation in self._observations[len(states) :]:
            state = self.filter.apply(state, observation)
            states.append(state)

    def _forget(self, begin_ns: int) -> None:
        self._settle()
        index = bisect.bisect_left(self._keys, (begin_ns, -1, "", "", 0))
        if index:
            self._first = self._states[index - 1]
            del self._keys[:index], self._observations[:index], self._states[:index]
        self._begin_ns = begin_ns
