"""People who stand as landmarks: which of them a robot sees, while nobody else sees the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import margins, rotation_2d, squared_mahalanobis
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
        outline: Standard deviation of the middle of a person's visible outline [m].
    """

    most: int = 16
    unseen_s: float = 300.0
    sway: float = 0.02
    apart: float = 9.0
    new_from: float = 30.0
    outline: float = 0.1


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
        """The state after a sight: first those are recognized who are the surest."""
        state = self._swayed(state, seen.odometry.stamp_ns)
        # Those of one sight err by what a single one does, however long it lasts.
        single = seen.covariance / seen.inflated + self.tuning.outline**2 * np.eye(2)
        sights, people = list(range(len(seen.xy))), list(range(len(state.people)))
        squared = np.full((len(sights), 0), np.inf)
        while sights and people:
            squared, surprise = self._compared(state, seen, single, sights, people)
            margin = np.where(squared <= self.gates[2], margins(surprise), -np.inf)
            row, column = divmod(int(margin.argmax()), len(people))
            if margin[row, column] <= self.tuning.apart:
                break
            k, j = sights.pop(row), people.pop(column)
            state = self._recognized(state, seen, j, seen.xy[k], seen.covariance[k])
        for row, k in enumerate(sights):
            if not people or (squared[row] > self.tuning.new_from).all():
                state = self._added(state, seen, seen.xy[k], seen.covariance[k])
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

    def _compared(
        self, state: TeamState, seen: PeopleStand, single: Float, sights: list[int],
        people: list[int],
    ) -> tuple[Float, Float]:  # fmt: skip
        """Squared Mahalanobis lengths of differences, and -2 times their log likelihoods.

        Args:
            state: The state.
            seen: The sights.
            single: What each errs by at one time, shape (n, 2, 2).
            sights: Which of them.
            people: Which people of the state.

        Returns:
            Both of shape (len(sights), len(people)).
        """
        count, i = len(people), state.at(seen.robot)
        at = np.array([state.person_at(j) for j in people])[:, np.newaxis] + (0, 1)
        pose, rotation = state.mean[i : i + 3], rotation_2d(float(state.mean[i + 2]))
        offset = state.mean[at] - pose[:2]
        columns = np.concatenate([np.tile(np.arange(i, i + 3), (count, 1)), at], axis=1)
        joint = state.covariance[columns[:, :, np.newaxis], columns[:, np.newaxis]]
        jacobian = np.zeros((count, 2, 5))
        jacobian[:, :, :2], jacobian[:, :, 3:] = -rotation.T, rotation.T
        jacobian[:, :, 2] = np.stack([offset[:, 1], -offset[:, 0]], axis=1) @ rotation
        total = jacobian @ joint @ jacobian.transpose(0, 2, 1) + single[sights, np.newaxis]
        away = seen.xy[sights, np.newaxis] - offset @ rotation
        squared = squared_mahalanobis(away.reshape(-1, 2), total.reshape(-1, 2, 2))
        squared = squared.reshape(len(sights), count)
        return squared, squared + np.log(np.linalg.det(total))

    def _recognized(
        self, state: TeamState, seen: PeopleStand, index: int, xy: Float, covariance: Float
    ) -> TeamState:
        i, p = state.at(seen.robot), state.person_at(index)
        columns = np.array([i, i + 1, i + 2, p, p + 1])

        def model(part: Float) -> tuple[Float, Float]:
            predicted, by_robot, by_other = pose_from(part[:3], np.array([*part[3:], 0.0]))
            return xy - predicted[:2], np.hstack([by_robot[:2], by_other[:2, :2]])

        stamp_ns = seen.odometry.stamp_ns
        state, found = corrected(state, columns, model, covariance, seen.inflated)
        person = changed(state.people[index], seen_ns=stamp_ns)
        people = (*state.people[:index], person, *state.people[index + 1 :])
        state = changed(state, people=people)
        return noted(state, seen.robot, "standing people", True, found, stamp_ns)

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
