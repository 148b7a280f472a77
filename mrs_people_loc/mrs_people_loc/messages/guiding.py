"""Reads what the guide receives: people and tours."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence

import numpy as np

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.errors import PeopleError, TourError
from mrs_people_loc.guiding.tour import Tour, tour_from
from mrs_people_loc.messages.poses import MAX_COORDINATE_M, MAX_VARIANCE
from mrs_people_loc.messages.stamps import Message, read_stamp, stamp_ns_of
from mrs_people_loc.people import Group, Person

#: More people than a planner follows (`tracking.max_tracks`).
_MAX_PEOPLE = 10_000


def read_people(message: Message, map_frame: str) -> tuple[tuple[Person, ...], tuple[Group, ...]]:
    """Reads the people and groups of a mrs_people_msgs/People.

    People are in the planner's order, by id, those who are hidden with their `seen_at`. Recordings
    of before there were any have everybody in `persons`.

    Args:
        message: The message.
        map_frame: The frame that it must be in: the common one.

    Raises:
        PeopleError: The frame, a count or a value is wrong, or two people have one id.
        StampError: Its stamp is 0.
    """
    frame_id = message.header.frame_id.lstrip("/")
    if frame_id != map_frame:
        raise PeopleError(f"frame_id is {frame_id!r}; wanted: {map_frame!r}")
    stamp_ns = read_stamp(message)
    hidden = getattr(message, "hidden", ())
    for what, some in (
        ("persons", message.persons),
        ("hidden", hidden),
        ("groups", message.groups),
    ):
        if len(some) > _MAX_PEOPLE:
            raise PeopleError(f"{what} has {len(some)} entries; allowed: up to {_MAX_PEOPLE}")
    people = _persons([*message.persons, *(one.person for one in hidden)], stamp_ns)
    shown = len(message.persons)
    unseen = map(_unseen, people[shown:], hidden)
    everybody = sorted((*people[:shown], *unseen), key=lambda person: person.id)
    return tuple(everybody), _groups(message.groups)


def read_tour_goal(goal: Message, map_frame: str) -> Tour:
    """Reads the goal of a mrs_people_msgs/GuideTour.

    Args:
        goal: The goal.
        map_frame: The frame that its path must be in: the common one.

    Raises:
        TourError: It cannot be guided.
    """
    stops = [
        (str(stop.name), (stop.position.x, stop.position.y), _seconds(stop.wait))
        for stop in goal.stops
    ]
    points, speed = _points(goal.path, map_frame), float(goal.speed)
    return tour_from(points, stops, name=str(goal.name), speed=speed or None, frame=map_frame)


def read_tour_path(path: Message, map_frame: str) -> Tour:
    """Reads a nav_msgs/Path as a tour without stops.

    Args:
        path: The path; a pose without a frame is in the path's.
        map_frame: The frame that it must be in: the common one.

    Raises:
        TourError: It cannot be guided.
    """
    return tour_from(_points(path, map_frame), frame=map_frame)


def _points(path: Message, map_frame: str) -> list[tuple[float, float]]:
    of_path = path.header.frame_id
    frames = {of_path, *(pose.header.frame_id or of_path for pose in path.poses)}
    wrong = sorted(frame for frame in frames if frame.lstrip("/") != map_frame)
    if wrong:
        raise TourError(f"frame_id of the path is {wrong[0]!r}; wanted: {map_frame!r}")
    return [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]


def _persons(persons: Sequence[Message], stamp_ns: int) -> tuple[Person, ...]:
    position, covariance = _planar([one.pose for one in persons], "persons: pose")
    velocity, velocity_covariance = _moving([one.velocity for one in persons])
    ids = [int(one.id) for one in persons]
    counts = Counter(number for number in ids if number)
    for twice in [number for number, count in counts.items() if count > 1]:
        raise PeopleError(f"persons has two people with the id {twice}; wanted: each id once")
    return tuple(
        Person(
            position=position[k],
            covariance=covariance[k],
            height=float(one.height),
            sigma=float(one.sigma),
            robots=tuple(str(name) for name in one.robots),
            label=-1,
            stamp_ns=stamp_ns,
            id=ids[k],
            velocity=velocity[k],
            velocity_covariance=velocity_covariance[k],
            age_s=_seconds(one.age),
            coasting=bool(one.coasting),
        )
        for k, one in enumerate(persons)
    )


def _unseen(person: Person, message: Message) -> Person:
    """A person with when and where they were last seen, of a mrs_people_msgs/HiddenPerson."""
    seen_at = np.array([message.last_seen_at.x, message.last_seen_at.y], np.float64)
    if not (np.abs(seen_at) <= MAX_COORDINATE_M).all():
        raise PeopleError(
            f"hidden: last_seen_at is {seen_at.tolist()}; wanted: finite, within "
            f"{MAX_COORDINATE_M:g} m"
        )
    stamp_ns = min(stamp_ns_of(message.last_seen), person.stamp_ns)
    return dataclasses.replace(person, stamp_ns=stamp_ns, seen_at=seen_at)


def _groups(groups: Sequence[Message]) -> tuple[Group, ...]:
    centre, covariance = _planar([one.centre for one in groups], "groups: centre")
    velocity, velocity_covariance = _moving([one.velocity for one in groups])
    made = []
    for k, one in enumerate(groups):
        stragglers = [int(number) for number in one.stragglers]
        times_s = [_seconds(duration) for duration in one.straggling_for]
        if len(stragglers) != len(times_s):
            raise PeopleError(
                f"group {one.id} has {len(stragglers)} stragglers and {len(times_s)} times of "
                "straggling; wanted: as many of both"
            )
        made.append(
            Group(
                centre=centre[k],
                covariance=covariance[k],
                radius=float(one.radius),
                rms_spread=float(one.rms_spread),
                size=int(one.size),
                velocity=velocity[k],
                velocity_covariance=velocity_covariance[k],
                members=tuple(int(number) for number in one.members),
                id=int(one.id),
                stragglers=dict(zip(stragglers, times_s, strict=True)),
            )
        )
    return tuple(made)


def _planar(poses: Sequence[Message], what: str) -> tuple[Float, Float]:
    """Places [m], shape (n, 2), and their covariances [m^2], shape (n, 2, 2).

    Raises:
        PeopleError: A value is not finite or too large, or a covariance is none.
    """
    places = [(one.pose.position.x, one.pose.position.y) for one in poses]
    xy = np.array(places, np.float64).reshape(-1, 2)
    bad = ~(np.abs(xy) <= MAX_COORDINATE_M).all(axis=1)  # NaN compares false
    if bad.any():
        raise PeopleError(
            f"{what}: position is {xy[bad][0].tolist()}; wanted: finite, within "
            f"{MAX_COORDINATE_M:g} m"
        )
    covariance = _covariances([one.covariance for one in poses], what)
    bad = ~np.isfinite(covariance).all(axis=(1, 2)) | (covariance[:, (0, 1), (0, 1)] < 0).any(1)
    if bad.any():
        raise PeopleError(f"{what}: covariance is {covariance[bad][0].tolist()}; wanted: finite")
    return xy, covariance


def _moving(twists: Sequence[Message]) -> tuple[list[Float | None], list[Float | None]]:
    """Velocities [m/s] and their covariances [m^2/s^2]; None: unknown."""
    linear = [(one.twist.linear.x, one.twist.linear.y) for one in twists]
    velocity = np.array(linear, np.float64).reshape(-1, 2)
    known: Bool = np.asarray(np.isfinite(velocity).all(axis=1))
    bad = np.abs(velocity[known]) > MAX_COORDINATE_M
    if bad.any():
        raise PeopleError("velocity is too large; wanted: m/s, NaN where it is unknown")
    covariance = _covariances([one.covariance for one in twists], "velocity")
    sure = known & np.isfinite(covariance).all(axis=(1, 2))
    return (
        [velocity[k] if known[k] else None for k in range(len(twists))],
        [covariance[k] if sure[k] else None for k in range(len(twists))],
    )


def _covariances(values: Sequence[Sequence[float]], what: str) -> Float:
    """The planar parts of covariances of 36 values, shape (n, 2, 2)."""
    for one in values:
        if len(one) != 36:
            raise PeopleError(f"{what}: covariance has {len(one)} values; wanted: 36")
    every = np.array(values, np.float64).reshape(-1, 6, 6)[:, :2, :2]
    return np.asarray(np.clip(every, -MAX_VARIANCE, MAX_VARIANCE))  # NaN stays


def _seconds(duration: Message) -> float:
    return float(duration.sec) + float(duration.nanosec) / 1e9
