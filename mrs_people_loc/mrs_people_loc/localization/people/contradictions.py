"""Robots that see people where others see nobody, before anything tells what their poses are.

Two robots agree about who is at one place for both. They contradict each other about whom one of
them sees where the other has detected people before (`FieldsOfView`), and sees nobody now. Both are
counted for some tenths of a second. A robot is contradicted if no other one agrees with it, and one
that another one agrees with contradicts it; two robots alone cannot tell which of them is wrong. It
is contradicted until one agrees with it, but not for long: what looks like a person from one side
only must not part a robot from its team.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.geometry import rotation_2d, squared_mahalanobis
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_loc.team.masking import Walls
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.team.visibility import FieldsOfView


@dataclass(frozen=True)
class ContradictionsTuning:
    """Constants, chosen by hand with simulated tours.

    Attributes:
        sigmas: Places of two robots are of one person within so many standard deviations: of what
            each says, of where the robots are to each other, ...
        moved: ... and of this, as people move and look different from two sides [m].
        unknown: A larger variance is taken for this [m^2].
        reach: Whoever is farther away than so much of the way to the farthest detection of a robot
            may be missed.
        lately_s: What was seen counts for so long: it fades with this time constant [s].
        longest_s: An interval counts for no longer than this [s].
        least: Two robots agree, or not, if they share so much: people, times how long [s].
        odds: They contradict each other if that is more than so many times what they agree about.
        after_s: A robot is contradicted after this time, in which it agreed with nobody [s] ...
        holds_s: ... and for no longer than this, until it agrees with one again [s].
    """

    sigmas: float = 2.0
    moved: float = 0.2
    unknown: float = 1e6
    reach: float = 0.7
    lately_s: float = 0.5
    longest_s: float = 0.3
    least: float = 0.4
    odds: float = 0.5
    after_s: float = 0.25
    holds_s: float = 15.0


CONTRADICTIONS_TUNING = ContradictionsTuning()


@dataclass
class _Pair:
    """About how much two robots agree and contradict each other [s]."""

    agree: float = 0.0
    contradict: float = 0.0


class Contradictions:
    """Compares whom robots see, interval by interval.

    Args:
        tuning: Constants.
    """

    def __init__(self, tuning: ContradictionsTuning = CONTRADICTIONS_TUNING) -> None:
        self._tuning = tuning
        self._views = FieldsOfView()
        self._pairs: dict[tuple[str, str], _Pair] = {}
        self._since_ns: dict[str, int] = {}
        self._newest_ns: int | None = None

    def step(
        self,
        seen: Mapping[str, SeenPeople],
        poses: Mapping[str, Pose],
        walls: Walls | None = None,
    ) -> dict[str, bool]:
        """Takes an interval.

        Args:
            seen: By robot, the people that it sees.
            poses: By robot, its pose in the map, with its covariance relative to the team.
            walls: What hides people, where it is known.

        Returns:
            By robot, where that is known: whether it agrees with another one, or is contradicted.
        """
        if not seen:
            return {}
        now_ns = max(people.stamp_ns for people in seen.values())
        seconds = 0.0 if self._newest_ns is None else (now_ns - self._newest_ns) / 1e9
        seconds = min(max(seconds, 0.0), self._tuning.longest_s)
        self._newest_ns = now_ns
        places = {name: map_from_robot(people.xy, poses[name]) for name, people in seen.items()}
        unsure = {name: _turned(people.covariance, poses[name]) for name, people in seen.items()}
        robots = [name for name, xy in places.items() for _ in xy]
        self._views.learn(robots, np.concatenate(list(places.values())), poses)
        kept = math.exp(-seconds / self._tuning.lately_s)
        for pair in self._pairs.values():
            pair.agree, pair.contradict = kept * pair.agree, kept * pair.contradict
        for names in itertools.combinations(sorted(seen), 2):
            pair = self._pairs.setdefault(names, _Pair())
            for name, other in (names, names[::-1]):
                near, missed = self._compared(places, unsure, name, other, poses, walls)
                pair.agree += seconds * int(near.sum())
                pair.contradict += seconds * int(missed.sum())
        return self._judged(now_ns)

    def _compared(
        self,
        places: Mapping[str, Float],
        unsure: Mapping[str, Float],
        robot: str,
        other: str,
        poses: Mapping[str, Pose],
        walls: Walls | None,
    ) -> tuple[Bool, Bool]:
        """Which people of a robot another one sees at the same place, and which it should."""
        own, others = places[robot], places[other]
        variances = np.diagonal([poses[name].covariance for name in (robot, other)], 0, 1, 2)[:, :2]
        # Larger ones, and NaN, stand for "unknown".
        variance = sum(min(self._tuning.unknown, value) for value in variances.ravel().tolist())
        covariance = unsure[robot][:, np.newaxis] + unsure[other]
        covariance = covariance + (variance + self._tuning.moved**2) * np.eye(2)
        off = own[:, np.newaxis] - others
        fits = squared_mahalanobis(off, covariance) < self._tuning.sigmas**2
        near = np.asarray(fits.any(axis=1))
        everybody, index = np.concatenate([own, others]), np.arange(len(own))
        in_view = self._views.are_seen(
            own, everybody, index, looking={other: poses[other]}, robots=poses, walls=walls
        )
        away = np.hypot(*(own - (poses[other].x, poses[other].y)).T)
        in_view &= away <= self._tuning.reach * self._views.farthest(other)
        return near, in_view & ~near

    def _judged(self, now_ns: int) -> dict[str, bool]:
        """Who agrees with another one at a time [ns], and who is contradicted."""
        tuning = self._tuning
        agreeing: dict[str, set[str]] = {}
        against: dict[str, set[str]] = {}
        for names, pair in self._pairs.items():
            contradict = pair.contradict >= max(tuning.least, tuning.odds * pair.agree)
            if not contradict and pair.agree < tuning.least:
                continue
            for name, other in (names, names[::-1]):
                (against if contradict else agreeing).setdefault(name, set()).add(other)
        for name, others in against.items():
            if any(other in agreeing for other in others):
                self._since_ns.setdefault(name, now_ns)
        for name in agreeing:
            self._since_ns.pop(name, None)
        contradicted = (
            name
            for name, since_ns in self._since_ns.items()
            if tuning.after_s <= (now_ns - since_ns) / 1e9 < tuning.holds_s
        )
        return dict.fromkeys(agreeing, True) | dict.fromkeys(contradicted, False)


def _turned(covariance: Float, pose: Pose) -> Float:
    """Covariances in base_link, in the map, shape (n, 2, 2)."""
    rotation = rotation_2d(pose.yaw)
    return np.asarray(rotation @ covariance @ rotation.T)
