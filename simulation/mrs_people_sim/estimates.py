"""People that were found, by this process or as recorded, as they are scored and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.planner import People
from mrs_tools.bags.message_types import PEOPLE_TYPE
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.records import Estimate
from mrs_tools.bags.truth import MAX_PEOPLE

#: Identities that are scored at most.
MAX_IDS = 20_000


def estimate_of(people: People) -> Estimate:
    """The people of an interval, also who is hidden, as they are scored."""
    persons = people.everybody
    unknown = np.full(2, np.nan)
    velocities = [unknown if p.velocity is None else p.velocity for p in persons]
    return Estimate(
        stamp_ns=people.stamp_ns,
        positions=np.array([p.position for p in persons]).reshape(-1, 2),
        covariances=np.array([p.covariance for p in persons]).reshape(-1, 2, 2),
        centre=_centre([(group.size, group.centre) for group in people.groups]),
        largest=people.group.centre if people.group else None,
        ids=np.array([p.id for p in persons], dtype=np.int64),
        velocities=np.array(velocities).reshape(-1, 2),
        coasting=np.array([p.coasting for p in persons], dtype=bool),
        hidden=np.array([p.seen_at is not None for p in persons], dtype=bool),
        stragglers=tuple(sorted({one for group in people.groups for one in group.stragglers})),
    )


def read_estimate(message: Any) -> Estimate:
    """The people of a mrs_people_msgs/People, also who is hidden, as they are scored.

    Raises:
        ValueError: Two of them have one id, or they are more than are scored.
    """
    # Recordings of before there was `hidden` have everybody in `persons`.
    hidden = [one.person for one in getattr(message, "hidden", ())]
    persons = [*message.persons, *hidden]
    if len(persons) > MAX_PEOPLE:
        raise ValueError(f"has {len(persons)} people; allowed: {MAX_PEOPLE}")

    def place(pose: Any) -> tuple[float, float]:
        return pose.pose.position.x, pose.pose.position.y

    poses = [person.pose for person in persons]
    velocities = [person.velocity.twist.linear for person in persons]
    covariances = [np.reshape(pose.covariance, (6, 6))[:2, :2] for pose in poses]
    return Estimate(
        stamp_ns=stamp_ns_of(message.header.stamp),
        positions=np.array([place(pose) for pose in poses], dtype=np.float64).reshape(-1, 2),
        covariances=np.array(covariances, dtype=np.float64).reshape(-1, 2, 2),
        centre=_centre([(group.size, place(group.centre)) for group in message.groups]),
        largest=np.array(place(message.groups[0].centre)) if message.groups else None,
        ids=np.array([person.id for person in persons], dtype=np.int64),
        velocities=np.array([(v.x, v.y) for v in velocities], dtype=np.float64).reshape(-1, 2),
        coasting=np.array([person.coasting for person in persons], dtype=bool),
        hidden=np.repeat([False, True], [len(message.persons), len(hidden)]),
        stragglers=tuple(sorted({int(i) for group in message.groups for i in group.stragglers})),
    )


def _centre(groups: Sequence[tuple[int, Any]]) -> Float | None:
    """Centre of gravity of groups, given their sizes and centres; None if there are none."""
    if not any(size for size, _ in groups):
        return None
    sizes, centres = zip(*groups, strict=True)
    with np.errstate(over="ignore", invalid="ignore"):  # a message may say anything
        return np.asarray(np.average(np.array(centres, dtype=np.float64), axis=0, weights=sizes))


def has_people(bag: BagReader) -> bool:
    """Whether a planner's people are in a bag."""
    return any(topic.type == PEOPLE_TYPE and topic.count for topic in bag.topics.values())


def read_recorded(bag: BagReader) -> tuple[str, list[Estimate]]:
    """The people that a planner published when a bag was recorded.

    Returns:
        The topic, and the people of each of its messages.

    Raises:
        BagError: There is no such topic, or several; two people of a message have one id; or they
            are more than are scored.
    """
    topics = [t.name for t in bag.topics.values() if t.type == PEOPLE_TYPE and t.count]
    if len(topics) != 1:
        raise BagError(
            f"{bag.path}: has {len(topics)} topics of {PEOPLE_TYPE}; wanted: one "
            f"(topics: {', '.join(topics or bag.topics)})"
        )
    try:
        estimates = [read_estimate(message) for _, _, message in bag.decoded(topics)]
    except ValueError as err:
        raise BagError(f"{bag.path}: {topics[0]}: {err}") from err
    ids = len({int(one) for estimate in estimates for one in estimate.ids})
    if ids > MAX_IDS:
        raise BagError(f"{bag.path}: {topics[0]} has {ids} ids; allowed: {MAX_IDS}. Cut the bag")
    return topics[0], estimates
