"""Bodies of several robots as one: each compared with each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.config import Joining
from oracle.arrays import Float
from oracle.fusion import Seen
from oracle.numbers import LEAST_SCORE, MOST_IN_SQUARE, SQUARE_M


@dataclass(frozen=True)
class One:
    """What bodies are together.

    Attributes:
        members: Them.
        xy: Place [m].
        covariance: Of the place [m^2].
        score: Log-odds of being a person.
    """

    members: tuple[Seen, ...]
    xy: Float
    covariance: Float
    score: float

    @property
    def robots(self) -> set[str]:
        """Who saw it."""
        return {body.robot for body in self.members}

    @property
    def cells(self) -> list[int]:
        """Its cells on the map."""
        return [cell for body in self.members for cell in body.cells]


def one_of(members: Sequence[Seen]) -> One:
    """Bodies as one: what each robot knows of its place, and says of it, is added."""
    score = sum(max(body.score, LEAST_SCORE) for body in members)
    if len(members) == 1:
        return One(tuple(members), members[0].xy, members[0].covariance, score)
    covariance = np.linalg.inv(sum(np.linalg.inv(body.covariance) for body in members))
    vector = sum(np.linalg.solve(body.covariance, body.xy) for body in members)
    return One(tuple(members), covariance @ vector, covariance, score)


def _squared(one: One, other: One) -> float:
    """Squared distance in sigmas of both."""
    # Written out: where many pairs are equally far apart, rounding orders them.
    (x, y), ((xx, xy), (_, yy)) = one.xy - other.xy, one.covariance + other.covariance
    return float((yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))


def _may_join(one: One, other: One, config: Joining) -> bool:
    return (
        not one.robots & other.robots
        and math.dist(one.xy, other.xy) < config.max_distance
        and _squared(one, other) < config.gate**2
    )


def taking_part(bodies: Sequence[Seen]) -> list[int]:
    """Those that take part: of each square the likeliest."""
    if len(bodies) <= MOST_IN_SQUARE:
        return list(range(len(bodies)))
    squares: dict[tuple[int, ...], list[int]] = {}
    for k, body in enumerate(bodies):
        squares.setdefault(tuple(math.floor(x / SQUARE_M) for x in body.xy), []).append(k)
    likeliest = (
        sorted(s, key=lambda k: -bodies[k].score)[:MOST_IN_SQUARE] for s in squares.values()
    )
    return sorted(k for square in likeliest for k in square)


def joined_of(bodies: Sequence[Seen], config: Joining) -> list[One]:
    """Joins bodies, the nearest in sigmas first; in the order of their first members."""
    alone = {k: one_of([bodies[k]]) for k in taking_part(bodies)}
    pairs = sorted(
        (_squared(alone[i], alone[j]), i, j)
        for i in alone
        for j in alone
        if i < j and _may_join(alone[i], alone[j], config)
    )
    group = {k: [k] for k in alone}
    for _, i, j in pairs:
        a, b = group[i], group[j]
        one, other = (one_of([bodies[k] for k in members]) for members in (a, b))
        if a is not b and _may_join(one, other, config):
            a += b
            for k in b:
                group[k] = a
    return [
        one_of([bodies[m] for m in sorted(members)])
        for k, members in group.items()
        if k == min(members)
    ]


def are_people(joined: Sequence[One], config: Joining) -> list[bool]:
    """Which are likely enough, and are not what a likelier person already is."""

    def is_same(one: One, other: One) -> bool:
        away = math.dist(one.xy, other.xy)
        if away < config.apart:
            return True
        return (
            not one.robots & other.robots
            and away < config.fragment_distance
            and _squared(one, other) < config.fragment_gate**2
        )

    people = [False] * len(joined)
    for i in sorted(range(len(joined)), key=lambda i: -joined[i].score):
        others = [other for k, other in enumerate(joined) if people[k]]
        likely = joined[i].score >= config.min_score
        people[i] = likely and not any(is_same(joined[i], other) for other in others)
    return people
