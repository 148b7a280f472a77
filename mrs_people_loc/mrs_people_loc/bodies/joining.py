"""Joining: the bodies that several robots found, merged on the common map.

Each body is a place with a covariance that is long along the line of sight, so two robots that look
from different sides correct each other's ranges. Nearest first, in standard deviations, bodies of
different robots become one; the log-odds that each robot gives them add up.
"""

from __future__ import annotations

import math
from collections import defaultdict
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
    first, information = _merge(
        _information(covariance, xy), robot, *_pairs(xy, covariance, robot, config), config
    )
    of_body[index] = (np.cumsum(first == np.arange(len(index))) - 1)[first]
    joined_xy, joined_covariance = _places(information)
    scores = np.maximum(bodies.score[index], tuning.min_score)
    return Joined(
        of_body=of_body,
        xy=joined_xy,
        covariance=joined_covariance,
        score=np.bincount(of_body[index], scores).astype(np.float64),
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


def _merge(
    information: Float, robot: Int, one: Int, other: Int, config: cfg.Joining
) -> tuple[Int, Float]:
    """Merges bodies, pair by pair in their order, unless they have a robot in common.

    Args:
        information: Of each body, shape (n, 5).
        robot: Which robot saw it, shape (n,).
        one: First bodies of the pairs, shape (m,).
        other: Second ones, likewise.
        config: Parameters.

    Returns:
        Of each body, the first of those that it is one with, shape (n,); and the information of
        those that are one, added, in the order of their first bodies.
    """
    up = list(range(len(robot)))  # those that are one: a tree, with the first one as its root
    robots, total = [1 << number for number in robot.tolist()], information.tolist()
    merged: set[int] = set()
    for start in range(0, len(one), _BLOCK):
        pairs = one[start : start + _BLOCK], other[start : start + _BLOCK]
        if start:  # many are one, or have a robot in common, by now
            unmerged = ~_share_a_robot(root := _roots(up), robot, root[pairs[0]], root[pairs[1]])
            pairs = pairs[0][unmerged], pairs[1][unmerged]
        for i, j in zip(pairs[0].tolist(), pairs[1].tolist(), strict=True):
            while i != up[i]:
                i = up[i]
            while j != up[j]:
                j = up[j]
            if robots[i] & robots[j]:
                continue
            # Pairs were gated by their bodies' places; those that are several have moved.
            if (i in merged or j in merged) and not _are_near(total[i], total[j], config):
                continue
            i, j = min(i, j), max(i, j)
            up[j] = i
            robots[i] |= robots[j]
            total[i] = [a + b for a, b in zip(total[i], total[j], strict=True)]
            merged.add(i)
    first = _roots(up)
    return first, np.array([total[k] for k in np.flatnonzero(first == np.arange(len(up)))])


def _roots(up: list[int]) -> Int:
    """The root of each element of trees, shape (n,)."""
    root = np.array(up)
    while not np.array_equal(root, root[root]):
        root = root[root]
    return root


def _are_near(one: list[float], other: list[float], config: cfg.Joining) -> bool:
    """Whether two that are several bodies each may be one, where they are by now."""
    xx, xy, yy, x, y = one
    a, b, c = _inverse(xx, xy, yy)
    x, y = a * x + b * y, b * x + c * y
    xx, xy, yy, right, up = other
    d, e, f = _inverse(xx, xy, yy)
    x, y = x - (d * right + e * up), y - (e * right + f * up)
    if not math.hypot(x, y) < config.max_distance:
        return False
    xx, xy, yy = _inverse(a + d, b + e, c + f)
    return bool(xx * x * x + 2.0 * xy * x * y + yy * y * y < config.gate**2)


def _likeliest_in_square(bodies: BodiesOnMap, index: Int, tuning: JoiningTuning) -> Int:
    """Of some bodies, those that take part, in their order."""
    most = tuning.most_in_square
    if len(index) <= most:
        return index
    # A square is one number: rows of two take NumPy ten times as long to sort.
    column, row = np.floor(bodies.xy[index] / tuning.square).T
    squares = column + 1j * row
    _, square, sizes = np.unique(squares, return_inverse=True, return_counts=True)
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


def _share_a_robot(number: Int, robot: Int, one: Int, other: Int) -> Bool:
    """Which pairs of joined bodies a robot saw both of, shape (m,).

    Args:
        number: Which of them each body belongs to, shape (n,).
        robot: Which robot saw each body, shape (n,).
        one: First ones of the pairs, shape (m,).
        other: Second ones, likewise.
    """
    robots = np.zeros((int(number.max()) + 1, int(robot.max()) + 1), dtype=bool)
    robots[number, robot] = True
    bits = np.packbits(robots, axis=1)
    return np.asarray((bits[one] & bits[other]).any(axis=1))


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
    likely = joined.score >= config.min_score
    pairs = _rivals(joined, bodies, likely, config, expected)
    rivals: defaultdict[int, list[int]] = defaultdict(list)
    for i, j in pairs.tolist():
        rivals[i].append(j)
        rivals[j].append(i)
    people, rivalled = likely.tolist(), np.unique(pairs)
    for i in rivalled.tolist():
        people[i] = False
    for i in rivalled[np.argsort(-joined.score[rivalled], kind="stable")].tolist():
        people[i] = not any(people[j] for j in rivals[i])
    return np.array(people, dtype=bool)


def _rivals(
    joined: Joined, bodies: BodiesOnMap, likely: Bool, config: cfg.Joining, expected: Int | None
) -> Int:
    """Pairs of likely joined bodies of which one at most is a person; see `are_people`.

    Returns:
        Shape (k, 2).
    """
    one, other, away = pairs_within(joined.xy, max(config.apart, config.fragment_distance))
    rival = likely[one] & likely[other]
    if expected is not None:
        two = (expected[one] >= 0) & (expected[other] >= 0) & (expected[one] != expected[other])
        rival &= ~two
    one, other, away = one[rival], other[rival], away[rival]
    rival = away < config.apart
    squared = _squared_between(joined.xy, joined.covariance, one, other)
    fragment = (squared < config.fragment_gate**2) & (away < config.fragment_distance) & ~rival
    if fragment.any():
        member = joined.of_body >= 0
        of_body, robot = joined.of_body[member], bodies.robot[member]
        rival[fragment] = ~_share_a_robot(of_body, robot, one[fragment], other[fragment])
    return np.stack([one[rival], other[rival]], axis=1)
