"""The joining as it reads when each body is compared with each: what the fast one must equal."""

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.bodies.joining import Joined
from mrs_people_loc.team.fusion import BodiesOnMap

LEAST_SCORE = -2.0


def squared(offset, covariance) -> float:
    # Written as the core has it: where many pairs are equally far apart, rounding orders them.
    (x, y), ((xx, xy), (_, yy)) = offset, covariance
    return float((yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))


def place_of(members, bodies: BodiesOnMap):
    if len(members) == 1:
        return bodies.xy[members[0]], bodies.covariance[members[0]]
    information = sum(np.linalg.inv(bodies.covariance[k]) for k in members)
    covariance = np.linalg.inv(information)
    vector = sum(np.linalg.solve(bodies.covariance[k], bodies.xy[k]) for k in members)
    return covariance @ vector, covariance


def may_be_one(one, other, bodies: BodiesOnMap, config: cfg.Joining):
    """Squared distance in sigmas of two groups; None where they cannot be one."""
    if {bodies.robot[k] for k in one} & {bodies.robot[k] for k in other}:
        return None
    (a, of_a), (b, of_b) = (place_of(members, bodies) for members in (one, other))
    if not np.hypot(*(a - b)) < config.max_distance:
        return None
    distance = squared(a - b, of_a + of_b)
    return distance if distance < config.gate**2 else None


def groups_of(bodies: BodiesOnMap, used, config: cfg.Joining) -> list[list[int]]:
    """Members of each group, by their first ones."""
    group = {int(k): [int(k)] for k in np.flatnonzero(used)}
    pairs = []
    for i in group:
        for j in group:
            distance = may_be_one([i], [j], bodies, config) if i < j else None
            if distance is not None:
                pairs.append((distance, i, j))
    for _, i, j in sorted(pairs):
        a, b = group[i], group[j]
        if a is not b and may_be_one(a, b, bodies, config) is not None:
            a += b
            for k in b:
                group[k] = a
    return [sorted(members) for k, members in group.items() if k == min(members)]


def people_among(
    groups: list[list[int]], joined: Joined, bodies: BodiesOnMap, config: cfg.Joining
) -> list[bool]:
    def is_same(i, j) -> bool:
        offset = joined.xy[i] - joined.xy[j]
        if np.hypot(*offset) < config.apart:
            return True
        if {bodies.robot[k] for k in groups[i]} & {bodies.robot[k] for k in groups[j]}:
            return False
        within = np.hypot(*offset) < config.fragment_distance
        distance = squared(offset, joined.covariance[i] + joined.covariance[j])
        return within and distance < config.fragment_gate**2

    people = [False] * len(groups)
    for i in sorted(range(len(groups)), key=lambda i: -joined.score[i]):
        likely = joined.score[i] >= config.min_score
        people[i] = likely and not any(people[j] and is_same(i, j) for j in range(len(groups)))
    return people
