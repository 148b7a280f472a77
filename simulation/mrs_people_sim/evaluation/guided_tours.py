"""Guided tours in a bag: what the guide said on `guide_status`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mrs_people_loc.errors import BagError
from mrs_people_loc.geometry import yaw_from_quaternion
from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_people_loc.messages import stamp_ns_of
from mrs_tools.bags.message_types import STATUS_TYPE
from mrs_tools.bags.reader import BagReader


def read_statuses(bag: BagReader) -> list[Guidance]:
    """What the guide said when a bag was recorded, by stamp; nothing where no guide ran.

    Raises:
        BagError: There are several topics, or a message cannot be used.
    """
    topics = [t.name for t in bag.topics.values() if t.type == STATUS_TYPE and t.count]
    if len(topics) > 1:
        raise BagError(
            f"{bag.path}: has {len(topics)} topics of {STATUS_TYPE}, {', '.join(topics)}; "
            "wanted: one at most"
        )
    try:
        decoded = bag.decoded(topics) if topics else ()
        statuses = [_status(message, time_ns) for _, time_ns, message in decoded]
    except ValueError as err:
        raise BagError(f"{bag.path}: {topics[0]}: {err}") from err
    return sorted(statuses, key=lambda status: status.stamp_ns)


def _status(message: Any, time_ns: int) -> Guidance:
    """A mrs_people_msgs/GuideStatus; its stamp is 0 as long as there were no people.

    Raises:
        ValueError: A state, role or place is none.
    """
    posts = [post for post in message.posts if not post.fault]
    return Guidance(
        stamp_ns=stamp_ns_of(message.header.stamp) or time_ns,
        state=State(message.state),
        reason=message.reason,
        stop=message.stop,
        way_m=float(message.way),
        length_m=float(message.length),
        speed=float(message.speed),
        people=tuple(map(int, message.people)),
        stragglers=tuple(map(int, message.stragglers)),
        lost=tuple(map(int, message.lost)),
        posts={post.robot: _post(post) for post in posts},
        faults={post.robot: post.fault for post in message.posts if post.fault},
    )


def _post(message: Any) -> Post:
    """A mrs_people_msgs/RobotPost."""
    at, turn = message.post.position, message.post.orientation
    if not (math.isfinite(at.x) and math.isfinite(at.y)):
        raise ValueError(f"post of {message.robot} is ({at.x}, {at.y}); wanted: finite")
    yaw = yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)
    return Post(Role(message.role), np.array([at.x, at.y]), yaw, math.nan)
