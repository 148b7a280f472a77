"""People that were found, by this process or as recorded, as they are scored and drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.people import Group, Person
from mrs_people_loc.planner import People
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.bags.truth import MAX_PEOPLE
from mrs_tools.scoring.records import Estimate


def estimate_of(people: People) -> Estimate:
    """The people of an interval, as they are scored."""
    persons = people.persons
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
        stragglers=tuple(sorted({one for group in people.groups for one in group.stragglers})),
    )


def read_estimate(message: Any) -> Estimate:
    """The people of a mrs_people_msgs/People, as they are scored.

    Raises:
        ValueError: Two of them have one id, or they are more than are scored.
    """
    if len(message.persons) > MAX_PEOPLE:
        raise ValueError(f"has {len(message.persons)} people; allowed: {MAX_PEOPLE}")

    def place(pose: Any) -> tuple[float, float]:
        return pose.pose.position.x, pose.pose.position.y

    persons = message.persons
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
        stragglers=tuple(sorted({int(i) for group in message.groups for i in group.stragglers})),
    )


def _centre(groups: Sequence[tuple[int, Any]]) -> Float | None:
    """Centre of gravity of groups, given their sizes and centres; None if there are none."""
    if not any(size for size, _ in groups):
        return None
    sizes, centres = zip(*groups, strict=True)
    with np.errstate(over="ignore", invalid="ignore"):  # a message may say anything
        return np.asarray(np.average(np.array(centres, dtype=np.float64), axis=0, weights=sizes))


def read_people(message: Any) -> tuple[tuple[Person, ...], tuple[Group, ...]]:
    """The people and groups of a mrs_people_msgs/People.

    Raises:
        ValueError: A group does not say of each straggler for how long.
    """
    for group in message.groups:
        if len(group.stragglers) != len(group.straggling_for):
            raise ValueError(
                f"group {group.id} has {len(group.stragglers)} stragglers and "
                f"{len(group.straggling_for)} times of straggling; wanted: as many"
            )
    stamp_ns = stamp_ns_of(message.header.stamp)
    persons = tuple(_person(person, stamp_ns) for person in message.persons)
    return persons, tuple(map(_group, message.groups))


def _person(message: Any, stamp_ns: int) -> Person:
    """A mrs_people_msgs/Person."""
    velocity, covariance = _velocity(message.velocity)
    return Person(
        *_place(message.pose),
        height=message.height,
        sigma=message.sigma,
        robots=tuple(message.robots),
        label=-1,
        stamp_ns=stamp_ns,
        id=message.id,
        velocity=velocity,
        velocity_covariance=covariance,
        age_s=seconds_of(message.age),
        coasting=message.coasting,
    )


def _group(message: Any) -> Group:
    """A mrs_people_msgs/Group."""
    velocity, covariance = _velocity(message.velocity)
    away_s = map(seconds_of, message.straggling_for)
    return Group(
        *_place(message.centre),
        radius=message.radius,
        rms_spread=message.rms_spread,
        size=message.size,
        velocity=velocity,
        velocity_covariance=covariance,
        members=tuple(message.members),
        id=message.id,
        stragglers=dict(zip(message.stragglers, away_s, strict=True)),
    )


def _place(pose: Any) -> tuple[Float, Float]:
    """Position [m], shape (2,), and covariance [m^2], shape (2, 2), of a PoseWithCovariance."""
    at = pose.pose.position
    return np.array([at.x, at.y]), np.reshape(pose.covariance, (6, 6))[:2, :2]


def _velocity(twist: Any) -> tuple[Float | None, Float | None]:
    """Velocity [m/s] and covariance of a TwistWithCovariance; None if it is NaN."""
    v = twist.twist.linear
    if math.isnan(v.x) or math.isnan(v.y):
        return None, None
    return np.array([v.x, v.y]), np.reshape(twist.covariance, (6, 6))[:2, :2]


def seconds_of(duration: Any) -> float:
    """A builtin_interfaces/Duration [s]."""
    return float(duration.sec + duration.nanosec * 1e-9)


PEOPLE_TYPE = "mrs_people_msgs/msg/People"
#: Identities that are scored at most.
MAX_IDS = 20_000


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
