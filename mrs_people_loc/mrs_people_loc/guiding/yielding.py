"""How the leader makes way for people who are not of the group: early, slowly, on the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.guiding.way import Way
from mrs_people_loc.people import Person


@dataclass(frozen=True)
class YieldTuning:
    """Constants of giving way; chosen.

    Attributes:
        ahead: People count who are ahead of the leader by no more than this [m], ...
        beside: ... and no farther from the way than this [m], now or ...
        soon_s: ... in this time [s].
        stops: The leader stands while somebody is nearer ahead than this [m]; it slows down from
            `ahead` on.
        stands: Who is slower than this stands [m/s]: the leader passes them ...
        passes: ... at this share of its speed.
        along: Who walks along the way faster than this is in nobody's way [m/s].
        right: The leader keeps so far to the right of the way, where it is free, while somebody
            comes [m].
    """

    ahead: float = 4.0
    beside: float = 1.1
    soon_s: float = 1.5
    stops: float = 1.5
    stands: float = 0.2
    passes: float = 0.5
    along: float = 0.2
    right: float = 0.5


YIELD_TUNING = YieldTuning()


@dataclass(frozen=True)
class Yielding:
    """How the leader makes way.

    Attributes:
        share: Of its speed; 0: it stands.
        right: How far to the right of the way it goes, where it is free [m].
    """

    share: float = 1.0
    right: float = 0.0


def yielding(
    others: Sequence[Person],
    way: Way,
    leader_m: float,
    tuning: YieldTuning = YIELD_TUNING,
) -> Yielding:
    """How the leader makes way for people who are not of the group.

    Args:
        others: Those who are followed, and not of the group.
        way: Of the tour.
        leader_m: How far along it the leader is [m].
        tuning: Constants.
    """
    if not others:
        return Yielding()
    still = np.zeros(2)
    xy = np.concatenate([person.position for person in others]).reshape(-1, 2)
    velocity = np.concatenate([still if p.velocity is None else p.velocity for p in others])
    velocity = velocity.reshape(-1, 2)
    speed = np.hypot(*velocity.T)
    # Whoever is farther away than this is neither ahead nor comes to the way soon.
    reach = tuning.ahead + 2.0 * tuning.beside + tuning.soon_s * speed
    near = np.hypot(*(xy - way.at(leader_m)).T) < reach
    xy, velocity, speed = xy[near], velocity[near], speed[near]
    ways = way.nearest(xy, leader_m, tuning.ahead)
    ahead = ways - leader_m
    along = (way.ahead(ways) * velocity).sum(axis=1)
    stands = speed < tuning.stands
    # Also who is beside the way now and on it in a moment.
    beside = np.min(
        [np.hypot(*(xy + velocity * s - way.at(ways)).T) for s in (0.0, tuning.soon_s)], axis=0
    )
    counts = (ahead > 0.0) & (ahead < tuning.ahead) & (beside < tuning.beside)
    counts &= (along < tuning.along) | stands
    if not counts.any():
        return Yielding()
    share = np.clip((ahead - tuning.stops) / (tuning.ahead - tuning.stops), 0.0, 1.0)
    share = np.where(stands, np.maximum(share, tuning.passes), share)[counts]
    return Yielding(float(share.min()), tuning.right * bool((~stands[counts]).any()))
