"""Joining: the bodies that several robots found, put together on the common map.

Each body is a place with a covariance that is long along the line of sight, so two robots that look
from different sides correct each other's ranges. Nearest first, in standard deviations, bodies of
different robots become one; what each robot says for and against a person there adds up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.geometry import Float, squared_mahalanobis
from mrs_people_loc.neighbours import pairs_within
from mrs_people_loc.team.fusion import BodiesOnMap

Int = NDArray[np.intp]
Bool = NDArray[np.bool_]

#: One robot says no more against a person than this.
_LEAST_SCORE = -2.0
#: In a square of this side [m] so many bodies take part, the likeliest: more than fifty robots see
#: of two people who touch.
_PLACE, _MOST_IN_PLACE = 0.5, 100
#: So many pairs are looked at at once.
_BLOCK = 50_000


@dataclass(frozen=True)
class Joined:
    """What the bodies of all robots are together, a struct of arrays of one length (m,).

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


def join(bodies: BodiesOnMap, used: Bool, config: cfg.Joining) -> Joined:
    """Joins bodies of different robots that are near each other, nearest first.

    Where more than `_MOST_IN_PLACE` bodies are in one square, the likeliest take part.

    Args:
        bodies: The bodies.
        used: Which of them take part, shape (n,).
        config: Parameters.
    """
    index = _likeliest_in_place(bodies, np.flatnonzero(used))
    of_body = np.full(len(bodies), -1, dtype=np.intp)
    if not len(index):
        return Joined(of_body, np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
    xy, covariance, robot = bodies.xy[index], bodies.covariance[index], bodies.robot[index]
    one, other, away = pairs_within(xy, config.max_distance)
    squared = _squared_between(xy, covariance, one, other)
    possible = np.flatnonzero(
        (robot[one] != robot[other]) & (away < config.max_distance) & (squared < config.gate**2)
    )
    nearest_first = np.lexsort((other[possible], one[possible], squared[possible]))

    information = _information(covariance, xy)
    groups = [
        _Group([k], {of}, *numbers)
        for k, (of, numbers) in enumerate(zip(robot.tolist(), information.tolist(), strict=True))
    ]
    one, other = one[possible][nearest_first], other[possible][nearest_first]
    for start in range(0, len(one), _BLOCK):
        pairs = one[start : start + _BLOCK], other[start : start + _BLOCK]
        if start:  # many are one, or have a robot in common, by now
            apart = _may_be_joined(groups, *pairs)
            pairs = pairs[0][apart], pairs[1][apart]
        for i, j in zip(pairs[0].tolist(), pairs[1].tolist(), strict=True):
            a, b = groups[i], groups[j]
            if a is b or not a.robots.isdisjoint(b.robots):
                continue
            # Where one of them has grown already, it is its place that counts.
            if len(a.members) + len(b.members) > 2 and not a.is_near(b, config):
                continue
            a.take(b)
            for member in b.members:
                groups[member] = a
    found = list(dict.fromkeys(groups))
    number = np.empty(len(index), dtype=np.intp)
    for k, group in enumerate(found):
        number[group.members] = k
    of_body[index] = number
    joined_xy, joined_covariance = _places(
        np.array([(g.xx, g.xy, g.yy, g.x, g.y) for g in found]).reshape(-1, 5)
    )
    scores = np.maximum(bodies.score[index], _LEAST_SCORE)
    return Joined(
        of_body=of_body,
        xy=joined_xy,
        covariance=joined_covariance,
        score=np.bincount(number, scores, minlength=len(found)).astype(np.float64),
    )


def _likeliest_in_place(bodies: BodiesOnMap, index: Int) -> Int:
    """Of some bodies, those that take part, in their order."""
    if len(index) <= _MOST_IN_PLACE:
        return index
    squares = np.floor(bodies.xy[index] / _PLACE)
    _, square, sizes = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    if sizes.max() <= _MOST_IN_PLACE:
        return index
    square = square.reshape(-1)
    likeliest_first = np.lexsort((-bodies.score[index], square))
    rank = np.arange(len(index)) - (np.cumsum(sizes) - sizes)[square[likeliest_first]]
    return index[np.sort(likeliest_first[rank < _MOST_IN_PLACE])]


def _squared_between(xy: Float, covariance: Float, one: Int, other: Int) -> Float:
    """Squared distances of pairs in standard deviations of both, shape (m,)."""
    squared = np.empty(len(one))
    for start in range(0, len(one), _BLOCK):
        i, j = one[start : start + _BLOCK], other[start : start + _BLOCK]
        squared[start : start + _BLOCK] = squared_mahalanobis(
            xy[i] - xy[j], covariance[i] + covariance[j]
        )
    return squared


def _may_be_joined(groups: list[_Group], one: Int, other: Int) -> Bool:
    """Which pairs are not one yet and have no robot in common, shape (m,)."""
    number = {id(group): k for k, group in enumerate(dict.fromkeys(groups))}
    of_body = np.array([number[id(group)] for group in groups], dtype=np.intp)
    robots = np.zeros((len(number), 1 + max(max(group.robots) for group in groups)), dtype=bool)
    for group in dict.fromkeys(groups):
        robots[number[id(group)], list(group.robots)] = True
    bits = np.packbits(robots, axis=1)
    i, j = of_body[one], of_body[other]
    return np.asarray((i != j) & ~(bits[i] & bits[j]).any(axis=1))


def _information(covariance: Float, xy: Float) -> Float:
    """Information matrix (xx, xy, yy) and vector (x, y) of each place, shape (n, 5)."""
    inverse = _inverse(covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1])
    (a, b, c), (x, y) = inverse, xy.T
    return np.stack([a, b, c, a * x + b * y, b * x + c * y], axis=1)


