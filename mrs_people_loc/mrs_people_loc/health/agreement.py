"""Agreement: whether robots see people at the same places; a robot that does not is misplaced.

The places where each robot sees people are kept for a while. A robot is misplaced if its people are
not at the places of the others', but would be after one small move and turn of the robot: until
then, a person whom both see is two people.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.anthropometry import APART_AMONG_ROBOTS
from mrs_people_loc.arrays import Float
from mrs_people_loc.cells.clustering import cluster
from mrs_people_loc.cells.human import is_human
from mrs_people_loc.clusters import measure
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.team.fusion import ShortTermMap, place_bodies
from mrs_people_loc.team.masking import are_masked, bodies_of_robots
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class AgreementTuning:
    """Constants of `Agreement`, chosen by hand.

    Attributes:
        same: Places of two robots nearer to each other than this are of one person [m].
        reach: A pose is corrected by no more than this [m]: beyond, another person is as likely an
            explanation.
        turns_deg: Turns that corrections are searched from, the likeliest first [deg].
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
    turns_deg: tuple[float, ...] = (0.0, 6.0, -6.0, 12.0, -12.0, 18.0, -18.0)
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
        self._samples.append(_Sample(robots, _places_of_people(fused, poses, config)))
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
        tuning, same = self.tuning, self.tuning.same
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
        agreed = len(_pairs(own, others, np.zeros(2), 0.0, same)[0]) / sum(map(len, own))
        if agreed > tuning.most_agreed:
            return None
        turns = np.radians(tuning.turns_deg)
        starts = [(_coarse_move(own, others, turn, tuning), turn) for turn in turns]
        move, turn = max(starts, key=lambda way: len(_pairs(own, others, way[0], way[1], same)[0]))
        for _ in range(5):
            mine, theirs = _pairs(own, others, move, turn, same)
            if len(mine) < tuning.least_people * len(own):
                return None
            move, turn = _fit(mine, theirs)
        would_agree = len(_pairs(own, others, move, turn, same)[0]) / sum(map(len, own))
        if would_agree < tuning.least_would_agree or np.hypot(*move) > tuning.reach:
            return None
        return Misplaced(move, turn, agreed, would_agree)


def _places_of_people(
    fused: ShortTermMap, poses: Mapping[str, Pose], config: cfg.PlannerConfig
) -> dict[str, Float]:
    """By robot, where it alone sees people, shape (n, 2) [m]."""
    bodies = place_bodies(fused, poses, line_of_sight=config.joining.line_of_sight)
    robots = bodies_of_robots(bodies, fused.robots, poses, config.masking)
    likely = (bodies.score >= config.joining.min_score) & ~robots
    all_plain = np.flatnonzero(bodies.of_cell < 0)
    all_plain = all_plain[~are_masked(fused, all_plain, poses, None, config.masking)]
    places = {}
    for index, name in enumerate(fused.robots):
        plain = all_plain[fused.robot[all_plain] == index]
        cells, seen_by = fused.cells.select(plain), np.zeros(len(plain), np.intp)
        part = ShortTermMap((name,), seen_by, fused.xy[plain], cells, (0,))
        clusters = measure(part, cluster(part.xy, distance=config.clustering.distance))
        places[name] = np.concatenate(
            [
                bodies.xy[(bodies.robot == index) & likely],
                clusters.centroid[is_human(clusters, config.human)],
            ]
        )
    return places


def _pairs(
    own: list[Float], others: list[Float], move: Float, turn: float, same: float
) -> tuple[Float, Float]:
    """Pairs of an own place, turned and moved, and the nearest of the others' within `same`."""
    mine, theirs = [np.empty((0, 2))], [np.empty((0, 2))]
    rotation = rotation_2d(turn)
    for here, there in zip(own, others, strict=True):
        offset = there - (here @ rotation.T + move)[:, np.newaxis]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        nearest = distance.argmin(axis=1)
        near = distance[np.arange(len(here)), nearest] < same
        mine.append(here[near])
        theirs.append(there[nearest[near]])
    return np.concatenate(mine), np.concatenate(theirs)


def _coarse_move(
    own: list[Float], others: list[Float], turn: float, tuning: AgreementTuning
) -> Float:
    """After a turn: the difference between places that most others are like [m], shape (2,)."""
    rotation = rotation_2d(turn)
    offsets = np.concatenate(
        [
            (there - (here @ rotation.T)[:, np.newaxis]).reshape(-1, 2)
            for here, there in zip(own, others, strict=True)
        ]
    )
    reach = tuning.reach
    offsets = offsets[np.hypot(*offsets.T) < reach]
    if not len(offsets):
        return np.zeros(2)
    edges = np.linspace(-reach, reach, 21)
    counts, _, _ = np.histogram2d(offsets[:, 0], offsets[:, 1], bins=[edges, edges])
    around = np.lib.stride_tricks.sliding_window_view(np.pad(counts, 1), (3, 3))
    counts = around.sum(axis=(2, 3))  # each with those around it
    peak = np.unravel_index(counts.argmax(), counts.shape)
    centre = np.array([(edges[i] + edges[i + 1]) / 2.0 for i in peak])
    return np.asarray(offsets[np.hypot(*(offsets - centre).T) < tuning.same].mean(axis=0))


def _fit(here: Float, there: Float) -> tuple[Float, float]:
    """Move and turn that bring places nearest to others (least squares)."""
    centre_here, centre_there = here.mean(axis=0), there.mean(axis=0)
    a, b = here - centre_here, there - centre_there
    turn = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    return centre_there - rotation_2d(turn) @ centre_here, turn
