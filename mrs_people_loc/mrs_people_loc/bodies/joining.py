"""Joining: the bodies that several robots found, merged on the common map.

Each body is a place with a covariance that is long along the line of sight, so two robots that look
from different sides correct each other's ranges. Nearest first, in standard deviations, bodies of
different robots become one; the log-odds that each robot gives them add up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.geometry import squared_mahalanobis
from mrs_people_loc.neighbours import pairs_within
from mrs_people_loc.team.fusion import BodiesOnMap

#: So many pairs are looked at at once.
_BLOCK = 50_000


@dataclass(frozen=True)
class JoiningTuning:
    """Constants of joining, beside `joining.*` in the configuration.

    Attributes:
        min_score: Lower bound of one robot's log-odds; chosen on the training suite.
        square: Side of a square [m] in which ...
        most_in_square: ... so many bodies take part, the likeliest. Bounds the work; fifty robots
            see no more of two people who touch.
    """

    min_score: float = -2.0
    square: float = 0.5
    most_in_square: int = 100


JOINING_TUNING = JoiningTuning()


@dataclass(frozen=True)
class Joined:
    """Joined bodies, a struct of arrays of one length (m,).

    Attributes:
        of_body: Which of them each body belongs to; -1: to none, it is a robot, or one too many
            where it stands, shape (n,).
        xy: Place [m], shape (m, 2).
        covariance: Of the place [m^2], shape (m, 2, 2).
        score: Log-odds of being a person.
    """

    of_body: Int
    xy: Float
    covariance: Float
    score: Float

    def __len__(self) -> int:
        """How many they are."""
        return len(self.xy)


def join(
    bodies: BodiesOnMap, used: Bool, config: cfg.Joining, tuning: JoiningTuning = JOINING_TUNING
) -> Joined:
    """Joins bodies of different robots that are near each other, nearest first.

    Args:
        bodies: The bodies.
        used: Which of them take part, shape (n,); where too many are in one square, the likeliest.
        config: Parameters.
        tuning: Its constants.
    """
    index = _likeliest_in_square(bodies, np.flatnonzero(used), tuning)
    of_body = np.full(len(bodies), -1, dtype=np.intp)
    if not len(index):
        return Joined(of_body, np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
    xy, covariance, robot = bodies.xy[index], bodies.covariance[index], bodies.robot[index]
    information = _information(covariance, xy)
    components = [
        _Component([k], {of}, *numbers)
        for k, (of, numbers) in enumerate(zip(robot.tolist(), information.tolist(), strict=True))
    ]
    _merge(components, *_pairs(xy, covariance, robot, config), config)
    found = list(dict.fromkeys(components))
    number = np.empty(len(index), dtype=np.intp)
    for k, component in enumerate(found):
        number[component.members] = k
    of_body[index] = number
    joined_xy, joined_covariance = _places(
        np.array([(c.xx, c.xy, c.yy, c.x, c.y) for c in found]).reshape(-1, 5)
    )
    scores = np.maximum(bodies.score[index], tuning.min_score)
    return Joined(
        of_body=of_body,
        xy=joined_xy,
        covariance=joined_covariance,
        score=np.bincount(number, scores, minlength=len(found)).astype(np.float64),
    )


def _pairs(xy: Float, covariance: Float, robot: Int, config: cfg.Joining) -> tuple[Int, Int]:
    """Pairs of bodies of different robots that may be one, the nearest first (in sigmas)."""
    one, other, away = pairs_within(xy, config.max_distance)
    squared = _squared_between(xy, covariance, one, other)
    possible = np.flatnonzero(
        (robot[one] != robot[other]) & (away < config.max_distance) & (squared < config.gate**2)
    )
    nearest_first = np.lexsort((other[possible], one[possible], squared[possible]))
    return one[possible][nearest_first], other[possible][nearest_first]


def _merge(components: list[_Component], one: Int, other: Int, config: cfg.Joining) -> None:
    """Merges the components of pairs of bodies, in their order.

    Args:
        components: Of each body, the one that it belongs to; changed in place.
        one: First bodies of the pairs, shape (m,).
        other: Second ones, likewise.
        config: Parameters.
    """
    for start in range(0, len(one), _BLOCK):
        pairs = one[start : start + _BLOCK], other[start : start + _BLOCK]
        if start:  # many are one, or have a robot in common, by now
            unmerged = _may_be_merged(components, *pairs)
            pairs = pairs[0][unmerged], pairs[1][unmerged]
        for i, j in zip(pairs[0].tolist(), pairs[1].tolist(), strict=True):
            a, b = components[i], components[j]
            if a is b or not a.robots.isdisjoint(b.robots):
                continue
            # Pairs were gated by their bodies' places; a component that has grown has moved.
            if len(a.members) + len(b.members) > 2 and not a.is_near(b, config):
                continue
            a.take(b)
            for member in b.members:
                components[member] = a


def _likeliest_in_square(bodies: BodiesOnMap, index: Int, tuning: JoiningTuning) -> Int:
    """Of some bodies, those that take part, in their order."""
    most = tuning.most_in_square
    if len(index) <= most:
        return index
    squares = np.floor(bodies.xy[index] / tuning.square)
    _, square, sizes = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    if sizes.max() <= most:
        return index
    square = square.reshape(-1)
    likeliest_first = np.lexsort((-bodies.score[index], square))
    rank = np.arange(len(index)) - (np.cumsum(sizes) - sizes)[square[likeliest_first]]
    return index[np.sort(likeliest_first[rank < most])]


def _squared_between(xy: Float, covariance: Float, one: Int, other: Int) -> Float:
    """Squared distances of pairs in standard deviations of both, shape (m,)."""
    squared = np.empty(len(one))
    for start in range(0, len(one), _BLOCK):
        i, j = one[start : start + _BLOCK], other[start : start + _BLOCK]
        squared[start : start + _BLOCK] = squared_mahalanobis(
            xy[i] - xy[j], covariance[i] + covariance[j]
        )
    return squared


def _may_be_merged(components: list[_Component], one: Int, other: Int) -> Bool:
    """Which pairs are not one yet and have no robot in common, shape (m,)."""
    number = {id(component): k for k, component in enumerate(dict.fromkeys(components))}
    of_body = np.array([number[id(component)] for component in components], dtype=np.intp)
    most = max(max(component.robots) for component in components)
    robots = np.zeros((len(number), 1 + most), dtype=bool)
    for component in dict.fromkeys(components):
        robots[number[id(component)], list(component.robots)] = True
    bits = np.packbits(robots, axis=1)
    i, j = of_body[one], of_body[other]
    return np.asarray((i != j) & ~(bits[i] & bits[j]).any(axis=1))


def _information(covariance: Float, xy: Float) -> Float:
    """Information matrix (xx, xy, yy) and vector (x, y) of each place, shape (n, 5)."""
    inverse = _inverse(covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1])
    (a, b, c), (x, y) = inverse, xy.T
    return np.stack([a, b, c, a * x + b * y, b * x + c * y], axis=1)


def _places(information: Float) -> tuple[Float, Float]:
    """The inverse: places, shape (n, 2), and covariances, shape (n, 2, 2)."""
    xx, xy, yy, x, y = information.T
    a, b, c = _inverse(xx, xy, yy)
    places = np.stack([a * x + b * y, b * x + c * y], axis=1)
    return places, np.stack([a, b, b, c], axis=1).reshape(-1, 2, 2)


def _inverse(xx: Any, xy: Any, yy: Any) -> tuple[Any, Any, Any]:
    """Inverse of symmetric matrices of 2 x 2."""
    determinant = xx * yy - xy * xy
    return yy / determinant, -xy / determinant, xx / determinant


@dataclass(eq=False)
class _Component:
    """Bodies that are one: their indices, their robots, and their information added."""

    members: list[int]
    robots: set[int]
    xx: float
    xy: float
    yy: float
    x: float
    y: float

    def is_near(self, other: _Component, config: cfg.Joining) -> bool:
        """Whether the two may be one, where they are by now."""
        a, b, c = _inverse(self.xx, self.xy, self.yy)
        d, e, f = _inverse(other.xx, other.xy, other.yy)
        x = a * self.x + b * self.y - (d * other.x + e * other.y)
        y = b * self.x + c * self.y - (e * other.x + f * other.y)
        if not math.hypot(x, y) < config.max_distance:
            return False
        xx, xy, yy = _inverse(a + d, b + e, c + f)
        return bool(xx * x * x + 2.0 * xy * x * y + yy * y * y < config.gate**2)

    def take(self, other: _Component) -> None:
        """Joins the other to this one."""
        self.members += other.members
        self.robots |= other.robots
        self.xx += other.xx
        self.xy += other.xy
        self.yy += other.yy
        self.x += other.x
        self.y += other.y


def are_people(
    joined: Joined,
    bodies: BodiesOnMap,
    config: cfg.Joining,
    *,
    expected: Int | None = None,
) -> Bool:
    """Which are people, shape (m,): likely enough, and no likelier one is in the same place.

    Two people are never closer than `apart`. Besides, what is left over of robots that did not see
    a likelier person near it, at a distance that their range may be wrong by, is that person:
    ranges err by more than their sigma now and then.

    Args:
        joined: The joined bodies.
        bodies: What they were joined of.
        config: Parameters.
        expected: Which expected person each may be, shape (m,); -1: none. Bodies that may be two
            different ones are two, however close they are.
    """
    if not len(joined):
        return np.empty(0, dtype=bool)
    rivals = _rivals(joined, bodies, config, expected)
    people = [False] * len(joined)
    for i in np.argsort(-joined.score, kind="stable").tolist():
        if joined.score[i] < config.min_score:
            break
        people[i] = not any(people[j] for j in rivals[i])
    return np.array(people, dtype=bool)


def _rivals(
    joined: Joined, bodies: BodiesOnMap, config: cfg.Joining, expected: Int | None
) -> list[list[int]]:
    """Of each joined body, those that are not people if it is one; see `are_people`."""
    one, other, away = pairs_within(joined.xy, max(config.apart, config.fragment_distance))
    squared = _squared_between(joined.xy, joined.covariance, one, other)
    same = away < config.apart
    fragment = (squared < config.fragment_gate**2) & (away < config.fragment_distance)
    rival = same | fragment
    if expected is not None:
        two = (expected[one] >= 0) & (expected[other] >= 0) & (expected[one] != expected[other])
        rival &= ~two
    member = joined.of_body >= 0
    robots: list[set[int]] = [set() for _ in range(len(joined))]
    of_body, robot = joined.of_body[member].tolist(), bodies.robot[member].tolist()
    for number, name in zip(of_body, robot, strict=True):
        robots[number].add(name)
    rivals: list[list[int]] = [[] for _ in robots]
    near = np.flatnonzero(rival)
    pairs = zip(one[near].tolist(), other[near].tolist(), same[near].tolist(), strict=True)
    for i, j, always in pairs:
        if always or robots[i].isdisjoint(robots[j]):
            rivals[i].append(j)
            rivals[j].append(i)
    return rivals