def _places(information: Float) -> tuple[Float, Float]:
    """The other way round: places, shape (n, 2), and covariances, shape (n, 2, 2)."""
    xx, xy, yy, x, y = information.T
    a, b, c = _inverse(xx, xy, yy)
    places = np.stack([a * x + b * y, b * x + c * y], axis=1)
    return places, np.stack([a, b, b, c], axis=1).reshape(-1, 2, 2)


def _inverse(xx: Any, xy: Any, yy: Any) -> tuple[Any, Any, Any]:
    """Inverse of symmetric matrices of 2 x 2."""
    determinant = xx * yy - xy * xy
    return yy / determinant, -xy / determinant, xx / determinant


@dataclass(eq=False)
class _Group:
    """Bodies that are one: who they are, and their information added."""

    members: list[int]
    robots: set[int]
    xx: float
    xy: float
    yy: float
    x: float
    y: float

    def is_near(self, other: _Group, config: cfg.Joining) -> bool:
        """Whether the two may be one, where they are by now."""
        a, b, c = _inverse(self.xx, self.xy, self.yy)
        d, e, f = _inverse(other.xx, other.xy, other.yy)
        x = a * self.x + b * self.y - (d * other.x + e * other.y)
        y = b * self.x + c * self.y - (e * other.x + f * other.y)
        if not math.hypot(x, y) < config.max_distance:
            return False
        xx, xy, yy = _inverse(a + d, b + e, c + f)
        return bool(xx * x * x + 2.0 * xy * x * y + yy * y * y < config.gate**2)

    def take(self, other: _Group) -> None:
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
    """Which are people, shape (m,): likely enough, and not what a likelier one already is.

    Two people are never closer than `apart`. Besides, what is left over of robots that did not see
    a likelier person near it, at a distance that their range may be wrong by, is that person:
    ranges err by more than their sigma now and then.

    Args:
        joined: The joined bodies.
        bodies: What they were joined of.
        config: Parameters.
        expected: Which expected person each may be, shape (m,); -1: none. Who may be two different
            ones are two, however close they are.
    """
    if not len(joined):
        return np.empty(0, dtype=bool)
    one, other, away = pairs_within(joined.xy, max(config.apart, config.fragment_distance))
    squared = _squared_between(joined.xy, joined.covariance, one, other)
    same = away < config.apart
    fragment = (squared < config.fragment_gate**2) & (away < config.fragment_distance)
    member = joined.of_body >= 0
    robots: list[set[int]] = [set() for _ in range(len(joined))]
    of_body, robot = joined.of_body[member].tolist(), bodies.robot[member].tolist()
    for number, name in zip(of_body, robot, strict=True):
        robots[number].add(name)
    rivals: list[list[int]] = [[] for _ in robots]
    rival = same | fragment
    if expected is not None:
        two = (expected[one] >= 0) & (expected[other] >= 0) & (expected[one] != expected[other])
        rival &= ~two
    near = np.flatnonzero(rival)
    pairs = zip(one[near].tolist(), other[near].tolist(), same[near].tolist(), strict=True)
    for i, j, always in pairs:
        if always or robots[i].isdisjoint(robots[j]):
            rivals[i].append(j)
            rivals[j].append(i)
    people = [False] * len(joined)
    for i in np.argsort(-joined.score, kind="stable").tolist():
        if joined.score[i] < config.min_score:
            break
        people[i] = not any(people[j] for j in rivals[i])
    return np.array(people, dtype=bool)
