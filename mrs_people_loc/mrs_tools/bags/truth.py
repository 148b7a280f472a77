"""Ground truth of a bag: where the people truly are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError
from mrs_people_loc.messages import stamp_ns_of
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.records import Truth

TRUTH_TOPIC = "/ground_truth/people_poses"
VISIBLE_TOPIC = "/ground_truth/visible"
PERCENT_TOPIC = "/ground_truth/visible_percent"
GROUP_TOPIC = "/ground_truth/group"
#: std_msgs' arrays of whole numbers.
_INTEGER_ARRAYS = tuple(
    f"std_msgs/msg/{sign}Int{bits}MultiArray" for sign in ("", "U") for bits in (8, 16, 32, 64)
)
#: Bag time [ns] and array of each message.
_Numbers = list[tuple[int, NDArray[np.integer]]]
#: What is scored at most: people of one message, messages times people.
MAX_PEOPLE, MAX_PLACES = 1_000, 10_000_000


def true_pose_topic(robot: str) -> str:
    """Where a robot's true pose is."""
    return f"/ground_truth/{robot}/pose"


def read_truth(bag: BagReader) -> Truth:
    """Ground truth of a bag; without any messages where it has none.

    `/ground_truth/people_poses` is a PoseArray in `map`. `/ground_truth/visible`,
    `/ground_truth/visible_percent` and `/ground_truth/group` are any arrays of whole numbers of
    std_msgs, one number per person; 0: no robot sees that person, or the person belongs to no
    group. They have no stamps, so each message of the first belongs to those of the others that are
    nearest in bag time.

    Raises:
        BagError: A topic has another type, they do not fit together, or are more than are scored.
    """
    stamps: list[int] = []
    times: list[int] = []
    positions: list[Float] = []
    numbers: dict[str, _Numbers] = {VISIBLE_TOPIC: [], PERCENT_TOPIC: [], GROUP_TOPIC: []}
    topics = _topics(bag)
    for topic, time_ns, message in bag.decoded(topics) if topics else ():
        if topic != TRUTH_TOPIC:
            numbers[topic].append((time_ns, np.asarray(message.data)))
            continue
        if len(message.poses) > MAX_PEOPLE:
            raise BagError(
                f"{bag.path}: {topic} has {len(message.poses)} people; allowed: {MAX_PEOPLE}"
            )
        stamps.append(stamp_ns_of(message.header.stamp))
        times.append(time_ns)
        places = [(pose.position.x, pose.position.y) for pose in message.poses]
        positions.append(np.array(places, dtype=np.float64).reshape(-1, 2))
    most = max(map(len, positions), default=0)
    if len(positions) * most > MAX_PLACES:
        raise BagError(
            f"{bag.path}: {TRUTH_TOPIC} has {len(positions)} messages of up to {most} people; "
            f"allowed: {MAX_PLACES} places in all. Cut the bag"
        )
    sizes = [len(xy) for xy in positions]
    visible, percent, groups = (
        _nearest(bag, topic, numbers[topic], times, sizes)
        for topic in (VISIBLE_TOPIC, PERCENT_TOPIC, GROUP_TOPIC)
    )
    seen = None if visible is None else [each > 0 for each in visible]
    shares = None if percent is None else [each.astype(np.float64) / 100.0 for each in percent]
    return Truth.build(stamps, positions, seen, groups, shares)


def _topics(bag: BagReader) -> list[str]:
    """The topics of ground truth that a bag has.

    Raises:
        BagError: One has another type.
    """
    kinds = {
        TRUTH_TOPIC: ("geometry_msgs/msg/PoseArray",),
        VISIBLE_TOPIC: _INTEGER_ARRAYS,
        PERCENT_TOPIC: _INTEGER_ARRAYS,
        GROUP_TOPIC: _INTEGER_ARRAYS,
    }
    topics = [topic for topic in kinds if topic in bag.topics]
    for topic in topics:
        if bag.topics[topic].type not in kinds[topic]:
            raise BagError(
                f"{bag.path}: {topic} is {bag.topics[topic].type}; "
                f"allowed: {', '.join(kinds[topic])}"
            )
    return topics


def _nearest(
    bag: BagReader, topic: str, numbers: _Numbers, times: Sequence[int], sizes: Sequence[int]
) -> list[NDArray[np.integer]] | None:
    """The arrays of a topic that are nearest to some bag times; None: the topic is empty.

    Args:
        bag: The bag.
        topic: The topic.
        numbers: Bag time [ns] and array of each of its messages.
        times: Bag times [ns], shape (n,).
        sizes: Numbers of people at these times, shape (n,).

    Raises:
        BagError: An array has another number of elements than there are people.
    """
    if not numbers:
        return None
    given_ns = np.array([time_ns for time_ns, _ in numbers])
    found = [numbers[int(np.argmin(np.abs(given_ns - time_ns)))][1] for time_ns in times]
    for each, size in zip(found, sizes, strict=True):
        if len(each) != size:
            raise BagError(
                f"{bag.path}: {topic} has {len(each)} numbers for {size} people of "
                f"{TRUTH_TOPIC}; wanted: one per person"
            )
    return found
