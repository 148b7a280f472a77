"""Agreement: whether robots see people at the same places; a robot that does not is misplaced.

The places where each robot sees people are kept for a while. A robot is misplaced if its people are
not at the places of the others', but would be after one small move and turn of the robot: until
then, a person whom both see is two people.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.anthropometry import APART_AMONG_ROBOTS
from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.people.alignment import Places, align
from mrs_people_loc.localization.people.seen_people import people_by_robot
from mrs_people_loc.neighbours import pairs_between
from mrs_people_loc.team.fusion import ShortTermMap, map_from_robot
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class AgreementTuning:
    """Constants of `Agreement`, chosen by hand.

    Attributes:
        same: Places of two robots nearer to each other than this are of one person [m].
        reach: A pose is corrected by no more than this [m]: beyond, another person is as likely an
            explanation.
        expected: Standard deviations of what a pose may be wrong by, x, y, yaw [m, m, rad].
        samples: Intervals that are kept.
        enough: Intervals with people of a robot and of others, at least.
        at_once: Robots that are compared with the others per interval: each takes some
            milliseconds.
        least_people: People that agree per interval, on average, at least: one fits anywhere.
        most_agreed: A robot is misplaced if no more than this share of its people agree,
        least_would_agree: ... and at least this share would, with its pose corrected.
    """

    same: float = APART_AMONG_ROBOTS
    reach: float = 1.0
    expected: tuple[float, float, float] = (0.5, 0.5, math.radians(9.0))
    samples: int = 20
    enough: int = 8
    at_once: int = 4
    least_people: float = 1.8
    most_agreed: float = 0.35
    least_would_agree: float = 0.65


_TUNING = AgreementTuning()


@dataclass(frozen=True)
class Misplaced:
    """How a robot would have to be moved and turned for its people to agree with the others'.

    Attributes:
        move: In the map [m], shape (2,).
        turn: To the left [rad].
        agreed: Share of its people that agree with the others' as it is.
        would_agree: Likewise, after that.
    """

    move: Float
    turn: float
    agreed: float
    would_agree: float


@dataclass(frozen=True)
class _Sample:
    """One interval: by robot where it is, and the places of the people it sees."""

    robots: Mapping[str, Float]
    places: Mapping[str, Float]


@dataclass
class Agreement:
    """Keeps what robots saw lately, and compares.

    Attributes:
        misplaced: The robots that do not agree with the others, and what would mend it.
        tuning: Constants.
    """

    misplaced: dict[str, Misplaced] = field(default_factory=dict)
    tuning: AgreementTuning = _TUNING
    _next: int = 0
    _samples: deque[_Sample] = field(default_factory=deque)

    def __post_init__(self) -> None:
        """Makes room for the samples."""
        self._samples = deque(maxlen=self.tuning.samples)

    def add(
        self, fused: ShortTermMap, poses: Mapping[str, Pose], config: cfg.PlannerConfig
    ) -> None:
        """Takes an interval, and compares some robots, in turn; about once a second is enough.

        Args:
            fused: Its map.
            poses: By robot, the pose that its cells were placed with.
            config: What is human.
        """
        robots = {name: np.array([poses[name].x, poses[name].y]) for name in fused.robots}
        people = people_by_robot(fused, poses, config)
        places = {name: map_from_robot(people[name].xy, poses[name]) for name in fused.robots}
        self._samples.append(_Sample(robots, places))
        names = sorted({name for sample in self._samples for name in sample.places})
        for gone in set(self.misplaced) - set(names):
            del self.misplaced[gone]
        for _ in range(min(self.tuning.at_once, len(names))):
            self._next = (self._next + 1) % len(names)
            name = names[self._next]
            self.misplaced.pop(name, None)
            found = self._compare(name)
            if found is not None:
                self.misplaced[name] = found

    def _compare(self, name: str) -> Misplaced | None:
        tuning = self.tuning
        own, others = [], []  # relative to the robot, per sample
        for sample in self._samples:
            if name not in sample.places:
                continue
            rest = [places for other, places in sample.places.items() if other != name]
            mine, theirs = sample.places[name], np.concatenate([np.empty((0, 2)), *rest])
            if len(mine) and len(theirs):
                own.append(mine - sample.robots[name])
                others.append(theirs - sample.robots[name])
        if len(own) < tuning.enough:
            return None
        agreed = _agreed(own, others, np.zeros(2), 0.0, tuning.same)
        if agreed > tuning.most_agreed:
            return None
        prior = np.diag(np.square(tuning.expected))
        found = align(_places(own, tuning.same), _places(others, tuning.same), prior)
        if found is None or len(found.own) < tuning.least_people * len(own):
            return None
        would_agree = _agreed(own, others, found.move, found.turn, tuning.same)
        if would_agree < tuning.least_would_agree or np.hypot(*found.move) > tuning.reach:
            return None
        return Misplaced(found.move, found.turn, agreed, would_agree)


def _places(samples: list[Float], same: float) -> Places:
    """Places of all samples, so unsure that those within a distance [m] match."""
    sample = np.repeat(np.arange(len(samples)), [len(places) for places in samples])
    covariance = np.tile(same**2 / 8.0 * np.eye(2), (len(sample), 1, 1))
    return Places(np.concatenate(samples), covariance, sample)


def _agreed(own: list[Float], others: list[Float], move: Float, turn: float, same: float) -> float:
    """Share of own places that are, turned and moved, within a distance of one of the others'."""
    rotation = rotation_2d(turn)
    near = [
        len(np.unique(pairs_between(here @ rotation.T + move, there, same)[0]))
        for here, there in zip(own, others, strict=True)
    ]
    return sum(near) / sum(map(len, own))
