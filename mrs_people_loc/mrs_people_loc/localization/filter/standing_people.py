"""People who stand as landmarks: which of them a robot sees, while nobody else sees the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.geometry import rotation_2d, squared_mahalanobis
from mrs_people_loc.localization.filter.kalman import corrected, noted
from mrs_people_loc.localization.filter.observations import PeopleStand, pose_from
from mrs_people_loc.localization.filter.team_state import Standing, TeamState, changed


@dataclass(frozen=True)
class StandingTuning:
    """Constants, chosen by hand.

    Attributes:
        most: So many people are kept; the one unseen for longest is dropped ...
        unseen_s: ... and who was not seen for so long [s].
        sway: Standard deviation that a second adds to a place; it grows with the root of time [m].
        apart: Of several people who fit, one is taken if their squared Mahalanobis length is less
            by this.
        new_from: Who is within this squared Mahalanobis length of somebody is nobody new.
    """

    most: int = 16
    unseen_s: float = 60.0
    sway: float = 0.02
    apart: float = 9.0
    new_from: float = 30.0


_TUNING = StandingTuning()


class StandingLandmarks:
    """Recognizes people who stand, corrects the state by them, and adds new ones.

    Args:
        gates: Largest squared Mahalanobis length by degrees of freedom.
        tuning: Constants.
    """

    def __init__(self, gates: Mapping[int, float], tuning: StandingTuning = _TUNING) -> None:
        self.gates = gates
        self.tuning = tuning

    def take(self, state: TeamState, seen: PeopleStand) -> TeamState:
        """The state after a sight."""
        stamp_ns = seen.odometry.stamp_ns
        state = self._swayed(state, stamp_ns)
        new = []
        for xy, covariance in zip(seen.xy, seen.covariance, strict=True):
            squared = self._squared(state, seen.robot, xy, covariance)
            order = np.argsort(squared)
            if not len(order) or squared[order[0]] > self.tuning.new_from:
                new.append((xy, covariance))
            elif squared[order[0]] <= self.gates[2] and (
                len(order) == 1 or squared[order[1]] > squared[order[0]] + self.tuning.apart
            ):
                state = self._recognized(state, seen, int(order[0]), xy, covariance)
        for xy, covariance in new:
            state = self._added(state, seen, xy, covariance)
        return state

    def _swayed(self, state: TeamState, stamp_ns: int) -> TeamState:
        """The state at a time [ns], without those who were not seen for long."""
        oldest_ns = stamp_ns - round(1e9 * self.tuning.unseen_s)
        for index in reversed(range(len(state.people))):
            if state.people[index].seen_ns < oldest_ns:
                state = state.without_person(index)
        seconds = max(stamp_ns - state.people_ns, 0) / 1e9
        places = range(state.person_at(0), state.wall_at(0))
        covariance = state.covariance.copy()
        covariance[places, places] += self.tuning.sway**2 * seconds
        return changed(state, covariance=covariance, people_ns=max(stamp_ns, state.people_ns))

    def _squared(self, state: TeamState, robot: str, xy: Float, covariance: Float) -> Float:
        """Squared Mahalanobis length of the difference from each person, shape (n,)."""
        count, i, first = len(state.people), state.at(robot), state.person_at(0)
        places = state.mean[first : first + 2 * count].reshape(-1, 2)
        pose, rotation = state.mean[i : i + 3], rotation_2d(float(state.mean[i + 2]))
        offset = places - pose[:2]
        at = np.arange(first, first + 2 * count).reshape(-1, 2)
        columns = np.concatenate([np.tile(np.arange(i, i + 3), (count, 1)), at], axis=1)
        joint = state.covariance[columns[:, :, np.newaxis], columns[:, np.newaxis]]
        jacobian = np.zeros((count, 2, 5))
        jacobian[:, :, :2], jacobian[:, :, 3:] = -rotation.T, rotation.T
        jacobian[:, :, 2] = np.stack([offset[:, 1], -offset[:, 0]], axis=1) @ rotation
        total = jacobian @ joint @ jacobian.transpose(0, 2, 1) + covariance
        return squared_mahalanobis(xy - offset @ rotation, total)

    def _recognized(
        self, state: TeamState, seen: PeopleStand, index: int, xy: Float, covariance: Float
    ) -> TeamState:
        columns = self._columns(state, seen.robot, index)

        def model(part: Float) -> tuple[Float, Float]:
            predicted, by_robot, by_other = pose_from(part[:3], np.array([*part[3:], 0.0]))
            return xy - predicted[:2], np.hstack([by_robot[:2], by_other[:2, :2]])

        stamp_ns = seen.odometry.stamp_ns
        state, found = corrected(state, columns, model, covariance, seen.inflated)
        person = changed(state.people[index], seen_ns=stamp_ns)
        people = (*state.people[:index], person, *state.people[index + 1 :])
        state = changed(state, people=people)
        return noted(state, seen.robot, "standing people", True, found, stamp_ns)

    def _columns(self, state: TeamState, robot: str, index: int) -> Int:
        """Indices of a robot's pose and of a person, shape (5,)."""
        i, p = state.at(robot), state.person_at(index)
        return np.array([i, i + 1, i + 2, p, p + 1])

    def _added(
        self, state: TeamState, seen: PeopleStand, xy: Float, covariance: Float
    ) -> TeamState:
        if len(state.people) >= self.tuning.most:
            oldest = min(range(len(state.people)), key=lambda k: state.people[k].seen_ns)
            state = state.without_person(oldest)
        i = state.at(seen.robot)
        rotation = rotation_2d(float(state.mean[i + 2]))
        dx, dy = rotation @ xy
        by_pose = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx]])
        across = by_pose @ state.covariance[i : i + 3]
        own = across[:, i : i + 3] @ by_pose.T + rotation @ covariance @ rotation.T
        person = Standing(seen.robot, seen.odometry.stamp_ns)
        return state.with_person(person, state.mean[i : i + 2] + (dx, dy), across, own)
